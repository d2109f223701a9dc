"""What curves, surfaces and solids have in common: mass, pins, springs, contact, reports."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp

from warpdeform.body import Body, Pin, Spring
from warpdeform.errors import InputError
from warpdeform.material import Material
from warpdeform.measure import exposed_shares
from warpdeform.model import Model
from warpdeform.obstacle import Obstacle
from warpdeform.section import Section
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, block, line, pipe, ring, root_line, strands
from warpdeform.simulation import Simulation
from warpdeform.tensors import CurveCurvature
from warpdeform.track import Track
from warpdeform.wind import Wind

CPU = wp.get_device("cpu")
SETTINGS = Settings(integrator="implicit-euler", precision="float64", preconditioner="block-jacobi", device="cpu")
SHAPES: dict[str, RestShape] = {
    "line": line((9,), 1.0),
    "fringe": strands(line((6,), 1.0), root_line(11, 0.5)),
    "ring": ring((9,), 0.4),
    "block": block((3, 4, 11), (0.5, 0.4, 0.3)),
    "pipe": pipe((8, 3, 4), 0.5, 0.4, 0.1),
}
MATERIALS = {
    "curve": Material(linear_density=0.1, axial_stiffness=1e-6),
    "solid": Material(density=500.0, eta=1e-6),
}
"""Too weak to be noticed."""
SECTION = Section.circular(0.005)
FIRST = {"curve": "end:0", "solid": "face:u,0"}
LAST = {"curve": "end:1", "solid": "face:u,1"}


def model(shape: RestShape, **body: Any) -> Model:
    return Model(Body("body", shape, MATERIALS[shape.kind], **body), "float64", CPU)


@pytest.mark.parametrize(("name", "mass"), [
    ("line", 0.1), ("fringe", 1.1), ("ring", 0.08 * np.pi), ("block", 30.0), ("pipe", 20 * np.pi),
])  # fmt: skip
def test_mass_is_density_times_measure(name: str, mass: float) -> None:
    shape = SHAPES[name]
    found = model(shape)
    assert found.node_mass.shape == shape.nodes
    assert found.node_mass.sum() == pytest.approx(mass, rel=0.11)
    assert found.mass.numpy().sum() == pytest.approx(found.node_mass.sum(), rel=1e-12)


def test_lengths_and_spacing() -> None:
    fringe = model(SHAPES["fringe"])
    assert fringe.lengths == (pytest.approx(0.2), np.inf)
    assert fringe.spacing == pytest.approx(0.2)
    brick = model(SHAPES["block"])
    assert brick.lengths == pytest.approx((0.25, 0.4 / 3, 0.03))
    assert brick.spacing == pytest.approx(0.03)


@pytest.mark.parametrize("name", SHAPES)
def test_stretch_sees_every_edge_around_the_seam_too(name: str) -> None:
    shape = SHAPES[name]
    body = model(shape)
    assert body.max_stretch(body.upload(shape.positions)) == pytest.approx(1.0)
    for axis in range(shape.dimension):
        pulled = shape.positions.copy()
        first, last = ((slice(None),) * axis + (end,) for end in (0, -1))
        direction = pulled[last] - pulled[first]
        length = np.linalg.norm(direction, axis=-1).min()
        pulled[last] += direction * (2.0 if not shape.periodic[axis] else 1.0)
        assert body.max_stretch(body.upload(pulled)) > 1.5, (axis, length)


@pytest.mark.parametrize("lane_width", [1, 8])
@pytest.mark.parametrize("name", SHAPES)
def test_pins_hold_springs_pull_and_the_rest_falls(name: str, lane_width: int) -> None:
    shape = SHAPES[name]
    led = Track.line((0.0, 0.0, 0.0), (0.3, 0.0, 0.0), 0.0, 1.0)
    body = Body(
        "body",
        shape,
        MATERIALS[shape.kind],
        pins=(Pin(FIRST[shape.kind], led),),
        springs=(Spring(LAST[shape.kind], 7.0),),
    )
    simulation = Simulation([body], settings=SETTINGS, lane_width=lane_width)
    dt = simulation.dt
    for _ in range(3):
        simulation.step()
    handle = simulation["body"]
    positions = handle.positions()
    assert positions.shape == shape.positions.shape
    np.testing.assert_allclose(positions[0], shape.positions[0] + [0.3 * 3 * dt, 0, 0], atol=1e-12)
    fall = -9.81 * dt**2 * 6
    np.testing.assert_allclose(positions[1:-1], shape.positions[1:-1] + [0, 0, fall], atol=1e-9)
    assert (positions[-1, ..., 2] - shape.positions[-1, ..., 2] > fall * (1 - 1e-3)).all()
    energy = simulation.record().energy
    assert energy.kinetic > 0
    assert energy.gravity == pytest.approx(9.81 * np.sum(handle.model.node_mass * positions[..., 2]), rel=1e-9)


@pytest.mark.parametrize("name", SHAPES)
def test_bodies_come_to_rest_on_the_ground(name: str) -> None:
    shape = SHAPES[name]
    low = float(shape.positions[..., 2].min())
    body = Body("body", shape, MATERIALS[shape.kind], position=(0.0, 0.0, 0.01 - low), drag=20.0)
    floor = Obstacle("plane", friction=0.5)
    simulation = Simulation([body], obstacles=[floor], settings=replace(SETTINGS, precision="float32"))
    for _ in range(60):
        simulation.step()
    z = simulation["body"].positions()[..., 2]
    assert z.min() > 0.0
    if shape.kind == "solid":  # of solids obstacles hold the skin; these here are too soft to hold what is inside
        z = z[exposed_shares(shape.grid, shape.positions).any(axis=-1)]
    assert z.min() == pytest.approx(0.002, rel=0.2)
    assert np.isfinite(z).all()


def test_metric_and_curvature_of_what_a_kind_has() -> None:
    curve, solid = (
        Simulation([Body("body", SHAPES[name], MATERIALS[SHAPES[name].kind])], settings=SETTINGS)["body"]
        for name in ("ring", "block")
    )
    curvature = curve.curvature()
    assert isinstance(curvature, CurveCurvature)
    np.testing.assert_allclose(curvature.binormal[..., 2], 2.5, rtol=0.07)
    assert curve.metric().G11.shape == (9, 1)
    assert curve.metric().G22 is None
    assert solid.metric().G33 is not None
    with pytest.raises(ValueError, match="is a solid; curves and surfaces have a curvature"):
        solid.curvature()


def test_information_names_kind_and_nodes() -> None:
    bodies = [Body("rope", SHAPES["fringe"], MATERIALS["curve"]), Body("brick", SHAPES["block"], MATERIALS["solid"])]
    lines = Simulation(bodies, settings=SETTINGS, wind=Wind((1.0, 0.0, 0.0))).info().lines()
    assert lines[0].startswith("rope: curve 6 x 11, state ")
    assert any(line.startswith("brick: solid 3 x 4 x 11, state ") for line in lines)


def test_one_strand_may_be_given_without_its_axis() -> None:
    start = SHAPES["line"].positions[:, 0] + [0, 0, 1.0]
    body = Body("rope", SHAPES["line"], MATERIALS["curve"], initial_positions=start)
    assert body.nodes == (9, 1)
    np.testing.assert_array_equal(body.placed_positions()[:, 0], start)


def test_selectors_and_sections_follow_the_kind() -> None:
    with pytest.raises(InputError) as error:
        Body(
            "brick",
            SHAPES["block"],
            MATERIALS["solid"],
            section=SECTION,
            pins=(Pin("edge:u,0"),),
            springs=(Spring("end:0", 1.0),),
        )
    assert {mistake.key for mistake in error.value.mistakes} == {"section", "pins.0", "springs.0"}


def test_a_material_that_does_not_suit_the_kind_is_a_mistake_of_the_material() -> None:
    with pytest.raises(InputError, match=r"material\.linear_density: is missing beside eta"):
        Body("rope", SHAPES["line"], Material(density=500.0, eta=1.0))
    with pytest.raises(InputError, match=r"material\.axial_stiffness.*does not describe a solid"):
        Body("brick", SHAPES["block"], MATERIALS["curve"])
