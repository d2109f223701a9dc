"""The sheet of the scene `hanging` as plain numbers, from which every engine builds its own model."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FPS = 60
"""Frames per second; errors are taken at frames."""
FRAMES = 30
"""Frames of a run: 0.5 s, as far as the swing can be foreseen (design 6.3)."""
CHECKED = (15, 30)
"""Frames whose errors are measured: 0.25 and 0.5 s."""


@dataclass(frozen=True)
class Sheet:
    """A flat square of cloth in the plane z = 0, let go with two neighbouring corners pinned.

    Attributes:
        nodes: Nodes along each side, n.
        side: Length of a side [m].
        areal_density: Mass per area [kg/m2].
        membrane_stiffness: Young's modulus times thickness, Eh [N/m].
        poisson_ratio: Poisson ratio.
        bending_stiffness: D [N m].
        gravity: Acceleration of gravity, along -z [m/s2].
    """

    nodes: int
    side: float = 1.0
    areal_density: float = 0.2
    membrane_stiffness: float = 1000.0
    poisson_ratio: float = 0.3
    bending_stiffness: float = 1e-5
    gravity: float = 9.81

    @property
    def spacing(self) -> float:
        """Distance of neighbouring nodes, h [m]."""
        return self.side / (self.nodes - 1)

    @property
    def first_lame(self) -> float:
        """Plane-stress first Lame parameter times thickness, Eh nu / (1 - nu^2) [N/m]."""
        return self.membrane_stiffness * self.poisson_ratio / (1 - self.poisson_ratio**2)

    @property
    def shear_modulus(self) -> float:
        """Shear modulus times thickness, Eh / (2 (1 + nu)) [N/m]."""
        return self.membrane_stiffness / (2 * (1 + self.poisson_ratio))

    @property
    def axis_spring(self) -> float:
        """Stiffness of springs along the grid, 3/4 Eh [N/m]; half of it on the rim.

        Springs along the grid (k) and both diagonals (k/2) of square cells make an isotropic membrane of Poisson ratio
        1/3, the nearest that springs get to 0.3, whose Young's modulus is 4/3 k.
        """
        return 0.75 * self.membrane_stiffness

    @property
    def diagonal_spring(self) -> float:
        """Stiffness of springs along both diagonals of a cell [N/m]."""
        return 0.5 * self.axis_spring

    @property
    def stable_step(self) -> float:
        """Longest stable step of the springs under explicit integration [s]: 2 over their highest frequency.

        That is the wave of two spacings along the grid, whose squared frequency is 6 k / (rho h^2).
        """
        return self.spacing * float(np.sqrt(2 * self.areal_density / (3 * self.axis_spring)))

    def explicit_substeps(self, share: float) -> int:
        """Steps per frame whose length is at most a share of the longest stable step."""
        return int(np.ceil(1.0 / (FPS * share * self.stable_step)))

    def positions(self) -> Array:
        """Positions at the start [m], shape (n, n, 3); the first axis is x."""
        along = np.linspace(0.0, self.side, self.nodes)
        x, y = np.meshgrid(along - self.side / 2, along, indexing="ij")
        return np.stack([x, y, np.zeros_like(x)], axis=-1)

    def masses(self) -> Array:
        """Node masses [kg], shape (n, n): a quarter of each cell to each of its corners."""
        share = np.ones(self.nodes)
        share[[0, -1]] = 0.5
        return self.areal_density * self.spacing**2 * np.outer(share, share)

    def pinned(self) -> tuple[int, int]:
        """Numbers of the pinned nodes, counted along y first."""
        return 0, (self.nodes - 1) * self.nodes

    def triangles(self) -> NDArray[np.int64]:
        """Two triangles a cell, split from (i + 1, j) to (i, j + 1), shape (2 (n - 1)^2, 3)."""
        number = np.arange(self.nodes**2).reshape(self.nodes, self.nodes)
        a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
        return np.stack([np.stack([a, b, d], -1), np.stack([b, c, d], -1)], 2).reshape(-1, 3)

    def springs(self) -> list[tuple[int, int, float]]:
        """Springs along the grid and both diagonals: two node numbers and the stiffness [N/m]."""
        n, number = self.nodes, np.arange(self.nodes**2).reshape(self.nodes, self.nodes)
        found = []
        for k in range(n):
            stiffness = self.axis_spring * (0.5 if k in (0, n - 1) else 1.0)
            for line in (number[k, :], number[:, k]):
                found += [(int(i), int(j), stiffness) for i, j in pairwise(line)]
        for first, second in ((number[:-1, :-1], number[1:, 1:]), (number[1:, :-1], number[:-1, 1:])):
            pairs = zip(first.ravel(), second.ravel(), strict=True)
            found += [(int(i), int(j), self.diagonal_spring) for i, j in pairs]
        return found


def longest_stretch(positions: Array, spacing: float) -> float:
    """Longest edge along the grid over its rest length.

    Args:
        positions: Positions [m], shape (n, n, 3).
        spacing: Rest length [m].
    """
    lengths = [np.linalg.norm(np.diff(positions, axis=axis), axis=-1).max() for axis in (0, 1)]
    return float(max(lengths) / spacing)
