"""Steps shared by threads: the same bits as from one, whatever a scene has."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpdeform as wd
from warpdeform import launching, team
from warpdeform.grid import Layout
from warpdeform.launching import PerRow, Whole, do_alone, launch_lanes, launch_rows, repeat_while
from warpdeform.team import Team, choose_threads

Array = np.ndarray[Any, Any]
CPU = wp.get_device("cpu")
ROOT = Path(launching.__file__).parent


@pytest.fixture(autouse=True)
def small_grids_are_shared(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launching, "SHARED_FROM", 0)


def falling_sheet(threads: int, preconditioner: str, precision: str, lane_width: int | None = None) -> wd.Simulation:
    """Everything that launches: multigrid, bending, contact with friction, gusts, springs, drag, led pins."""
    sheet = wd.Body(
        "sheet",
        wd.sheet((13, 18), (0.6, 0.5)),
        wd.Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-4),
        position=(-0.3, -0.25, 0.36),
        pins=(wd.Pin("corner:0,0", wd.Track((0.0, 1.0), ((0.0, 0.0, 0.0), (0.1, 0.0, 0.2)))),),
        springs=(wd.Spring("corner:1,1", 3.0),),
        drag=0.1,
    )
    ball = wd.Obstacle("sphere", {"radius": 0.3}, friction=0.4)
    log = wd.Obstacle("torus", {"radius": 0.3, "tube_radius": 0.05}, track=wd.Track.fixed((0.1, 0.0, 0.2)))
    settings = wd.Settings(
        newton_iterations=2, preconditioner=preconditioner, precision=precision, device="cpu", threads=threads
    )
    wind = wd.Wind((2.0, 1.0, 0.0), gust=0.4)
    return wd.Simulation([sheet], obstacles=[ball, log], wind=wind, settings=settings, lane_width=lane_width)


def trajectory(simulation: wd.Simulation, steps: int = 12) -> Array:
    for _ in range(steps):
        simulation.step()
    return np.stack([simulation["sheet"].positions(), simulation["sheet"].velocities()])


@pytest.mark.parametrize(
    ("preconditioner", "precision", "lane_width"),
    [("multigrid", "float32", None), ("cheapest", "float64", None), ("block-jacobi", "float64", 1)],
)
def test_threads_do_not_change_a_bit(preconditioner: str, precision: str, lane_width: int | None) -> None:
    alone = trajectory(falling_sheet(1, preconditioner, precision, lane_width))
    for threads in (2, 3):
        shared = falling_sheet(threads, preconditioner, precision, lane_width)
        assert shared.threads == threads
        np.testing.assert_array_equal(trajectory(shared), alone)


@pytest.mark.parametrize("shape", [wd.tube((12, 18), 0.3, 0.6), wd.sphere((12, 18), 0.3)], ids=["tube", "ball"])
def test_threads_do_not_change_a_bit_of_closed_bodies(shape: wd.RestShape) -> None:
    material = wd.Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-3)
    growth = wd.Growth([0.0, 0.1], [1.0, 0.8])
    body = wd.Body("sheet", shape, material, pressure=20.0, growth=growth, pins=(wd.Pin([[0, 0]]),))
    settings = wd.Settings(device="cpu", preconditioner="multigrid", precision="float64", newton_iterations=2)
    alone, *shared = (
        trajectory(wd.Simulation([body], wind=wd.Wind((2.0, 1.0, 0.0)), settings=replace(settings, threads=threads)), 8)
        for threads in (1, 2, 3)
    )
    for found in shared:
        np.testing.assert_array_equal(found, alone)


def test_two_teams_run_in_one_process() -> None:
    first, second = (falling_sheet(2, "multigrid", "float32") for _ in range(2))
    for _ in range(6):
        first.step()
        second.step()
    np.testing.assert_array_equal(first["sheet"].positions(), second["sheet"].positions())
    first.reset()
    np.testing.assert_array_equal(trajectory(first, 6)[0], second["sheet"].positions())


@pytest.fixture
def layout() -> Layout:
    return Layout((7, 5), 8)


def kernels() -> Any:
    from warpdeform.kernels.krylov import krylov, reductions

    return krylov(8, wp.float64), reductions()


@pytest.mark.parametrize("threads", [1, 2, 3, 9])
def test_every_row_is_written_once_and_loops_are_left_together(layout: Layout, threads: int) -> None:
    lanes, sums = kernels()
    ones = wp.array(layout.pack(np.ones((7, 5, 3))), dtype=wp.float64, device=CPU)
    total, partials, rows = wp.zeros_like(ones), wp.zeros(ones.shape[1:], dtype=wp.float64, device=CPU), None
    rows = wp.zeros((2, 7), dtype=wp.float64, device=CPU)
    turns = wp.zeros(1, dtype=wp.int32, device=CPU)
    alpha = wp.zeros(8, dtype=wp.float64, device=CPU)
    alpha[0:1].fill_(1.0)

    def turn() -> None:
        launch_lanes(lanes.advance, layout, alpha, ones, ones, total, Whole(spare), device=CPU)
        launch_lanes(lanes.dot, layout, total, ones, partials, device=CPU)
        launch_rows(sums.sum_rows, layout, partials, 8, PerRow(rows), device=CPU)
        do_alone(lambda: wp.launch(count_down, dim=1, inputs=[turns], device=CPU))

    @wp.kernel(enable_backward=False)
    def count_down(turns_out: wp.array(dtype=wp.int32)) -> None:  # type: ignore[valid-type]
        turns_out[0] = turns_out[0] - 1

    spare = wp.zeros_like(ones)
    team = Team(threads, CPU)
    turns.fill_(1)
    turn()  # loads the kernels
    turns.fill_(5)
    total.zero_()
    team.record(lambda: repeat_while(turns, turn))
    team.replay()
    np.testing.assert_array_equal(layout.unpack(total.numpy()), 5.0)
    np.testing.assert_array_equal(rows.numpy()[0], 5.0 * 3 * 5)
    turns.fill_(2)
    team.replay()
    np.testing.assert_array_equal(layout.unpack(total.numpy()), 7.0)


def test_threads_are_chosen_by_size_unless_asked() -> None:
    assert choose_threads(3, 10, CPU) == 3
    assert choose_threads(0, 10, CPU) == 1
    assert 1 <= choose_threads(0, 10**6, CPU) <= team.MOST_THREADS


def test_steps_launch_by_nothing_else() -> None:
    """A launch that is not shared would run once in every thread."""
    direct = re.compile(r"wp\.(launch|capture_while|capture_if|copy)\(")
    found = []
    for folder in ("forces", "linear", "integrators"):
        for file in sorted((ROOT / folder).glob("*.py")):
            for line in file.read_text().splitlines():
                allowed = ("do_alone", "_flush", "decisions(), name")
                if direct.search(line) and not any(word in line for word in allowed):
                    found.append(f"{file.name}: {line.strip()}")
    assert not found


@pytest.mark.parametrize("threads", [1, 2])
def test_bands_do_not_change_a_bit(threads: int, monkeypatch: pytest.MonkeyPatch) -> None:
    def swing() -> Array:
        sheet = wd.Body("sheet", wd.sheet((90, 9)), wd.Material.preset("cotton"), pins=(wd.Pin("edge:u,0"),))
        settings = wd.Settings(device="cpu", threads=threads, preconditioner="multigrid")
        return trajectory(wd.Simulation([sheet], settings=settings), 4)

    monkeypatch.setattr(launching, "BAND_BYTES", 10**9)
    whole = swing()
    entered = []
    rows = launching._rows
    monkeypatch.setattr(launching, "_rows", lambda band: (entered.append(band), rows(band))[1])
    for band_bytes in (1, 12 * (9 + 4) * 3 * 16 * 4):
        monkeypatch.setattr(launching, "BAND_BYTES", band_bytes)
        np.testing.assert_array_equal(swing(), whole)
    assert {band.high - band.low for band in entered} >= {8, 12}
