"""The direct solve along strands, which is to curves what coarser grids are to surfaces and solids."""

from typing import Any

import warp as wp

from warpdeform.kernels.strand import strand
from warpdeform.kernels.strand_border import border_components, corner_components
from warpdeform.kernels.strand_words import band_components
from warpdeform.launching import launch_alone
from warpdeform.linear.operator import GridOperator


class StrandInverse:
    """The inverse of A on the grid of a curve body: every strand a band matrix, factorised and solved on the device.

    In one dimension a factorisation and a solve cost what the smoother of a V-cycle would cost, about ten products with
    A, and they are exact. So curves are not coarsened: however long, stiff or inextensible a strand is, conjugate
    gradient has nothing left to do but to correct round-off, and what couples bodies with each other. Everything that
    acts on single nodes - inertia, contact, springs, pins - is in the diagonal. With material frames the angles are
    unknowns of the band, which leaves the Hessian that has them eliminated without anybody forming it.

    Args:
        operator: A on the grid.
    """

    def __init__(self, operator: GridOperator) -> None:
        body, layout = operator.body, operator.body.layout
        self._operator, self._device = operator, body.device
        angled, closed = operator.terms[0].angled, layout.periodic[0]
        self._nodes = layout.nodes[0]
        self._kernels = strand(body.lane_width, body.real, angled, closed)
        self._dim = layout.lane_dim[1]

        def zeros(components: int, rows: int = layout.rows, real: Any = wp.float64) -> wp.array:
            return wp.zeros((components, rows, layout.columns), dtype=real, device=self._device)

        self._band, self._work = zeros(band_components(angled)), zeros(4 if angled else 3)
        self._border = zeros(border_components(angled)) if closed else zeros(1, 1)
        self._corner = zeros(corner_components(angled), 1) if closed else zeros(1, 1)
        alone = operator.blocks is not None and len(operator.terms) == 1
        self._own = None if alone else zeros(6, real=body.real)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = (self._band, self._work, self._border, self._corner, self._own)
        return sum(int(array.capacity) for array in arrays if array is not None)

    def update(self) -> None:
        """Assemble and factorise A, from terms linearised at the iterate."""
        operator = self._operator
        operator.terms[0].write_band(operator.body, self._band)
        blocks = operator.blocks
        if self._own is not None:
            # What acts on single nodes: mass, and the diagonal of whatever else couples nodes.
            blocks = self._own
            if operator.blocks is None:
                operator.start_blocks(blocks)
            else:
                operator.launch("copy_blocks", operator.blocks, blocks)
            for term in operator.terms[1:]:
                term.add_block_diagonal(operator.body, blocks)
        self._launch("factorise", blocks, self._band, self._border, self._corner)

    def apply(self, residual: wp.array, solution: wp.array) -> None:
        """solution = A^-1 residual on the free nodes; arrays of shape (3, rows, columns)."""
        self._launch("solve", self._band, self._border, self._corner, residual, self._work, solution)

    def _launch(self, name: str, *inputs: Any) -> None:
        kernel = getattr(self._kernels, name)
        launch_alone(kernel, self._dim, self._nodes, *inputs, device=self._device)
