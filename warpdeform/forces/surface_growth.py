"""The coefficients of a surface whose rest shape changes over time."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import Coarsening
from warpdeform.forces.parameters import Parameters
from warpdeform.forces.surface_bending import squared_steps
from warpdeform.forces.surface_chart import cells_of
from warpdeform.grid import ParameterGrid
from warpdeform.growth import Growth
from warpdeform.kernels.surface_growth import REST_ENTRIES, surface_growth
from warpdeform.launching import launch_alone
from warpdeform.measure import strip_corners

if TYPE_CHECKING:
    from warpdeform.forces.surface_elasticity import SurfaceElasticity

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GrowthOnGrid:
    """A growth on a grid.

    Attributes:
        growth: Keyframes.
        cells: Shares of the cells in it, shape (*cells).
        nodes: Shares of the nodes, shape (*nodes).
        rest: What holds for the body now (:mod:`warpdeform.kernels.surface_growth`), the same on all its grids.
        turned: The same with u and v exchanged.
    """

    growth: Growth
    cells: Array
    nodes: Array
    rest: Parameters
    turned: Parameters

    @staticmethod
    def of(growth: Growth, grid: ParameterGrid, real: Any, device: Any) -> "GrowthOnGrid":
        """The growth on a body's own grid.

        Raises:
            InputError: Shares that do not fit the grid or are none.
        """
        cells, nodes = growth.shares(grid)
        start = _entries(np.ones(2), np.zeros(3))
        return GrowthOnGrid(growth, cells, nodes, Parameters(start, real, device), Parameters(start, real, device))

    def coarser(self, transfer: Coarsening) -> "GrowthOnGrid":
        """The same growth on a coarser grid, with the mean of the shares."""
        return replace(self, cells=transfer.average_cells(self.cells), nodes=transfer.average_nodes(self.nodes))

    def move(self, time: float) -> bool:
        """Write what holds at a time [s] (host, between steps); says whether that is something else than before."""
        scale, curvature = self.growth.at(time, 2, 3)
        self.turned.write(_entries(scale[::-1], curvature[[1, 0, 2]]))
        return self.rest.write(_entries(scale, curvature))

    def node_scales(self) -> list[Array]:
        """Factors by which rest lengths along u and v have grown by now, shape (*nodes) each."""
        return [1.0 + self.nodes * (scale - 1.0) for scale in self.rest.values[:2]]


class SurfaceGrowth:
    """Computes the coefficients and rest numbers of one elastic surface from those of the shape that it starts with.

    That happens on the device and between steps, when a growth has moved on. So everything that reads them, on every
    grid, sees the rest shape of the moment, and what does not grow has no part in it. A factor for the kernels to
    multiply by, which even growth could do with, would be a variant of each of them; this costs 1 to 4 % of a step.

    Args:
        elasticity: The surface, measured at the shape that it starts with.
        growth: Growth on its grid.
        rest: Rest positions [m], shape (nu, nv, 3).
        grid: Parameter grid.
        normalised: Strains are those over rest lengths, and K grows, too; False with the paper's weights.
    """

    def __init__(
        self,
        elasticity: "SurfaceElasticity",
        growth: GrowthOnGrid,
        rest: Array,
        grid: ParameterGrid,
        normalised: bool,
    ) -> None:
        e, real = elasticity, elasticity.real
        self._layout, self._device = e.layout, e.device
        self._rest, self._turned = growth.rest, growth.turned
        self._words = surface_growth(self._layout.lane_width, real, e.stiffness.orthogonal)

        def upload(values: Array, cells: bool) -> wp.array:
            array: wp.array = wp.array(self._layout.pack(values), dtype=real, device=self._device)
            return e.halo.surrounded(array, cells=cells)

        cells, nodes = upload(growth.cells, True), upload(growth.nodes, False)
        self._constants = [cells, nodes]
        # What changes, and what it was: name of the kernel, shares that it takes, base, result.
        self._tasks: list[tuple[str, tuple[wp.array, ...], wp.array, wp.array]] = []
        self._keep("grow_strains", (cells,), (e.q0,))
        if normalised:
            self._keep("grow_membrane", (cells,), e.twins("K"))
        if e.bending:
            self._constants.append(upload(_steps(grid, rest), False))
            self._keep("grow_curvature", (cells, *self._constants[1:]), (e.b0,))
        if e.bending and normalised:
            self._keep("grow_bending", (nodes,), e.twins("KB"))
            self._keep("grow_twist", (cells,), e.twins("K12"))
        if e.coupled and normalised:
            self._keep("grow_coupling", (cells, nodes), e.twins("KC"))
        self._in_caps: list[tuple[str, wp.array, wp.array]] = []
        if e.cap is not None:
            shares = [strip_corners(growth.nodes[tuple(ring.T)]).mean(axis=0) for ring in grid.rings]
            self._constants.append(wp.array(np.array(shares)[None], dtype=real, device=self._device))
            self._cap_words = surface_growth(1, real, False)
            self._cap_rest = self._rest if grid.periodic[0] else self._turned
            self._in_caps.append(("grow_strains", wp.clone(e.cap.q0), e.cap.q0))
            if normalised:
                self._in_caps.append(("grow_membrane", wp.clone(e.cap.K), e.cap.K))

    def _keep(self, name: str, shares: tuple[wp.array, ...], arrays: tuple[wp.array, ...]) -> None:
        self._tasks += [(name, shares, wp.clone(array), array) for array in arrays]

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that are launched before a step."""
        return tuple(dict.fromkeys(f"surface_growth.{name}" for name, *_ in self._tasks))

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = [*self._constants, *(base for *_, base, _ in self._tasks), *(base for _, base, _ in self._in_caps)]
        own = sum({a.ptr: a.capacity for a in arrays}.values())
        return own + self._rest.bytes() + self._turned.bytes()

    def launch(self) -> None:
        """Make the rest shape that of now."""
        rows, groups = self._layout.rows, self._layout.columns // self._layout.lane_width
        for name, shares, base, result in self._tasks:
            # The halo grows with the rest; a corner's node may lie one row and column further on.
            less = 1 if name == "grow_coupling" else 0
            kernel, arrays = getattr(self._words, name), (*shares, base, result)
            launch_alone(kernel, (rows - less, groups - less), self._rest.array, *arrays, device=self._device)
        for name, base, result in self._in_caps:
            # The first axis of a strip runs around the pole.
            kernel, arrays = getattr(self._cap_words, name), (self._constants[-1], base, result)
            launch_alone(kernel, result.shape[1:], self._cap_rest.array, *arrays, device=self._device)


def _entries(scale: Array, curvature: Array) -> Array:
    entries = np.concatenate([scale, curvature])
    assert len(entries) == REST_ENTRIES
    return entries


def _steps(grid: ParameterGrid, rest: Array) -> Array:
    """What b11, b22 and b12 divide by to be curvatures [m2], shape (nu, nv, 3); zero where there is no cell."""
    steps = np.zeros((*grid.nodes, 3))
    steps[..., 0], steps[..., 1] = squared_steps(grid, rest)
    chart = cells_of(grid, rest)
    steps[tuple(slice(count) for count in grid.cells)][..., 2] = np.sqrt(chart.g11 * chart.g22)
    return steps
