"""The coefficients of a surface whose rest shape changes over time."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import warp as wp
from numpy.typing import NDArray

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


class GrowthOnGrid(NamedTuple):
    """A growth, and the shares of places in it on a grid.

    Attributes:
        growth: Keyframes.
        cells: Shares of the cells, shape (*cells).
        nodes: Shares of the nodes, shape (*nodes).
    """

    growth: Growth
    cells: Array
    nodes: Array

    @staticmethod
    def of(growth: Growth, grid: ParameterGrid) -> "GrowthOnGrid":
        """The growth on a grid.

        Raises:
            InputError: Shares that do not fit the grid or are none.
        """
        return GrowthOnGrid(growth, *growth.shares(grid))


class SurfaceGrowth:
    """Keeps the coefficients and rest numbers of one elastic surface in step with its growth.

    They are computed anew, on the device, from those of the shape that the body starts with, when the growth has moved
    on: once in a step, which costs about what one product with A costs. So everything that reads them, on every grid,
    sees the rest shape of the moment, and what does not grow has no part in it; a factor for the kernels to multiply by
    would be a variant of each of them.

    Args:
        elasticity: The surface, measured at its rest shape.
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
        e, self._growth, self._normalised = elasticity, growth.growth, normalised
        self._layout, real, self._device = e.layout, e.real, e.device
        self._shares = growth.nodes
        self.scale: Array = np.ones(2)
        self._rest = Parameters(_entries(self.scale, np.zeros(3)), real, self._device)
        self._words = surface_growth(self._layout.lane_width, real, e.stiffness.orthogonal)

        def upload(values: Array, cells: bool) -> wp.array:
            array: wp.array = wp.array(self._layout.pack(values), dtype=real, device=self._device)
            return e.halo.surrounded(array, cells=cells)

        self._cells, self._nodes = upload(growth.cells, True), upload(growth.nodes, False)
        self._steps = upload(_steps(grid, rest), False) if e.bending else self._cells
        # What changes, and what it was: name of the kernel, shares that it takes, base, result.
        self._tasks: list[tuple[str, tuple[wp.array, ...], wp.array, wp.array]] = []
        self._keep("grow_strains", (self._cells,), (e.q0,))
        if normalised:
            self._keep("grow_membrane", (self._cells,), e.twins("K"))
        if e.bending:
            self._keep("grow_curvature", (self._cells, self._nodes, self._steps), (e.b0,))
        if e.bending and normalised:
            self._keep("grow_bending", (self._nodes,), e.twins("KB"))
            self._keep("grow_twist", (self._cells,), e.twins("K12"))
        if e.coupled and normalised:
            self._keep("grow_coupling", (self._cells, self._nodes), e.twins("KC"))
        self._cap = _CapGrowth(e, growth, grid, normalised) if e.cap is not None else None

    def _keep(self, name: str, shares: tuple[wp.array, ...], arrays: tuple[wp.array, ...]) -> None:
        self._tasks += [(name, shares, wp.clone(array), array) for array in arrays]

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that are launched before a step."""
        return tuple(dict.fromkeys(f"surface_growth.{name}" for name, *_ in self._tasks))

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = [self._cells, self._nodes, self._steps, *(base for _, _, base, _ in self._tasks)]
        own = sum({a.ptr: a.capacity for a in arrays}.values()) + self._rest.bytes()
        return own + (self._cap.bytes() if self._cap is not None else 0)

    def move(self, time: float) -> None:
        """Make the rest shape that of a time [s] (host, between steps); does nothing if it is that already."""
        scale, curvature = self._growth.at(time, 2, 3)
        self.scale = scale
        if not self._rest.write(_entries(scale, curvature)):
            return
        for name, shares, base, result in self._tasks:
            self._launch(name, *shares, base, result)
        if self._cap is not None:
            self._cap.move(scale)

    def node_scales(self) -> list[Array]:
        """Factors by which rest lengths along u and v have grown by now, shape (*nodes) each (host)."""
        return [1.0 + self._shares * (scale - 1.0) for scale in self.scale]

    def _launch(self, name: str, *arrays: wp.array) -> None:
        # The halo grows with the rest; a corner's node may lie one row and column further on.
        less = 1 if name == "grow_coupling" else 0
        dim = (self._layout.rows - less, self._layout.columns // self._layout.lane_width - less)
        launch_alone(getattr(self._words, name), dim, self._rest.array, *arrays, device=self._device)


class _CapGrowth:
    """The same for the strips across poles, whose first axis runs around the pole."""

    def __init__(
        self, elasticity: "SurfaceElasticity", growth: GrowthOnGrid, grid: ParameterGrid, normalised: bool
    ) -> None:
        cap, real, self._device = elasticity.cap, elasticity.real, elasticity.device
        assert cap is not None
        self._around = grid.periodic.index(True)
        self._rest = Parameters(_entries(np.ones(2), np.zeros(3)), real, self._device)
        self._words = surface_growth(1, real, False)
        shares = [strip_corners(growth.nodes[tuple(ring.T)]).mean(axis=0) for ring in grid.rings]
        self._shares: wp.array = wp.array(np.array(shares)[None], dtype=real, device=self._device)
        self._tasks = [("grow_strains", wp.clone(cap.q0), cap.q0)]
        if normalised:
            self._tasks.append(("grow_membrane", wp.clone(cap.K), cap.K))

    def bytes(self) -> int:
        return int(self._shares.capacity + sum(base.capacity for _, base, _ in self._tasks)) + self._rest.bytes()

    def move(self, scale: Array) -> None:
        self._rest.write(_entries(scale if self._around == 0 else scale[::-1], np.zeros(3)))
        for name, base, result in self._tasks:
            kernel, dim = getattr(self._words, name), result.shape[1:]
            launch_alone(kernel, dim, self._rest.array, self._shares, base, result, device=self._device)


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
