"""Laws of solvers that know single precision only, integrated in double precision with the explicit Verlet method.

In single precision a step of 1e-4 s adds less to a position than its rounding keeps, and the sheet's folds grow the
difference: such a solver's own finest runs are centimetres apart at 0.5 s. So its limit is computed from its law. That
this is its law is tested: the solver approaches the limit as its steps shrink.

Sheets are (n, n, 3) arrays; triangles are split from (i + 1, j) to (i, j + 1), so that u and v edges are slices.
"""

from collections.abc import Callable, Sequence

import numpy as np

from warpdeform.study.peers.engine import Session
from warpdeform.study.peers.sheet import FPS, Array, Sheet

Stress = Callable[[Array, Array], tuple[Array, Array]]
"""First Piola-Kirchhoff stress [N/m] along u and v from the deformed unit vectors along u and v."""
Forces = Callable[[Array], Array]
"""Forces [N] from positions [m], both of shape (n, n, 3)."""


def neo_hookean(first_lame: float, shear_modulus: float) -> Stress:
    """Stable neo-Hookean membrane: mu/2 (|F|^2 - 2) + k/2 (J - 1 - mu / k)^2, k = lambda + mu, J the area ratio."""
    bulk = first_lame + shear_modulus

    def stress(f0: Array, f1: Array) -> tuple[Array, Array]:
        area = np.cross(f0, f1)
        ratio = np.sqrt(np.maximum(_dot(area, area), 1e-20))
        normal = area / ratio
        pull = bulk * (ratio - 1.0) - shear_modulus
        return shear_modulus * f0 + pull * np.cross(f1, normal), shear_modulus * f1 + pull * np.cross(normal, f0)

    return stress


def stretch_and_shear(stretch: float, shear: float) -> Stress:
    """Stretch along u and v, and the cosine of the angle between them, with stiffnesses [N/m] and no lateral effect."""

    def stress(f0: Array, f1: Array) -> tuple[Array, Array]:
        long0, long1 = np.sqrt(_dot(f0, f0)), np.sqrt(_dot(f1, f1))
        e0, e1 = f0 / long0, f1 / long1
        lean = shear * _dot(e0, e1)
        return stretch * (long0 - 1.0) * e0 + lean * e1, stretch * (long1 - 1.0) * e1 + lean * e0

    return stress


def membrane(stress: Stress, spacing: float) -> Forces:
    """Constant-strain triangles under a stress."""
    pull = 0.5 * spacing  # area over spacing

    def forces(x: Array) -> Array:
        found = np.zeros_like(x)
        a, b, c, d = _corners(x)
        first, second = stress((b - a) / spacing, (d - a) / spacing)
        fa, fb, fc, fd = _corners(found)
        fa += pull * (first + second)
        fb -= pull * first
        fd -= pull * second
        first, second = stress((c - d) / spacing, (c - b) / spacing)
        fc -= pull * (first + second)
        fd += pull * first
        fb += pull * second
        return found

    return forces


def hinges(straight: float, diagonal: float, *, true_gradient: bool = True) -> Forces:
    """Dihedral angles at all inner edges.

    Args:
        straight: Stiffness of a hinge along the grid: torque over angle [N m]; without the true gradient, force over
            angle and edge length [N/m].
        diagonal: The same of hinges along diagonals.
        true_gradient: Whether forces follow the angle's gradient; else this without its division by twice the
            triangles' areas, as in a position-based constraint that leaves it out.
    """

    def forces(x: Array) -> Array:
        found = np.zeros_like(x)
        for stiffness, corners in ((straight, _along_v), (straight, _along_u), (diagonal, _across)):
            p, q, a, b = corners(x)
            fp, fq, fa, fb = corners(found)
            edge, n1, n2 = b - a, np.cross(a - p, b - p), np.cross(b - q, a - q)
            length, size1, size2 = (np.sqrt(_dot(w, w)) for w in (edge, n1, n2))
            e, n1, n2 = edge / length, n1 / size1, n2 / size2
            torque = stiffness * np.arctan2(_dot(np.cross(n1, n2), e), _dot(n1, n2))
            if true_gradient:
                n1, n2 = n1 / size1, n2 / size2
            fp += torque * length * n1
            fq += torque * length * n2
            fa += torque * (_dot(p - b, e) * n1 + _dot(q - b, e) * n2)
            fb += torque * (_dot(a - p, e) * n1 + _dot(a - q, e) * n2)
        return found

    return forces


def quadratic_bending(straight: float, diagonal: float, spacing: float) -> Forces:
    """Quadratic bending of flat sheets: k/2 3/A |sum of cotangent weights times positions|^2 at every inner edge.

    Args:
        straight: Stiffness k of edges along the grid [N m].
        diagonal: The same of diagonals.
        spacing: Node spacing [m]; two triangles have the area A = spacing^2.
    """
    weight = 3.0 / spacing**2

    def forces(x: Array) -> Array:
        found = np.zeros_like(x)
        for stiffness, cotangents, corners in (
            (straight, 1.0, _along_v),
            (straight, 1.0, _along_u),
            (diagonal, 2.0, _across),
        ):
            p, q, a, b = corners(x)
            fp, fq, fa, fb = corners(found)
            pull = stiffness * weight * cotangents**2 * (a + b - p - q)
            fp += pull
            fq += pull
            fa -= pull
            fb -= pull
        return found

    return forces


def springs(axis: float, diagonal: float, spacing: float) -> Forces:
    """Springs along the grid, half as stiff on the rim, and along both diagonals, with stiffnesses [N/m]."""

    def pull(stiffness: float | Array, rest: float, a: Array, b: Array, fa: Array, fb: Array) -> None:
        between = b - a
        force = stiffness * (1.0 - rest / np.sqrt(_dot(between, between))) * between
        fa += force
        fb -= force

    def forces(x: Array) -> Array:
        found = np.zeros_like(x)
        line = np.full((x.shape[0], 1), axis)
        line[[0, -1]] *= 0.5
        pull(line[None], spacing, x[:-1], x[1:], found[:-1], found[1:])
        pull(line[:, None], spacing, x[:, :-1], x[:, 1:], found[:, :-1], found[:, 1:])
        a, b, c, d = _corners(x)
        fa, fb, fc, fd = _corners(found)
        pull(diagonal, spacing * np.sqrt(2.0), a, c, fa, fc)
        pull(diagonal, spacing * np.sqrt(2.0), b, d, fb, fd)
        return found

    return forces


class Verlet(Session):
    """A law under the explicit Verlet method, of second order.

    Args:
        sheet: The sheet.
        terms: Its forces.
        substeps: Steps per frame.
    """

    def __init__(self, sheet: Sheet, terms: Sequence[Forces], substeps: int) -> None:
        self._terms, self._substeps, self._dt = terms, substeps, 1.0 / (FPS * substeps)
        self._x = sheet.positions()
        self._per_mass = 1.0 / sheet.masses()[..., None]
        free = np.ones(sheet.nodes**2)
        free[list(sheet.pinned())] = 0.0
        self._free = free.reshape(sheet.nodes, sheet.nodes, 1)
        self._fall = np.array([0.0, 0.0, -sheet.gravity])
        self._v = -0.5 * self._dt * self._acceleration()  # velocities stand half a step before positions

    def advance_frame(self) -> None:
        """Simulate one frame."""
        for _ in range(self._substeps):
            self._v += self._dt * self._acceleration()
            self._x += self._dt * self._v

    def positions(self) -> Array:
        """Positions [m], shape (n, n, 3)."""
        return self._x.copy()

    def _acceleration(self) -> Array:
        forces = sum((term(self._x) for term in self._terms), np.zeros_like(self._x))
        return self._free * (self._fall + self._per_mass * forces)


def _dot(a: Array, b: Array) -> Array:
    return np.einsum("...k,...k->...", a, b)[..., None]


def _corners(x: Array) -> tuple[Array, Array, Array, Array]:
    """Corners of every cell: (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)."""
    return x[:-1, :-1], x[1:, :-1], x[1:, 1:], x[:-1, 1:]


def _along_v(x: Array) -> tuple[Array, Array, Array, Array]:
    """Both tips, then both ends, of the inner edges from (i, j) to (i, j + 1)."""
    return x[2:, :-1], x[:-2, 1:], x[1:-1, :-1], x[1:-1, 1:]


def _along_u(x: Array) -> tuple[Array, Array, Array, Array]:
    """Both tips, then both ends, of the inner edges from (i, j) to (i + 1, j)."""
    return x[:-1, 2:], x[1:, :-2], x[:-1, 1:-1], x[1:, 1:-1]


def _across(x: Array) -> tuple[Array, Array, Array, Array]:
    """Both tips, then both ends, of the diagonals from (i + 1, j) to (i, j + 1)."""
    a, b, c, d = _corners(x)
    return a, c, b, d
