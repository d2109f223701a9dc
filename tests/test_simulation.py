"""A simulation as a whole: it repeats to the bit, keeps its pins, conserves momentum, and says when it fails."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from bodies import (
    CLOTH,
    EVERYWHERE,
    PAPER_FPS,
    PRECISE,
    REAL_TIME,
    SEARCHING,
    assert_same_bits,
    busy,
    hanging,
    material_for,
    run,
)
from surfaces import MATERIALS, noise, stretched

from warpdeform.body import Body, Pin, Spring, rotate
from warpdeform.errors import InputError, SimulationFailure
from warpdeform.integrators import INTEGRATORS
from warpdeform.material import Material
from warpdeform.result import Outcome
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation
from warpdeform.track import Track
from warpdeform.wind import Wind

Array = np.ndarray[Any, Any]


@pytest.mark.parametrize("integrator", EVERYWHERE)
@pytest.mark.parametrize(("newton_iterations", "steps"), [(1, 12), (0, 3)], ids=["one iteration", "to tolerance"])
def test_replayed_steps_are_the_launched_ones_to_the_bit(integrator: str, newton_iterations: int, steps: int) -> None:
    fps = PAPER_FPS.get(integrator, 60.0)
    options: dict[str, Any] = {"integrator": integrator, "newton_iterations": newton_iterations, "fps": fps}
    steps = 2 if INTEGRATORS[integrator].explicit else steps
    replayed, launched = busy(**options), busy(captured=False, **options)
    assert_same_bits(run(replayed, steps), run(launched, steps))
    statistics = [replace(s.record(), wall_s=0.0, setup_s=0.0) for s in (replayed, launched)]
    assert statistics[0] == statistics[1]


def test_runs_repeat_to_the_bit_and_do_not_disturb_each_other() -> None:
    alone = run(busy(), 12)
    first, second = busy(), busy(gravity=(1.0, 0.0, 3.0), fps=90.0, integrator="implicit-euler")
    for _ in range(12):
        first.step()
        second.step()
    assert_same_bits(run(first, 0), alone)
    assert np.abs(second.bodies[0].positions() - alone[0]).max() > 0.01


def test_reset_starts_again_bit_for_bit() -> None:
    simulation = busy()
    start = run(simulation, 0)
    ten = run(simulation, 10)
    run(simulation, 5)
    simulation.reset()
    assert_same_bits(run(simulation, 0), start)
    assert (simulation.time, simulation.frame) == (0.0, 0)
    record = simulation.record()
    assert (record.newton_iterations, record.cg_iterations, record.frames, record.max_residual) == (0, 0, 1, 0.0)
    assert_same_bits(run(simulation, 10), ten)


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("start", ["placed", "crumpled"])
def test_pins_stay_to_the_last_bit(precision: str, start: str) -> None:
    pins = (Pin("corner:0,0"), Pin([[3, 7], [2, 16], [2, 15]]), Pin("edge:v,1,2"))
    initial = noise(sheet((6, 19)).positions, 0.3) + sheet((6, 19)).positions if start == "crumpled" else None
    body = hanging(pins=pins, initial_positions=initial, position=(0.123, 4.56, -0.789), wind_coefficient=1.0)
    simulation = Simulation([body], wind=Wind((5.0, 2.0, 1.0)), settings=replace(REAL_TIME, precision=precision))
    held = np.zeros((6, 19), dtype=bool)
    held[0, 0] = held[3, 7] = held[2, 16] = held[2, 15] = True
    held[:, 17:] = True
    before = simulation["sheet"].positions()
    np.testing.assert_array_equal(before, body.placed_positions().astype(precision))
    run(simulation, 15)
    after = simulation["sheet"].positions()
    np.testing.assert_array_equal(after[held], before[held])
    assert (after != before).any(axis=-1)[~held].all()
    assert not simulation["sheet"].velocities()[held].any()


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_led_pins_are_on_their_track_to_the_last_bit(integrator: str, precision: str) -> None:
    half = np.sqrt(0.5)
    track = Track(
        [0.0, 0.1, 0.4], [[0, 0, 0], [0.1, 0, 0.2], [0, 0, 0.2]], [[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, half, half]]
    )
    pins = (Pin("edge:u,0", track), Pin("corner:1,1"))
    body = hanging(material=material_for(integrator), pins=pins, position=(0.3, 0.0, 0.0))
    settings = replace(REAL_TIME, precision=precision, integrator=integrator, fps=PAPER_FPS.get(integrator, 60.0))
    simulation = Simulation([body], settings=settings)
    start = body.placed_positions()
    for _ in range(30):
        simulation.step()
        position, (x, y, z, w) = track.pose(simulation.time)
        R = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        led = simulation["sheet"].positions()[0]
        np.testing.assert_allclose(led, position + start[0] @ R.T, atol=1e-6 if precision == "float32" else 1e-14)
        exact = position + rotate((x, y, z, w), start[0])
        np.testing.assert_array_equal(led, exact.astype(precision))
    np.testing.assert_array_equal(simulation["sheet"].positions()[-1, -1], start[-1, -1].astype(precision))


def test_everything_pinned() -> None:
    simulation = Simulation([hanging(pins=(Pin("all"),))], settings=REAL_TIME)
    before = simulation["sheet"].positions()
    for _ in range(3):
        report = simulation.step()
        assert (report.cg_iterations, report.cg_breakdowns, report.residual) == (0, 0, 0.0)
    np.testing.assert_array_equal(simulation["sheet"].positions(), before)


@pytest.mark.parametrize("settings", [REAL_TIME, PRECISE], ids=["real time", "precise"])
def test_nothing_to_do_changes_nothing(settings: Settings) -> None:
    simulation = Simulation([hanging(pins=())], settings=replace(settings, gravity=(0.0, 0.0, 0.0)))
    before = simulation["sheet"].positions()
    for _ in range(5):
        report = simulation.step()
        assert report.cg_breakdowns == 0
        assert report.residual < 1e-3
    # Rest lengths are measured on the rounded positions, so that even float32 is at rest to the bit.
    assert np.abs(simulation["sheet"].positions() - before).max() < 1e-7
    assert [term.name for term in simulation.info().bodies[0].terms] == ["elasticity"]


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_lane_widths_agree_to_round_off(precision: str) -> None:
    # How far sums of another order lead apart is a matter of the tolerance of the linear solves.
    widths, tolerance, cg = ((1, 8), 1e-8, 1e-11) if precision == "float64" else ((1, 16), 1e-3, 1e-5)
    settings: dict[str, Any] = {"newton_iterations": 3, "cg_tolerance": cg, "cg_iterations": 3000}
    narrow, wide = (run(busy(precision=precision, lane_width=width, **settings), 6) for width in widths)
    moved = np.abs(narrow[0] - sheet((6, 19)).positions).max()
    assert moved > 0.05
    for a, b in zip(narrow[::2], wide[::2], strict=True):
        np.testing.assert_allclose(a, b, atol=tolerance * moved)


@pytest.mark.parametrize("integrator", INTEGRATORS)
@pytest.mark.parametrize("gravity", [(0.0, 0.0, 0.0), (1.0, -2.0, -9.81)], ids=["weightless", "falling"])
def test_momentum_in_free_flight(integrator: str, gravity: tuple[float, float, float]) -> None:
    shape, velocity = sheet((5, 9)), np.array([1.0, -2.0, 0.5])
    start = 0.9 * shape.positions + 0.1 * stretched(shape.positions)
    body = hanging(
        material=material_for(integrator), shape=shape, pins=(), initial_positions=start, velocity=tuple(velocity)
    )
    fps = PAPER_FPS.get(integrator, 60.0)
    simulation = Simulation([body], settings=replace(PRECISE, integrator=integrator, gravity=gravity, fps=fps))
    handle = simulation["sheet"]
    mass = handle.model.node_mass[..., None]
    lengths = np.linalg.norm(np.diff(handle.positions(), axis=0), axis=-1)
    for _ in range(10):
        simulation.step()
        momentum = np.sum(mass * handle.velocities(), (0, 1))
        expected = mass.sum() * (velocity + np.array(gravity) * simulation.time)
        np.testing.assert_allclose(momentum, expected, atol=1e-9 * np.linalg.norm(expected))
    assert np.abs(np.linalg.norm(np.diff(handle.positions(), axis=0), axis=-1) - lengths).max() > 1e-3


def test_weightless_float32_keeps_its_momentum() -> None:
    shape = sheet((5, 9))
    body = hanging(shape=shape, pins=(), initial_positions=stretched(shape.positions), velocity=(1.0, -2.0, 0.5))
    settings = replace(REAL_TIME, gravity=(0.0, 0.0, 0.0), newton_iterations=3, cg_tolerance=1e-5)
    simulation = Simulation([body], settings=settings)
    mass = simulation["sheet"].model.node_mass[..., None]
    run(simulation, 10)
    momentum = np.sum(mass * simulation["sheet"].velocities(), (0, 1)) / mass.sum()
    np.testing.assert_allclose(momentum, [1.0, -2.0, 0.5], atol=1e-4)


@pytest.mark.parametrize("node", [(0, 0), (3, 5), (3, 17), (5, 18)], ids=str)
@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_node_that_is_not_finite_is_named(node: tuple[int, int], precision: str) -> None:
    bodies = [hanging((3, 3), name="good"), hanging(name="bad")]
    simulation = Simulation(bodies, settings=replace(REAL_TIME, precision=precision))
    run(simulation, 3)
    live = simulation["bad"].position_array.numpy()
    live[1, 1 + node[0], simulation["bad"].model.layout.halo + node[1]] = np.nan
    with pytest.raises(SimulationFailure) as error:
        simulation.step()
    assert (error.value.body, error.value.node) == ("bad", node)
    assert error.value.time == pytest.approx(3 / 60)
    assert error.value.remedy
    assert f'body "bad", node {list(node)}, t = 0.05 s' in str(error.value)


def test_forces_that_overflow_are_a_failure_and_a_reset_heals_them() -> None:
    simulation = Simulation([hanging()], settings=REAL_TIME)
    fine = run(simulation, 3)
    simulation.reset()
    simulation["sheet"].state.v.fill_(1e30)
    with pytest.raises(SimulationFailure, match="sheet"):
        run(simulation, 3)
    simulation.reset()
    assert_same_bits(run(simulation, 3), fine)


@pytest.mark.parametrize("captured", [True, False])
def test_steps_allocate_nothing(captured: bool) -> None:
    simulation = busy(captured=captured)
    run(simulation, 2)
    reports: list[str] = []
    with wp.ScopedMemoryTracker("steps", print=False, report_func=reports.append) as tracker:
        tracker.clear()
        run(simulation, 3)
        tracker.report()
        probe = wp.zeros(3, dtype=float, device="cpu")
        tracker.report()
    assert "Total allocations:\n  Peak" in reports[0]
    assert "12 B" in reports[1]
    assert probe.size == 3


@pytest.mark.parametrize("captured", [True, False])
def test_steps_leave_the_processor_as_they_found_it(captured: bool) -> None:
    # Denormal numbers count as zero inside a step; outside they belong to the caller.
    simulation = busy(captured=captured)
    for _ in range(2):
        simulation.step()
        assert np.array([1e-310])[0] * np.array([0.5])[0] == 5e-311


def test_every_step_counts_its_iterations_from_nought() -> None:
    # Lagged loads (wind, friction) follow the first iterations of a step and then freeze.
    simulation, late = busy(), busy()
    for _ in range(6):
        simulation.step()
        late.bodies[0].state.iteration.fill_(99)
        late.step()
    assert_same_bits(run(late, 0), run(simulation, 0))


def test_iterations_to_tolerance_end_converged() -> None:
    simulation = Simulation([hanging()], settings=PRECISE)
    total = 0
    for _ in range(5):
        report = simulation.step()
        assert report.outcome in (Outcome.CONVERGED, Outcome.ROUND_OFF)
        assert report.residual < 1e-4
        assert 1 < report.newton_iterations < 40
        total += report.newton_iterations
    record = simulation.record()
    assert (record.newton_iterations, record.newton_unconverged, record.cg_breakdowns) == (total, 0, 0)


def test_fixed_iterations_are_those_asked_for() -> None:
    simulation = Simulation(
        [hanging()], settings=replace(REAL_TIME, newton_iterations=3, cg_iterations=2, cg_tolerance=1e-6)
    )
    report = simulation.step()
    assert (report.outcome, report.newton_iterations, report.cg_capped) == (Outcome.FIXED, 3, 3)
    assert report.cg_iterations == 6
    assert simulation.record().cg_capped == 3


def test_converged_steps_do_not_depend_on_the_preconditioner() -> None:
    found = [run(Simulation([hanging((5, 6))], settings=replace(PRECISE, preconditioner=name)), 3)[0]
             for name in ("none", "jacobi", "block-jacobi")]  # fmt: skip
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], atol=1e-8)


@pytest.mark.parametrize("integrator", SEARCHING)
def test_one_iteration_with_its_line_search_holds_stiff_cloth(integrator: str) -> None:
    # Without the line search this blows up: stretch 81 at 1e7 N/m and dt 1/10 (design 2.1, 6.2).
    stiff = replace(CLOTH, membrane_stiffness=1e7)
    settings = replace(REAL_TIME, integrator=integrator, fps=10.0, precision="float64")
    simulation = Simulation([hanging((13, 13), material=stiff)], settings=settings)
    weight = 0.2 * 9.81
    for _ in range(30):
        simulation.step()
        energy = simulation.record().energy
        assert energy.kinetic + energy.elastic + energy.gravity < 1e-2 * weight
        assert simulation["sheet"].max_stretch() < 1.25


@pytest.mark.parametrize("integrator", SEARCHING)
def test_degenerate_starts_are_survived(integrator: str) -> None:
    # Four nodes in one point and one node moved by two cells (design 6.6).
    shape = sheet((9, 9))
    start = shape.positions.copy()
    start[2:4, 2:4] = start[2, 2]
    start[6, 6] += [0.25, 0.25, 0.0]
    body = hanging(shape=shape, initial_positions=start)
    simulation = Simulation([body], settings=replace(REAL_TIME, integrator=integrator))
    before = simulation["sheet"].max_stretch()
    for _ in range(30):
        simulation.step()
        assert simulation["sheet"].max_stretch() < before
    assert simulation["sheet"].max_stretch() < 1.3


def test_time_counts_steps_and_frames() -> None:
    simulation = Simulation([hanging((3, 3))], settings=replace(REAL_TIME, fps=50.0, substeps=4))
    assert simulation.dt == pytest.approx(0.005)
    assert simulation.gravity == (0.0, 0.0, -9.81)
    for k in range(1, 6):
        simulation.step()
        assert simulation.time == pytest.approx(k * 0.005)
        assert simulation.frame == k // 4
    simulation.advance_frame()
    assert simulation.time == pytest.approx(0.045)
    record = simulation.record()
    assert record.frames == 3
    assert record.sim_s == pytest.approx(0.045)
    assert record.newton_iterations == 9
    assert record.max_stretch > 1.0
    assert (record.nodes, record.device, record.precision, record.integrator) == (9, "cpu", "float32", "bdf2")
    assert record.wall_s > 0
    assert record.setup_s > 0
    plain = json.loads(json.dumps(record.as_dict()))
    assert set(plain["energy"]) == {"kinetic", "elastic", "gravity", "field", "work_in"}


def test_work_of_the_pins_is_the_energy_that_a_slow_lift_gives() -> None:
    track = Track.line((0, 0, 0), (0, 0, 0.5), 0.0, 1.0)
    body = hanging((3, 3), shape=sheet((3, 3), (0.1, 0.1)), pins=(Pin("all", track),))
    simulation = Simulation([body], settings=replace(PRECISE, fps=100.0))
    before = simulation.record().energy
    run(simulation, 100)
    after = simulation.record().energy
    gain = sum(getattr(after, kind) - getattr(before, kind) for kind in ("kinetic", "elastic", "gravity"))
    assert after.gravity - before.gravity == pytest.approx(0.2 * 0.01 * 9.81 * 0.5, rel=1e-9)
    assert after.work_in == pytest.approx(gain, rel=0.05)


@pytest.mark.parametrize(
    ("bodies", "settings", "messages"),
    [
        ([], {}, ["body: is missing"]),
        (["a", "a", "b"], {}, ['body.name = "a": is used twice']),
        (
            ["a"],
            {"integrator": "leapfrog"},
            ['integrator = "leapfrog": is not known. Use one of: symplectic-euler, verlet'],
        ),
        (["a"], {"preconditioner": "ilu"}, ['preconditioner = "ilu"', "auto, none, jacobi, block-jacobi"]),
        (["a"], {"device": "cuda:99"}, ['device = "cuda:99"', "Use auto or one of: cpu"]),
        ([], {"integrator": "x", "preconditioner": "y"}, ["body", 'integrator = "x"', 'preconditioner = "y"']),
    ],
    ids=["no body", "one name twice", "integrator", "preconditioner", "device", "all at once"],
)
def test_what_does_not_fit_together_is_refused(
    bodies: list[str], settings: dict[str, Any], messages: list[str]
) -> None:
    with pytest.raises(InputError) as error:
        Simulation([hanging((3, 3), name=name) for name in bodies], settings=replace(REAL_TIME, **settings))
    for message in messages:
        assert message in str(error.value)


def test_bodies_are_found_by_name() -> None:
    simulation = busy()
    assert simulation["scarf"] is simulation.bodies[1]
    with pytest.raises(KeyError, match="there are sheet, scarf"):
        _ = simulation["shawl"]


@pytest.mark.gpu
@pytest.mark.skipif(not wp.is_cuda_available(), reason="there is no CUDA device")
def test_cuda_agrees_with_the_cpu() -> None:
    settings: dict[str, Any] = {"newton_iterations": 3, "cg_tolerance": 1e-5}
    cpu, cuda = run(busy(**settings), 10), run(busy(device="cuda:0", **settings), 10)
    for a, b in zip(cpu[::2], cuda[::2], strict=True):
        np.testing.assert_allclose(a, b, atol=1e-3)
    assert_same_bits(run(busy(device="cuda:0", **settings), 10), cuda)


def test_materials_of_every_form_run() -> None:
    for name in MATERIALS:
        simulation = Simulation([hanging((4, 5), material=MATERIALS[name])], settings=REAL_TIME)
        assert np.isfinite(run(simulation, 2)[0]).all(), name


@pytest.mark.parametrize("preconditioner", ["block-jacobi", "multigrid"])
def test_pins_and_springs_let_go(preconditioner: str) -> None:
    """After 0.1 s nothing holds the second corner, nor pulls at the middle: the rest is a run without them."""
    held = (Pin("corner:0,0"), Pin("corner:1,0", until=0.1))
    pulled = (Spring([[4, 4]], 50.0, (0.5, 0.5, 1.0), until=0.1),)
    body = Body("sheet", sheet((9, 9)), Material.preset("cotton"), pins=held, springs=pulled)
    settings = Settings(device="cpu", precision="float64", preconditioner=preconditioner)
    simulation = Simulation([body], settings=settings)
    start = simulation["sheet"].positions()
    for _ in range(6):
        simulation.step()
    there = simulation["sheet"].positions()
    np.testing.assert_array_equal(there[8, 0], start[8, 0])
    assert there[4, 4, 2] > start[4, 4, 2]
    for _ in range(6):
        simulation.step()
    after = simulation["sheet"].positions()
    assert np.linalg.norm(after[8, 0] - start[8, 0]) > 0.01
    np.testing.assert_array_equal(after[0, 0], start[0, 0])
    assert simulation.record().energy.field == 0.0
    simulation.reset()
    for _ in range(6):
        simulation.step()
    np.testing.assert_array_equal(simulation["sheet"].positions(), there)
    with pytest.raises(InputError, match="must not be negative"):
        Pin("all", until=-1.0)
