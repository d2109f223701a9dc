"""The rest cells of a surface: what its coefficients are made of (design 1.3)."""

import numpy as np
from numpy.typing import NDArray

from warpdeform.grid import ParameterGrid

Array = NDArray[np.float64]


def cells_of(grid: ParameterGrid, rest: Array) -> "Chart":
    """The cells of a grid of rest positions [m], shape (nu, nv, 3)."""
    closed = grid.closed(rest)
    return Chart(closed[:-1, :-1], closed[1:, :-1], closed[:-1, 1:], closed[1:, 1:])


class Chart:
    """Quads by their corners [m], shape (..., 3) each: edges, metric of the mean edges, area.

    Attributes:
        m1: Mean u-edge [m], shape (..., 3).
        m2: Mean v-edge [m], shape (..., 3).
        edges_u: Squared lengths of the two u-edges [m2], at the start of v and at its end, shape (...).
        edges_v: Squared lengths of the two v-edges [m2].
        g11: m1.m1 [m2]; g12, g22 likewise.
        area: |m1 x m2| [m2].
        cosine: Cosine of the angle between m1 and m2.
    """

    def __init__(self, r00: Array, r10: Array, r01: Array, r11: Array) -> None:
        self.m1, self.m2 = 0.5 * (r10 + r11 - r00 - r01), 0.5 * (r01 + r11 - r00 - r10)
        self.edges_u = np.sum((r10 - r00) ** 2, axis=-1), np.sum((r11 - r01) ** 2, axis=-1)
        self.edges_v = np.sum((r01 - r00) ** 2, axis=-1), np.sum((r11 - r10) ** 2, axis=-1)
        pairs = ((self.m1, self.m1), (self.m1, self.m2), (self.m2, self.m2))
        self.g11, self.g12, self.g22 = (np.sum(a * b, axis=-1) for a, b in pairs)
        self.area = np.sqrt(np.maximum(self.g11 * self.g22 - self.g12**2, 0.0))
        self.cosine = self.g12 / np.sqrt(np.maximum(self.g11 * self.g22, np.finfo(np.float64).tiny))

    def flat(self) -> list[int] | None:
        """Index of the first quad without area, if there is one."""
        where = np.argwhere(self.area <= 1e-6 * np.sqrt(self.g11 * self.g22))
        return [int(k) for k in where[0]] if len(where) else None

    def voigt(self) -> Array:
        """(E11, E22, 2 E12) over m1, m2 to the orthonormal frame whose first axis is m1, shape (..., 3, 3)."""
        f11 = np.sqrt(self.g11)
        f12, f22 = self.g12 / f11, self.area / f11
        a, b, d = 1.0 / f11, -f12 / (f11 * f22), 1.0 / f22
        zero = np.zeros_like(a)
        rows = [[a * a, zero, zero], [b * b, d * d, b * d], [2 * a * b, zero, a * d]]
        return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
