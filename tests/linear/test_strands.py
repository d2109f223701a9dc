"""The direct solve along strands: the exact inverse, and one or two iterations however long and stiff a strand is."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from bodies import CORNERS
from curves import CASES, FLAT, ROUND, SHAPES, Curve, FakeModel, crumpled, line, segment_lengths
from surfaces import MATERIALS, REALS, WIDTHS

from warpdeform.body import Body
from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.kernels import krylov as entries
from warpdeform.linear import ConjugateGradient, LinearOperator, Sums, choose_preconditioner
from warpdeform.linear.cheapest import Cheapest
from warpdeform.linear.multigrid import Multigrid
from warpdeform.linear.strands import StrandInverse
from warpdeform.material import Material
from warpdeform.model import Model
from warpdeform.shape import sheet
from warpdeform.state import State

Array = np.ndarray[Any, Any]
CPU = wp.get_device("cpu")


class Contact(Force):
    """A wall that presses on every second node."""

    name = "contact"

    def __init__(self, curve: Curve, stiffness: float) -> None:
        normal = np.array([0.6, 0.0, 0.8])
        blocks = np.zeros((*curve.nodes, 6))
        outer = [normal[a] * normal[b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        blocks[::2] = stiffness * np.array(outer)
        self.blocks, self._packed = blocks, curve.layout.pack(blocks)

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        blocks.assign(blocks.numpy() + self._packed)


class System:
    """A d = -g of one deformed curve body; every strand pinned where `pins` says (rows)."""

    def __init__(
        self, curve: Curve, z: Array, *, pins: tuple[int, ...] = (0, -1), contact: float = 0.0, tau: float = 1 / 60,
        tolerance: float = 1e-4, preconditioner: str = "auto", linear_density: float = 0.1,
    ) -> None:  # fmt: skip
        self.curve, self.pinned = curve, np.zeros(curve.nodes, dtype=bool)
        self.pinned[list(pins)] = True
        self.mass = linear_density * curve.grid.cells_to_nodes(segment_lengths(curve))
        self.state = State(FakeModel(curve, self.mass, self.pinned), wp.zeros(1, dtype=wp.int32, device=CPU))
        self.state.z.assign(curve.layout.pack(z))
        terms: list[Force] = [curve.force] + ([Contact(curve, contact)] if contact else [])
        curve.force.linearise(self.state, self.state.z)
        self.operator = LinearOperator([self.state], [terms])
        self.operator.set_tau(tau)
        self.operator.update()
        self.preconditioner = choose_preconditioner(preconditioner, self.operator)
        self.solver = ConjugateGradient(self.operator, self.preconditioner, Sums([self.state]), tolerance, 2000)
        self.tau = tau

    def matrix(self) -> Array:
        """A on the free nodes, the identity on the pinned ones."""
        H = self.curve.hessian() + np.diag(np.repeat(self.mass.ravel(), 3)) / self.tau**2
        for term in self.operator.terms[0][1:]:
            blocks = term.blocks[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(-1, 3, 3)
            for k, block in enumerate(blocks):
                H[3 * k : 3 * k + 3, 3 * k : 3 * k + 3] += block
        free = np.repeat(~self.pinned.ravel(), 3)
        return np.where(free[:, None] & free, H, np.eye(len(H)))

    def inverse(self, residual: Array) -> Array:
        solve = StrandInverse(self.operator.grids[0])
        solve.update()
        out = self.curve.upload(np.full_like(residual, np.nan))
        solve.apply(self.curve.upload(residual), out)
        return self.curve.download(out)

    def iterations(self) -> int:
        """Iterations for a load that bends and stretches the strands everywhere, smoothly and roughly."""
        rough = np.random.default_rng(7).normal(size=(*self.curve.nodes, 3))
        load = self.mass[..., None] * (np.array([0.0, 0.0, 9.81]) + 1e-2 * rough)
        self.state.gradient.assign(self.curve.layout.pack(load * ~self.pinned[..., None]))
        self.solver.solve()
        found = self.solver.state.numpy()
        assert found[entries.BREAKDOWN] == found[entries.RETREATS] == 0
        return int(found[entries.ITERATIONS])


def waved(rest: Array) -> Array:
    """Stretched a little and bent: what takes a strand out of a plane and out of its rest curvature."""
    s = np.linspace(0, 6, len(rest))[:, None, None]
    return rest * 1.001 + 0.05 * (np.sin(s) * [0.0, 0.0, 1.0] + np.cos(1.3 * s) * [0.0, 1.0, 0.0])


@pytest.mark.parametrize("contact", [0.0, 1e3])
@pytest.mark.parametrize("width", WIDTHS[wp.float64])
@pytest.mark.parametrize("name", CASES)
def test_the_solve_is_the_inverse(name: str, width: int, contact: float) -> None:
    curve = Curve.of(name, (9, 3), lane_width=width)
    system = System(curve, crumpled(curve.rest), pins=(0, 1, 5), contact=contact)
    residual = np.random.default_rng(3).normal(size=(9, 3, 3)) * ~system.pinned[..., None]
    found = system.inverse(residual)
    assert not found[system.pinned].any()
    expected = np.linalg.solve(system.matrix(), residual.ravel()).reshape(found.shape)
    assert np.abs(found - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize(("closed", "count"), [(False, 2), (False, 3), (True, 4), (True, 5)])
def test_the_shortest_strands(closed: bool, count: int) -> None:
    for section in (ROUND, FLAT):
        rest = SHAPES["ring" if closed else "helix"](count, 2)
        curve = Curve(rest, CASES["ring"].material, section=section, closed=closed)
        system = System(curve, crumpled(rest), pins=())
        residual = np.random.default_rng(3).normal(size=(count, 2, 3))
        expected = np.linalg.solve(system.matrix(), residual.ravel()).reshape(residual.shape)
        assert np.abs(system.inverse(residual) - expected).max() < 1e-9 * np.abs(expected).max()


def test_held_directors_are_no_unknowns() -> None:
    curve = Curve.of("helix", (9, 3))
    held = np.zeros((8, 3), dtype=bool)
    held[[0, 4, 7]] = True
    curve.force.frames.hold(held)
    system = System(curve, crumpled(curve.rest), pins=(0, 1))
    residual = np.random.default_rng(3).normal(size=(9, 3, 3)) * ~system.pinned[..., None]
    expected = np.linalg.solve(system.matrix(), residual.ravel()).reshape(residual.shape)
    assert np.abs(system.inverse(residual) - expected).max() < 1e-9 * np.abs(expected).max()


STIFFNESSES = [(1.0, 0.0), (1.0, 1.0), (1e3, 1e-6), (1e3, 1e-3), (1e6, 0.0), (1e6, 1e-3), (1e6, 1.0)]
"""EA [N] and EI [N m2] of strands of a metre and ten grams."""


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("count", [17, 129, 1025])
@pytest.mark.parametrize("kind", ["plain", "framed", "closed"])
def test_iterations_do_not_depend_on_length_and_stiffness(kind: str, count: int, real: Any) -> None:
    found = {}
    closed, tolerance = kind == "closed", 1e-4 if real is wp.float64 else 1e-3
    for axial, bending in STIFFNESSES:
        if not bending and kind != "plain":
            continue
        material = Material(linear_density=0.01, axial_stiffness=axial, bending_stiffness=bending)
        rest = SHAPES["ring" if closed else "line"](count, 3)
        curve = Curve(rest, material, real, WIDTHS[real][1], closed=closed, framed=kind == "framed")
        pins = (0,) if closed else (0, -1)
        found[axial, bending] = System(
            curve, waved(rest), pins=pins, tolerance=tolerance, linear_density=0.01
        ).iterations()
    print(f"\n{kind}, {count} nodes, {real.__name__}, EA and EI: {found}")
    assert max(found.values()) <= 2


@pytest.mark.parametrize("real", REALS)
def test_a_free_strand_and_stiff_contact(real: Any) -> None:
    rest = line(65, 3)
    curve = Curve(
        rest, Material(linear_density=0.01, axial_stiffness=1e4, bending_stiffness=1e-3), real, WIDTHS[real][1]
    )
    for contact in (0.0, 1e2, 1e6):
        system = System(curve, waved(rest), pins=(), contact=contact, tolerance=1e-3, linear_density=0.01)
        assert system.iterations() <= 3


def test_curves_take_the_direct_solve_by_themselves() -> None:
    curve = Curve.of("ring", (9, 3))
    system = System(curve, curve.rest)
    assert isinstance(system.preconditioner, Multigrid)
    (level,) = system.preconditioner.levels
    assert level.coarse is None
    assert isinstance(level.strands, StrandInverse)
    assert level.bytes() == level.strands.bytes() > 38 * 8 * 9 * 3


def test_curves_are_solved_directly_beside_other_bodies_too() -> None:
    """Whatever suits the sheet: curves have no part in the trials of the cheapest preconditioner."""
    curve, rest = Curve.of("helix", (33, 2)), sheet((17, 17))
    strands = System(curve, waved(curve.rest))
    body = Body("sheet", rest, MATERIALS["isotropic"], pins=CORNERS)
    state = State(Model(body, "float64", CPU), wp.zeros(1, dtype=wp.int32, device=CPU))
    state.z.assign(state.layout.pack(rest.positions))
    elastic = SurfaceElasticity(state.model.grid, state.layout, rest.positions, body.material, wp.float64, CPU)
    elastic.linearise(state, state.z)
    states = [strands.state, state]
    operator = LinearOperator(states, [[curve.force], [elastic]])
    operator.set_tau(1 / 60)
    operator.update()
    preconditioner = choose_preconditioner("auto", operator)
    assert isinstance(preconditioner, Cheapest)
    preconditioner.multigrid.update_blocks()
    residual = np.random.default_rng(3).normal(size=(33, 2, 3)) * ~strands.pinned[..., None]
    strands.state.residual.assign(curve.layout.pack(residual))
    expected = strands.inverse(residual)
    for apply in (preconditioner.multigrid.apply_blocks, preconditioner.multigrid.apply_cycle):
        strands.state.conditioned.fill_(np.nan)
        apply()
        np.testing.assert_array_equal(curve.download(strands.state.conditioned), expected)
        preconditioner.multigrid.update_coarse()
