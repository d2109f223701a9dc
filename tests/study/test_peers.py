"""The peers' bench: errors against known distances, laws against finite differences, adapters at tiny size."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from warpdeform.cli import app
from warpdeform.errors import InputError, WarpdeformError
from warpdeform.scene import load_scene
from warpdeform.study.errors import block_averaged, rms
from warpdeform.study.peers import bench as bench_module
from warpdeform.study.peers import laws, processes
from warpdeform.study.peers.bench import Effort, bench_peers
from warpdeform.study.peers.engine import Engine, Setting
from warpdeform.study.peers.engines import ENGINES, find_engines
from warpdeform.study.peers.picture import draw_peers
from warpdeform.study.peers.processes import default_cache, find_reference, last_json, reference_key
from warpdeform.study.peers.records import OURS, EngineFacts, PeerRun, fastest, front, targets, with_gains
from warpdeform.study.peers.report import peers_lines
from warpdeform.study.peers.sheet import CHECKED, FPS, FRAMES, Array, Sheet, longest_stretch
from warpdeform.study.peers.worker import Answer, Job, work

SHEET = Sheet(7)


def crumpled(seed: int = 3) -> Array:
    """The sheet with every node moved by up to a tenth of the spacing."""
    rng = np.random.default_rng(seed)
    return SHEET.positions() + 0.1 * SHEET.spacing * rng.uniform(-1, 1, (7, 7, 3))


def run_of(engine: str, cpu: float, error: float, nodes: int = 64, **more: object) -> PeerRun:
    """A run with an error."""
    run = PeerRun(engine, "1", nodes, f"setting {cpu:g}", {}, False, cpu, block_own_m=(0.1 * error, error))
    return replace(run, **more)


def test_the_sheet_is_the_scenes() -> None:
    built = load_scene("hanging", {"body.0.nodes": [7, 7]})
    (body,) = built.bodies
    found = body.material
    assert found.areal_density == SHEET.areal_density
    assert found.membrane_stiffness == SHEET.membrane_stiffness
    assert found.poisson_ratio == SHEET.poisson_ratio
    assert found.bending_stiffness == SHEET.bending_stiffness
    assert built.settings.gravity == (0.0, 0.0, -SHEET.gravity)
    assert built.settings.fps == FPS


def test_masses_and_triangles_cover_the_sheet() -> None:
    assert SHEET.masses().sum() == pytest.approx(SHEET.areal_density * SHEET.side**2)
    a, b, c = SHEET.positions().reshape(-1, 3)[SHEET.triangles()].transpose(1, 0, 2)
    areas = 0.5 * np.cross(b - a, c - a)
    np.testing.assert_allclose(areas, np.tile([0, 0, SHEET.spacing**2 / 2], (len(areas), 1)), atol=1e-15)


def test_springs_pull_like_a_sheet_of_their_youngs_modulus() -> None:
    x = SHEET.positions()
    stretched = x * [1 + 1e-6, 1 - 1e-6 / 3, 1]  # Poisson ratio 1/3: no force across
    forces = laws.springs(SHEET.axis_spring, SHEET.diagonal_spring, SHEET.spacing)(stretched)
    assert forces[0, :, 0].sum() == pytest.approx(SHEET.membrane_stiffness * SHEET.side * 1e-6, rel=1e-5)
    np.testing.assert_allclose(forces[1:-1], 0, atol=1e-9)
    net = np.zeros((49, 3))
    flat = stretched.reshape(-1, 3)
    for i, j, stiffness in SHEET.springs():
        rest = np.linalg.norm(x.reshape(-1, 3)[j] - x.reshape(-1, 3)[i])
        between = flat[j] - flat[i]
        pull = stiffness * (1 - rest / np.linalg.norm(between)) * between
        net[i] += pull
        net[j] -= pull
    np.testing.assert_allclose(net.reshape(7, 7, 3), forces, atol=1e-12)


def neo_hookean_energy(x: Array) -> float:
    points, area = x.reshape(-1, 3)[SHEET.triangles()], SHEET.spacing**2 / 2
    rest = SHEET.positions().reshape(-1, 3)[SHEET.triangles()]
    frames = np.linalg.inv(np.stack([rest[:, 1] - rest[:, 0], rest[:, 2] - rest[:, 0]], -1)[:, :2])
    F = np.stack([points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]], -1) @ frames
    ratio = np.sqrt(np.linalg.det(F.transpose(0, 2, 1) @ F))
    mu, k = SHEET.shear_modulus, SHEET.shear_modulus + SHEET.first_lame
    return float(area * np.sum(mu / 2 * np.sum(F**2, axis=(1, 2)) + k / 2 * (ratio - 1 - mu / k) ** 2))


def hinge_energy(x: Array) -> float:
    total = 0.0
    for stiffness, corners in ((1.0, laws._along_v), (1.0, laws._along_u), (2.0, laws._across)):
        p, q, a, b = corners(x)
        n1, n2 = np.cross(a - p, b - p), np.cross(b - q, a - q)
        lengths = np.linalg.norm(n1, axis=-1) * np.linalg.norm(n2, axis=-1)
        total += stiffness * np.sum(np.arccos(np.sum(n1 * n2, axis=-1) / lengths) ** 2) / 2
    return float(total)


def quadratic_energy(x: Array) -> float:
    total = 0.0
    for stiffness, weight, corners in ((1.0, 1.0, laws._along_v), (1.0, 1.0, laws._along_u), (2.0, 2.0, laws._across)):
        p, q, a, b = corners(x)
        total += stiffness * 1.5 / SHEET.spacing**2 * np.sum((weight * (a + b - p - q)) ** 2)
    return float(total)


@pytest.mark.parametrize(
    ("forces", "energy"),
    [
        (
            laws.membrane(laws.neo_hookean(SHEET.first_lame, SHEET.shear_modulus), SHEET.spacing),
            neo_hookean_energy,
        ),
        (laws.hinges(1.0, 2.0), hinge_energy),
        (laws.quadratic_bending(1.0, 2.0, SHEET.spacing), quadratic_energy),
    ],
    ids=["neo-Hookean", "hinges", "quadratic bending"],
)
def test_forces_are_the_gradient_of_the_energy(forces: laws.Forces, energy: object) -> None:
    assert callable(energy)
    x, way = crumpled(), np.random.default_rng(4).normal(size=(7, 7, 3))
    step = 1e-7
    slope = (energy(x + step * way) - energy(x - step * way)) / (2 * step)
    assert -np.sum(forces(x) * way) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("true_gradient", [True, False])
def test_a_rolled_sheet_bends_back_with_the_plates_stiffness(true_gradient: bool) -> None:
    D, h, curvature = SHEET.bending_stiffness, SHEET.spacing, 0.01
    x = SHEET.positions()
    x[..., 2] = 0.5 * curvature * x[..., 0] ** 2
    stiffness = (D, D * np.sqrt(2.0)) if true_gradient else (D / h**2, D / h**2)
    quadratic = laws.quadratic_bending(D / 3, D / 3, h)(x)
    for forces in (laws.hinges(*stiffness, true_gradient=true_gradient)(x), quadratic):
        moment = -forces[0, :, 2].sum() * h  # the rim's couple: force on its first row times the spacing
        assert moment == pytest.approx(D * curvature * SHEET.side, rel=1e-3)


def test_threads_resist_stretch_and_shear() -> None:
    stress = laws.stretch_and_shear(1000.0, 400.0)
    first, second = stress(np.array([[1.01, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]]))
    np.testing.assert_allclose([first[0], second[0]], [[10.0, 0, 0], [0, 0, 0]], atol=1e-9)
    first, second = stress(np.array([[1.0, 0.0, 0.0]]), np.array([[1e-4, 1.0, 0.0]]))
    np.testing.assert_allclose([first[0, 1], second[0, 0]], [0.04, 0.04], rtol=1e-3)


def test_verlet_falls_freely() -> None:
    session = laws.Verlet(replace(SHEET, gravity=2.0), (), substeps=3)
    for _ in range(6):
        session.advance_frame()
    x = session.positions()
    assert x[3, 3, 2] == pytest.approx(-0.01, rel=1e-9)  # half g t^2 at 0.1 s, exact in the mean of each step
    assert x[0, 0, 2] == x[-1, 0, 2] == 0.0


def test_errors_of_a_shift_are_the_shift() -> None:
    x = SHEET.positions()
    shifted = x + [0.003, 0.0, -0.004]
    assert rms(shifted, x) == pytest.approx(0.005)
    assert block_averaged(shifted, x) == pytest.approx(0.005)


def test_block_averages_are_blind_to_folds_but_not_to_halves() -> None:
    x = Sheet(33).positions()
    folds = x.copy()
    folds[..., 2] += 0.01 * (-1.0) ** np.add.outer(np.arange(33), np.arange(33))
    assert rms(folds, x) == pytest.approx(0.01)
    assert block_averaged(folds, x) < 1e-4
    half = x.copy()
    half[17:, :, 2] += 0.01
    assert block_averaged(half, x) == pytest.approx(0.01 / np.sqrt(2), rel=0.15)


def test_longest_stretch_is_of_an_edge() -> None:
    x = SHEET.positions()
    x[0, 0, 0] -= 0.25 * SHEET.spacing
    assert longest_stretch(x, SHEET.spacing) == pytest.approx(1.25)


def test_answers_are_found_behind_what_engines_print() -> None:
    told = {"cpu_s_per_s": [2.0, 4.0, 3.0], "frames": 30, "max_stretch": 1.1, "lowest": -1.0}
    printed = f"Module x load took 3 ms\n{{not json\n{json.dumps(told)}\n"
    answer = Answer(**last_json(printed))
    assert (answer.median, answer.frames, answer.trouble) == (3.0, 30, "")
    for bad in ("", "nothing", "{half"):
        with pytest.raises(WarpdeformError, match="no answer"):
            last_json(bad)


def test_a_run_that_would_take_too_long_is_given_up() -> None:
    answer = work(Job("newton-vbd", 5, {"verlet_substeps": 4}, frames=1000, limit_s=1e-9))
    assert answer.frames == 1
    assert answer.trouble.startswith("over the limit")


def test_a_run_that_tears_says_when() -> None:
    answer = work(Job("newton-vbd", 9, {"verlet_substeps": 1}, frames=FRAMES))
    assert answer.trouble.startswith("blew up at 0.")


def test_a_failing_worker_is_told() -> None:
    with pytest.raises(WarpdeformError, match="nobody"):
        processes.run_worker(Job("nobody", 5, {}, frames=1))


def test_references_are_kept_and_keyed(tmp_path: Path) -> None:
    engine, said = installed("newton-vbd"), []
    first = find_reference(engine, 5, tmp_path, said.append, 60.0)
    told = len(said)
    again = find_reference(engine, 5, tmp_path, said.append, 60.0)
    assert first is not None
    assert again is not None
    assert told == len(said) == 2
    assert first.positions.shape == (2, 5, 5, 3)
    np.testing.assert_array_equal(first.positions, again.positions)
    assert 0 < first.block_m[0] <= first.rms_m[0] < 1e-3
    assert find_reference(engine, 6, tmp_path, said.append, 1e-9) is None


def test_a_references_key_is_of_the_setting_and_the_size() -> None:
    engine = ENGINES[OURS]
    fine, coarse = engine.references(9)
    keys = {reference_key(engine, 9, fine), reference_key(engine, 9, coarse), reference_key(engine, 10, fine)}
    assert len(keys) == 3
    assert reference_key(engine, 9, fine) in keys


def test_the_front_is_what_no_run_beats() -> None:
    runs = [run_of("a", 1.0, 0.04), run_of("b", 2.0, 0.03), run_of("c", 3.0, 0.035), run_of("d", 4.0, 0.001)]
    lost = [run_of("e", 0.1, 0.2), run_of("f", 0.1, 0.01, trouble="blew up"), PeerRun("g", "1", 64, "", {}, False, 0.1)]
    assert [run.engine for run in front(runs + lost)] == ["a", "b", "d"]
    assert fastest(runs + lost, 0.032) is runs[1]
    assert fastest(runs, 1e-9) is None


def test_gains_compare_at_no_greater_error() -> None:
    ours = [run_of(OURS, 0.1, 0.03), run_of(OURS, 0.5, 0.01), run_of(OURS, 0.01, 0.001, nodes=32)]
    peers = [run_of("a", 2.0, 0.03), run_of("b", 3.0, 0.02), run_of("c", 4.0, 0.009)]
    gains = [run.gain for run in with_gains(ours + peers)[3:]]
    assert gains == [pytest.approx(20.0), pytest.approx(6.0), None]
    found = list(targets(with_gains(ours + peers)))
    assert [t.name.split(" of ")[1] for t in found] == ["a, setting 2", "b, setting 3", "c, setting 4"]
    assert [t.met for t in found] == [True, False, False]
    assert [t.value for t in found] == [pytest.approx(1 / 20), pytest.approx(1 / 6), float("inf")]


def test_tables_name_engines_troubles_and_levels() -> None:
    facts = EngineFacts(OURS, "a law", "1.0", "", 12.0, 1.5, {64: (1e-6, 1e-5)}, {64: (1e-6, 1e-5)})
    missing = EngineFacts("gone", "none", "", "pip install gone")
    runs = with_gains(
        [run_of(OURS, 0.1, 0.004), run_of("a", 2.0, 0.006), run_of("b", 1.0, 0.1, trouble="blew up at 0.1 s")]
    )
    text = "\n".join(peers_lines([facts, missing], runs))
    assert "missing: gone (pip install gone)" in text
    assert "b, setting 1: blew up at 0.1 s" in text
    assert "  a, setting 2: 6 mm, 2 s per s, 20 times ours" in text
    assert (
        "fastest within 10 mm: ours, setting 0.1, 0.1 s per s; of the peers a, setting 2, 2 s per s: 20 times" in text
    )


def test_a_missing_engine_is_reported_and_the_rest_goes_on(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    class Gone(Engine):
        name, package, law = "gone", "no_such_engine", "none"

        def settings(self, nodes: int) -> tuple[Setting, ...]:
            raise AssertionError("a missing engine is not asked")

        references = prepare = settings  # type: ignore[assignment]

    class Brief(type(ENGINES[OURS])):  # type: ignore[misc]
        def settings(self, nodes: int) -> tuple[Setting, ...]:
            return super().settings(nodes)[:1]

    monkeypatch.setitem(ENGINES, "gone", Gone())
    monkeypatch.setitem(ENGINES, OURS, Brief())
    said: list[str] = []
    times = bench_peers(
        [5], engines=["gone"], effort=Effort(repeats=1, frames=1), cache=tmp_path, starts=False, said=said.append
    )
    assert "gone is missing: pip install no_such_engine" in said
    assert [(e.name, bool(e.version)) for e in times.engines] == [(OURS, True), ("gone", False)]
    (run,) = times.runs
    assert run.engine == OURS
    assert run.cpu_s_per_s > 0
    assert json.loads((tmp_path / "runs.jsonl").read_text())["setting"] == run.setting
    assert json.loads(json.dumps(times.as_dict()))["engines"][1]["install"] == "pip install no_such_engine"


def test_unknown_engines_are_refused() -> None:
    with pytest.raises(InputError, match="Use some of: ours, newton-vbd"):
        find_engines(["blender", OURS])
    result = CliRunner().invoke(app, ["bench", "peers", "--engines", "blender"])
    assert result.exit_code == 2


def test_a_failing_engine_is_a_trouble_and_not_the_end(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def fail(job: Job) -> None:
        raise WarpdeformError("ours: the worker ended with code 1")

    monkeypatch.setattr(bench_module, "run_worker", fail)
    times = bench_peers([5], engines=[OURS], effort=Effort(frames=1), cache=tmp_path, starts=False)
    assert {run.trouble for run in times.runs} == {"ours: the worker ended with code 1"}
    assert any("the worker ended" in line for line in times.lines())


def test_the_cache_has_a_platform_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert default_cache() == Path("/somewhere/warpdeform/peers")


def test_the_picture_is_drawn(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    runs = [run_of(OURS, 0.1, 0.03, example=True), run_of("a", 2.0, 0.006), run_of("a", 3.0, 0.005, nodes=32)]
    draw_peers(runs, tmp_path / "peers.png")
    assert (tmp_path / "peers.png").stat().st_size > 10_000
    with pytest.raises(InputError, match="has nothing to show"):
        draw_peers([run_of("a", 1.0, 0.1, trouble="blew up")], tmp_path / "none.png")


@pytest.mark.parametrize("name", list(ENGINES))
def test_every_engine_swings_the_sheet(name: str, tmp_path: Path) -> None:
    engine, nodes, file = installed(name), 5, str(tmp_path / "positions.npy")
    reference, *ends = [
        np.load(file)
        for setting in (engine.references(nodes)[0], *engine.settings(nodes)[:2])
        if not work(Job(name, nodes, setting.values, CHECKED[0], file=file)).trouble
    ]
    assert reference.shape == (1, nodes, nodes, 3)
    pins = Sheet(nodes).positions()[[0, -1], 0]
    np.testing.assert_allclose(reference[0, [0, -1], 0], pins, atol=1e-6)
    assert -0.35 < reference[0, ..., 2].min() < -0.25  # half g t^2 is 0.31 m
    assert min(block_averaged(x[0], reference[0]) for x in ends) < 0.06


@pytest.mark.parametrize(("name", "iterations"), [("newton-vbd", 5), ("newton-xpbd", 1)])
def test_single_precision_solvers_approach_their_laws(name: str, iterations: int, tmp_path: Path) -> None:
    engine, nodes, file = installed(name), 5, str(tmp_path / "positions.npy")
    fine, coarse = engine.references(nodes)
    values = [{"substeps": substeps, "iterations": iterations} for substeps in (20, 40)]
    ends = []
    for setting in (fine.values, coarse.values, *values):
        work(Job(name, nodes, setting, CHECKED[0], file=file))
        ends.append(np.load(file)[0])
    uncertainty, longer, shorter = (rms(end, ends[0]) for end in ends[1:])
    assert uncertainty < 1e-4
    assert shorter < 2e-3
    assert shorter < 0.6 * longer  # of first order in the step


def installed(name: str) -> Engine:
    """The engine of that name; skips where it is missing."""
    engine = ENGINES[name]
    if engine.missing:
        pytest.skip(f"{engine.package} is not installed: {engine.install}")
    return engine
