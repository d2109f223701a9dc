"""The direct solve along strands, which is to curves what coarser grids are to surfaces and solids."""

from typing import Any

import warp as wp

from warpdeform.kernels.strand import band_row, strand
from warpdeform.linear.operator import GridOperator


class StrandInverse:
    """The inverse of A on the grid of a curve body: every strand a band matrix, factorised and solved on the device.

    In one dimension a direct solve costs what a sweep of a smoother does, so that curves are not coarsened: however
    long, stiff or inextensible a strand is, conjugate gradient has nothing left to do but to correct round-off, and
    what couples bodies with each other. Everything that acts on single nodes - inertia, contact, springs, pins - is in
    the diagonal. With material frames the angles are unknowns of the band, which leaves the Hessian that has them
    eliminated without anybody forming it.

    Args:
        operator: A on the grid.
    """

    def __init__(self, operator: GridOperator) -> None:
        body, grid = operator.body, operator.body.layout
        self._operator, self._free, self._device = operator, body.free, body.device
        unknowns = max((term.unknowns for term in operator.terms), default=3)
        closed = grid.periodic[0]
        self._nodes, self._loop = grid.nodes[0], grid.nodes[0] if closed else 0
        self._kernels = strand(body.lane_width, body.real, unknowns, closed)
        self._dim = grid.lane_dim

        def zeros(components: int, real: Any = wp.float64, needed: bool = True) -> wp.array:
            shape = (components, grid.rows, grid.columns) if needed else (1, 1, 1)
            return wp.zeros(shape, dtype=real, device=self._device)

        self._band, self._work = zeros(band_row(unknowns, unknowns)), zeros(unknowns)
        self._border = zeros(2 * unknowns**2, needed=closed)
        self._blocks = zeros(6, body.real) if operator.blocks is None else operator.blocks

    def bytes(self) -> int:
        """Device memory [bytes]."""
        own = self._blocks.capacity if self._operator.blocks is None else 0
        return int(own + self._band.capacity + self._work.capacity + self._border.capacity)

    def update(self, unit: wp.array, product: wp.array) -> None:
        """Assemble and factorise; the scratch arrays of :class:`~warpdeform.linear.coarsest.DenseInverse` are left."""
        operator = self._operator
        if operator.blocks is None:
            operator.start_blocks(self._blocks)
        self._band.zero_()
        for term in operator.terms:
            term.add_band(operator.body, self._band)
        self._launch("enter_nodes", self._dim, self._loop, self._free, self._blocks, self._band)
        if self._loop:
            self._border.zero_()
        self._launch("factorise", self._dim[1], self._nodes, self._band, self._border)

    def apply(self, residual: wp.array, solution: wp.array) -> None:
        """solution = A^-1 residual on the free nodes; arrays of shape (3, rows, columns)."""
        arrays = (self._band, self._border, residual, self._work, solution)
        self._launch("solve", self._dim[1], self._nodes, *arrays)

    def _launch(self, name: str, dim: Any, *inputs: Any) -> None:
        wp.launch(getattr(self._kernels, name), dim=dim, inputs=inputs, device=self._device)
