"""Benchmarks run at tiny sizes and say what they measured; nothing here asks how fast."""

import json
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import warp as wp
from typer.testing import CliRunner

from warpdeform.cli import app
from warpdeform.scene import Override, load_scene
from warpdeform.scene.measure import folds
from warpdeform.study.bench import kernels as kernel_bench
from warpdeform.study.bench import scaling as scaling_bench
from warpdeform.study.bench import step as step_bench
from warpdeform.study.bench import terms as term_bench
from warpdeform.study.bench.iterations import bench_iterations
from warpdeform.study.bench.kernels import bench_kernels
from warpdeform.study.bench.machine import core_for, describe, one_core, sentence
from warpdeform.study.bench.passes import PASSES, YARDSTICK, Sheet
from warpdeform.study.bench.solid_passes import SOLID_PASSES, Block
from warpdeform.study.bench.start import _COMPILED
from warpdeform.study.bench.step import SIZES, bench_step
from warpdeform.study.bench.stream import streams
from warpdeform.study.bench.table import Target, table, targets_lines, three_digits
from warpdeform.study.bench.threads import bench_threads
from warpdeform.study.bench.yardstick import FLUXES, WEIGHTS, yardstick

FEW = [each for each in PASSES if each.name in (YARDSTICK, "membrane flux", "membrane product")]


def bench(*arguments: str) -> dict[str, object]:
    """What `warpdeform bench ... --json` prints."""
    result = CliRunner().invoke(app, ["bench", *arguments, "--json"])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout)


@pytest.mark.parametrize("width", [1, 16])
def test_yardstick_is_the_flux_of_edges_and_shear(width: int) -> None:
    n, columns = 6, 2 * width + (8 if width == 1 else 16)
    rng = np.random.default_rng(1)
    r, p = rng.uniform(-1, 1, (2, 3, n + 2, columns))
    weights = rng.uniform(-1, 1, (WEIGHTS, n + 2, columns))
    k = 3.0

    def device(a: np.ndarray) -> wp.array:
        return wp.array(a, dtype=wp.float32, device="cpu")

    flux_u, flux_v = (device(np.full((FLUXES, n + 2, columns), np.nan)) for _ in range(2))
    inputs = [device(r), device(weights), wp.float32(k), device(p), flux_u, flux_v]
    groups = (columns - 2 * width) // width
    wp.launch(yardstick(width, wp.float32), dim=(n, groups), inputs=inputs, device="cpu")

    here, right = slice(width, columns - width), slice(width + 1, columns - width + 1)

    def edges(a: np.ndarray) -> tuple[np.ndarray, ...]:
        a00, a10, a01, a11 = a[:, 1:-1, here], a[:, 2:, here], a[:, 1:-1, right], a[:, 2:, right]
        return k * (a10 - a00), k * (a01 - a00), k / 2 * (a10 + a11 - a00 - a01), k / 2 * (a01 + a11 - a00 - a10)

    (e1, e2, m1, m2), (d1, d2, n1, n2) = edges(r), edges(p)
    w = weights[:, 1:-1, here]
    shear = w[2] * np.sum(m2 * n1 + m1 * n2, axis=0)
    for found, e, d, m, a in ((flux_u, e1, d1, m2, 0), (flux_v, e2, d2, m1, 1)):
        expected = np.concatenate([w[a] * np.sum(e * d, axis=0) * e + w[3 + a] * d, shear * m])
        np.testing.assert_allclose(found.numpy()[:, 1:-1, here], expected, rtol=2e-5, atol=2e-4)


def test_passes_leave_finite_numbers_in_every_array() -> None:
    sheet = Sheet(9, "float32", 1, wp.get_device("cpu"))
    for each in PASSES:
        for _ in range(3):
            each.launch(sheet)
    for values in (sheet.sum, sheet.blocks, sheet.z, sheet.flux_u, sheet.shell.scatter, sheet.state.partials):
        assert np.isfinite(values.numpy()).all()
        assert np.any(values.numpy())


def test_kernels_compare_lane_widths_and_the_yardstick() -> None:
    times = bench_kernels([9, 64], repeats=2, passes=FEW)
    assert [(t.nodes, t.width) for t in times.passes if t.name == YARDSTICK] == [(9, 16), (9, 1), (64, 16), (64, 1)]
    assert all(t.fastest_ns > 0 and t.median_ns >= t.fastest_ns for t in times.passes)
    assert all(t.over_yardstick == 1.0 for t in times.passes if t.name == YARDSTICK)
    assert all(t.over_wide == 1.0 for t in times.passes if t.width == 16)
    assert [t.name for t in times.targets] == ["membrane flux, 64 x 64", "membrane product, 64 x 64"]
    text = "\n".join(times.lines())
    assert "| membrane flux " in text
    assert "times the yardstick, median (limit 1.3)" in text


def test_kernels_say_what_they_move_and_compute() -> None:
    times = bench_kernels([32], repeats=1, passes=FEW)
    found = {(t.name, t.width): t.traffic for t in times.passes}
    assert all((traffic is None) == (width == 1) for (_, width), traffic in found.items())
    flux = found["membrane flux", 16]
    assert flux is not None
    assert (flux.bytes_per_node, flux.flops_per_node) == (100, 171)
    assert flux.working_set_mb == pytest.approx(100e-6 * 32 * 32)
    time = next(t for t in times.passes if t.name == "membrane flux" and t.width == 16)
    assert flux.gb_per_s == pytest.approx(100 / time.fastest_ns)
    assert flux.gflop_per_s == pytest.approx(171 / time.fastest_ns)
    assert flux.share == pytest.approx(flux.gb_per_s / flux.stream_gb_per_s)
    assert any(line.startswith("| membrane flux    |        100 |        171 |") for line in times.lines())


@pytest.mark.parametrize(("width", "threads"), [(1, 12), (1, 1), (16, 1)])
def test_streams_go_through_every_entry(width: int, threads: int) -> None:
    rows, nodes, vectors = 3, 16 if width == 16 else 12, 2
    rng = np.random.default_rng(2)
    a, b = rng.uniform(-1, 1, (2, 3 * vectors, rows + 2, nodes + 2 * width)).astype(np.float32)
    out = wp.array(np.full_like(a, np.nan), dtype=wp.float32, device="cpu")
    given = [wp.array(values, dtype=wp.float32, device="cpu") for values in (a, b)]
    kernels, inside = streams(width, wp.float32), np.s_[:, 1:-1, width:-width]
    for kernel, arrays, expected in ((kernels.copy, given[:1], a), (kernels.triad, given, a + np.float32(0.5) * b)):
        wp.launch(kernel, dim=(vectors, rows, threads), inputs=[*arrays, threads], outputs=[out], device="cpu")
        np.testing.assert_allclose(out.numpy()[inside], expected[inside], rtol=1e-6)
        assert np.isnan(out.numpy()[:, 0]).all()
        out.fill_(np.nan)


def test_kernels_of_solids_are_timed_and_counted() -> None:
    few = [each for each in SOLID_PASSES if each.name in (YARDSTICK, "boxes product", "gather")]
    times = bench_kernels([17], repeats=1, solid=True, passes=few)
    assert [(t.name, t.nodes, t.width) for t in times.passes[:3]] == [
        (YARDSTICK, 17, 16), ("boxes product", 17, 16), ("gather", 17, 16),
    ]  # fmt: skip
    product, gather = (next(t for t in times.passes if t.name == name).traffic for name in ("boxes product", "gather"))
    assert product is not None
    assert gather is not None
    # A node of 17 to a row has nearly two places of the lanes; rows between the planes count too.
    places = 2 * 16 / 17 * (18 * 17 - 1) / 17**2
    assert gather.bytes_per_node == pytest.approx(4 * (21 + 2 * 3) * places, rel=0.01)
    assert product.bytes_per_node == pytest.approx(4 * (3 + 3 + 1 + 6 + 21 + 21 + 2 * 3) * places, rel=0.01)
    assert "17 x 17 x 17 nodes, float32" in "\n".join(times.lines())


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_passes_of_solids_leave_finite_numbers_in_every_array(precision: str) -> None:
    block = Block(5, precision, 1, wp.get_device("cpu"))
    for each in SOLID_PASSES:
        for _ in range(2):
            each.launch(block)
    for values in (block.sum, block.blocks, block.partials, block.chart.flux, block.guarded.hardness):
        assert np.isfinite(values.numpy()).all()
        assert np.any(values.numpy())


def test_kernels_as_json(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_bench, "PASSES", FEW)
    found = bench("kernels", "--sizes", "9", "--repeats", "1", "--precision", "float64")
    assert found["precision"] == "float64"
    assert {p["width"] for p in found["passes"]} == {8, 1}
    assert {p["name"] for p in found["passes"]} == {each.name for each in FEW}
    assert found["targets"] == []


def test_step_as_json() -> None:
    found = bench("step", "--sizes", "9", "--newton", "1", "--repeats", "1", "--set", "scene.duration=0.1")
    (run,) = found["runs"]
    assert (run["nodes"], run["newton"], run["steps"]) == (9, 1, 6)
    assert run["newton_iterations"] == 6
    assert run["cg_iterations"] > 6
    assert run["median"] > 0
    assert run["bytes_per_node"] > 0
    assert found["core"] is None or found["core"] in os.sched_getaffinity(0)
    assert run["ms_per_step"] == pytest.approx(1e3 * run["median"] * run["sim_s"] / run["steps"])
    assert run["share_of_copy"] == pytest.approx(run["gb_per_s"] / found["copy_gb_per_s"])


def test_step_chooses_sizes_for_the_device(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_bench, "SIZES", {"cpu": (9, 10), "cuda": ()})
    found = bench("step", "--newton", "1", "--repeats", "1", "--set", "scene.duration=0.02")
    assert [run["nodes"] for run in found["runs"]] == [9, 10]
    assert max(SIZES["cuda"]) == 2048


def test_step_without_countable_kernels_has_no_share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(step_bench, "run_traffic", lambda scene, steps: None)
    times = bench_step([9], newton=[1], repeats=1, overrides=[Override("scene.duration", 0.02)])
    assert times.runs[0].gb_per_s is None
    (row,) = [line for line in times.lines() if line.startswith("| 9 x 9 |")]
    assert row.endswith("|    - |             - |")


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="no CUDA device")
def test_step_on_a_gpu() -> None:
    found = bench("step", "--device", "cuda:0", "--sizes", "64", "--repeats", "1", "--set", "scene.duration=0.1")
    assert found["core"] is None
    assert all(0 < run["share_of_copy"] < 1 for run in found["runs"])


def test_scaling_as_json(tmp_path: Path) -> None:
    picture = tmp_path / "scaling.png"
    options = ("--duration", "0.05", "--set", "solver.newton_iterations=1", "--picture", str(picture))
    found = bench("scaling", "--sizes", "9,64", *options)
    small, reference = found["sizes"]
    assert (small["side"], small["nodes"], small["steps"]) == (9, 81, 3)
    assert small["newton_per_step"] == 1
    assert small["cg_per_step"] > 1
    assert reference["growth"] == 1
    ratio = small["ns_per_node_per_step"] / reference["ns_per_node_per_step"]
    assert small["growth"] == pytest.approx(ratio)
    assert small["ns_per_node_per_step"] == pytest.approx(1e9 * small["median"] * 0.05 / (81 * 3))
    assert small["bytes_per_node"] > reference["bytes_per_node"] > 0
    assert found["targets"] == []
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_scaling_as_a_table(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling_bench, "LARGEST", 9)
    monkeypatch.setattr(scaling_bench, "REFERENCE", 10)
    monkeypatch.setattr(scaling_bench, "LEAST_S", 0.0)
    result = CliRunner().invoke(app, ["bench", "scaling", "--sizes", "10,9", "--duration", "0.05"])
    assert result.exit_code == 0, result.output
    assert "hanging, float32, cpu" in result.stdout
    assert "| 10 x 10 |    1 |     3 |" in result.stdout
    assert "times the cost per node and step (limit 1.5)" in result.stdout


def test_step_as_a_table() -> None:
    result = CliRunner().invoke(
        app, ["bench", "step", "--sizes", "32", "--newton", "0", "--repeats", "1", "--set", "scene.duration=0.05"]
    )
    assert result.exit_code == 0, result.output
    assert "| 32 x 32 |    to tolerance |" in result.stdout
    assert "bytes per node (limit 1000)" in result.stdout


def test_terms_add_to_their_body_and_absent_ones_cost_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    sheet, *_ = families = term_bench.families(9)
    few = replace(sheet, terms={name: sheet.terms[name] for name in ("gravity", "drag")})
    monkeypatch.setattr(term_bench, "families", lambda side: (few,))
    assert [family.name.split()[0] for family in families] == ["sheet", "tube", "2", "block"]
    costs = term_bench.bench_terms(9, repeats=1, steps=1, compile_=False)
    alone, gravity, drag = costs.families[few.name]
    assert alone.ns_per_node_per_step > 0
    assert gravity.bytes_per_node < 1.0 < drag.bytes_per_node < alone.bytes_per_node
    assert any(line.startswith("| + gravity ") for line in costs.lines())


def test_every_family_of_terms_is_a_scene() -> None:
    for family in term_bench.families(9):
        for own in ({}, *family.terms.values()):
            load_scene(term_bench.SCENE, {**term_bench.SOLVER, **family.values, **own})


@pytest.mark.slow
def test_terms_say_what_they_compile(monkeypatch: pytest.MonkeyPatch) -> None:
    sheet = term_bench.families(9)[0]
    few = replace(sheet, terms={"gravity": sheet.terms["gravity"], "bending": sheet.terms["bending"]})
    monkeypatch.setattr(term_bench, "families", lambda side: (few,))
    alone, gravity, bending = term_bench.bench_terms(9, repeats=1, steps=1).families[few.name]
    assert not any("bending" in name or "gravity" in name for name in alone.compiled)
    assert [name for name in gravity.compiled if "gravity" not in name] == []
    assert any("bending" in name for name in bending.compiled)


@pytest.mark.slow
def test_start_as_json() -> None:
    found = bench("start", "--repeats", "1")
    assert [len(found[kind]) for kind in ("help", "cold", "warm")] == [1, 1, 1]
    cold, warm = found["cold"][0], found["warm"][0]
    assert any(name.startswith("warpdeform_surface") for name in cold["compiled"])
    assert warm["compiled"] == {}
    assert list(cold["phases"]) == list(warm["phases"])
    assert {t["limit"] for t in found["targets"]} == {0.5, 2.0, 30.0}


def test_lines_about_modules_are_understood() -> None:
    said = (
        "Module a_float32_16 1022771 load on device 'cpu' took 9768.46 ms  (compiled)\n"
        "Module b_float32_16 5964ef1 load on device 'cpu' took 7.20 ms  (cached)\n"
    )
    assert _COMPILED.findall(said) == [("a_float32_16", "9768.46")]


@pytest.mark.parametrize(
    ("arguments", "mistake"),
    [
        (["kernels", "--sizes", "1"], "--sizes = 1: must be whole numbers of at least 2"),
        (["kernels", "--sizes", "64,x"], "--sizes = 64,x"),
        (["kernels", "--precision", "half"], "--precision = half: is not a precision"),
        (["kernels", "--device", "tpu"], "device = tpu: does not exist"),
        (["step", "--newton", "-1"], "--newton = -1"),
        (["step", "--scene", "nowhere"], "nowhere"),
        (["step", "--set", "solver.device=cuda:0"], "--set solver.device = cuda:0: is set by the benchmark"),
        (["scaling", "--sizes", "9", "--scene", "nowhere"], "nowhere"),
        (["scaling", "--sizes", "9", "--duration", "-1"], "scene.duration"),
        (["scaling", "--picture", "s.txt"], "--picture = s.txt: is no kind of picture"),
        (["scaling", "--picture", "nowhere/s.png"], "lies in a folder that does not exist"),
        (["start", "--scene", "nowhere"], "nowhere"),
    ],
)
def test_bad_options_are_refused(arguments: list[str], mistake: str) -> None:
    result = CliRunner().invoke(app, ["bench", *arguments])
    assert result.exit_code == 2, result.output
    assert mistake in result.output.replace("'", "").replace('"', "")


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="the system does not let a process choose its core")
def test_one_core_is_given_back() -> None:
    before = os.sched_getaffinity(0)
    with one_core() as core:
        assert os.sched_getaffinity(0) == {core}
    assert os.sched_getaffinity(0) == before


def test_machine_is_described() -> None:
    machine = describe()
    assert machine["cores"] >= 1
    assert machine["warp"] in sentence(machine)


def test_tables_align() -> None:
    lines = table(["pass", "ns"], [["a long name", "1.25"], ["b", "10.50"]])
    assert lines == [
        "| pass        |    ns |",
        "|-------------|------:|",
        "| a long name |  1.25 |",
        "| b           | 10.50 |",
    ]


def test_numbers_have_three_digits_and_no_exponent() -> None:
    assert [three_digits(x) for x in (0.01234, 1.0, 999.4, 999.6, 12345.6)] == ["0.0123", "1", "999", "1000", "12346"]


def test_targets_say_whether_they_are_met() -> None:
    assert targets_lines([Target("x", "s", 0.4, 0.5), Target("y", "s", 0.6, 0.5)]) == [
        "met   x: 0.4 s (limit 0.5)",
        "MISS  y: 0.6 s (limit 0.5)",
    ]


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="the system does not let a process choose its core")
def test_a_gpu_keeps_all_cores() -> None:
    before = os.sched_getaffinity(0)
    with core_for(SimpleNamespace(is_cuda=True), min(before)) as core:
        assert core is None
        assert os.sched_getaffinity(0) == before
    with core_for(SimpleNamespace(is_cuda=False), max(before)) as core:
        assert os.sched_getaffinity(0) == {max(before)} == {core}


def test_iterations_are_counted_until_a_sheet_folds() -> None:
    found = bench_iterations((9,), scenes=("carpet", "hanging"), steps=3)
    assert [run.scene for run in found.runs] == ["carpet"] + 6 * ["hanging"]
    assert found.runs[0].nodes == (9, 7)
    assert {run.stretching for run in found.runs[1:]} == {1e2, 1e3, 1e5}
    assert all(run.steps == 3 and 1 <= run.mean <= run.most <= 40 for run in found.runs)
    assert any("hanging" in line for line in found.lines())
    flat = np.zeros((3, 3, 3))
    flat[..., 0], flat[..., 1] = np.meshgrid(np.arange(3.0), np.arange(3.0), indexing="ij")
    assert folds(flat) == pytest.approx(0.0, abs=1e-3)
    bent = flat.copy()
    bent[2] = bent[1] + [0.0, 0.0, 1.0] * np.ones((3, 1))
    assert folds(bent) == pytest.approx(90.0)


def test_threads_are_timed_beside_one() -> None:
    found = bench_threads((24,), (2,), steps=2, repeats=2)
    assert [run.threads for run in found.runs] == [1, 2]
    assert all(run.same and run.fastest_ms > 0 for run in found.runs)
    assert found.runs[0].gain == 1.0
    assert any("24 x 24" in line for line in found.lines())
