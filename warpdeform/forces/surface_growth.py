"""The coefficients of a surface whose rest shape changes over time."""

from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.rest_growth import GrowthOnGrid, RestGrowth
from warpdeform.forces.surface_bending import squared_steps
from warpdeform.forces.surface_chart import cells_of
from warpdeform.grid import ParameterGrid
from warpdeform.growth import Growth
from warpdeform.kernels.surface_growth import REST_ENTRIES, surface_growth
from warpdeform.measure import strip_corners

if TYPE_CHECKING:
    from warpdeform.forces.surface_elasticity import SurfaceElasticity

Array = NDArray[np.float64]


class SurfaceGrowth(RestGrowth):
    """What grows of one elastic surface.

    Args:
        elasticity: The surface, measured at the shape that it starts with.
        growth: Growth of the body, or on its grid.
        rest: Rest positions [m], shape (nu, nv, 3).
        grid: Parameter grid.
        normalised: Strains are those over rest lengths, and K grows, too; False with the paper's weights.
    """

    module = "surface_growth"

    def __init__(
        self,
        elasticity: "SurfaceElasticity",
        growth: Growth | GrowthOnGrid,
        rest: Array,
        grid: ParameterGrid,
        normalised: bool,
    ) -> None:
        e = elasticity
        words = surface_growth(e.layout.lane_width, e.real, e.stiffness.orthogonal)
        super().__init__(words, growth, grid, e.layout, e.halo, e.real, e.device)
        shares = self.on_grid
        cells, nodes = self._upload(shares.cells, cells=True), self._upload(shares.nodes)
        self._keep("grow_strains", (cells,), (e.q0,))
        if normalised:
            self._keep("grow_membrane", (cells,), e.twins("K"))
        if e.bending:
            self._keep("grow_curvature", (cells, nodes, self._upload(_steps(grid, rest))), (e.b0,))
        if e.bending and normalised:
            self._keep("grow_bending", (nodes,), e.twins("KB"))
            self._keep("grow_twist", (cells,), e.twins("K12"))
        if e.coupled and normalised:
            # A corner's node may lie one row and column further on.
            self._keep("grow_coupling", (cells, nodes), e.twins("KC"), less=1)
        if e.cap is not None:
            around = [strip_corners(shares.nodes[tuple(ring.T)]).mean(axis=0) for ring in grid.rings]
            strips: wp.array = wp.array(np.array(around)[None], dtype=e.real, device=e.device)
            self._constants.append(strips)
            # The first axis of a strip runs around the pole.
            first = 0 if grid.periodic[0] else REST_ENTRIES
            numbers, words = self._numbers[first : first + REST_ENTRIES], surface_growth(1, e.real, False)
            self._keep("grow_strains", (strips,), (e.cap.q0,), words=words, rest=numbers)
            if normalised:
                self._keep("grow_membrane", (strips,), (e.cap.K,), words=words, rest=numbers)

    @staticmethod
    def _entries(scale: Array, curvature: Array) -> Array:
        """Along u and v, and the same with u and v exchanged."""
        return np.concatenate([scale, curvature, scale[::-1], curvature[[1, 0, 2]]])


def _steps(grid: ParameterGrid, rest: Array) -> Array:
    """What b11, b22 and b12 divide by to be curvatures [m2], shape (nu, nv, 3); zero where there is no cell."""
    steps = np.zeros((*grid.nodes, 3))
    steps[..., 0], steps[..., 1] = squared_steps(grid, rest)
    chart = cells_of(grid, rest)
    steps[tuple(slice(count) for count in grid.cells)][..., 2] = np.sqrt(chart.g11 * chart.g22)
    return steps
