"""The coefficients of a solid whose rest shape changes over time."""

from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.rest_growth import GrowthOnGrid, RestGrowth
from warpdeform.forces.solid_coefficients import PAIRS
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.growth import Growth
from warpdeform.halo import Halo
from warpdeform.kernels.solid_growth import solid_growth

if TYPE_CHECKING:
    from warpdeform.forces.solid_elasticity import SolidElasticity

Array = NDArray[np.float64]


class SolidGrowth(RestGrowth):
    """What grows of one solid.

    Args:
        elasticity: The solid, measured at the shape that it starts with.
        growth: Growth of the body, or on its grid.
        grid: Parameter grid.
        layout: Memory layout.
        halo: Halo of the body's arrays.
        normalised: Strains are those over rest lengths, and K grows, too; False with the paper's weights.
    """

    module = "solid_growth"
    curvatures = 0

    def __init__(
        self,
        elasticity: "SolidElasticity",
        growth: Growth | GrowthOnGrid,
        grid: ParameterGrid,
        layout: Layout,
        halo: Halo,
        normalised: bool,
    ) -> None:
        e, real, device = elasticity, elasticity.q0.dtype, elasticity.q0.device
        words = solid_growth(layout.lane_width, real, e.stiffness.orthogonal)
        super().__init__(words, growth, grid, layout, halo, real, device)
        lines, cells = self._upload(self._line_shares()), self._upload(self.on_grid.cells, cells=True)
        self._keep("grow_strains", (lines,), (e.q0,))
        if normalised:
            shares = cells
            if e.stiffness.uniform:
                # All cells have the same K, and take all of it.
                shares = wp.full((1, *e.K.shape[1:]), 1.0, dtype=real, device=device)
                self._constants.append(shares)
            self._keep("grow_law", (shares,), e.laws)
            if not e.stiffness.orthogonal:
                self._keep("grow_edges", (lines,), (e.t,))
        if e.barrier:
            self._keep("grow_volume", (cells,), (e.volume,))

    def _line_shares(self) -> Array:
        """Shares of the edges along u, v, w and of the faces uv, uw, vw that begin at each node, shape (*nodes, 6)."""
        on = self.on_grid
        found = [on.edge_shares(axis) for axis in range(3)]
        found += [on.grid.means(on.edge_shares(i), j) for i, j in PAIRS]
        shares = np.zeros((*on.grid.nodes, 6))
        for k, values in enumerate(found):
            shares[..., k][tuple(slice(n) for n in values.shape)] = values
        return shares
