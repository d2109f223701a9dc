"""Extremes: each ends in a finite, sensible state, or is refused or stopped with a reason (issue of stability).

Small grids, the methods that people use, and the precision that they use unless a test says otherwise.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import CLOTH, MEMBRANE, REAL_TIME, hanging

from warpdeform.body import Body, Pin, Spring
from warpdeform.errors import InputError, SimulationFailure
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.scene import Override, load_scene
from warpdeform.scene.play import play
from warpdeform.section import Section
from warpdeform.settings import Settings
from warpdeform.shape import block, line, sheet, tube
from warpdeform.simulation import Simulation
from warpdeform.track import Track
from warpdeform.varying import Varying
from warpdeform.wind import Wind

Array = np.ndarray[Any, Any]

METHODS = ["bdf2", "tr-bdf2", "verlet"]
RUBBER = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3)


def build(*bodies: Body, obstacles: Any = (), wind: Wind | None = None, **settings: Any) -> Simulation:
    return Simulation(bodies, obstacles=obstacles, wind=wind, settings=replace(REAL_TIME, **settings))


def total(simulation: Simulation) -> float:
    energy = simulation.record().energy
    return energy.kinetic + energy.elastic + energy.gravity + energy.field - energy.work_in


def run(simulation: Simulation, frames: int = 30) -> Array:
    """Positions of the first body after so many frames, each of which is finite."""
    for _ in range(frames):
        simulation.advance_frame()
        for handle in simulation.bodies:
            assert np.isfinite(handle.positions()).all()
            assert np.isfinite(handle.velocities()).all()
    return simulation.bodies[0].positions()


def across(u: Array, v: Array | float, w: Array | float = 0.0) -> Array:
    """1 to 1e6 over the body, in the middle of its first axis within a cell."""
    return np.where(u < 0.5, 1.0, 1e6)


@pytest.mark.parametrize("method", METHODS)
def test_masses_that_differ_by_a_million(method: str) -> None:
    material = replace(CLOTH, areal_density=Varying(lambda u, v: 1e-3 * across(u, v)))
    simulation = build(hanging((9, 9), material=material, pins=(Pin("edge:u,0"),)), integrator=method, fps=240.0)
    before = total(simulation)
    positions = run(simulation, 12)
    # The heavy half, a tonne, falls freely as good as; the light one is torn along.
    heavy = simulation["sheet"].model.node_mass > 1.0
    assert simulation["sheet"].model.node_mass.max() > 5e5 * simulation["sheet"].model.node_mass.min()
    fall = 0.5 * 9.81 * (12 / 240.0) ** 2
    assert positions[heavy][:, 2].mean() == pytest.approx(-fall, rel=0.15)
    assert total(simulation) < before + 1e-2 * abs(simulation.record().energy.gravity)


@pytest.mark.parametrize("method", METHODS)
def test_stiffnesses_that_differ_by_a_hundred_million(method: str) -> None:
    varying = Varying(lambda u, v: np.where(u < 0.5, 1.0, 1e8))
    simulation = build(hanging((9, 9), material=replace(MEMBRANE, membrane_stiffness=varying)), integrator=method)
    before = total(simulation)
    positions = run(simulation, 6 if method == "verlet" else 30)
    edges = np.linalg.norm(np.diff(positions[5:], axis=0), axis=-1)
    np.testing.assert_allclose(edges, 0.125, rtol=1e-3)  # the stiff half keeps its lengths
    assert total(simulation) < before + 1e-2 * 0.2 * 9.81


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["curve", "surface", "solid"])
@pytest.mark.parametrize("size", [1e-4, 1e3])
def test_sizes_of_a_tenth_of_a_millimetre_and_of_a_kilometre(size: float, kind: str, method: str) -> None:
    # Alike, they do alike: E over rho g L, and time over sqrt(L/g), are the same at every size.
    def end(length: float) -> Array:
        material = Material(density=1000.0, youngs_modulus=2e5 * length, poisson_ratio=0.3)
        bodies = {
            "curve": lambda: Body(
                "b", line((9,), length), material, section=Section.circular(0.05 * length), pins=(Pin("end:0"),)
            ),
            "surface": lambda: Body(
                "b", sheet((6, 6), (length, length)), replace(material, thickness=0.02 * length),
                pins=(Pin("edge:u,0"),),
            ),
            "solid": lambda: Body(
                "b", block((5, 3, 3), (length, 0.4 * length, 0.4 * length)), material, pins=(Pin("face:u,0"),)
            ),
        }  # fmt: skip
        simulation = build(bodies[kind](), integrator=method, fps=60.0 / np.sqrt(length))
        return run(simulation, 20) / length

    expected = end(1.0)
    assert expected[..., 2].min() < -0.05
    np.testing.assert_allclose(end(size), expected, atol=5e-3)


@pytest.mark.parametrize("method", ["bdf2", "verlet"])
def test_ten_kilometres_from_the_origin(method: str) -> None:
    # float32 resolves a millimetre there: a sheet of a metre still hangs, coarsely.
    simulation = build(hanging((9, 9), position=(1e4, -1e4, 1e4)), integrator=method)
    near = run(build(hanging((9, 9)), integrator=method))
    positions = run(simulation) - [1e4, -1e4, 1e4]
    assert simulation["sheet"].max_stretch() < 1.1
    assert np.sqrt(np.mean(np.sum((positions - near) ** 2, axis=-1))) < 0.1
    assert positions[..., 2].mean() == pytest.approx(near[..., 2].mean(), abs=0.02)
    assert any("falls may be off by" in note for note in simulation.notes) == (method == "bdf2")


def test_steps_that_float32_would_round_away_are_refused() -> None:
    # A stage of TR-BDF2 is 5 ms: gravity moves nodes by a quarter of what float32 resolves there, and nothing moves.
    far = hanging((9, 9), position=(1e4, -1e4, 1e4))
    for options in ({"integrator": "tr-bdf2"}, {"integrator": "bdf2", "substeps": 4}):
        with pytest.raises(InputError, match=r'precision = "float32": resolves 0.00098 m .* they would stand still'):
            build(far, **options)
    exact = build(far, integrator="tr-bdf2", precision="float64")
    near = run(build(hanging((9, 9)), integrator="tr-bdf2", precision="float64"))
    np.testing.assert_allclose(run(exact) - [1e4, -1e4, 1e4], near, atol=1e-7)
    assert not build(far, gravity=(0.0, 0.0, 0.0), integrator="tr-bdf2").notes


@pytest.mark.parametrize("method", METHODS)
def test_a_thousand_gravities(method: str) -> None:
    simulation = build(hanging((9, 9)), integrator=method, gravity=(0.0, 0.0, -1e4), fps=600.0)
    before = total(simulation)
    positions = run(simulation, 60)
    # Two corners carry two kilonewtons at 1000 N/m: a few times its length.
    assert positions[..., 2].min() < -0.4
    assert 2.0 < simulation.record().max_stretch < 10.0
    assert total(simulation) < before + 1e-2 * 0.2 * 1e4


def test_wind_of_a_thousand_metres_a_second_is_refused() -> None:
    with pytest.raises(
        InputError, match=r"velocity = .*: is not the velocity of a wind. Use three numbers in m/s below 340"
    ):
        Wind((0.0, 0.0, 1000.0))


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["curve", "surface", "solid"])
def test_wind_as_fast_as_sound(kind: str, method: str) -> None:
    bodies = {
        "curve": Body("b", line((9,), 0.5), RUBBER, section=Section.circular(0.01), pins=(Pin("end:0"),)),
        "surface": hanging((9, 9), name="b", pins=(Pin("edge:u,0"),)),
        "solid": Body("b", block((5, 3, 3), (0.5, 0.2, 0.2)), RUBBER, pins=(Pin("face:u,0"),)),
    }
    simulation = build(bodies[kind], wind=Wind((0.0, 100.0, 320.0)), integrator=method)
    positions = run(simulation, 12)
    assert positions[..., 2].max() > 0.02
    speed = np.linalg.norm(simulation["b"].velocities(), axis=-1).max()
    assert speed < 500.0


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("kind", ["curve", "surface", "solid"])
def test_an_obstacle_that_starts_ten_centimetres_inside(kind: str, method: str) -> None:
    shapes: dict[str, Callable[[], Body]] = {
        "curve": lambda: Body("b", line((17,), 1.0), RUBBER, section=Section.circular(0.01), position=(-0.5, 0, 0)),
        "surface": lambda: hanging((9, 9), name="b", pins=(), position=(-0.5, -0.5, 0.0)),
        "solid": lambda: Body("b", block((5, 5, 3), (0.4, 0.4, 0.2)), RUBBER, position=(-0.2, -0.2, 0.0)),
    }
    # A ball whose top is 10 cm above the body.
    ball = Obstacle("sphere", {"radius": 0.3}, track=Track.fixed((0.0, 0.0, -0.2)))
    if method == "verlet":
        with pytest.raises(InputError, match=r'integrator = "verlet": would shoot body "b" out of the obstacle'):
            build(shapes[kind](), obstacles=[ball], integrator=method)
        return
    simulation = build(shapes[kind](), obstacles=[ball], integrator=method)
    positions = run(simulation, 30)
    depth = 0.3 - np.linalg.norm(positions - [0.0, 0.0, -0.2], axis=-1).min()
    assert depth < 0.02  # out again
    assert np.abs(positions).max() < 30.0  # and not shot away
    assert np.linalg.norm(simulation["b"].velocities(), axis=-1).max() < 25.0


@pytest.mark.parametrize("method", METHODS)
def test_an_obstacle_at_fifty_metres_a_second(method: str) -> None:
    ball = Obstacle("sphere", {"radius": 0.2}, track=Track.line((0.5, 0.5, -2.0), (0.5, 0.5, 3.0), 0.0, 0.1))
    simulation = build(hanging((17, 17), pins=(Pin("edge:u,0"), Pin("edge:u,1"))), obstacles=[ball], integrator=method)
    for _ in range(6 if method == "verlet" else 30):  # the ball is through after three
        simulation.advance_frame()
        positions = simulation["sheet"].positions()
        assert np.isfinite(positions).all()
        centre = ball.track.pose(simulation.time)[0]
        assert 0.2 - np.linalg.norm(positions - centre, axis=-1).min() < 0.05
    assert simulation.record().max_stretch < 25.0


@pytest.mark.parametrize("method", METHODS)
def test_a_surface_that_starts_inside_out(method: str) -> None:
    shape = tube((12, 6), 0.2, 0.5)
    start = shape.positions * [1.0, -1.0, 1.0]  # a mirror image: curved the other way, seen from its normal
    simulation = build(
        Body("b", shape, replace(CLOTH, bending_stiffness=1e-2), initial_positions=start, pins=(Pin("edge:v,0"),)),
        integrator=method,
    )
    before = total(simulation)
    positions = run(simulation)
    assert total(simulation) < before + 1e-3
    assert np.linalg.norm(positions[..., :2], axis=-1).max() < 0.5
    assert simulation["b"].max_stretch() < 1.3


@pytest.mark.parametrize("barrier", [None, 2e4])
def test_a_solid_that_starts_inside_out(barrier: float | None) -> None:
    shape = block((4, 4, 4), (0.2, 0.2, 0.2))
    body = Body(
        "b", shape, replace(RUBBER, inversion_barrier=barrier), initial_positions=shape.positions * [1.0, 1.0, -1.0]
    )
    if barrier:
        with pytest.raises(InputError, match="inside out"):
            build(body)
        return
    # Without a barrier a mirror image is as good: its metric is the same.
    simulation = build(body, gravity=(0.0, 0.0, 0.0))
    np.testing.assert_allclose(run(simulation, 10), body.placed_positions(), atol=1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("nodes", [(2, 2), (3, 257), (257, 3)])
def test_the_smallest_grids_and_long_ones(nodes: tuple[int, int], method: str) -> None:
    size = [0.02 * (n - 1) for n in nodes] if max(nodes) > 2 else [1.0, 1.0]
    body = hanging(shape=sheet(nodes, size), pins=(Pin("edge:u,0"),))
    simulation = build(body, integrator=method)
    before = total(simulation)
    mass = float(simulation["sheet"].model.node_mass.sum())
    positions = run(simulation, 10)
    assert positions[..., 2].min() < -0.008
    assert total(simulation) < before + 1e-2 * mass * 9.81 * max(size)
    assert simulation.record().max_stretch < 1.5


def test_a_strip_of_three_by_a_thousand() -> None:
    body = hanging(shape=sheet((3, 1025), (0.02, 10.24)), pins=(Pin("edge:v,0"),))
    simulation = build(body)
    before = total(simulation)
    mass = float(simulation["sheet"].model.node_mass.sum())
    positions = run(simulation, 10)
    assert positions[..., 2].min() < -0.1
    assert total(simulation) < before + 1e-2 * mass * 9.81 * 10.24
    assert simulation.record().max_stretch < 1.5


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("preconditioner", ["none", "jacobi", "block-jacobi", "multigrid", "cheapest"])
def test_nothing_to_do(preconditioner: str, precision: str) -> None:
    bodies = hanging((9, 9), pins=()), Body("jelly", block((3, 3, 3), (0.1, 0.1, 0.1)), RUBBER)
    options = {"preconditioner": preconditioner, "precision": precision, "gravity": (0.0, 0.0, 0.0)}
    for newton in (1, 0):
        simulation = build(*bodies, newton_iterations=newton, **options)
        before = [handle.positions() for handle in simulation.bodies]
        run(simulation, 5)
        for handle, start in zip(simulation.bodies, before, strict=True):
            np.testing.assert_allclose(handle.positions(), start, atol=1e-6)
        assert simulation.record().cg_breakdowns == 0


@pytest.mark.parametrize("method", [*METHODS, "implicit-euler", "terzopoulos", "linear-implicit"])
def test_everything_held(method: str) -> None:
    bodies = (
        hanging((5, 5), pins=(Pin("all"),)),
        Body("rod", line((9,), 0.5), RUBBER, section=Section.circular(0.01), pins=(Pin("all"),)),
        Body("jelly", block((3, 3, 3), (0.1, 0.1, 0.1)), RUBBER, pins=(Pin("all"),)),
    )
    for body in bodies if "terzopoulos" not in method else bodies[:1]:
        simulation = build(body, integrator=method)
        np.testing.assert_array_equal(run(simulation, 5), np.float32(body.placed_positions()))
        assert not simulation["sheet" if body is bodies[0] else body.name].velocities().any()


@pytest.mark.parametrize("duration", [0.0, 1e-3])
def test_a_step_longer_than_the_scene(duration: float) -> None:
    changed = {"scene.duration": duration, "scene.fps": 1.0, "body.0.nodes": [5, 5], "solver.device": "cpu"}
    scene = load_scene("hanging", [Override(key, value) for key, value in changed.items()])
    played = play(scene)
    assert played.failure is None
    assert played.record.frames == 1
    assert played.record.steps == 0


@pytest.mark.parametrize("method", [*METHODS, "implicit-euler"])
def test_springs_of_a_giant(method: str) -> None:
    body = hanging((5, 5), pins=(), springs=(Spring("corner:0,0", 1e8), Spring("corner:0,1", 1e8)))
    simulation = build(body, integrator=method, precision="float64")
    positions = run(simulation, 3 if method == "verlet" else 20)
    np.testing.assert_allclose(positions[0, 0], [0.0, 0.0, 0.0], atol=1e-5)


def test_what_cannot_be_done_is_refused_or_stopped_with_a_reason() -> None:
    with pytest.raises(InputError, match="stable up to"):
        build(
            hanging((5, 5), material=replace(MEMBRANE, membrane_stiffness=1e9)), integrator="verlet", time_step="fixed"
        )
    simulation = build(hanging((9, 9), material=replace(CLOTH, membrane_stiffness=1e9)), integrator="terzopoulos")
    before = simulation["sheet"].positions()
    with pytest.raises(SimulationFailure, match="Use "):
        run(simulation)
    assert np.isfinite(simulation["sheet"].positions()).all()
    assert np.abs(simulation["sheet"].positions() - before).max() < 1e3
    with pytest.raises(InputError, match="gravity"):
        Settings(gravity=(0.0, 0.0, float("nan")))
