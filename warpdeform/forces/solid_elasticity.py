"""The elastic energy of a solid (design 1.3)."""

from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.coefficients import PaperSolidWeights, SolidCoefficients
from warpdeform.forces.force import BodyArrays, Coarsening, CoarseTerm, Force, GridArrays
from warpdeform.forces.rest_growth import GROWING_STEPS, GrowthOnGrid
from warpdeform.forces.solid_coefficients import SolidStiffness, solid_stiffness
from warpdeform.forces.solid_growth import SolidGrowth
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.growth import Growth
from warpdeform.halo import Halo
from warpdeform.kernels import solid as kernels
from warpdeform.kernels.solid_blocks import solid_blocks
from warpdeform.kernels.solid_folds import solid_folds
from warpdeform.kernels.solid_gather import FLUX_COMPONENTS, solid_gather
from warpdeform.kernels.solid_levels import solid_levels
from warpdeform.kernels.solid_mean import solid_mean
from warpdeform.launching import Buffer, RowStruct, Whole, launch_lanes
from warpdeform.material import Material

Array = NDArray[np.float64]


class SolidElasticity(Force):
    """Extension and shear of one solid, and a barrier against inversion where the material has one.

    With a `growth` the rest lengths along the axes change, and with them the volume of the cells: strains are those
    over the lengths of the moment, the energy is that of the volume of the moment, and the barrier keeps cells above a
    part of it (:mod:`warpdeform.kernels.solid_growth`). Cells stretch along their edges, whose angles stay.

    Args:
        grid: Parameter grid.
        layout: Memory layout.
        rest: Rest positions [m], shape (nu, nv, nw, 3); G0 is measured on them by the kernel that measures G.
        material: Material; on coarser grids its coefficients, the mean over the fine cells of each.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
        like: Take the variant of the kernels that these coefficients take; None takes the one that the chart needs.
        growth: How the rest shape changes over time; None if it stays.

    Attributes:
        stiffness: Coefficients at the start.
        growth: What the growth changes; None without.
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
        material: Material | SolidCoefficients | PaperSolidWeights,
        real: Any,
        device: Any,
        like: SolidStiffness | None = None,
        growth: Growth | GrowthOnGrid | None = None,
    ) -> None:
        here = material.solid(grid) if isinstance(material, Material) else material
        self.stiffness: SolidStiffness = solid_stiffness(grid, rest, here, like)
        if growth is not None and growth.varies and self.stiffness.uniform:
            alike = self.stiffness.cells
            self.stiffness = replace(self.stiffness, cells=np.broadcast_to(alike, (*grid.cells, len(alike))))
        self.barrier = self.stiffness.volume is not None
        self._rest, self._material = rest, here
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
        self._halo = Halo(layout, real, device)
        if not self.stiffness.orthogonal:
            self._halo.refresh(self.t)
        constants = (self.t, *ratios, int(not self.stiffness.uniform))
        self._law = (self.share, self.K, *constants)
        # The same for kernels that read the coefficients of their neighbours.
        K = self.K if self.stiffness.uniform else self._halo.surrounded(self.K)
        self._law_around = (self._halo.surrounded(self.share), K, *constants)
        self.q0 = scratch(kernels.NUMBER_COMPONENTS)
        self.tension = scratch(kernels.TENSION_COMPONENTS)
        self.volume, self.hardness = upload(self.stiffness.volume), scratch(1, self.barrier)
        self.flux = scratch(FLUX_COMPONENTS)
        self.gathering = self._gather.gathering
        stride: wp.array = wp.array([layout.stride], dtype=wp.int32, device=device)
        self.fluxes = RowStruct(self.gathering.Fluxes, {"flux": self.flux, "stride": stride}, frozenset({"flux"}))
        # The tensions that a gradient does without are a sixth of what its cells write.
        self.force_gathering = self.gathering
        self.force_fluxes = RowStruct(self.gathering.Fluxes, {"flux": self.flux, "stride": stride}, frozenset({"flux"}))
        self.quadratic = not self.barrier
        self.measure(upload(rest), self.q0)
        self._halo.refresh(self.q0)
        self.growth: SolidGrowth | None = None
        if growth is not None:
            self.most_steps = GROWING_STEPS
            normalised = not isinstance(here, PaperSolidWeights)
            self.growth = SolidGrowth(self, growth, grid, layout, self._halo, normalised)
            self.growth.launch()

    @property
    def laws(self) -> tuple[wp.array, ...]:
        """K, and K for kernels which read it at neighbours, where that is another array."""
        around = self._law_around[1]
        return (self.K,) if around is self.K else (self.K, around)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        names = ("stress_cells", "product_cells", "energy_cells")
        others = ("solid_folds.forbid_folds", "solid_gather.gather", "solid_blocks.block_nodes")
        grows = self.growth.kernels if self.growth is not None else ()
        return (*(f"solid.{name}" for name in names), *others, *grows)

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        arrays = [self.share, self.K, self.t, self.q0, self.tension, self.volume, self.hardness, self.flux]
        arrays += self._law_around[:2]
        own = sum({a.ptr: a.capacity for a in arrays}.values()) + self._halo.bytes()
        return own + (self.growth.bytes() if self.growth is not None else 0)

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Launch over the rows from the first node's to the last one's."""
        first = self._layout.first_row
        launch_lanes(kernel, self._layout, first, *arguments, device=self._device, inner=True)

    def coarser(self, transfer: Coarsening) -> "SolidElasticity":
        """The solid through the coarse nodes, with the kernels of this one."""
        rest, material = transfer.sample(self._rest), self._material.mapped(transfer.average_cells)
        growth = None if self.growth is None else self.growth.coarser(transfer)
        coarse = SolidElasticity(
            transfer.coarse, transfer.layout, rest, material, self._real, self._device, self.stiffness, growth
        )
        if self.growth is not None:
            self.growth.above(coarse.growth)
        return coarse

    def prepare(self, time: float, dt: float, tau: float) -> None:
        """Let the rest shape grow, here and on the coarser grids."""
        if self.growth is not None:
            self.growth.follow(time)

    def coarsen(self, transfer: Coarsening, coarse: CoarseTerm) -> None:
        """Mean tension of the fine cells: strains measured on a coarse grid would be those of another shape."""
        assert isinstance(coarse, SolidElasticity)
        k, cells = solid_levels(self._layout.lane_width, self._real), transfer.cells
        growth, volume = [self._real(grown) for grown in transfer.growth], self._real(float(np.prod(transfer.growth)))
        coarse._launch_everywhere(k.average_tension, Whole(self.tension), cells, *growth, coarse.tension)
        if self.barrier:
            coarse._launch_everywhere(k.average_hardness, Whole(self.hardness), cells, volume, coarse.hardness)

    def _launch_everywhere(self, kernel: Any, *arguments: Any) -> None:
        launch_lanes(kernel, self._layout, *arguments, device=self._device)

    def measure(self, position: wp.array, q_out: wp.array) -> None:
        """Strain numbers q of the edges and faces that begin at each node, shape (6, rows, columns), of a shape."""
        self._halo.refresh(position)
        self._launch(self._words.measure, self._layout.stride, position, q_out)

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Stresses, and the coefficients of the Hessian at `position`."""
        self._linearise(position, self.q0, self.flux)
        self._position = position

    def linearise_mean(self, body: BodyArrays, position: wp.array, start: wp.array) -> None:
        """Stresses of the mean strains of a step from `start` with its middle at `position` (without the barrier)."""
        self._halo.refresh(position, start)
        shift = solid_mean(self._layout.lane_width, self._real).shift_rest
        self._launch(shift, self._layout.stride, position, start, self.q0, self._mean_rest)
        self._halo.refresh(self._mean_rest)
        self._linearise(position, self._mean_rest, self.flux)
        self._position = position

    @cached_property
    def _mean_rest(self) -> wp.array:
        return wp.zeros_like(self.q0)

    def write_force(self, body: BodyArrays, position: wp.array) -> None:
        """Write the flux of the force, and the tensions that go with it."""
        self._linearise(position, self.q0, Buffer(self.flux))

    def _linearise(self, position: wp.array, q0: wp.array, flux: wp.array | Buffer) -> None:
        self._halo.refresh(position)
        self._launch(
            self._words.stress_cells, self._layout.stride, position, q0, *self._law, self.volume,
            self.tension, self.hardness, flux,
        )  # fmt: skip
        self._halo.refresh(self.flux)

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the elastic energy [J]; infinite where there is a barrier and a cell is flat or inside out."""
        self._halo.refresh(position)
        k = self._words
        self._launch(k.energy_cells, self._layout.stride, position, self.q0, *self._law, self.volume, partials)

    def forbid_start(self, body: BodyArrays, before: wp.array, position: wp.array, partials: wp.array) -> None:
        """No cell may be squeezed flat or turned inside out on the way."""
        self._halo.refresh(before, position)
        kernel = solid_folds(self._layout.lane_width, self._real).forbid_folds
        self._launch(kernel, self._layout.stride, self.share, before, position, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the exact derivative of the energy; uses the stresses of `linearise` (before any Hessian product)."""
        self._launch(self._gather.gather, self.fluxes, gradient)
        self._halo.clear(gradient)

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None:
        """Write the flux of the projected Hessian times `direction`."""
        k = self._words
        self._halo.refresh(direction)
        self._launch(
            k.product_cells, self._layout.stride, self._position, *self._law, self.tension, self.hardness, direction,
            Buffer(self.flux),
        )  # fmt: skip
        self._halo.refresh(self.flux)

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction`; what the halo gets of it is for the mask of pins to clear."""
        self.write_fluxes(body, direction)
        self._launch(self._gather.gather, self.fluxes, product)

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian."""
        kernel = solid_blocks(*self._variant).block_nodes
        law, stride = self._law_around, self._layout.stride
        self._halo.refresh(self._position, self.tension)
        if self.barrier:
            self._halo.refresh(self.hardness)
        self._launch(kernel, stride, self._position, *law, self.tension, self.hardness, blocks)
        self._halo.clear(blocks)
