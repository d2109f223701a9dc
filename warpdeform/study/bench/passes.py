"""What the kernel benchmark times: the passes of a Newton step, as data."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp

from warpdeform.body import Body
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.kernels.krylov import ALPHA, BETA, SOLVER_SCALARS, krylov, reductions
from warpdeform.kernels.products import products
from warpdeform.kernels.surface import surface
from warpdeform.material import Material
from warpdeform.model import Model
from warpdeform.shape import sheet
from warpdeform.state import State
from warpdeform.study.bench.yardstick import FLUXES, WEIGHTS, yardstick

YARDSTICK = "yardstick flux"


class Sheet:
    """The arrays of a crumpled square sheet with random vectors, for one lane width.

    Positions are the rest shape with every node moved at random by up to a fifth of an edge, so that stresses, tensions
    and curvatures are what they are in a wild step and no number is denormal.

    Args:
        nodes: Nodes along each side.
        precision: "float32" or "float64".
        width: Lane width.
        device: Warp device.

    Attributes:
        axes: Axes of the grid.
        side: Nodes along each side.
        node_count: Nodes in all.
        dim: Threads along each axis of a launch over lane groups.
        vector_size: Bytes of a vector.
    """

    axes = 2

    def __init__(self, nodes: int, precision: str, width: int, device: Any) -> None:
        self.side = nodes
        shape = sheet(nodes=(nodes, nodes), size=(1.0, 1.0))
        cloth = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3)
        shell = replace(cloth, bending_stiffness=1e-5)
        model = Model(Body("sheet", shape, shell), precision, device, width)
        self.state = State(model, wp.zeros(1, dtype=wp.int32, device=device))
        self.real, self.width, self.device = model.real, width, device
        self.vector_size = 3 * int(wp.types.type_size_in_bytes(model.real))
        self.node_count, self.dim = model.grid.node_count, model.layout.lane_dim
        self.membrane, self.shell = (
            SurfaceElasticity(model.grid, model.layout, shape.positions, material, model.real, device)
            for material in (cloth, shell)
        )
        self._random = np.random.default_rng(0)
        edge = 1.0 / (nodes - 1)
        moved = 0.2 * edge * self._random.uniform(-1.0, 1.0, (nodes, nodes, 3))
        self.x = model.upload(shape.positions + moved)
        self.p, self.r, self.z, self.q = (self.numbers(3) for _ in range(4))
        self.sum = model.zeros(3)
        self.blocks, self.inverse = model.zeros(6), self.numbers(6)
        self.weights = self.numbers(WEIGHTS)
        self.flux_u, self.flux_v = model.zeros(FLUXES), model.zeros(FLUXES)
        self.per_spacing = model.real(1.0 / edge)
        self.inertia: wp.array = wp.array([3600.0], dtype=model.real, device=device)
        scalars = np.zeros(SOLVER_SCALARS)
        scalars[[int(ALPHA), int(BETA)]] = 1e-3, 0.5
        self.scalars: wp.array = wp.array(scalars, dtype=wp.float64, device=device)
        self.rows = wp.zeros((2, nodes), dtype=wp.float64, device=device)
        self.membrane.linearise(self.state, self.x)
        self.shell.linearise(self.state, self.x)

    def numbers(self, components: int) -> wp.array:
        """A component array of random numbers between -1 and 1."""
        return self.state.model.upload(self._random.uniform(-1.0, 1.0, (*self.state.layout.nodes, components)))

    def launch(self, kernel: Any, *inputs: Any, rows: bool = False) -> None:
        """Launch a kernel once per lane group, or once per row."""
        wp.launch(kernel, dim=self.dim[0] if rows else self.dim, inputs=inputs, device=self.device)

    def flux(self, bending: bool) -> None:
        """The cell pass of the Hessian product."""
        e = self.shell if bending else self.membrane
        kernels = surface(self.width, self.real, True, bending)
        self.launch(kernels.product_cells, self.x, e.K, e.tension, e.K12, e.twist, self.p, e.flux)

    def nodes(self) -> None:
        """The node pass of the Hessian product."""
        e = self.shell
        kernels = surface(self.width, self.real, True, True)
        self.launch(kernels.product_nodes, e.KB, e.alpha_u, e.alpha_v, e.flexure, self.p, e.scatter)

    def gather(self, bending: bool) -> None:
        """The gather pass of gradient and Hessian product."""
        e = self.shell if bending else self.membrane
        kernels = surface(self.width, self.real, True, bending)
        self.launch(kernels.gather, e.fluxes.of_rows(0, self.dim[0]), self.sum)

    def product(self, bending: bool) -> None:
        """The Hessian product with the mass, as conjugate gradient makes it."""
        e = self.shell if bending else self.membrane
        e.write_fluxes(self.state, self.p)
        assert e.gathering is not None
        kernels = products(self.width, self.real, e.gathering, False)
        self.launch(kernels.product, 1, e.fluxes.of_rows(0, self.dim[0]), self.state.mass, self.inertia, self.p, self.q)

    def updates(self) -> None:
        """All that an iteration of conjugate gradient with block-Jacobi does besides the product."""
        k, sums, s = krylov(self.width, self.real), reductions(), self.state
        self.launch(k.mask_dot, s.free, self.p, self.q, s.dots)
        self.launch(sums.sum_rows, s.dots, self.width, self.rows, rows=True)
        self.launch(k.advance, self.scalars, self.p, self.q, self.sum, self.r)
        self.launch(k.apply_blocks, s.free, self.inverse, self.r, self.z, s.dots)
        self.launch(sums.sum_rows, s.dots, self.width, self.rows, rows=True)
        self.launch(k.turn, self.scalars, self.z, self.p)


@dataclass(frozen=True)
class Limit:
    """What a pass has to reach at the CPU's lane width in float32.

    Attributes:
        over_yardstick: Largest ratio to the yardstick of the same run.
        ns_per_node: Largest time per node [ns].
    """

    over_yardstick: float | None = None
    ns_per_node: float | None = None


@dataclass(frozen=True)
class Pass:
    """A pass: its name, how to launch it once on a sheet or block, and its limit."""

    name: str
    launch: Callable[[Any], None]
    limit: Limit | None = None


def _iteration(s: Sheet) -> None:
    s.product(True)
    s.updates()


PASSES = (
    Pass(
        YARDSTICK,
        lambda s: s.launch(yardstick(s.width, s.real), s.x, s.weights, s.per_spacing, s.p, s.flux_u, s.flux_v),
    ),
    Pass("membrane flux", lambda s: s.flux(False), Limit(over_yardstick=1.3)),
    Pass("membrane gather", lambda s: s.gather(False)),
    Pass("membrane product", lambda s: s.product(False), Limit(ns_per_node=8.0)),
    Pass("bending flux", lambda s: s.flux(True)),
    Pass("bending nodes", lambda s: s.nodes()),
    Pass("bending gather", lambda s: s.gather(True)),
    Pass("membrane + bending product", lambda s: s.product(True), Limit(ns_per_node=20.0)),
    Pass("membrane energy", lambda s: s.membrane.add_energy(s.state, s.x, s.state.partials)),
    Pass("membrane + bending energy", lambda s: s.shell.add_energy(s.state, s.x, s.state.partials)),
    Pass("membrane stress", lambda s: s.membrane.linearise(s.state, s.x)),
    Pass("membrane + bending stress", lambda s: s.shell.linearise(s.state, s.x)),
    Pass("membrane block diagonal", lambda s: s.membrane.add_block_diagonal(s.state, s.blocks)),
    Pass("membrane + bending block diagonal", lambda s: s.shell.add_block_diagonal(s.state, s.blocks)),
    Pass("CG vector updates", lambda s: s.updates()),
    Pass("CG iteration, membrane + bending", _iteration),
)
"""The passes in the order of the table; "flux" is the cell pass, "bending" the parts of a surface that bends."""
