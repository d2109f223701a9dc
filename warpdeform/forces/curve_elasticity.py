"""The elastic energy of a curve body: stretch, and bending and twist where the curve has them (design 1.3)."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpdeform.clamps import Clamps
from warpdeform.forces.curve_coefficients import CurveStiffness, Sections, curve_stiffness, segment_lengths
from warpdeform.forces.curve_frames import MaterialFrames
from warpdeform.forces.curve_growth import CurveGrowth
from warpdeform.forces.force import BodyArrays, Force, GridArrays
from warpdeform.forces.rest_growth import GROWING_STEPS
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.growth import Growth
from warpdeform.halo import Halo
from warpdeform.kernels.curve import SLOPE_COMPONENTS, STRETCH_COMPONENTS, curve, flux_components
from warpdeform.kernels.curve_blocks import curve_blocks
from warpdeform.launching import RowStruct, launch_alone, launch_lanes
from warpdeform.material import Material

Array = NDArray[np.float64]


class CurveElasticity(Force):
    """Stretch of many strands side by side; bending where the material has it; twist where something asks for it.

    A material frame is kept where bending cannot do without: sections that do not bend alike in every direction,
    natural curvature or twist, also such as a growth adds, or `framed`. Round strands that are straight at rest have
    none, nor kernels or arrays for it: as long as one of their ends is free to turn their twist costs no energy.

    With a `growth` the rest lengths of the segments change, and so do the coefficients that have them in the
    denominator; natural curvatures about both directors and a natural twist come on top of those of the rest shape
    (:mod:`warpdeform.kernels.curve_growth`).

    There are no coarser grids of a curve: strands are solved directly (:mod:`warpdeform.linear.strands`).

    Args:
        grid: Parameter grid, nodes along the first axis, strands along the second.
        layout: Memory layout.
        rest: Rest positions [m], shape (n, strands, 3): they are the lengths of the segments.
        material: Material.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
        section: Cross-section of all strands, or one for each; the physical form of a material needs it.
        natural: The shape whose curvature and twist need no force [m], shape (n, strands, 3); None: the rest shape.
        director: Where director 1 of the section points, on that shape: of each strand's first segment, or of every
            segment (:func:`~warpdeform.forces.curve_coefficients.material_frames`); None: anywhere. Directors of every
            segment that wind around the curve are its natural twist.
        framed: Keep material frames in any case, so that held directors twist the strands.
        start: Initial positions [m], shape (n, strands, 3), and the rotation (x, y, z, w) that they have from the rest
            shape, where they are others.
        clamps: Segments whose directors are held, and how they turn.
        growth: How the rest shape changes over time; None if it stays.

    Attributes:
        stiffness: Weights of the strains at the start.
        frames: The material frames; None without.
        angled: The direct solve has the angles as unknowns.
        growth: What the growth changes; None without.

    Raises:
        InputError: Shape, material, sections or directors that do not fit together.
    """

    name = "elasticity"
    elastic = True
    energy_kind = "elastic"
    sample_nodes = 3

    def __init__(
        self,
        grid: ParameterGrid,
        layout: Layout,
        rest: Array,
        material: Material,
        real: Any,
        device: Any,
        *,
        section: Sections = None,
        natural: Array | None = None,
        director: ArrayLike | None = None,
        framed: bool = False,
        start: tuple[Array, Sequence[float]] | None = None,
        clamps: Clamps | None = None,
        growth: Growth | None = None,
    ) -> None:
        wound = director is not None and np.ndim(director) == 3
        curls = growth is not None and bool(growth.curvature.any())
        framed = framed or wound or curls
        self.stiffness: CurveStiffness = curve_stiffness(grid, rest, material, section, natural, framed)
        strains = self._strains = self.stiffness.strains
        self._layout, self._device = layout, device
        self._lane_width, self._real = layout.lane_width, real
        self._loop = grid.nodes[0] if grid.periodic[0] else 0
        self._floor = real(self.stiffness.floor)
        self._words = curve(layout.lane_width, real, strains)

        def upload(values: Array) -> wp.array:
            return wp.array(layout.pack(values), dtype=real, device=device)

        def scratch(components: int, needed: bool = True) -> wp.array:
            shape = (components, layout.rows, layout.columns) if needed else (1, 1, 1)
            return wp.zeros(shape, dtype=real, device=device)

        bends = strains > 0
        self.axial, self.g0 = upload(self.stiffness.axial), upload(segment_lengths(grid, rest) ** 2)
        self.bending = upload(self.stiffness.bending) if bends else scratch(1, False)
        self.stretch = scratch(STRETCH_COMPONENTS)
        self.slopes = scratch(SLOPE_COMPONENTS * strains, bends)
        self.flux = scratch(flux_components(strains))
        self._none = scratch(1, False)
        self._halo = Halo(layout, real, device)
        self.gathering = self._words.gathering
        self.fluxes = RowStruct(self.gathering.Fluxes, {"flux": self.flux})
        self.force_gathering, self.force_fluxes = self.gathering, self.fluxes
        self.frames: MaterialFrames | None = None
        if strains == 3:
            shape, bent = (rest, None) if natural is None else (natural, rest)
            self.frames = MaterialFrames(grid, layout, self.bending, self._floor, real, device, shape, bent, director)
            if start is not None:
                self.frames.place(*start)
            if clamps is not None:
                self.frames.hold(clamps.held(0.0))
        self._clamps = clamps if clamps is not None and clamps.change else None
        self.angled = self.frames is not None
        self.growth: CurveGrowth | None = None
        if growth is not None:
            self.most_steps = GROWING_STEPS
            self.growth = CurveGrowth(
                growth,
                grid,
                layout,
                self._halo,
                rest,
                normalised=material.form != "eta",
                axial=self.axial,
                g0=self.g0,
                bending=self.bending if bends else None,
                natural=self.frames.natural if self.frames else None,
            )

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        names = ["curve.product", "curve.gather", "curve_blocks.block_nodes", "curve_blocks.band_nodes"]
        names += ["halo.wrap"] if self._loop else []
        names += self.growth.kernels if self.growth else ()
        if self.frames:
            return (*names, "curve_blocks.band_angles", *self.frames.kernels)
        return ("curve.stress", "curve.energy", *names)

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        arrays = (self.axial, self.g0, self.bending, self.stretch, self.slopes, self.flux)
        own = sum(int(array.capacity) for array in arrays) + self._halo.bytes()
        own += self.growth.bytes() if self.growth else 0
        return own + (self.frames.bytes() if self.frames else 0)

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        """Closed curves find their neighbours at the other end: nobody can have but some rows of them."""
        if self._loop:
            launch_alone(kernel, self._layout.lane_dim, *arguments, device=self._device)
        else:
            launch_lanes(kernel, self._layout, *arguments, device=self._device)

    def measure(self, position: wp.array, metric_out: wp.array, binormal_out: wp.array) -> None:
        """Squared lengths of the segments, shape (1, rows, columns), and kb of the nodes, shape (3, rows, columns)."""
        self._launch(self._words.measure, position, self._loop, self._floor, metric_out, binormal_out)

    def prepare(self, time: float, dt: float, tau: float) -> None:
        """Let the rest shape grow, and clamps hold and turn the directors that they do in the step up to `time` [s]."""
        if self.growth:
            self.growth.follow(time)
        if self.frames and self._clamps:
            directors = self._clamps.directors(self.frames.start.directors, time)
            self.frames.hold(self._clamps.held(time), directors)

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Stresses, moments and the coefficients of the Hessian at `position`."""
        outputs = (self.stretch, self.slopes, self.flux)
        if self.frames:
            self.frames.linearise(position, stretching=(self.axial, self.g0), outputs=outputs)
        else:
            inputs = (position, self._loop, self.axial, self.g0, self.bending, self._floor)
            self._launch(self._words.stress, *inputs, *outputs)
        self._halo.refresh(self.flux)

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the elastic energy [J]."""
        if self.frames:
            self.frames.add_energy(position, (self.axial, self.g0), partials)
        else:
            inputs = (position, self._loop, self.axial, self.g0, self.bending, self._floor)
            self._launch(self._words.energy, *inputs, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the elastic force with its sign reversed [N]; `linearise` has stored the flux."""
        self._gather(gradient)

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None:
        """Write the flux of the projected Hessian times `direction`, the angles eliminated."""
        spins, turn = self._none, self._none
        if self.frames:
            self.frames.relax(self.slopes, direction)
            spins, turn = self.frames.spins, self.frames.turn
        self._launch(self._words.product, self._loop, self.stretch, self.slopes, spins, turn, direction, self.flux)
        self._halo.refresh(self.flux)

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction` [N], the angles eliminated."""
        self.write_fluxes(body, direction)
        self._gather(product)

    def _gather(self, force: wp.array) -> None:
        launch_lanes(self._words.gather, self._layout, self.fluxes, force, device=self._device)

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks [N/m], of the Hessian with its angles held where there are frames."""
        kernel = curve_blocks(self._lane_width, self._real, self._strains).block_nodes
        self._launch(kernel, self._loop, self.stretch, self.slopes, blocks)

    def write_band(self, body: GridArrays, band: wp.array) -> None:
        """Write the Hessian, angles and all, as the band of each strand [N/m]."""
        kernels = curve_blocks(self._lane_width, self._real, self._strains)
        self._launch(kernels.band_nodes, self._loop, self.stretch, self.slopes, body.free, band)
        if self.frames:
            angles = (self.frames.spins, self.frames.held)
            self._launch(kernels.band_angles, self._loop, self.slopes, *angles, body.free, band)

    def finish(self, body: BodyArrays) -> None:
        """The frames of the accepted step are what the next one starts from."""
        if self.frames:
            self.frames.accept(body.x)

    def keep(self, body: BodyArrays) -> None:
        if self.frames:
            self.frames.keep()

    def restore(self, body: BodyArrays) -> None:
        if self.frames:
            self.frames.restore()

    def reset(self) -> None:
        """Frames as at the start of a run."""
        if self.frames:
            self.frames.reset()
