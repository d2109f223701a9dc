"""A mass-spring cloth in Taichi, written as its cloth examples are."""

from typing import Any, ClassVar

import numpy as np

from warpdeform.study.peers.engine import Engine, Session, Setting
from warpdeform.study.peers.sheet import FPS, Array, Sheet

EXAMPLE_STEP = 0.04
"""Step of Taichi's own cloth over its node spacing [s/m]."""
SHARES = (0.95, 0.5, 0.25)
"""Steps as shares of the longest stable one."""


class Taichi(Engine):
    """Springs under semi-implicit Euler steps in one Taichi kernel, on its CPU backend with one thread.

    Springs to the eight neighbours: 3/4 Eh along the grid (half on the rim), 3/8 Eh along the diagonals, the isotropic
    lattice of Young's modulus Eh and Poisson ratio 1/3. It has no bending stiffness. No damping, neither the example's
    drag nor its dashpots. The example's step, 0.04 s/m times the spacing, belongs to its own softness.
    """

    name: ClassVar[str] = "taichi"
    package: ClassVar[str] = "taichi"
    law: ClassVar[str] = "springs along the grid and its diagonals, no bending"

    def settings(self, nodes: int) -> tuple[Setting, ...]:
        """The example's step, and shares of the longest stable one."""
        sheet = Sheet(nodes)
        example = int(np.ceil(1.0 / (FPS * EXAMPLE_STEP * sheet.spacing)))
        counts = [(example, True), *((sheet.explicit_substeps(share), False) for share in SHARES)]
        return tuple(Setting(f"dt 1/{FPS * k}", {"substeps": k}, example=first) for k, first in counts)

    def references(self, nodes: int) -> tuple[Setting, Setting]:
        """Double precision at a third of the longest stable step, and two thirds, velocities half a step behind."""
        substeps = Sheet(nodes).explicit_substeps(2 / 3)
        fine, coarse = ({"substeps": k * substeps, "precision": "float64"} for k in (2, 1))
        return Setting("double precision", fine), Setting("double precision, twice the step", coarse)

    def prepare(self, sheet: Sheet, setting: Setting) -> Session:
        """Compile the kernel."""
        return _Springs(sheet, setting.values["substeps"], setting.values.get("precision", "float32"))


class _Springs(Session):
    def __init__(self, sheet: Sheet, substeps: int, precision: str) -> None:
        import taichi as ti

        real = ti.f64 if precision == "float64" else ti.f32
        ti.init(arch=ti.cpu, cpu_max_num_threads=1, default_fp=real, log_level=ti.WARN)
        dt = 1.0 / (FPS * substeps)
        self._substeps = substeps
        self._x = ti.Vector.field(3, dtype=real, shape=(sheet.nodes, sheet.nodes))
        self._v = ti.Vector.field(3, dtype=real, shape=(sheet.nodes, sheet.nodes))
        self._step = _kernel(ti, sheet, dt, self._x, self._v)
        self._step()  # compiles it
        self._x.from_numpy(sheet.positions().astype(precision))
        # Half a step back in a reference, so that its steps are Verlet's, of second order.
        self._v.fill([0.0, 0.0, 0.5 * dt * sheet.gravity if precision == "float64" else 0.0])

    def advance_frame(self) -> None:
        for _ in range(self._substeps):
            self._step()

    def positions(self) -> Array:
        return self._x.to_numpy().astype(np.float64)


def _kernel(ti: Any, sheet: Sheet, dt: float, x: Any, v: Any) -> Any:
    """The kernel of one step."""
    n, fall, mass = sheet.nodes, dt * sheet.gravity, sheet.areal_density * sheet.spacing**2
    axis, diagonal, spacing = dt * sheet.axis_spring, dt * sheet.diagonal_spring, sheet.spacing
    neighbours = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]

    @ti.kernel
    def step():  # type: ignore[no-untyped-def]
        for i, j in x:
            push = ti.Vector([0.0, 0.0, 0.0])
            for di, dj in ti.static(neighbours):
                if 0 <= i + di < n and 0 <= j + dj < n:
                    between = x[i + di, j + dj] - x[i, j]
                    if ti.static(di != 0 and dj != 0):
                        push += diagonal * (1.0 - spacing * ti.sqrt(2.0) / between.norm()) * between
                    else:
                        rim = (i == 0 or i == n - 1) if ti.static(di == 0) else (j == 0 or j == n - 1)
                        push += ti.select(rim, 0.5, 1.0) * axis * (1.0 - spacing / between.norm()) * between
            share = ti.select(i == 0 or i == n - 1, 0.5, 1.0) * ti.select(j == 0 or j == n - 1, 0.5, 1.0)
            if j > 0 or 0 < i < n - 1:
                v[i, j] += push / (mass * share) - ti.Vector([0.0, 0.0, fall])
        for i, j in x:
            if j > 0 or 0 < i < n - 1:
                x[i, j] += dt * v[i, j]

    return step
