"""A block of rubber that is dropped on the ground, as plain numbers, from which every engine builds its own model."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpdeform.study.peers.sheet import Array

CORNERS = np.array([[i, j, k] for i in (0, 1) for j in (0, 1) for k in (0, 1)])
"""The corners of a cell, by how far along each axis."""


@dataclass(frozen=True)
class Block:
    """A cube above the plane z = 0.

    Attributes:
        nodes: Nodes along each side.
        side: Length of a side [m].
        density: Mass per volume [kg/m3].
        youngs_modulus: E [Pa].
        poisson_ratio: nu.
        height: Height of its lowest nodes at the start [m].
        gravity: Acceleration of gravity, along -z [m/s2].
        seconds: Simulated time [s].
    """

    nodes: int = 10
    side: float = 0.2
    density: float = 1000.0
    youngs_modulus: float = 1e5
    poisson_ratio: float = 0.4
    height: float = 0.1
    gravity: float = 9.81
    seconds: float = 2.0

    @property
    def spacing(self) -> float:
        """Distance of neighbouring nodes [m]."""
        return self.side / (self.nodes - 1)

    @property
    def mass(self) -> float:
        """Mass [kg]."""
        return self.density * self.side**3

    @property
    def shear_modulus(self) -> float:
        """E / (2 (1 + nu)) [Pa]."""
        return self.youngs_modulus / (2.0 * (1.0 + self.poisson_ratio))

    @property
    def first_lame(self) -> float:
        """E nu / ((1 + nu) (1 - 2 nu)) [Pa]."""
        nu = self.poisson_ratio
        return self.youngs_modulus * nu / ((1.0 + nu) * (1.0 - 2.0 * nu))


def least_volume(positions: Array, spacing: float) -> float:
    """Smallest volume ratio J at any corner of any cell; not above 0 where a cell is turned inside out.

    Args:
        positions: Positions [m], shape (n, n, n, 3), axes along x, y and z.
        spacing: Rest distance of neighbouring nodes [m].
    """
    cells = np.array(positions.shape[:3]) - 1

    def edge(corner: NDArray[np.int64], axis: int) -> Array:
        """From the one end to the other of the edge along an axis that meets the corner, in all cells."""
        low, high = corner.copy(), corner.copy()
        low[axis], high[axis] = 0, 1
        part = [tuple(slice(s, s + n) for s, n in zip(start, cells, strict=True)) for start in (low, high)]
        difference: Array = positions[part[1]] - positions[part[0]]
        return difference

    ratios = []
    for corner in CORNERS:
        u, v, w = (edge(corner, axis) for axis in range(3))
        ratios.append(np.einsum("...k,...k", u, np.cross(v, w)).min())
    return float(min(ratios) / spacing**3)
