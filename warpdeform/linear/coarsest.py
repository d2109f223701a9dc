"""The direct solve on the coarsest grid of a multigrid hierarchy."""

from typing import Any

import numpy as np
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
        nodes = np.stack(np.unravel_index(np.arange(np.prod(body.layout.nodes)), body.layout.nodes), axis=-1)
        self._places: wp.array = wp.array(body.layout.places(nodes), dtype=wp.int32, device=self._device)
        self._unknowns = 3 * len(nodes)
        shape = (self._unknowns, self._unknowns)
        self._inverse: wp.array = wp.zeros(shape, dtype=wp.float64, device=self._device)
        self._swept: wp.array = wp.zeros(shape, dtype=wp.float64, device=self._device)
        self._product: wp.array = wp.zeros(
            (3, body.layout.rows, body.layout.columns), dtype=body.real, device=self._device
        )
        self._vector: wp.array = wp.zeros(self._unknowns, dtype=wp.float64, device=self._device)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return int(sum(a.capacity for a in (self._inverse, self._swept, self._product, self._vector, self._places)))

    def update(self, unit: wp.array) -> None:
        """Assemble A column by column and invert it.

        Args:
            unit: Scratch, shape (3, rows, columns), zero outside the body.
        """
        source, target = self._swept, self._inverse
        if self._unknowns % 2 == 0:
            source, target = target, source
        for column in range(self._unknowns):
            self._launch("set_unit", self._places, column, unit)
            self._operator.product(unit, self._product)
            self._launch("store_column", self._places, column, self._free, self._product, source)
        for pivot in range(self._unknowns):
            self._launch("sweep", pivot, source, target)
            source, target = target, source

    def apply(self, residual: wp.array, solution: wp.array) -> None:
        """solution = A^-1 residual on the free nodes; arrays of shape (3, rows, columns)."""
        self._launch("gather_unknowns", self._places, self._free, residual, self._vector)
        self._launch("multiply", self._places, self._free, self._inverse, self._vector, solution)

    def _launch(self, name: str, *inputs: Any) -> None:
        launch_alone(getattr(self._kernels, name), self._unknowns, *inputs, device=self._device)
