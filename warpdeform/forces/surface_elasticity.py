"""The elastic energy of a surface: membrane, and bending where the material has it (design 1.3)."""

from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import BodyArrays, Coarsening, CoarseTerm, Force, GridArrays
from warpdeform.forces.surface_coefficients import SurfaceStiffness, difference_weights, surface_stiffness
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.halo import Halo
from warpdeform.kernels import surface as kernels
from warpdeform.kernels.surface_blocks import surface_blocks
from warpdeform.kernels.surface_coupling import CHANGE_COMPONENTS, COUPLING_KERNELS, surface_coupling
from warpdeform.kernels.surface_force import surface_force
from warpdeform.kernels.surface_levels import surface_levels
from warpdeform.kernels.surface_majorant import surface_majorant
from warpdeform.kernels.surface_mean import surface_mean
from warpdeform.launching import Buffer, RowStruct, Whole, launch_lanes
from warpdeform.material import Material

Array = NDArray[np.float64]


class SurfaceElasticity(Force):
    """Membrane and bending of one surface; twist coupled to the other curvatures where the axes are not orthogonal.

    Args:
        grid: Parameter grid.
        layout: Memory layout.
        rest: Rest positions [m], shape (nu, nv, 3); G0 and B0 are measured on them by the kernels that measure G and B.
        material: Material.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
        like: Take the variants of the kernels that these coefficients take; None takes those that the chart needs.
    """

    name = "elasticity"
    elastic = True
    energy_kind = "elastic"

    def __init__(
        self,
        grid: ParameterGrid,
        layout: Layout,
        rest: Array,
        material: Material,
        real: Any,
        device: Any,
        like: SurfaceStiffness | None = None,
    ) -> None:
        self.stiffness: SurfaceStiffness = surface_stiffness(grid, rest, material.surface(), like)
        self._rest, self._material = rest, material
        self.bending = self.stiffness.bending is not None
        self.coupled = self.stiffness.coupling is not None
        self.quadratic = not self.bending
        # A cell's corners; a node and its neighbours; a cell and the neighbours of one of its corners.
        self.sample_nodes = 6 if self.coupled else 5 if self.bending else 4
        self._layout, self._device = layout, device
        self._lane_width, self._real = layout.lane_width, real
        self._words = kernels.surface(layout.lane_width, real, self.stiffness.orthogonal, self.bending)
        self._coupling: Any = surface_coupling(layout.lane_width, real) if self.coupled else None

        def upload(values: Array) -> wp.array:
            return wp.array(layout.pack(values), dtype=real, device=device)

        def scratch(components: int, needed: bool = True) -> wp.array:
            shape = (components, layout.rows, layout.columns) if needed else (1, 1, 1)
            return wp.zeros(shape, dtype=real, device=device)

        self.K = upload(self.stiffness.membrane)
        self.q0 = scratch(5)
        self.tension = scratch(kernels.TENSION_COMPONENTS)
        self.flux = scratch(kernels.FLUX_COMPONENTS)
        self.K12 = upload(self.stiffness.twist) if self.stiffness.twist is not None else scratch(1, False)
        self.KB = upload(self.stiffness.bending) if self.stiffness.bending is not None else scratch(1, False)
        self.KC = upload(self.stiffness.coupling) if self.stiffness.coupling is not None else scratch(1, False)
        self.b0 = scratch(3, self.bending)
        self.twist = scratch(kernels.TWIST_COMPONENTS, self.bending)
        self.flexure = scratch(kernels.FLEXURE_COMPONENTS, self.bending)
        self.scatter = scratch(kernels.SCATTER_COMPONENTS, self.bending)
        self.change = scratch(CHANGE_COMPONENTS, self.coupled)
        self.gathering = self._words.gathering
        gathered = {"flux": self.flux, "flexure": self.flexure, "scatter": self.scatter}
        # Coupled moments reach one row farther than a band does.
        buffers = frozenset() if self.coupled else frozenset({"flux", "scatter"})
        self.fluxes = RowStruct(self._words.gathering.Fluxes, gathered, buffers)
        if not self.coupled:
            self.force_gathering = self.gathering
            self.force_fluxes = RowStruct(self.gathering.Fluxes, gathered, frozenset(gathered))
        alpha_u, alpha_v = difference_weights(layout)
        self.alpha_u: wp.array = wp.array(alpha_u, dtype=real, device=device)
        self.alpha_v: wp.array = wp.array(alpha_v, dtype=real, device=device)
        self._cell_floor, self._node_floor = real(self.stiffness.cell_floor), real(self.stiffness.node_floor)
        # The same coefficients for kernels that read those of their neighbours.
        self._halo = Halo(layout, real, device)
        self._K = self._halo.surrounded(self.K)
        self._K12 = self._halo.surrounded(self.K12) if self.bending else self.K12
        self._KB = self._halo.surrounded(self.KB) if self.bending else self.KB
        self._KC = self._halo.surrounded(self.KC) if self.coupled else self.KC
        self.measure(upload(rest), self.q0, self.b0)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        places = ("cells", "nodes") if self.bending else ("cells",)
        names = [f"surface.{task}_{place}" for task in ("stress", "product", "energy") for place in places]
        names += ["surface.gather", *(f"surface_blocks.block_{place}" for place in places)]
        if self.coupled:
            names.remove("surface.product_nodes")
            names += [f"surface_coupling.{name}" for name in COUPLING_KERNELS]
        return tuple(names)

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        arrays = [self.q0, self.tension, self.flux, self.b0, self.twist, self.flexure, self.scatter, self.change]
        arrays += [self.K, self.K12, self.KB, self.KC, self._K, self._K12, self._KB, self._KC]
        arrays += [self.alpha_u, self.alpha_v]
        return sum({a.ptr: a.capacity for a in arrays}.values()) + self._halo.bytes()

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        launch_lanes(kernel, self._layout, *arguments, device=self._device)

    def coarser(self, transfer: Coarsening) -> "SurfaceElasticity":
        """The surface through the coarse nodes, with the kernels of this one."""
        rest = transfer.sample(self._rest)
        return SurfaceElasticity(
            transfer.coarse, transfer.layout, rest, self._material, self._real, self._device, self.stiffness
        )

    def coarsen(self, transfer: Coarsening, coarse: CoarseTerm) -> None:
        """Mean tension of the fine cells: strains measured on a coarse grid would be those of another shape."""
        assert isinstance(coarse, SurfaceElasticity)
        kernel = surface_levels(self._lane_width, self._real).average_tension
        ratio = self._real(transfer.growth[0] / transfer.growth[1])
        coarse._launch(kernel, Whole(self.tension), transfer.cells, ratio, coarse.tension)

    def measure(self, position: wp.array, q_out: wp.array, b_out: wp.array) -> None:
        """Strain numbers q, shape (5, rows, columns), and curvature numbers b, shape (3, rows, columns), of a shape."""
        self._halo.refresh(position)
        self._launch(self._words.measure_membrane, position, q_out)
        if self.bending:
            self._launch(self._words.measure_bending, position, self.alpha_u, self.alpha_v, self._node_floor, b_out)

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Stresses, moments and the coefficients of the Hessian at `position`."""
        self._linearise(position, self.q0)

    def linearise_mean(self, body: BodyArrays, position: wp.array, start: wp.array) -> None:
        """Stresses of the mean strains of a step from `start` with its middle at `position` (membranes)."""
        self._halo.refresh(position, start)
        shift = surface_mean(self._lane_width, self._real).shift_rest
        self._launch(shift, position, start, self.q0, self._mean_rest)
        self._linearise(position, self._mean_rest)

    @cached_property
    def _mean_rest(self) -> wp.array:
        return wp.zeros_like(self.q0)

    def _linearise(self, position: wp.array, q0: wp.array) -> None:
        k = self._words
        self._halo.refresh(position)
        self._launch(
            k.stress_cells, position, self.K, q0, self.K12, self.b0, self._cell_floor,
            self.tension, self.twist, self.flux,
        )  # fmt: skip
        if self.bending:
            self._launch(
                k.stress_nodes, position, self.KB, self.b0, self.alpha_u, self.alpha_v, self._node_floor,
                self.flexure, self.scatter,
            )  # fmt: skip
        if self.coupled:
            self._measure_change(position)
            self._couple()
        if self.bending:
            self._halo.refresh(self.flexure)
        self._refresh_stresses()
        self._position = position

    def _refresh_stresses(self) -> None:
        """What the forces are gathered from."""
        self._halo.refresh(self.flux)
        if self.bending:
            self._halo.refresh(self.scatter)

    def _measure_change(self, position: wp.array) -> None:
        """Changes of b since rest."""
        self._launch(
            self._coupling.change, position, self.b0, self.alpha_u, self.alpha_v, self._node_floor, self._cell_floor,
            self.change,
        )  # fmt: skip

    def _couple(self) -> None:
        """Moments of the changes of b: on top of the cells' flux, in place of the nodes' scatter."""
        self._halo.refresh(self.change)
        self._launch(
            self._coupling.couple, self.KB, self._KC, self.alpha_u, self.alpha_v, self.flexure, self.twist, self.change,
            self.flux, self.scatter,
        )  # fmt: skip

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the elastic energy [J]."""
        self._halo.refresh(position)
        self._launch(self._words.energy_cells, position, self.K, self.q0, self.K12, self.b0, self._cell_floor, partials)
        if self.bending:
            self._launch(
                self._words.energy_nodes, position, self.KB, self.b0, self.alpha_u, self.alpha_v, self._node_floor,
                partials,
            )  # fmt: skip
        if self.coupled:
            self._measure_change(position)
            self._halo.refresh(self.change)
            self._launch(self._coupling.energy_coupling, self.KC, self.change, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the exact derivative of the energy; uses the stresses of `linearise` (before any Hessian product)."""
        self._launch(self._words.gather, self.fluxes, gradient)
        self._halo.clear(gradient)

    def write_force(self, body: BodyArrays, position: wp.array) -> None:
        """Write flux, normals and scatter of the force."""
        k = surface_force(self._lane_width, self._real, self.stiffness.orthogonal, self.bending)
        self._halo.refresh(position)
        self._launch(
            k.force_cells, position, self.K, self.q0, self.K12, self.b0, self._cell_floor, Buffer(self.flux)
        )  # fmt: skip
        if self.bending:
            self._launch(
                k.force_nodes, position, self.KB, self.b0, self.alpha_u, self.alpha_v, self._node_floor,
                Buffer(self.flexure), Buffer(self.scatter),
            )  # fmt: skip
            self._halo.refresh(self.flexure)
        self._refresh_stresses()

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None:
        """Write flux and scatter of the projected Hessian times `direction`."""
        k = self._words
        self._halo.refresh(direction)
        flux, scatter = Buffer(self.flux), Buffer(self.scatter)
        self._launch(k.product_cells, self._position, self.K, self.tension, self.K12, self.twist, direction, flux)
        if self.coupled:
            c = self._coupling
            self._launch(c.change_along, self.alpha_u, self.alpha_v, self.flexure, self.twist, direction, self.change)
            self._couple()
        elif self.bending:
            self._launch(k.product_nodes, self.KB, self.alpha_u, self.alpha_v, self.flexure, direction, scatter)
        self._refresh_stresses()

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction`; what the halo gets of it is for the mask of pins to clear."""
        self.write_fluxes(body, direction)
        self._launch(self._words.gather, self.fluxes, product)

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian."""
        k = surface_blocks(self._lane_width, self._real, self.stiffness.orthogonal, self.bending)
        self._halo.refresh(self._position, self.tension)
        if self.bending:
            self._halo.refresh(self.twist)
        self._launch(k.block_cells, self._position, self._K, self.tension, self._K12, self.twist, blocks)
        if self.bending:
            self._launch(k.block_nodes, self._KB, self.alpha_u, self.alpha_v, self.flexure, blocks)
        if self.coupled:
            self._launch(
                self._coupling.block_coupling, self._KC, self.alpha_u, self.alpha_v, self.flexure, self.twist, blocks
            )
        self._halo.clear(blocks)

    def add_majorant(self, body: BodyArrays, blocks: wp.array) -> None:
        """Add bounds of cells and bending samples; on coupled charts as many diagonal blocks as a sample has nodes."""
        if self.coupled:
            super().add_majorant(body, blocks)
            return
        k = surface_majorant(self._lane_width, self._real, self.stiffness.orthogonal, self.bending)
        self._launch(k.bound_cells, self._position, self.K, self.tension, self.K12, self.twist, self.flux)
        self._halo.refresh(self.flux)
        self._launch(k.bound_nodes, self.flux, self._KB, self.alpha_u, self.alpha_v, self.flexure, blocks)
        self._halo.clear(blocks)
