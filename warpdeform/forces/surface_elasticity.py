"""The elastic energy of a surface: membrane, and bending where the material has it (design 1.3)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.coefficients import PaperWeights, SurfaceCoefficients
from warpdeform.forces.force import BodyArrays, Coarsening, CoarseTerm, Force, GridArrays
from warpdeform.forces.pole_cap import PoleCap
from warpdeform.forces.rest_growth import GROWING_STEPS, GrowthOnGrid
from warpdeform.forces.surface_bending import difference_weights
from warpdeform.forces.surface_coefficients import SurfaceStiffness, surface_stiffness
from warpdeform.forces.surface_growth import SurfaceGrowth
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.growth import Growth
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


@dataclass(frozen=True)
class OnGrid:
    """A material on a grid.

    Attributes:
        cells: Its coefficients at the cells.
        nodes: Its coefficients at the nodes.
    """

    cells: SurfaceCoefficients | PaperWeights
    nodes: SurfaceCoefficients | PaperWeights

    @staticmethod
    def of(material: Material, grid: ParameterGrid) -> "OnGrid":
        """The material where it belongs."""
        return OnGrid(material.surface(grid), material.surface(grid, at="nodes"))

    def coarser(self, transfer: Coarsening) -> "OnGrid":
        """The mean of what varies on the fine grid.

        The arithmetic mean: what a coarse grid moves is interpolated linearly, and then stores the mean of the fine
        stiffness times its strain squared. The harmonic mean, right for springs in a row, is softer than that by any
        factor, and corrections by it go as far beyond the mark: where stiffness varies by 1e4 along lines, hems and
        checks, 65 x 65 nodes take up to 38 iterations with the one and 253 with the other.
        """
        return OnGrid(self.cells.mapped(transfer.average_cells), self.nodes.mapped(transfer.average_nodes))


class SurfaceElasticity(Force):
    """Membrane and bending of one surface; twist coupled to the other curvatures where the axes are not orthogonal.

    Args:
        grid: Parameter grid.
        layout: Memory layout.
        rest: Rest positions [m], shape (nu, nv, 3); G0 and B0 are measured on them by the kernels that measure G and B.
        material: Material; of coarser grids, what it is there on average.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
        like: Take the variants of the kernels that these coefficients take; None takes those that the chart needs.
        growth: How the rest shape changes over time; None if it stays.
    """

    name = "elasticity"
    elastic = True
    energy_kind = "elastic"

    def __init__(
        self,
        grid: ParameterGrid,
        layout: Layout,
        rest: Array,
        material: "Material | OnGrid",
        real: Any,
        device: Any,
        like: SurfaceStiffness | None = None,
        growth: "Growth | GrowthOnGrid | None" = None,
    ) -> None:
        here = material if isinstance(material, OnGrid) else OnGrid.of(material, grid)
        self.stiffness: SurfaceStiffness = surface_stiffness(grid, rest, here.cells, like, here.nodes)
        self._rest, self._material = rest, here
        self.bending = self.stiffness.bending is not None
        self.coupled = self.stiffness.coupling is not None
        # A cell's corners; a node and its neighbours; a cell and the neighbours of one of its corners.
        self.sample_nodes = 6 if self.coupled else 5 if self.bending else 4
        self.layout, self.device, self.real = layout, device, real
        self._lane_width = layout.lane_width
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
        capped = any(layout.poles)
        self.quadratic = not (self.bending or capped)
        if not (self.coupled or capped):
            self.force_gathering = self.gathering
            self.force_fluxes = RowStruct(self.gathering.Fluxes, gathered, frozenset(gathered))
        alpha_u, alpha_v = difference_weights(layout)
        self.alpha_u: wp.array = wp.array(alpha_u, dtype=real, device=device)
        self.alpha_v: wp.array = wp.array(alpha_v, dtype=real, device=device)
        self._cell_floor, self._node_floor = real(self.stiffness.cell_floor), real(self.stiffness.node_floor)
        # The same coefficients for kernels that read those of their neighbours.
        self.halo = Halo(layout, real, device)
        self._K = self.halo.surrounded(self.K, cells=True)
        self._K12 = self.halo.surrounded(self.K12, cells=True) if self.bending else self.K12
        self._KB = self.halo.surrounded(self.KB) if self.bending else self.KB
        self._KC = self.halo.surrounded(self.KC, cells=True) if self.coupled else self.KC
        # Behind a pole the tangents, and with them Gamma^1 and Gamma^2, point the other way; i + 1 stands for i - 1.
        self._flexure_turning = self.halo.turning(range(kernels.FLEXURE_COMPONENTS), [1, 1, 1, -1, -1, -1, -1])
        self._scatter_turning = self.halo.turning([1, 0, 3, 2], [1, 1, 1, 1])
        self.cap = PoleCap(layout, self.stiffness.strips, real, device) if capped else None
        position = upload(rest)
        self.measure(position, self.q0, self.b0)
        if self.cap is not None:
            self.cap.measure(position, self.cap.q0)
        self.growth: SurfaceGrowth | None = None
        if growth is not None:
            self.most_steps = GROWING_STEPS
            self.growth = SurfaceGrowth(self, growth, rest, grid, not isinstance(here.cells, PaperWeights))
            self.growth.launch()

    def twins(self, name: str) -> tuple[wp.array, ...]:
        """A coefficient's array, and that for kernels which read it at neighbours, where it is another one."""
        own, surrounded = getattr(self, name), getattr(self, f"_{name}")
        return (own,) if own is surrounded else (own, surrounded)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        places = ("cells", "nodes") if self.bending else ("cells",)
        names = [f"surface.{task}_{place}" for task in ("stress", "product", "energy") for place in places]
        names += ["surface.gather", *(f"surface_blocks.block_{place}" for place in places)]
        if self.coupled:
            names.remove("surface.product_nodes")
            names += [f"surface_coupling.{name}" for name in COUPLING_KERNELS]
        names += self.cap.kernels if self.cap is not None else ()
        return (*names, *(self.growth.kernels if self.growth is not None else ()))

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        arrays = [self.q0, self.tension, self.flux, self.b0, self.twist, self.flexure, self.scatter, self.change]
        arrays += [self.K, self.K12, self.KB, self.KC, self._K, self._K12, self._KB, self._KC]
        arrays += [self.alpha_u, self.alpha_v]
        own = sum({a.ptr: a.capacity for a in arrays}.values()) + self.halo.bytes()
        own += self.cap.bytes() if self.cap is not None else 0
        return own + (self.growth.bytes() if self.growth is not None else 0)

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        launch_lanes(kernel, self.layout, *arguments, device=self.device)

    def coarser(self, transfer: Coarsening) -> "SurfaceElasticity":
        """The surface through the coarse nodes, with the kernels of this one."""
        rest, material = transfer.sample(self._rest), self._material.coarser(transfer)
        growth = None if self.growth is None else self.growth.coarser(transfer)
        coarse = SurfaceElasticity(
            transfer.coarse, transfer.layout, rest, material, self.real, self.device, self.stiffness, growth
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
        assert isinstance(coarse, SurfaceElasticity)
        kernel = surface_levels(self._lane_width, self.real).average_tension
        ratio = self.real(transfer.growth[0] / transfer.growth[1])
        coarse._launch(kernel, Whole(self.tension), transfer.cells, ratio, coarse.tension)
        if self.cap is not None and coarse.cap is not None:
            self.cap.coarsen(transfer.growth[self.layout.periodic.index(True)], coarse.cap)

    def measure(self, position: wp.array, q_out: wp.array, b_out: wp.array) -> None:
        """Strain numbers q, shape (5, rows, columns), and curvature numbers b, shape (3, rows, columns), of a shape."""
        self.halo.refresh(position)
        self._launch(self._words.measure_membrane, position, q_out)
        if self.bending:
            self._launch(self._words.measure_bending, position, self.alpha_u, self.alpha_v, self._node_floor, b_out)

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Stresses, moments and the coefficients of the Hessian at `position`."""
        self._linearise(position, self.q0)

    def linearise_mean(self, body: BodyArrays, position: wp.array, start: wp.array) -> None:
        """Stresses of the mean strains of a step from `start` with its middle at `position` (membranes)."""
        self.halo.refresh(position, start)
        shift = surface_mean(self._lane_width, self.real).shift_rest
        self._launch(shift, position, start, self.q0, self._mean_rest)
        self._linearise(position, self._mean_rest)

    @cached_property
    def _mean_rest(self) -> wp.array:
        return wp.zeros_like(self.q0)

    def _linearise(self, position: wp.array, q0: wp.array) -> None:
        k = self._words
        self.halo.refresh(position)
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
            self.halo.refresh_turned(self.flexure, self._flexure_turning)
        self._refresh_stresses()
        if self.cap is not None:
            self.cap.linearise(position, self.flux)
        self._position = position

    def _refresh_stresses(self) -> None:
        """What the forces are gathered from."""
        self.halo.refresh_cells(self.flux)
        if self.bending:
            self.halo.refresh_turned(self.scatter, self._scatter_turning)

    def _measure_change(self, position: wp.array) -> None:
        """Changes of b since rest."""
        self._launch(
            self._coupling.change, position, self.b0, self.alpha_u, self.alpha_v, self._node_floor, self._cell_floor,
            self.change,
        )  # fmt: skip

    def _couple(self) -> None:
        """Moments of the changes of b: on top of the cells' flux, in place of the nodes' scatter."""
        self.halo.refresh(self.change)
        self._launch(
            self._coupling.couple, self.KB, self._KC, self.alpha_u, self.alpha_v, self.flexure, self.twist, self.change,
            self.flux, self.scatter,
        )  # fmt: skip

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the elastic energy [J]."""
        self.halo.refresh(position)
        self._launch(self._words.energy_cells, position, self.K, self.q0, self.K12, self.b0, self._cell_floor, partials)
        if self.bending:
            self._launch(
                self._words.energy_nodes, position, self.KB, self.b0, self.alpha_u, self.alpha_v, self._node_floor,
                partials,
            )  # fmt: skip
        if self.coupled:
            self._measure_change(position)
            self.halo.refresh(self.change)
            self._launch(self._coupling.energy_coupling, self.KC, self.change, partials)
        if self.cap is not None:
            self.cap.add_energy(position, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the exact derivative of the energy; uses the stresses of `linearise` (before any Hessian product)."""
        self._launch(self._words.gather, self.fluxes, gradient)
        self.halo.clear(gradient)

    def write_force(self, body: BodyArrays, position: wp.array) -> None:
        """Write flux, normals and scatter of the force."""
        k = surface_force(self._lane_width, self.real, self.stiffness.orthogonal, self.bending)
        self.halo.refresh(position)
        self._launch(
            k.force_cells, position, self.K, self.q0, self.K12, self.b0, self._cell_floor, Buffer(self.flux)
        )  # fmt: skip
        if self.bending:
            self._launch(
                k.force_nodes, position, self.KB, self.b0, self.alpha_u, self.alpha_v, self._node_floor,
                Buffer(self.flexure), Buffer(self.scatter),
            )  # fmt: skip
            self.halo.refresh_turned(self.flexure, self._flexure_turning)
        self._refresh_stresses()

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None:
        """Write flux and scatter of the projected Hessian times `direction`."""
        k = self._words
        self.halo.refresh(direction)
        flux, scatter = Buffer(self.flux), Buffer(self.scatter)
        self._launch(k.product_cells, self._position, self.K, self.tension, self.K12, self.twist, direction, flux)
        if self.coupled:
            c = self._coupling
            self._launch(c.change_along, self.alpha_u, self.alpha_v, self.flexure, self.twist, direction, self.change)
            self._couple()
        elif self.bending:
            self._launch(k.product_nodes, self.KB, self.alpha_u, self.alpha_v, self.flexure, direction, scatter)
        self._refresh_stresses()
        if self.cap is not None:
            self.cap.write_fluxes(self._position, direction, self.flux)

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction`; what the halo gets of it is for the mask of pins to clear."""
        self.write_fluxes(body, direction)
        self._launch(self._words.gather, self.fluxes, product)

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian."""
        k = surface_blocks(self._lane_width, self.real, self.stiffness.orthogonal, self.bending)
        self.halo.refresh(self._position)
        self.halo.refresh_cells(self.tension)
        if self.bending:
            self.halo.refresh_cells(self.twist)
        self._launch(k.block_cells, self._position, self._K, self.tension, self._K12, self.twist, blocks)
        if self.bending:
            self._launch(k.block_nodes, self._KB, self.alpha_u, self.alpha_v, self.flexure, blocks)
        if self.coupled:
            self._launch(
                self._coupling.block_coupling, self._KC, self.alpha_u, self.alpha_v, self.flexure, self.twist, blocks
            )
        self.halo.clear(blocks)
        if self.cap is not None:
            self.cap.add_block_diagonal(self._position, blocks)

    def add_majorant(self, body: BodyArrays, blocks: wp.array) -> None:
        """Add bounds of cells and bending samples; on coupled charts and poles as many blocks as a sample has nodes."""
        if self.coupled or self.cap is not None:
            super().add_majorant(body, blocks)
            return
        k = surface_majorant(self._lane_width, self.real, self.stiffness.orthogonal, self.bending)
        self._launch(k.bound_cells, self._position, self.K, self.tension, self.K12, self.twist, self.flux)
        self.halo.refresh(self.flux)
        self._launch(k.bound_nodes, self.flux, self._KB, self.alpha_u, self.alpha_v, self.flexure, blocks)
        self.halo.clear(blocks)
