"""What the kernel benchmark times on solids: the passes of a Newton step, as data."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.solid_elasticity import SolidElasticity
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.material import Material
from warpdeform.study.bench.passes import YARDSTICK, Pass
from warpdeform.study.bench.yardstick import FLUXES, WEIGHTS, yardstick


class Block:
    """The arrays of two crumpled cubes with random vectors, one of boxes and one of leaning cells, for one lane width.

    Positions are the rest shape with every node moved at random by up to a fifth of an edge, as of
    :class:`~warpdeform.study.bench.passes.Sheet`.

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

    axes = 3

    def __init__(self, nodes: int, precision: str, width: int, device: Any) -> None:
        self.side, self.node_count = nodes, nodes**3
        self.real: Any = wp.float32 if precision == "float32" else wp.float64
        self.width, self.device = width, device
        self.vector_size = 3 * int(wp.types.type_size_in_bytes(self.real))
        self._layout, self._random = Layout((nodes,) * 3, width), np.random.default_rng(0)
        self.dim = self._layout.lane_dim
        edge = 1.0 / (nodes - 1)
        self.grid = ParameterGrid((nodes,) * 3, (edge,) * 3)
        rest = self.grid.parameters()
        rubber = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.4)
        guarded = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.4, inversion_barrier=2e4)
        leaning = rest + 0.3 * rest[..., [1, 2, 0]] * [1.0, 0.0, 1.0]
        self.boxes, self.guarded, self.chart = (
            SolidElasticity(self.grid, self._layout, shape, material, self.real, device)
            for shape, material in ((rest, rubber), (rest, guarded), (leaning, rubber))
        )
        moved = 0.2 * edge * self._random.uniform(-1.0, 1.0, rest.shape)
        self.x, self.leaning_x = self._upload(rest + moved), self._upload(leaning + moved)
        self.p, self.weights = self.numbers(3), self.numbers(WEIGHTS)
        self.sum, self.blocks = self._upload(0.0 * rest), self._upload(np.zeros((*rest.shape[:3], 6)))
        self.flux_u, self.flux_v = (self._upload(np.zeros((*rest.shape[:3], FLUXES))) for _ in range(2))
        self.per_spacing = self.real(1.0 / edge)
        plane = (self._layout.rows, self._layout.columns)
        self.partials: wp.array = wp.zeros(plane, dtype=wp.float64, device=device)
        for term, position in ((self.boxes, self.x), (self.guarded, self.x), (self.chart, self.leaning_x)):
            term.linearise(self, position)  # type: ignore[arg-type]

    def _upload(self, values: NDArray[np.float64]) -> wp.array:
        return wp.array(self._layout.pack(values), dtype=self.real, device=self.device)

    def numbers(self, components: int) -> wp.array:
        """A component array of random numbers between -1 and 1."""
        return self._upload(self._random.uniform(-1.0, 1.0, (*self._layout.nodes, components)))

    def launch(self, kernel: Any, *inputs: Any) -> None:
        """Launch a kernel once per lane group."""
        wp.launch(kernel, dim=self.dim, inputs=inputs, device=self.device)

    def product(self, term: SolidElasticity) -> None:
        """The Hessian product."""
        term.add_hessian_product(self, self.p, self.sum)  # type: ignore[arg-type]


def _passes(word: str, term: str, position: str) -> tuple[Pass, ...]:
    def of(b: Any) -> tuple[Any, Any]:
        return getattr(b, term), getattr(b, position)

    return (
        Pass(f"{word} product", lambda b: b.product(of(b)[0])),
        Pass(f"{word} stress", lambda b: of(b)[0].linearise(b, of(b)[1])),
        Pass(f"{word} energy", lambda b: of(b)[0].add_energy(b, of(b)[1], b.partials)),
        Pass(f"{word} block diagonal", lambda b: of(b)[0].add_block_diagonal(b, b.blocks)),
    )


SOLID_PASSES = (
    Pass(
        YARDSTICK,
        lambda b: b.launch(yardstick(b.width, b.real), b.x, b.weights, b.per_spacing, b.p, b.flux_u, b.flux_v),
    ),
    *_passes("boxes", "boxes", "x"),
    Pass("gather", lambda b: b.boxes.add_gradient(b, b.x, b.sum)),
    *_passes("boxes with barrier", "guarded", "x"),
    *_passes("leaning cells", "chart", "leaning_x"),
)
"""The passes in the order of the table: the law of boxes, the same with the barrier, the law in a chart."""
