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
from warpdeform.kernels.solid_levels import solid_levels
from warpdeform.material import Material

Array = NDArray[np.float64]


class SolidElasticity(Force):
    """Extension and shear of one solid.

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
        self._rest, self._material, self._spacing = rest, material, grid.spacing
        self._layout, self._device, self._real = layout, device, real
        self._words = kernels.solid(layout.lane_width, real, self.stiffness.orthogonal)

        def upload(values: Array) -> wp.array:
            return wp.array(layout.pack(values), dtype=real, device=device)

        def scratch(components: int) -> wp.array:
            return wp.zeros((components, layout.rows, layout.columns), dtype=real, device=device)

        self.share = upload(self.stiffness.share)
        if self.stiffness.uniform:
            same = np.repeat(self.stiffness.cells[:, None, None], layout.lane_width, axis=-1)
            self.K: wp.array = wp.array(same, dtype=real, device=device)
        else:
            self.K = upload(self.stiffness.cells)
        none: wp.array = wp.zeros((1, 1, 1), dtype=real, device=device)
        self.t = none if self.stiffness.edges is None else upload(self.stiffness.edges)
        ratios = (real(ratio) for ratio in self.stiffness.ratios)
        self._law = (self.share, self.K, self.t, *ratios, int(not self.stiffness.uniform))
        self.q0 = scratch(kernels.NUMBER_COMPONENTS)
        self.mean = scratch(kernels.NUMBER_COMPONENTS)
        self.stress = scratch(kernels.NUMBER_COMPONENTS)
        self.flux = scratch(kernels.FLUX_COMPONENTS)
        self.measure(upload(rest), self.q0)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        names = ("stress_cells", "sum_stress", "gather_gradient", "product_cells", "gather_product", "energy_cells")
        return (*(f"solid.{name}" for name in names), "solid_blocks.block_nodes")

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        return sum(a.capacity for a in (self.share, self.K, self.t, self.q0, self.mean, self.stress, self.flux))

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Launch over the rows from the first node's to the last one's."""
        layout = self._layout
        dim = (layout.rows - 2 * layout.first_row, layout.groups)
        wp.launch(kernel, dim=dim, inputs=[layout.first_row, layout.stride, *arguments], device=self._device)

    def coarser(self, transfer: Coarsening) -> "SolidElasticity":
        """The solid through the coarse nodes, with the kernels of this one."""
        rest = transfer.sample(self._rest)
        return SolidElasticity(
            transfer.coarse, transfer.layout, rest, self._material, self._real, self._device, self.stiffness
        )

    def coarsen(self, transfer: Coarsening, coarse: CoarseTerm) -> None:
        """Mean stress of the fine cells: strains measured on a coarse grid would be those of another shape."""
        assert isinstance(coarse, SolidElasticity)
        k = solid_levels(self._layout.lane_width, self._real)
        inputs = [self.mean, transfer.cells, *(self._real(growth) for growth in transfer.growth), coarse.mean]
        wp.launch(k.average_stress, dim=transfer.layout.lane_dim, inputs=inputs, device=self._device)
        coarse._launch(k.sum_means, coarse.mean, coarse.stress)

    def measure(self, position: wp.array, q_out: wp.array) -> None:
        """Strain numbers q of the edges and faces that begin at each node, shape (6, rows, columns), of a shape."""
        self._launch(self._words.measure, position, q_out)

    def metric(self, position: wp.array) -> "SolidMetric":
        """The metric tensor of a shape, from the same operators as the energy (host); positions (3, rows, columns)."""
        q: wp.array = wp.zeros_like(self.q0)
        self.measure(position, q)
        return metric_of(self._layout.unpack(q.numpy()), self._spacing)

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Stresses at `position`, of which gradient and Hessian are made."""
        k = self._words
        self._launch(k.stress_cells, position, self.q0, *self._law, self.mean, self.flux)
        self._launch(k.sum_stress, self.flux, self.stress)
        self._position = position

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the elastic energy [J]."""
        self._launch(self._words.energy_cells, position, self.q0, *self._law, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the exact derivative of the energy."""
        self._launch(self._words.gather_gradient, position, self.stress, gradient)

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction`."""
        k = self._words
        self._launch(k.product_cells, self._position, *self._law, direction, self.flux)
        self._launch(k.gather_product, self._position, self.stress, direction, self.flux, product)

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian."""
        k = solid_blocks(self._layout.lane_width, self._real, self.stiffness.orthogonal)
        self._launch(k.block_nodes, self._position, *self._law, self.stress, blocks)


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
