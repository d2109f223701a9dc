"""Every method on every kind of body, and on bodies that are tied to each other."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import MEMBRANE, PRECISE, hanging, run

from warpdeform.attachment import Attachment
from warpdeform.body import Body, Pin
from warpdeform.errors import InputError
from warpdeform.integrators import INTEGRATORS
from warpdeform.material import Material
from warpdeform.scene import Override, load_scene
from warpdeform.scene.play import simulation_of
from warpdeform.section import Section
from warpdeform.shape import block, line
from warpdeform.simulation import Simulation

Array = np.ndarray[Any, Any]

RUBBER = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3)
EXPLICIT = [name for name, method in INTEGRATORS.items() if method.explicit]
IMPLICIT = [name for name, method in INTEGRATORS.items() if not method.explicit and "terz" not in name]


def jelly(**body: Any) -> Body:
    return Body(**{"name": "jelly", "shape": block((4, 4, 5), (0.1, 0.1, 0.2)), "material": RUBBER} | body)


def energy(simulation: Simulation) -> float:
    found = simulation.record().energy
    return found.kinetic + found.elastic + found.gravity + found.field


def build(*bodies: Body, integrator: str, attachments: Any = (), **settings: Any) -> Simulation:
    return Simulation(
        list(bodies), attachments=attachments, settings=replace(PRECISE, integrator=integrator, **settings)
    )


@pytest.mark.parametrize("integrator", [*EXPLICIT, *IMPLICIT])
def test_solids_swing_alike(integrator: str) -> None:
    # A soft bar that sags from one end.
    ends, shape = [], block((3, 3, 7), (0.1, 0.1, 0.4))
    bar = jelly(
        shape=shape,
        material=replace(RUBBER, youngs_modulus=2e4),
        rotation=(0.5**0.5, 0.0, 0.0, 0.5**0.5),
        pins=(Pin("face:w,0"),),
    )
    for name, substeps in ((integrator, 20 if INTEGRATORS[integrator].order == 2 else 160), ("verlet", 100)):
        simulation = build(bar, integrator=name, fps=20.0, substeps=substeps)
        for _ in range(3):
            simulation.advance_frame()
        ends.append(simulation["jelly"].positions())
    moved = np.abs(ends[1] - bar.placed_positions()).max()
    assert moved > 1e-2
    assert np.abs(ends[0] - ends[1]).max() < 0.08 * moved


@pytest.mark.parametrize("width", [1, 8])
def test_energy_momentum_keeps_the_energy_of_solids(width: int) -> None:
    shape = block((4, 4, 5), (0.1, 0.1, 0.2))
    body = jelly(initial_positions=shape.positions * [1.1, 0.9, 1.05], velocity=(1.0, 0.0, 0.5))
    settings = replace(PRECISE, integrator="energy-momentum", gravity=(0.0, 0.0, 0.0), fps=240.0)
    simulation = Simulation([body], settings=settings, lane_width=width)
    before = energy(simulation)
    for _ in range(60):
        simulation.step()
        assert energy(simulation) == pytest.approx(before, rel=1e-7)
    assert simulation.record().energy.elastic < 0.9 * before


@pytest.mark.parametrize("integrator", EXPLICIT)
def test_solids_and_curves_know_their_largest_frequency(integrator: str) -> None:
    rod = Body(
        "rod", line((9,), 0.5), Material(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3),
        section=Section.circular(0.01), pins=(Pin("end:0"),),
    )  # fmt: skip
    for body in (jelly(), rod):
        simulation = build(body, integrator=integrator)
        handle, stepper = simulation.bodies[0], simulation._stepper
        limit = stepper.stable_step(simulation._replay) / 0.95  # type: ignore[attr-defined]
        mass, free = handle.model.node_mass[..., None], handle.model.download(handle.state.free)
        p = np.random.default_rng(0).normal(size=(*handle.nodes, 3))
        for _ in range(200):
            q = handle.model.zeros(3)
            handle.elasticity.add_hessian_product(handle.state, handle.model.upload(free * p), q)
            push = free * handle.model.download(q) / mass
            square = float(np.sum(push * p * mass) / np.sum(p * p * mass))
            p = push / np.sqrt(np.sum(push * push * mass))
        assert 0.3 * 2.0 / np.sqrt(square) < limit <= 2.0 / np.sqrt(square)
        before = energy(simulation)
        for _ in range(20):
            simulation.advance_frame()
        assert abs(energy(simulation) - before) < 2e-2 * abs(simulation.record().energy.gravity - before) + 1e-3


def tied(stiffness: float | None) -> tuple[tuple[Body, Body], list[Attachment]]:
    """Two sheets, one hanging on the edge of the other."""
    above = hanging((5, 5), name="above", material=MEMBRANE)
    below = hanging((5, 5), name="below", material=MEMBRANE, pins=(), position=(1.0, 0.0, 0.0))
    return (above, below), [Attachment("below", "edge:u,0", "above", "edge:u,1", stiffness)]


@pytest.mark.parametrize("integrator", [*EXPLICIT, *IMPLICIT, "terzopoulos-exact"])
def test_soft_ties_swing_alike(integrator: str) -> None:
    ends = []
    for name, substeps in ((integrator, 16 if INTEGRATORS[integrator].order == 2 else 96), ("verlet", 128)):
        bodies, attachments = tied(20.0)
        simulation = build(*bodies, integrator=name, attachments=attachments, fps=20.0, substeps=substeps)
        for _ in range(3):
            simulation.advance_frame()
        ends.append(np.concatenate([each.ravel() for each in run(simulation, 0)[::2]]))
        if name == "verlet":
            assert abs(energy(simulation)) < 1e-3
    assert np.abs(ends[0] - ends[1]).max() < 0.02
    assert ends[1].min() < -0.05


@pytest.mark.parametrize("integrator", [*EXPLICIT, "terzopoulos"])
def test_rigid_ties_are_refused_by_methods_that_move_every_node_by_itself(integrator: str) -> None:
    bodies, attachments = tied(None)
    with pytest.raises(InputError, match="rigid attachments"):
        build(*bodies, integrator=integrator, attachments=attachments)


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_rigid_ties_hold_in_every_implicit_method(integrator: str) -> None:
    bodies, attachments = tied(None)
    simulation = build(*bodies, integrator=integrator, attachments=attachments, fps=120.0)
    for _ in range(20):
        simulation.step()
    above, below = (simulation[name].positions() for name in ("above", "below"))
    np.testing.assert_allclose(below[0], above[-1], atol=1e-12)
    assert below[..., 2].min() < -0.05


@pytest.mark.parametrize("integrator", [name for name in INTEGRATORS if "terz" not in name])
def test_pins_that_let_go_are_a_disturbance(integrator: str) -> None:
    # A sheet at rest, held by one edge without weight: let go under weight it falls as a stone.
    body = hanging((5, 5), material=MEMBRANE, pins=(Pin("all", until=0.1),))
    simulation = build(body, integrator=integrator, fps=100.0)
    for _ in range(30):
        simulation.step()
    fallen = simulation["sheet"].positions()[..., 2]
    np.testing.assert_allclose(fallen, fallen[0, 0], atol=1e-9)
    expected = -0.5 * 9.81 * 0.2**2
    first_order = INTEGRATORS[integrator].order == 1
    assert fallen[0, 0] == pytest.approx(expected, abs=0.012 if first_order or integrator == "bdf2" else 2e-4)


@pytest.mark.parametrize("how", ["not converged", "not finite"])
def test_a_step_of_a_twisted_rod_that_fails_leaves_no_trace_in_its_frames(how: str) -> None:
    options = {"solver.integrator": "implicit-euler", "solver.device": "cpu"}
    scene = load_scene("coiled_cord", [Override(key, value) for key, value in options.items()])
    ends = []
    for disturbed in (False, True):
        simulation = simulation_of(scene)
        run(simulation, 3)
        if disturbed:
            stepper: Any = simulation._stepper
            state, (cap, exact, _) = simulation.bodies[0].state, stepper._settled
            v, now, dt = state.v.numpy().copy(), simulation.time, simulation.dt
            if how == "not finite":
                state.v.fill_(1e30)
            else:
                stepper._settled[:2] = [1, 1]
            assert not stepper._attempt(now, now + dt, dt, simulation._replay).completed
            state.v.assign(v)
            stepper._settled[:2] = [cap, exact]
        run(simulation, 3)
        ends.append(simulation.bodies[0].positions())
    np.testing.assert_allclose(ends[1], ends[0], atol=1e-6)


def test_a_burst_of_a_twisted_rod_that_overflows_gives_its_frames_back() -> None:
    options = {"solver.integrator": "verlet", "solver.device": "cpu", "scene.fps": 6000.0}
    scene = load_scene("coiled_cord", [Override(key, value) for key, value in options.items()])
    ends = []
    for disturbed in (False, True):
        simulation = simulation_of(scene)
        for _ in range(4):
            simulation.advance_frame()
        if disturbed:
            state, dt = simulation.bodies[0].state, simulation.dt / 20
            v, stepper = state.v.numpy().copy(), simulation._stepper
            state.v.fill_(1e30)
            attempt: Any = stepper._attempt  # type: ignore[attr-defined]
            assert not attempt(simulation.time, simulation.time + dt, dt, 1, simulation._replay).completed
            state.v.assign(v)
        for _ in range(4):
            simulation.advance_frame()
        ends.append(simulation.bodies[0].positions())
    np.testing.assert_allclose(*ends, atol=1e-7)
