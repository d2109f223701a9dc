"""Explicit steps: known frequencies, the largest stable step, energy, loads, pins on their way, failures, same bits."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import warp as wp
from bodies import CLOTH, MEMBRANE, PRECISE, REAL_TIME, assert_same_bits, busy, hanging, run

from warpdeform import launching
from warpdeform.body import Body, Pin, Spring
from warpdeform.errors import InputError, SimulationFailure
from warpdeform.integrators.explicit import SAFETY
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.result import Outcome
from warpdeform.settings import Settings
from warpdeform.shape import from_map, sheet, tube
from warpdeform.simulation import Simulation
from warpdeform.track import Track
from warpdeform.wind import Wind

Array = np.ndarray[Any, Any]

METHODS = ["symplectic-euler", "verlet"]
WEIGHTLESS = {"gravity": (0.0, 0.0, 0.0)}


def explicit(*bodies: Body, integrator: str = "verlet", **options: Any) -> Simulation:
    """A precise simulation; `obstacles`, `wind`, `captured` and `lane_width` as for simulations, the rest settings."""
    own = {key: options.pop(key) for key in ("obstacles", "wind", "captured", "lane_width") if key in options}
    return Simulation(list(bodies), settings=replace(PRECISE, integrator=integrator, **options), **own)


def stable_step(simulation: Simulation) -> float:
    stepper: Any = simulation._stepper
    return float(stepper.stable_step(simulation._replay))


def energy(simulation: Simulation) -> float:
    found = simulation.record().energy
    return found.kinetic + found.elastic + found.gravity + found.field


def string(nodes: int, amplitude: float, mode: int, **settings: Any) -> tuple[Simulation, float]:
    """A prestretched string plucked in one mode, and the frequency of that mode on the grid."""
    stretch, density, stiffness, spacing = 1.2, 0.3, 40.0, 1.0 / (nodes - 1)
    shape = sheet((nodes, 2), (1.0, 0.2))
    start = shape.positions * [stretch, 1.0, 1.0]
    start[..., 2] = amplitude * np.sin(mode * np.pi * shape.positions[..., 0])
    material = Material(areal_density=density, membrane_stiffness=stiffness, poisson_ratio=0.0)
    body = hanging(shape=shape, material=material, initial_positions=start, pins=(Pin("edge:u,0"), Pin("edge:u,1")))
    omega = 2.0 / spacing * np.sin(0.5 * mode * np.pi * spacing) * np.sqrt(stiffness * (stretch**2 - 1) / (2 * density))
    return explicit(body, **WEIGHTLESS, **settings), omega


@pytest.mark.parametrize("mode", [1, 4])
@pytest.mark.parametrize("integrator", METHODS)
def test_string_rings_at_the_frequency_of_the_method(integrator: str, mode: int) -> None:
    # sin(omega' dt/2) = omega dt/2, and no damping, over a thousand steps.
    amplitude, nodes, count = 1e-6, 13, 10
    simulation, omega = string(nodes, amplitude, mode, integrator=integrator, fps=100.0, substeps=count)
    dt = simulation.dt
    phase = 2.0 * np.arcsin(0.5 * omega * dt)
    shape = np.sin(mode * np.pi * np.arange(nodes) / (nodes - 1))
    for frame in range(1, 101):
        simulation.advance_frame()
        n = frame * count
        u = np.cos(n * phase)
        if integrator == "symplectic-euler":  # velocities begin half a step before positions
            u = np.cos((n + 0.5) * phase) / np.cos(0.5 * phase)
        found = simulation["sheet"].positions()[..., 2] / amplitude
        np.testing.assert_allclose(found, np.outer(shape, [u, u]), atol=1e-8)
    assert simulation.record().steps == 1000


@pytest.mark.parametrize(
    ("body", "obstacles"),
    [
        (hanging((9, 9), pins=()), ()),
        (hanging((7, 9), material=MEMBRANE), ()),
        (hanging((7, 9), springs=(Spring("all", 1e5),)), ()),
        (hanging(shape=tube((7, 11), radius=0.3, length=0.7), pins=(Pin("edge:u,0"),)), ()),
        (
            hanging(
                shape=from_map(lambda u, v: np.stack([u + v, v, 0 * u], -1), (6, 7), ((0, 1), (0, 1))),
                material=replace(CLOTH, bending_stiffness=1.0),
            ),
            (),
        ),
    ],
    ids=["free", "membrane", "springs", "tube", "leaning plate"],
)
def test_largest_frequency_is_bounded_and_the_bound_is_near(body: Body, obstacles: Any) -> None:
    simulation = explicit(body, obstacles=obstacles)
    handle = simulation["sheet"]
    mass, free = handle.model.node_mass[..., None], handle.model.download(handle.state.free)
    for _ in range(2):
        limit = stable_step(simulation)
        p = np.random.default_rng(0).normal(size=(*handle.nodes, 3))
        for _ in range(300):  # power iteration
            q = handle.model.zeros(3)
            handle.elasticity.add_hessian_product(handle.state, handle.model.upload(free * p), q)
            force = handle.model.download(q) + sum(spring.stiffness for spring in body.springs) * p
            push = free * force / mass
            square = float(np.sum(push * p * mass) / np.sum(p * p * mass))
            p = push / np.sqrt(np.sum(push * push * mass))
        largest = 2.0 / np.sqrt(square)
        assert limit / SAFETY <= largest
        assert limit / SAFETY > 0.45 * largest
        for _ in range(10):
            simulation.advance_frame()


@pytest.mark.parametrize("integrator", METHODS)
def test_a_fixed_step_beyond_the_stable_one_is_refused(integrator: str) -> None:
    with pytest.raises(
        InputError, match=r"substeps = 2: makes steps of 0\.00833 s, and .* is stable up to 0\.00"
    ) as error:
        explicit(hanging(), integrator=integrator, time_step="fixed", substeps=2)
    needed = int(str(error.value).split("Use ")[1].split(" substeps")[0])
    simulation = explicit(hanging(), integrator=integrator, time_step="fixed", substeps=needed)
    simulation.advance_frame()
    assert simulation.record().steps == needed
    assert stable_step(simulation) == pytest.approx(1 / 60 / needed, rel=0.2)
    with pytest.raises(InputError, match=r'time_step = "adaptive": is for implicit methods'):
        explicit(hanging(), integrator=integrator, time_step="adaptive")


def test_a_fixed_step_that_becomes_unstable_stops_the_run() -> None:
    needed = int(np.ceil(1 / 60 / stable_step(explicit(hanging(pins=())))))
    simulation = explicit(hanging(pins=()), time_step="fixed", substeps=needed)
    simulation.advance_frame()
    stretched = simulation["sheet"].positions() * 3.0
    simulation["sheet"].state.x.assign(simulation["sheet"].model.layout.pack(stretched))
    with pytest.raises(SimulationFailure, match="longer than those that are stable"):
        simulation.advance_frame()
    np.testing.assert_array_equal(simulation["sheet"].positions(), stretched)
    assert simulation.frame == 1


@pytest.mark.parametrize("integrator", METHODS)
def test_half_as_much_again_as_the_stable_step_is_not_stable(integrator: str) -> None:
    # The bound is not idle: at the largest frequency itself there are 2 radians a step.
    simulation = explicit(hanging((9, 9), material=MEMBRANE, pins=()), integrator=integrator, **WEIGHTLESS)
    stepper: Any = simulation._stepper
    limit, grown = stable_step(simulation) / SAFETY, []
    for share in (1.0, 1.6):
        simulation.reset()
        handle = simulation["sheet"]
        start = handle.rest_positions
        moved = start + 1e-7 * np.random.default_rng(1).normal(size=start.shape)
        handle.state.x.assign(handle.model.layout.pack(moved))
        attempt = stepper._attempt(0.0, 100 * share * limit, share * limit, 100, simulation._replay)
        grown.append(float(np.abs(handle.positions() - start).max()) if attempt.completed else np.inf)
    assert grown[0] < 1e-5
    assert grown[1] > 1e-2


@pytest.mark.parametrize("integrator", METHODS)
def test_energy_is_kept_as_precisely_as_the_order_says(integrator: str) -> None:
    drift = []
    for substeps in (60, 120):
        simulation = explicit(hanging((9, 9)), integrator=integrator, substeps=substeps)
        before, worst = energy(simulation), 0.0
        for _ in range(30):
            simulation.advance_frame()
            worst = max(worst, abs(energy(simulation) - before))
        drift.append(worst)
    order = np.log2(drift[0] / drift[1])
    assert order == pytest.approx(1.0 if integrator == "symplectic-euler" else 2.0, abs=0.3)
    assert drift[1] < (1e-3 if integrator == "symplectic-euler" else 1e-6)


def test_free_flight_keeps_momentum_and_angular_momentum() -> None:
    shape = sheet((7, 9))
    start = shape.positions * [1.1, 0.9, 1.0]
    body = hanging(shape=shape, initial_positions=start, pins=(), velocity=(1.0, -2.0, 0.5))
    simulation = explicit(body, **WEIGHTLESS)
    handle = simulation["sheet"]
    spin = np.cross([0.5, 1.0, -2.0], start - start.mean((0, 1)))
    handle.state.v.assign(handle.model.layout.pack(handle.velocities() + spin))
    mass = handle.model.node_mass[..., None]

    def momenta() -> Array:
        x, v = handle.positions(), handle.velocities()
        return np.concatenate([np.sum(mass * v, (0, 1)), np.sum(np.cross(x, mass * v), (0, 1))])

    before = momenta()
    for _ in range(20):
        simulation.advance_frame()
    np.testing.assert_allclose(momenta(), before, atol=1e-11 * np.abs(before).max())
    assert np.abs(np.diff(handle.positions(), axis=0) - np.diff(start, axis=0)).max() > 0.05


@pytest.mark.parametrize(("integrator", "order"), [("symplectic-euler", 1), ("verlet", 2)])
@pytest.mark.parametrize("load", ["drag", "wind"])
def test_loads_that_depend_on_velocity_keep_the_order(load: str, integrator: str, order: int) -> None:
    # A rigid sheet: drag and wind against a fall, with their closed forms.
    rate, g, duration = 3.0, 9.81, 0.4
    errors = []
    for substeps in (40, 80):
        body = hanging(
            (3, 3), pins=(), drag=rate if load == "drag" else 0.0, wind_coefficient=rate * 0.2, velocity=(0, 0, 1.0)
        )
        wind = Wind((0.0, 0.0, 0.0)) if load == "wind" else None
        simulation = explicit(body, integrator=integrator, wind=wind, fps=1 / duration, substeps=substeps * 4)
        simulation.advance_frame()
        exact = (1.0 + g / rate) * (1 - np.exp(-rate * duration)) / rate - g * duration / rate
        errors.append(abs(float(simulation["sheet"].positions()[0, 0, 2]) - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.1)
    # Drag is a loss, counted as work.
    record = simulation.record().energy
    assert record.work_in < 0
    assert record.kinetic + record.gravity == pytest.approx(0.1 + record.work_in, abs=5e-3)


def test_work_of_pins_is_counted() -> None:
    track = Track.line((0, 0, 0), (0, 0, 0.5), 0.0, 1.0)
    body = hanging((4, 4), shape=sheet((4, 4), (0.1, 0.1)), pins=(Pin("edge:u,0", track),))
    simulation = explicit(body)
    before = energy(simulation)
    for _ in range(60):
        simulation.advance_frame()
    record = simulation.record()
    # What the pins took at once when they set out is no work of a force.
    jump = 0.5 * 0.5**2 * float(simulation["sheet"].model.node_mass[0].sum())
    assert record.energy.work_in == pytest.approx(energy(simulation) - before - jump, rel=1e-3)
    assert record.energy.work_in > 5e-3


def test_moving_pins_move_while_a_frame_goes_on() -> None:
    # Eight steps share a straight piece of the path, so that its curve is followed more closely with more steps.
    angles = np.linspace(0.0, np.pi, 200)
    path = 0.3 * np.stack([np.sin(angles), 0 * angles, 1 - np.cos(angles)], -1)
    track = Track(np.linspace(0.0, 0.1, 200), path, np.tile([0.0, 0, 0, 1], (200, 1)))
    ends = []
    for substeps in (128, 256, 512):
        simulation = explicit(hanging((5, 6), pins=(Pin("edge:u,0", track),)), fps=10.0, substeps=substeps)
        simulation.advance_frame()
        ends.append(simulation["sheet"].positions())
    changes = [np.abs(b - a).max() for a, b in pairwise(ends)]
    assert changes[1] < 0.4 * changes[0] < 0.01


@pytest.mark.parametrize("integrator", METHODS)
@pytest.mark.parametrize("moving", [False, True])
def test_obstacles_are_not_crossed(integrator: str, moving: bool) -> None:
    track = Track.line((0.4, 0.5, 0.0), (0.4, 0.5, 0.6), 0.0, 0.1) if moving else Track.fixed((0.4, 0.5, 0.2))
    ball = Obstacle("sphere", {"radius": 0.2}, track=track, friction=0.3)
    body = hanging((17, 17), pins=(), position=(0.0, 0.0, 0.6), velocity=(0.0, 0.0, -3.0))
    simulation = explicit(body, integrator=integrator, obstacles=[ball], precision="float32", fps=240.0)
    nearest, before = np.inf, energy(simulation)
    for _ in range(36):
        simulation.advance_frame()
        centre = track.pose(simulation.time)[0]
        nearest = min(nearest, float(np.linalg.norm(simulation["sheet"].positions() - centre, axis=-1).min()) - 0.2)
    assert 0.0 < nearest < 0.004
    if not moving:
        assert energy(simulation) < before + 1e-3


def test_bursts_of_any_length_are_the_same_steps() -> None:
    # Of 5 steps the last is alone; what moves needs bursts of one or eight.
    together = explicit(hanging(), substeps=105)
    together.advance_frame()
    alone = explicit(hanging(), substeps=105)
    run(alone, 105)
    assert together.record().steps == alone.record().steps == 105
    for a, b in zip(run(together, 0), run(alone, 0), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    assert together.time == alone.time


def test_every_load_runs_to_the_same_bits() -> None:
    options: dict[str, Any] = {"integrator": "verlet"}
    replayed, launched = busy(**options), busy(captured=False, **options)
    for simulation in (replayed, launched):
        simulation.advance_frame()
        simulation.advance_frame()
    assert_same_bits(run(replayed, 0), run(launched, 0))


@pytest.mark.parametrize("loaded", [False, True])
def test_threads_and_bands_do_not_change_a_bit(loaded: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def swing(threads: int, band_bytes: int) -> list[Array]:
        monkeypatch.setattr(launching, "SHARED_FROM", 0)
        monkeypatch.setattr(launching, "BAND_BYTES", band_bytes)
        body = hanging((70, 9), drag=0.5) if loaded else hanging((70, 9))
        settings = replace(REAL_TIME, integrator="verlet", threads=threads, substeps=35)
        simulation = Simulation([body], settings=settings, wind=Wind((2.0, 0.0, 1.0)) if loaded else None)
        simulation.advance_frame()
        return run(simulation, 0)

    alone = swing(1, 10**9)
    for threads, band_bytes in ((2, 10**9), (3, 10**9), (1, 1), (2, 1)):
        assert_same_bits(swing(threads, band_bytes), alone)


def test_a_burst_that_overflows_is_repeated_then_given_up_and_leaves_the_state() -> None:
    simulation = explicit(hanging((4, 5), name="good"), hanging((4, 5), name="bad"), precision="float32")
    simulation.advance_frame()
    live = simulation["bad"].state.v.numpy()
    live[2, 3, simulation["bad"].model.layout.halo + 1] = np.inf
    before = run(simulation, 0)
    with pytest.raises(SimulationFailure) as error:
        simulation.advance_frame()
    assert (error.value.body, error.value.time) == ("bad", pytest.approx(1 / 60))
    assert error.value.node
    assert_same_bits(run(simulation, 0), before)
    assert simulation.record().retries == 7
    simulation.reset()
    simulation.advance_frame()
    assert np.isfinite(run(simulation, 0)).all()


def test_a_burst_that_overflows_gives_the_anchors_of_friction_back() -> None:
    plane = Obstacle("plane", friction=0.5, track=Track.fixed((0.0, 0.0, -0.003)))
    ends = []
    for disturbed in (False, True):
        body = hanging((5, 6), pins=(), velocity=(0.5, 0.0, 0.0))
        simulation = explicit(body, obstacles=[plane])
        for _ in range(6):
            simulation.advance_frame()
        if disturbed:
            state, stepper = simulation["sheet"].state, simulation._stepper
            v, dt = state.v.numpy().copy(), simulation.dt
            state.v.fill_(1e300)
            attempt = stepper._attempt(simulation.time, simulation.time + dt, dt, 1, simulation._replay)  # type: ignore[attr-defined]
            assert not attempt.completed
            state.v.assign(v)
        simulation.advance_frame()
        ends.append(run(simulation, 0))
    assert_same_bits(*ends)


def test_explicit_steps_report_that_nothing_was_solved() -> None:
    simulation = explicit(hanging())
    report = simulation.step()
    assert (report.outcome, report.newton_iterations, report.cg_iterations) == (Outcome.EXPLICIT, 0, 0)
    assert report.steps > 10
    record = simulation.record()
    assert (record.frames, record.steps, record.integrator) == (2, report.steps, "verlet")
    assert simulation.info().preconditioner == ""
    assert any("explicit" in line for line in simulation.info().lines())


def test_explicit_bodies_keep_only_what_they_need() -> None:
    membrane = hanging((40, 48), material=MEMBRANE)
    implicit, light = (
        Simulation([membrane], settings=replace(REAL_TIME, integrator=name)) for name in ("bdf2", "verlet")
    )
    vectors = {name for name, value in vars(light["sheet"].state).items() if isinstance(value, wp.array)}
    assert {"gradient", "direction", "search", "w", "y"}.isdisjoint(vectors)
    assert light.info().bytes_total < 0.7 * implicit.info().bytes_total


def test_settings_say_what_a_choice_of_steps_may_be() -> None:
    with pytest.raises(InputError, match='time_step = "sometimes": is no choice of steps'):
        Settings(time_step="sometimes")
