"""`study tradeoff`: its measures on runs whose errors are known, its front, and a small study from end to end."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from warpdeform.cli import app
from warpdeform.errors import InputError
from warpdeform.integrators import INTEGRATORS
from warpdeform.scene import Override
from warpdeform.settings import Settings
from warpdeform.study.errors import block_averaged, block_averages, rms
from warpdeform.study.files import StudyFiles
from warpdeform.study.tradeoff.course import Asked, Course, apart, observe
from warpdeform.study.tradeoff.estimates import study_estimates
from warpdeform.study.tradeoff.ladder import Setting, sweep
from warpdeform.study.tradeoff.records import Measured, cheapest, front
from warpdeform.study.tradeoff.reference import make_reference
from warpdeform.study.tradeoff.tradeoff import study_tradeoff

SMALL = (Override("body.0.nodes", [9, 9]), Override("scene.duration", 0.4), Override("scene.fps", 30.0))
SHEET = Asked("hanging", SMALL)


@pytest.mark.parametrize("nodes", [(9, 1), (17, 2), (9, 17), (5, 6, 7)])
def test_errors_of_a_shift_are_its_length_at_any_resolution(nodes: tuple[int, ...]) -> None:
    x = np.random.default_rng(0).normal(size=(*nodes, 3))
    connected = 1 if nodes[-1] == 1 else 3
    assert rms(x + [0.3, 0.0, 0.4], x) == pytest.approx(0.5)
    assert block_averaged(x + [0.3, 0.0, 0.4], x, connected) == pytest.approx(0.5)


def test_block_averages_of_what_is_linear_do_not_depend_on_the_grid() -> None:
    def plane(n: int) -> np.ndarray:
        u, v = np.meshgrid(np.linspace(0, 1, n), np.linspace(0, 1, 2 * n - 1), indexing="ij")
        return np.stack([u, v, 2.0 * u - v], axis=-1)

    inside = block_averages(plane(9))[1:-1, 1:-1], block_averages(plane(33))[1:-1, 1:-1]
    np.testing.assert_allclose(*inside, atol=1e-12)


def test_the_period_is_that_of_the_centre() -> None:
    course = Course()
    for frame in range(100):
        sway = np.cos(2 * np.pi * frame / 37.5)
        course.positions.append([np.ones((4, 4, 3)) * [1.0, 2.0 * sway, 0.0]])
    assert course.period() == pytest.approx(37.5, rel=1e-3)
    assert replace(course, positions=course.positions[:30]).period() is None


def test_the_front_holds_what_nothing_beats() -> None:
    runs = [Measured(n, {}, cpu_s_per_s=t, block=e) for n, t, e in
            [("fast", 1, 0.1), ("worse", 2, 0.11), ("good", 3, 0.01), ("better", 4, 1e-5), ("same", 5, 1e-6),
             ("wild", 0.5, 0.7)]]  # fmt: skip
    assert [run.name for run in front(runs, 1e-4)] == ["fast", "good", "better"]
    best = cheapest(runs, 0.02)
    assert best is not None
    assert best.name == "good"
    assert cheapest(runs, 1e-9) is None


def test_settings_have_names_of_their_own_and_all_methods_are_among_them() -> None:
    settings = Settings()
    ladder = list(sweep(48, 1.0))
    names = [setting.name(settings) for setting in ladder]
    assert "tr-bdf2, 4 a frame, Newton 2, CG 1e-02" in names
    assert "verlet, 96 a frame or more" in names
    assert {setting.over(settings)["integrator"] for setting in ladder} == set(INTEGRATORS)
    distinct = {(setting.name(settings), repr(setting.over(settings)), setting.grid) for setting in ladder}
    assert len(distinct) == len({name for name, _, _ in distinct}) == len(set(names))


def test_a_reference_knows_its_doubt_its_noise_and_its_horizon() -> None:
    reference = make_reference(SHEET)
    assert 1 <= reference.horizon <= 12
    assert reference.size == pytest.approx(1.0)
    assert reference.scale == pytest.approx(0.2 * 9.81)
    assert 0.0 < reference.floor.rms < 1e-4
    assert 0.0 < reference.halved.block < reference.uncertainty.block < 1e-2
    # A coarse step is off by more than the references are from each other.
    coarse = observe(SHEET.under(Setting({"integrator": "implicit-euler"})), reference.horizon)
    assert reference.error(coarse).block > 3.0 * reference.uncertainty.block
    with pytest.raises(InputError, match="--horizon"):
        make_reference(SHEET, horizon_s=2.0)


def test_grids_are_compared_where_they_have_nodes_in_common() -> None:
    scene = SHEET.under(Setting())
    fine, coarse = (SHEET.under(Setting({}, factor)) for factor in (1.0, 0.5))
    assert coarse.bodies[0].nodes == (5, 5)
    positions = [scene.bodies[0].placed_positions() for scene in (fine, coarse)]
    found = apart([positions[1]], [positions[0]], scene.bodies)
    assert found.rms == 0.0
    assert found.block < 1e-12
    assert np.isnan(apart([positions[0][:6]], [positions[0]], scene.bodies).rms)


def test_a_study_writes_rows_a_record_and_a_picture(tmp_path: Path) -> None:
    ladder = [
        Setting(),
        Setting({"integrator": "verlet", "substeps": 1}),
        Setting({"integrator": "tr-bdf2", "substeps": 2}),
        Setting({"integrator": "energy-momentum"}),  # cannot run a sheet that bends
    ]
    found = study_tradeoff(SHEET, StudyFiles(tmp_path, "small"), settings=ladder, knobs=False, repeats=1)
    with (tmp_path / "small.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["name"] for row in rows] == [run.name for run in found.runs]
    assert float(rows[1]["block"]) < float(rows[0]["block"])
    assert "bending" in rows[3]["trouble"]
    record = json.loads((tmp_path / "small.json").read_text(encoding="utf-8"))
    assert record["machine"]["cores"]
    assert set(record["front"]) <= {run.name for run in found.runs if not run.trouble}
    assert (tmp_path / "small.png").stat().st_size > 10_000
    text = "\n".join(found.lines())
    assert "noise floor" in text
    assert found.default in text


def test_a_target_below_what_can_be_told_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--target = 1e-12: is below what can be told"):
        study_tradeoff(SHEET, StudyFiles(tmp_path, "small"), target=1e-12, settings=[])


def test_estimates_are_of_the_size_of_errors(tmp_path: Path) -> None:
    found = study_estimates(["hanging"], StudyFiles(tmp_path, "estimates"), overrides=SMALL).found[0]
    assert found.doubt_m < 0.1 * found.largest_m
    assert 0.2 < found.estimate_m / found.largest_m < 10.0
    assert (tmp_path / "estimates.csv").read_text(encoding="utf-8").splitlines()[1].startswith("hanging,bdf2")


def test_the_command_refuses_what_it_cannot_write() -> None:
    ended = CliRunner().invoke(app, ["study", "tradeoff", "hanging", "--out", "/no/such/folder"])
    assert ended.exit_code == 2
    assert "is no folder" in ended.stderr
