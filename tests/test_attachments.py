"""Bodies that hang on each other: soft ties are springs, rigid ones make one body of two."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp

import warpdeform as wd
from warpdeform.attachment import Attachment, find_ties
from warpdeform.errors import InputError
from warpdeform.forces.ties import RigidTies, SoftTies
from warpdeform.model import Model
from warpdeform.state import State

Array = np.ndarray[Any, Any]
MEMBRANE = wd.Material(areal_density=0.2, membrane_stiffness=500.0, poisson_ratio=0.3)
CPU = wp.get_device("cpu")


def body(name: str, nodes: tuple[int, int], size: tuple[float, float], **how: Any) -> wd.Body:
    return wd.Body(name, wd.sheet(nodes, size), MEMBRANE, **how)


def states(*bodies: wd.Body, lane_width: int | None = None) -> list[State]:
    iteration = wp.zeros(1, dtype=wp.int32, device=CPU)
    return [State(Model(each, "float64", CPU, lane_width), iteration) for each in bodies]


def placed(state: State, name: str, values: Array) -> None:
    getattr(state, name).assign(state.layout.pack(values))


def read(state: State, name: str) -> Array:
    return state.model.download(getattr(state, name))


@pytest.mark.parametrize("lane_width", [1, 8])
def test_soft_ties_are_springs(lane_width: int) -> None:
    a, b = body("a", (4, 5), (0.6, 0.8)), body("b", (3, 3), (1.0, 1.0), position=(-0.1, 0.0, 0.3))
    first, second = states(a, b, lane_width=lane_width)
    ties = find_ties(Attachment("a", "edge:u,0", "b", "nearest", 7.0), {"a": a, "b": b})
    term = SoftTies(first, second, ties, 7.0)
    random = np.random.default_rng(0)
    za, zb = random.normal(size=(4, 5, 3)), random.normal(size=(3, 3, 3))

    def energy(za: Array, zb: Array) -> float:
        placed(first, "x", za)
        placed(second, "x", zb)
        return term.stored_energy()

    points = np.einsum("km,kmc->kc", ties.weights, zb[tuple(np.moveaxis(ties.points, -1, 0))])
    assert energy(za, zb) == pytest.approx(3.5 * np.sum((za[0] - points) ** 2))
    placed(first, "z", za)
    placed(second, "z", zb)
    for state in (first, second):
        state.gradient.zero_()
    term.linearise("z")
    term.add_gradient("z", "gradient")
    ga, gb = read(first, "gradient"), read(second, "gradient")
    np.testing.assert_allclose(ga.sum(axis=(0, 1)) + gb.sum(axis=(0, 1)), 0.0, atol=1e-12)
    da, db, h = random.normal(size=za.shape), random.normal(size=zb.shape), 1e-6
    slope = (energy(za + h * da, zb + h * db) - energy(za - h * da, zb - h * db)) / (2 * h)
    assert np.vdot(ga, da) + np.vdot(gb, db) == pytest.approx(slope, rel=1e-7)
    # It is quadratic: the product with a direction is the change of the gradient.
    placed(first, "search", da)
    placed(second, "search", db)
    for state in (first, second):
        state.product.zero_()
    term.add_hessian_product("search", "product")
    placed(first, "z", za + da)
    placed(second, "z", zb + db)
    for state in (first, second):
        state.gradient.zero_()
    term.linearise("z")
    term.add_gradient("z", "gradient")
    changes = (read(first, "gradient") - ga, read(second, "gradient") - gb)
    for state, change, direction in zip((first, second), changes, (da, db), strict=True):
        blocks = state.model.zeros(6)
        term.add_node_blocks(state, blocks)
        own = state.model.download(blocks)[..., :1] * direction
        np.testing.assert_allclose(read(state, "product") + own, change, atol=1e-10)
    expected = np.zeros((3, 3))
    for points_of, weights in zip(ties.points, ties.weights, strict=True):
        for node, weight in zip(points_of, weights, strict=True):
            expected[tuple(node)] += 7.0 * weight**2
    np.testing.assert_allclose(second.model.download(blocks), expected[..., None] * [1, 1, 1, 0, 0, 0], atol=1e-12)


def test_rigid_ties_spread_and_gather_are_transposes() -> None:
    a, b = body("a", (4, 5), (0.6, 0.8)), body("b", (3, 3), (1.2, 0.8), pins=(wd.Pin("corner:0,0"),))
    first, second = states(a, b)
    ties = find_ties(Attachment("a", "edge:u,0", "b", "nearest"), {"a": a, "b": b})
    term = RigidTies(first, second, ties)
    random = np.random.default_rng(1)
    q, g = (
        [random.normal(size=(*s.layout.nodes, 3)) * s.model.download(s.free) for s in (first, second)] for _ in range(2)
    )
    q[0][0] = 0.0  # followers are no unknowns
    for state, values in zip((first, second), q, strict=True):
        placed(state, "search", values)
    for state, values in zip((first, second), g, strict=True):
        placed(state, "gradient", values)
    term.spread("search")
    term.gather("gradient")
    spread = sum(np.vdot(read(s, "search"), v) for s, v in zip((first, second), g, strict=True))
    gathered = sum(np.vdot(v, read(s, "gradient")) for s, v in zip((first, second), q, strict=True))
    assert spread == pytest.approx(gathered, rel=1e-12)
    assert not read(first, "gradient")[0].any()
    assert not read(second, "gradient")[0, 0].any(), "pinned"


def halves(preconditioner: str, stiffness: float | None = None) -> wd.Simulation:
    """A hanging membrane that was cut in two and tied again."""
    left = body("left", (6, 9), (0.5, 0.8), pins=(wd.Pin("corner:0,0"), wd.Pin("corner:0,1")))
    right = body("right", (5, 9), (0.4, 0.8), position=(0.5, 0.0, 0.0))
    seam = wd.Attachment("right", "edge:u,0", "left", "edge:u,1", stiffness)
    return wd.Simulation([left, right], attachments=[seam], settings=settings(preconditioner))


def settings(preconditioner: str) -> wd.Settings:
    return wd.Settings(
        precision="float64", preconditioner=preconditioner, cg_tolerance=1e-10, newton_iterations=0, device="cpu",
        newton_tolerance=1e-9,
    )  # fmt: skip


@pytest.mark.parametrize("preconditioner", ["block-jacobi", "multigrid"])
def test_two_halves_that_are_tied_rigidly_are_one_sheet(preconditioner: str) -> None:
    whole = body("whole", (10, 9), (0.9, 0.8), pins=(wd.Pin("corner:0,0"), wd.Pin("corner:0,1")))
    one, two = wd.Simulation([whole], settings=settings(preconditioner)), halves(preconditioner)
    for _ in range(10):
        one.step()
        two.step()
    expected = one["whole"].positions()
    np.testing.assert_allclose(two["left"].positions(), expected[:6], atol=1e-7)
    np.testing.assert_allclose(two["right"].positions(), expected[5:], atol=1e-7)
    np.testing.assert_allclose(two["right"].velocities(), one["whole"].velocities()[5:], atol=1e-5)
    assert np.abs(expected - whole.placed_positions()).max() > 0.05


def test_soft_seams_tend_to_the_rigid_one_as_they_stiffen() -> None:
    rigid = halves("block-jacobi")
    gaps = []
    for stiffness in (10.0, 1000.0):
        soft = halves("block-jacobi", stiffness)
        for _ in range(5):
            soft.step()
        gaps.append(np.abs(soft["left"].positions()[-1] - soft["right"].positions()[0]).max())
        assert soft.record().energy.field > 0.0
    for _ in range(5):
        rigid.step()
    assert gaps[1] < 0.05 * gaps[0]
    np.testing.assert_allclose(soft["right"].positions(), rigid["right"].positions(), atol=20 * gaps[1])


def test_weight_is_carried_over_ties_and_momentum_kept() -> None:
    """Without gravity two bodies that pull at each other keep their momentum."""
    left = body("left", (4, 4), (0.3, 0.3), velocity=(0.0, 0.0, 1.0))
    right = body("right", (5, 3), (0.3, 0.3), position=(0.3, 0.0, 0.0))
    free = replace(settings("block-jacobi"), gravity=(0.0, 0.0, 0.0))
    for stiffness in (None, 50.0):
        seam = wd.Attachment("right", "edge:u,0", "left", "edge:u,1", stiffness)
        simulation = wd.Simulation([left, right], attachments=[seam], settings=free)
        for _ in range(10):
            simulation.step()
        momentum = sum(np.einsum("ij,ijc->c", h.model.node_mass, h.velocities()) for h in simulation.bodies)
        start = np.array([0.0, 0.0, simulation["left"].model.node_mass.sum()])
        if stiffness is None:  # what follows takes the velocity of what it follows: a plastic impact keeps less
            assert momentum[2] > 0.5 * start[2]
        else:
            np.testing.assert_allclose(momentum, start, atol=1e-9)


def test_points_are_found_between_nodes() -> None:
    cloth = body("cloth", (5, 4), (0.4, 0.3), position=(0.05, 0.033, 0.0))
    table = body("table", (4, 3), (0.9, 0.6))
    bodies = {"cloth": cloth, "table": table}
    ties = find_ties(Attachment("cloth", "all", "table"), bodies)
    found = np.einsum("km,kmc->kc", ties.weights, table.placed_positions()[tuple(np.moveaxis(ties.points, -1, 0))])
    np.testing.assert_allclose(found, cloth.placed_positions().reshape(-1, 3), atol=1e-9)
    given = find_ties(Attachment("cloth", "corner:1,1", "table", [[0.5, 0.25]], 1.0), bodies)
    point = np.einsum("km,kmc->kc", given.weights, table.placed_positions()[tuple(np.moveaxis(given.points, -1, 0))])
    np.testing.assert_allclose(point, [[0.45, 0.15, 0.0]], atol=1e-12)


def test_a_point_of_a_single_strand_is_one_parameter() -> None:
    law = wd.Material(linear_density=0.1, axial_stiffness=50.0)
    bodies = {"cloth": body("cloth", (5, 4), (0.4, 0.3)), "rod": wd.Body("rod", wd.shape.line((9,), 0.8), law)}
    ties = find_ties(Attachment("cloth", [[0, 0], [1, 0]], "rod", [[0.5], [0.9]], 1.0), bodies)
    found = np.einsum(
        "km,kmc->kc", ties.weights, bodies["rod"].placed_positions()[tuple(np.moveaxis(ties.points, -1, 0))]
    )
    np.testing.assert_allclose(found, [[0.4, 0.0, 0.0], [0.72, 0.0, 0.0]], atol=1e-12)


BAD = {
    "nobody": (wd.Attachment("nobody", "all", "left"), "is no body of the scene"),
    "outside": (wd.Attachment("right", [[9, 9]], "left", stiffness=1.0), "lies outside the grid"),
    "counts": (wd.Attachment("right", "edge:u,0", "left", [[0, 0], [2, 2]], 1.0), "is 2 nodes for 3 attached ones"),
    "parameters": (wd.Attachment("right", "edge:u,0", "left", [[0.5, 2.0]], 1.0), "parameters from 0 to 1"),
    "apart": (wd.Attachment("right", "edge:u,1", "left"), "m from where node"),
    "pinned": (wd.Attachment("left", "corner:0,0", "right", "corner:0,0"), "is pinned and cannot follow"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_attachments_are_refused(name: str) -> None:
    attachment, words = BAD[name]
    left = body("left", (4, 4), (0.3, 0.3), pins=(wd.Pin("corner:0,0"),))
    right = body("right", (5, 3), (0.3, 0.3), position=(0.0, 0.0, 0.0) if name == "pinned" else (0.3, 0.0, 0.0))
    with pytest.raises(InputError, match=words) as caught:
        wd.Simulation([left, right], attachments=[attachment], settings=wd.Settings(device="cpu"))
    assert caught.value.mistakes[0].key.startswith("attachment.0.")


def test_followers_do_not_follow_each_other() -> None:
    strips = [body(f"s{k}", (3, 3), (0.2, 0.2), position=(0.2 * k, 0.0, 0.0)) for k in range(3)]
    chain = [
        wd.Attachment("s1", "edge:u,0", "s0", "edge:u,1"),
        wd.Attachment("s0", "edge:u,1", "s1", "edge:u,0"),
    ]
    with pytest.raises(InputError, match="is itself followed"):
        wd.Simulation(strips, attachments=chain, settings=wd.Settings(device="cpu"))
    with pytest.raises(InputError, match="follows two points"):
        wd.Simulation(strips, attachments=[chain[0], chain[0]], settings=wd.Settings(device="cpu"))
    with pytest.raises(InputError, match="must be positive"):
        wd.Attachment("s0", "all", "s1", stiffness=-1.0)
