"""The direct solve on the coarsest grid of a multigrid hierarchy."""

from typing import Any

import warp as wp

from warpdeform.kernels.multigrid import dense
from warpdeform.launching import launch_alone
from warpdeform.linear.operator import GridOperator


class DenseInverse:
    """The inverse of A on a grid of a few dozen nodes; rebuilt and applied on the device.

    Args:
        operator: A on the grid.
    """

    def __init__(self, operator: GridOperator) -> None:
        body = operator.body
        self._operator, self._free, self._device = operator, body.free, body.device
        self._kernels = dense(body.real)
        self._place = [body.layout.nodes[1], body.layout.halo]
        self._unknowns = 3 * body.layout.nodes[0] * body.layout.nodes[1]
        shape = (self._unknowns, self._unknowns)
        self._inverse: wp.array = wp.zeros(shape, dtype=wp.float64, device=self._device)
        self._swept: wp.array = wp.zeros(shape, dtype=wp.float64, device=self._device)
        self._vector: wp.array = wp.zeros(self._unknowns, dtype=wp.float64, device=self._device)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return int(self._inverse.capacity + self._swept.capacity + self._vector.capacity)

    def update(self, unit: wp.array, product: wp.array) -> None:
        """Assemble A column by column and invert it.

        Args:
            unit: Scratch, shape (3, rows, columns), zero outside the body.
            product: Scratch, shape (3, rows, columns).
        """
        source, target = self._swept, self._inverse
        if self._unknowns % 2 == 0:
            source, target = target, source
        for column in range(self._unknowns):
            self._launch("set_unit", *self._place, column, unit)
            self._operator.product(unit, product)
            self._launch("store_column", *self._place, column, self._free, product, source)
        for pivot in range(self._unknowns):
            self._launch("sweep", pivot, source, target)
            source, target = target, source

    def apply(self, residual: wp.array, solution: wp.array) -> None:
        """solution = A^-1 residual on the free nodes; arrays of shape (3, rows, columns)."""
        self._launch("gather_unknowns", *self._place, self._free, residual, self._vector)
        self._launch("multiply", *self._place, self._free, self._inverse, self._vector, solution)

    def _launch(self, name: str, *inputs: Any) -> None:
        launch_alone(getattr(self._kernels, name), self._unknowns, *inputs, device=self._device)
