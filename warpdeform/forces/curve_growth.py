"""The coefficients of a curve whose rest shape changes over time."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.curve_coefficients import node_lengths, segment_lengths
from warpdeform.forces.rest_growth import RestGrowth
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.growth import Growth
from warpdeform.halo import Halo
from warpdeform.kernels.curve_growth import curve_growth

Array = NDArray[np.float64]


class CurveGrowth(RestGrowth):
    """What grows of the strands of one body. The direct solve has no grids beside theirs: it reads what they have.

    Args:
        growth: Growth of the body.
        grid: Parameter grid.
        layout: Memory layout.
        halo: Halo of the body's arrays.
        rest: Rest positions at the start [m], shape (n, strands, 3).
        normalised: Weights are those over rest lengths, and change, too; False with the paper's weights.
        axial: Weights of the stretch, shape (1, rows, columns).
        g0: Squared rest lengths of the segments, shape (1, rows, columns).
        bending: Weights of the curvatures and the twist, shape (1 or 3, rows, columns); None without bending.
        natural: Curvatures and twist that need no force, shape (3, rows, columns); None without frames.
    """

    module = "curve_growth"

    def __init__(
        self,
        growth: Growth,
        grid: ParameterGrid,
        layout: Layout,
        halo: Halo,
        rest: Array,
        *,
        normalised: bool,
        axial: wp.array,
        g0: wp.array,
        bending: wp.array | None,
        natural: wp.array | None,
    ) -> None:
        words = curve_growth(layout.lane_width, g0.dtype)
        super().__init__(words, growth, grid, layout, halo, g0.dtype, g0.device)
        shares, lengths = self.on_grid.cells, segment_lengths(grid, rest)
        cells = self._upload(shares, cells=True)
        self._keep("grow_lengths", (cells,), (g0,))
        if normalised:
            self._keep("grow_stretching", (cells,), (axial,))
        if bending is None:
            return
        between = node_lengths(grid, lengths)
        nodes = self._upload(node_lengths(grid, shares * lengths) / between)
        if normalised:
            self._keep("grow_bending", (nodes,), (bending,))
        if natural is not None:
            if not grid.periodic[0]:
                between[[0, -1]] = 0.0
            self._keep("grow_curvature", (nodes, self._upload(between)), (natural,))
