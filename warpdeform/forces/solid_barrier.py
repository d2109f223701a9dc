"""What keeps a solid from turning inside out, for materials that ask for it (design 1.3)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.forces.force import BodyArrays, Coarsening, CoarseTerm, Force, GridArrays
from warpdeform.forces.solid_coefficients import RestCells
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels import solid_barrier as kernels
from warpdeform.material import Material

Array = NDArray[np.float64]


class InversionBarrier(Force):
    """A barrier in the signed volume of every cell.

    A term of its own beside :class:`~warpdeform.forces.solid_elasticity.SolidElasticity`, so that solids without it
    have no kernel, array or operation more. A solid takes it where `Material.inversion_barrier` is not zero.

    Args:
        grid: Parameter grid.
        layout: Memory layout.
        rest: Rest positions [m], shape (nu, nv, nw, 3).
        material: Material.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
    """

    name = "inversion barrier"
    elastic = True
    energy_kind = "elastic"
    sample_nodes = 8

    def __init__(
        self, grid: ParameterGrid, layout: Layout, rest: Array, material: Material, real: Any, device: Any
    ) -> None:
        self._rest, self._material = rest, material
        self._layout, self._real, self._device = layout, real, device
        self._words = kernels.solid_barrier(layout.lane_width, real)
        chart = RestCells(grid, rest)
        strength = material.solid().inversion_barrier * chart.volume
        cells = np.stack([strength, 1.0 / (64.0 * chart.signed_volume), np.ones(grid.cells)], axis=-1)
        self.cells: wp.array = wp.array(layout.pack(cells), dtype=real, device=device)
        self.stiffness, self.flux = (
            wp.zeros((components, layout.rows, layout.columns), dtype=real, device=device)
            for components in (1, kernels.FLUX_COMPONENTS)
        )

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        names = ("press_cells", "product_cells", "gather", "energy_cells", "block_nodes")
        return tuple(f"solid_barrier.{name}" for name in names)

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        return sum(a.capacity for a in (self.cells, self.stiffness, self.flux))

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Launch over the rows from the first node's to the last one's."""
        layout = self._layout
        dim = (layout.rows - 2 * layout.first_row, layout.groups)
        wp.launch(kernel, dim=dim, inputs=[layout.first_row, layout.stride, *arguments], device=self._device)

    def coarser(self, transfer: Coarsening) -> "InversionBarrier":
        """The barrier of the solid through the coarse nodes."""
        rest = transfer.sample(self._rest)
        return InversionBarrier(transfer.coarse, transfer.layout, rest, self._material, self._real, self._device)

    def coarsen(self, transfer: Coarsening, coarse: CoarseTerm) -> None:
        """Mean stiffness of the fine cells: the volumes of coarse cells would be those of another shape."""
        assert isinstance(coarse, InversionBarrier)
        growth = self._real(float(np.prod(transfer.growth)))
        inputs = [self.stiffness, transfer.cells, growth, coarse.stiffness]
        wp.launch(self._words.average_stiffness, dim=transfer.layout.lane_dim, inputs=inputs, device=self._device)

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Pressures and stiffnesses at `position`."""
        self._launch(self._words.press_cells, position, self.cells, self.stiffness, self.flux)
        self._position = position

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the energy of the barrier [J]; infinite where a cell is flat or inside out."""
        self._launch(self._words.energy_cells, position, self.cells, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the exact derivative of the energy; uses what `linearise` found (before any Hessian product)."""
        self._launch(self._words.gather, self.flux, gradient)

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction`."""
        self._launch(self._words.product_cells, self._position, self.stiffness, direction, self.flux)
        self._launch(self._words.gather, self.flux, product)

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian."""
        self._launch(self._words.block_nodes, self._position, self.stiffness, blocks)


def refuse_inverted(grid: ParameterGrid, rest: Array, positions: Array, key: str = "initial_positions") -> None:
    """Refuse to start a solid with a barrier from where the barrier is infinite.

    Args:
        grid: Parameter grid.
        rest: Rest positions [m], shape (nu, nv, nw, 3).
        positions: Where the solid starts [m], same shape.
        key: What to call them in the message.

    Raises:
        InputError: A cell is flat or turned inside out; with its index.
    """
    ratio = RestCells(grid, positions, check=False).signed_volume / RestCells(grid, rest).signed_volume
    if ratio.min() <= kernels.LEAST:
        cell = [int(k) for k in np.unravel_index(np.argmin(ratio), ratio.shape)]
        problem = f"has a cell that is flat or turned inside out, with {ratio.min():.3g} of its rest volume"
        remedy = "Start from cells that are upright, or leave out inversion_barrier."
        raise InputError(Mistake(key, cell, problem, remedy))
