"""The parameter grid of a body and how its nodes lie in device memory."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

MOST_GROWTH = 2.2
"""Largest growth of the spacing from a grid of a multigrid hierarchy to the next."""


@dataclass(frozen=True)
class ParameterGrid:
    """A regular grid of material coordinates a = (u, v).

    Attributes:
        nodes: Nodes along u and v, each at least 2.
        spacing: Parameter spacings (h1, h2), in the units of the parametrisation.
        periodic: Axes whose index wraps; a periodic axis has as many cells as nodes.
    """

    nodes: tuple[int, int]
    spacing: tuple[float, float]
    periodic: tuple[bool, bool] = (False, False)

    @property
    def cells(self) -> tuple[int, int]:
        """Cells along u and v."""
        nu, nv = self.nodes
        return (nu if self.periodic[0] else nu - 1, nv if self.periodic[1] else nv - 1)

    @property
    def node_count(self) -> int:
        """Number of nodes."""
        return self.nodes[0] * self.nodes[1]

    def coarser(self, lengths: tuple[float, float]) -> "ParameterGrid | None":
        """The next grid of a multigrid hierarchy: half as fine on every axis worth coarsening.

        Those are the axes with more than three nodes (periodic: four) that are spaced less than twice as far as the
        closest of them, so that stretched grids grow square before they grow coarse (design 7.1). Nodes stay equally
        spaced, so that the kernels of the fine grid serve the coarse one; they need not coincide with fine nodes. Half
        the nodes, rounded up, keep whole lane groups whole (64, 32, 16); where that would widen the spacing by more
        than `MOST_GROWTH` it is half the cells, rounded up.

        Args:
            lengths: Mean distance of neighbours along each axis [m].

        Returns:
            The coarser grid, or None if no axis can be coarsened.
        """
        open_axes = [n > (4 if p else 3) for n, p in zip(self.nodes, self.periodic, strict=True)]
        if not any(open_axes):
            return None
        limit = 2.0 * min(length for length, is_open in zip(lengths, open_axes, strict=True) if is_open)
        nodes, spacing = [], []
        for axis, cells in enumerate(self.cells):
            halve = open_axes[axis] and lengths[axis] < limit
            fewer = cells
            if halve:
                fewer = -(-self.nodes[axis] // 2) - (0 if self.periodic[axis] else 1)
                if cells > MOST_GROWTH * fewer:
                    fewer = -(-cells // 2)
            nodes.append(fewer + (0 if self.periodic[axis] else 1))
            spacing.append(self.spacing[axis] * cells / fewer)
        return ParameterGrid((nodes[0], nodes[1]), (spacing[0], spacing[1]), self.periodic)

    def parameters(self) -> NDArray[np.float64]:
        """Material coordinates of the nodes, scaled to 0..1 along each axis, shape (nu, nv, 2)."""
        u, v = (np.arange(n) / max(c, 1) for n, c in zip(self.nodes, self.cells, strict=True))
        return np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)

    def cells_to_nodes(self, cells: NDArray[np.float64]) -> NDArray[np.float64]:
        """Share a quantity of each cell (nu - 1, nv - 1) equally among its four corners: trapezoid weights.

        Returns:
            Node shares, shape (nu, nv); their sum is the sum over the cells.
        """
        shares = np.zeros(self.nodes)
        nu, nv = self.nodes
        rows, columns = np.arange(cells.shape[0]), np.arange(cells.shape[1])
        for di in (0, 1):
            for dj in (0, 1):
                shares[np.ix_((rows + di) % nu, (columns + dj) % nv)] += 0.25 * cells
        return shares


@dataclass(frozen=True)
class Layout:
    """Component arrays with a halo: node (i, j) lies at row i + 1, column j + halo.

    Columns are filled up to whole lane groups and framed by one group on each side, rows by one row, so that kernels
    read neighbours without a border test. Everything outside the body is zero and stays zero.

    Attributes:
        nodes: Nodes along u (rows) and v (columns).
        lane_width: Nodes per lane group.
    """

    nodes: tuple[int, int]
    lane_width: int
    halo: int = field(init=False)
    groups: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "halo", self.lane_width)
        object.__setattr__(self, "groups", -(-self.nodes[1] // self.lane_width))

    @property
    def rows(self) -> int:
        """Rows of an array, halo included."""
        return self.nodes[0] + 2

    @property
    def columns(self) -> int:
        """Columns of an array, halo included."""
        return (self.groups + 2) * self.lane_width

    @property
    def lane_dim(self) -> tuple[int, int]:
        """Launch dimensions of a lane kernel: one thread per lane group."""
        return (self.nodes[0], self.groups)

    def pack(self, values: NDArray[np.generic]) -> NDArray[np.float64]:
        """Host values per node, shape (nu, nv) or (nu, nv, n), to component form (n, rows, columns).

        Values on fewer samples than nodes (cells, edges) fill the first rows and columns; the rest is zero.
        """
        values = values[..., None] if values.ndim == 2 else values
        packed = np.zeros((values.shape[2], self.rows, self.columns))
        packed[:, 1 : 1 + values.shape[0], self.halo : self.halo + values.shape[1]] = np.moveaxis(values, 2, 0)
        return packed

    def unpack(self, packed: NDArray[np.generic], samples: tuple[int, int] | None = None) -> NDArray[np.float64]:
        """The inverse of `pack`: (n, rows, columns) to a fresh array (nu, nv, n), or of fewer `samples` than nodes."""
        nu, nv = samples or self.nodes
        values = np.moveaxis(packed[:, 1 : 1 + nu, self.halo : self.halo + nv], 0, 2)
        return np.array(values, dtype=np.float64, order="C")
