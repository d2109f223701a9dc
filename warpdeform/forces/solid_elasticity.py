"""The elastic energy of a solid (design 1.3)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import BodyArrays, Coarsening, CoarseTerm, Force, GridArrays
from warpdeform.forces.solid_coefficients import SolidStiffness, solid_stiffness
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels import solid as kernels
from warpdeform.kernels.solid_blocks import solid_blocks
from warpdeform.kernels.solid_gather import FLUX_COMPONENTS, solid_gather
from warpdeform.kernels.solid_levels import solid_levels
from warpdeform.material import Material

Array = NDArray[np.float64]


class SolidElasticity(Force):
    """Extension and shear of one solid, and a barrier against inversion where the material has one.

    Args:
        grid: Parameter grid.
        layout: Memory layout.
        rest: Rest positions [m], shape (nu, nv, nw, 3); G0 is measured on them by the kernel that measures G.
        material: Material.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
        like: Take the variant of the kernels that these coefficients take; None takes the one that the chart needs.
    """

    name = "elasticity"
    elastic = True
    energy_kind = "elastic"
    sample_nodes = 8

    def __init__(
        self,
        grid: ParameterGrid,
        layout: Layout,
        rest: Array,
        material: Material,
        real: Any,
        device: Any,
        like: SolidStiffness | None = None,
    ) -> None:
        self.stiffness: SolidStiffness = solid_stiffness(grid, rest, material.solid(), like)
        self.barrier = self.stiffness.volume is not None
        self._rest, self._material, self._spacing = rest, material, grid.spacing
        self._layout, self._device, self._real = layout, device, real
        self._variant = (layout.lane_width, real, self.stiffness.orthogonal, self.barrier)
        self._words, self._gather = kernels.solid(*self._variant), solid_gather(layout.lane_width, real)

        def upload(values: Array | None) -> wp.array:
            if values is None:
                return scratch(1, False)
            return wp.array(layout.pack(values), dtype=real, device=device)

        def scratch(components: int, needed: bool = True) -> wp.array:
            shape = (components, layout.rows, layout.columns) if needed else (1, 1, 1)
            return wp.zeros(shape, dtype=real, device=device)

        self.share, self.t = upload(self.stiffness.share), upload(self.stiffness.edges)
        if self.stiffness.uniform:
            same = np.repeat(self.stiffness.cells[:, None, None], layout.lane_width, axis=-1)
            self.K: wp.array = wp.array(same, dtype=real, device=device)
        else:
            self.K = upload(self.stiffness.cells)
        ratios = (real(ratio) for ratio in self.stiffness.ratios)
        self._law = (self.share, self.K, self.t, *ratios, int(not self.stiffness.uniform))
        self.q0 = scratch(kernels.NUMBER_COMPONENTS)
        self.tension = scratch(kernels.TENSION_COMPONENTS)
        self.volume, self.hardness = upload(self.stiffness.volume), scratch(1, self.barrier)
        self.flux = scratch(FLUX_COMPONENTS)
        self._fluxes = self._gather.Fluxes()
        self._fluxes.flux = self.flux
        self._fluxes.stride = wp.array([layout.stride], dtype=wp.int32, device=device)
        self.measure(upload(rest), self.q0)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        names = ("stress_cells", "product_cells", "energy_cells")
        return (*(f"solid.{name}" for name in names), "solid_gather.gather", "solid_blocks.block_nodes")

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        arrays = (self.share, self.K, self.t, self.q0, self.tension, self.volume, self.hardness, self.flux)
        return sum(a.capacity for a in arrays)

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Launch over the rows from the first node's to the last one's."""
        layout = self._layout
        dim = (layout.rows - 2 * layout.first_row, layout.groups)
        wp.launch(kernel, dim=dim, inputs=[layout.first_row, *arguments], device=self._device)

    def coarser(self, transfer: Coarsening) -> "SolidElasticity":
        """The solid through the coarse nodes, with the kernels of this one."""
        rest = transfer.sample(self._rest)
        return SolidElasticity(
            transfer.coarse, transfer.layout, rest, self._material, self._real, self._device, self.stiffness
        )

    def coarsen(self, transfer: Coarsening, coarse: CoarseTerm) -> None:
        """Mean tension of the fine cells: strains measured on a coarse grid would be those of another shape."""
        assert isinstance(coarse, SolidElasticity)
        k, cells = solid_levels(self._layout.lane_width, self._real), transfer.cells
        dim, growth = transfer.layout.lane_dim, [self._real(grown) for grown in transfer.growth]
        wp.launch(
            k.average_tension, dim=dim, inputs=[self.tension, cells, *growth, coarse.tension], device=self._device
        )  # fmt: skip
        if self.barrier:
            volume = self._real(float(np.prod(transfer.growth)))
            inputs = [self.hardness, cells, volume, coarse.hardness]
            wp.launch(k.average_hardness, dim=dim, inputs=inputs, device=self._device)

    def measure(self, position: wp.array, q_out: wp.array) -> None:
        """Strain numbers q of the edges and faces that begin at each node, shape (6, rows, columns), of a shape."""
        self._launch(self._words.measure, self._layout.stride, position, q_out)

    def metric(self, position: wp.array) -> "SolidMetric":
        """The metric tensor of a shape, from the same operators as the energy (host); positions (3, rows, columns)."""
        q: wp.array = wp.zeros_like(self.q0)
        self.measure(position, q)
        return metric_of(self._layout.unpack(q.numpy()), self._spacing)

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Stresses, and the coefficients of the Hessian at `position`."""
        self._launch(
            self._words.stress_cells, self._layout.stride, position, self.q0, *self._law, self.volume,
            self.tension, self.hardness, self.flux,
        )  # fmt: skip
        self._position = position

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the elastic energy [J]; infinite where there is a barrier and a cell is flat or inside out."""
        k = self._words
        self._launch(k.energy_cells, self._layout.stride, position, self.q0, *self._law, self.volume, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the exact derivative of the energy; uses the stresses of `linearise` (before any Hessian product)."""
        self._launch(self._gather.gather, self._fluxes, gradient)

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction`."""
        k = self._words
        self._launch(
            k.product_cells, self._layout.stride, self._position, *self._law, self.tension, self.hardness, direction,
            self.flux,
        )  # fmt: skip
        self._launch(self._gather.gather, self._fluxes, product)

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian."""
        kernel = solid_blocks(*self._variant).block_nodes
        self._launch(kernel, self._layout.stride, self._position, *self._law, self.tension, self.hardness, blocks)


@dataclass(frozen=True)
class SolidMetric:
    """Metric tensor of a solid at its samples, in parameter units.

    Attributes:
        G11: On the u-edges, shape (nu - 1, nv, nw).
        G22: On the v-edges, shape (nu, nv - 1, nw).
        G33: On the w-edges, shape (nu, nv, nw - 1).
        G12: On the uv-faces, shape (nu - 1, nv - 1, nw).
        G13: On the uw-faces, shape (nu - 1, nv, nw - 1).
        G23: On the vw-faces, shape (nu, nv - 1, nw - 1).
    """

    G11: Array
    G22: Array
    G33: Array
    G12: Array
    G13: Array
    G23: Array


def metric_of(q: Array, spacing: tuple[float, ...]) -> SolidMetric:
    """G from the numbers that `SolidElasticity.measure` gives, shape (*nodes, 6)."""
    h1, h2, h3 = spacing
    return SolidMetric(
        G11=2.0 * q[:-1, :, :, 0] / h1**2,
        G22=2.0 * q[:, :-1, :, 1] / h2**2,
        G33=2.0 * q[:, :, :-1, 2] / h3**2,
        G12=0.5 * q[:-1, :-1, :, 3] / (h1 * h2),
        G13=0.5 * q[:-1, :, :-1, 4] / (h1 * h3),
        G23=0.5 * q[:, :-1, :-1, 5] / (h2 * h3),
    )
