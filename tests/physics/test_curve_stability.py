"""Loads at which rods buckle (design 1.6), from the sign of the softest eigenvalue of the exact Hessian."""

import numpy as np
import pytest
import warp as wp
from curves import Curve
from physics.curve_statics import Array, critical, softest, spectrum
from physics.statics import orders, percent
from scipy.optimize import brentq

from warpdeform.material import Material

BENDING = 0.2
"""EI [N m2]; rods are a metre long."""
STIFF = 1e5
"""EA [N]: a rod shortens by 2e-5 before it buckles."""
ROD = Material(linear_density=1.0, axial_stiffness=STIFF, bending_stiffness=BENDING, torsional_stiffness=0.15)


def rods(cells: int, count: int, framed: bool = False) -> Curve:
    """Rods of a metre along x, as many as it takes to perturb one."""
    rest = np.linspace(0, 1, cells + 1)[:, None, None] * np.array([1.0, 0.0, 0.0]) + np.zeros((1, count, 1))
    return Curve(rest, ROD, wp.float64, 8, framed=framed, director=(0.0, 1.0, 0.0) if framed else None)


def pressed(forces: Array) -> Array:
    """Positions along x of a rod whose segments carry these thrusts [N], shape (cells + 1, 1, 3)."""
    stretch = [brentq(lambda lam, force=force: STIFF / 2 * lam * (lam**2 - 1) + force, 0.9, 1.1) for force in forces]
    x = np.concatenate([[0.0], np.cumsum(stretch)]) / len(forces)
    return x[:, None, None] * np.array([1.0, 0.0, 0.0])


def crossing(cells: int, free: Array, thrust_at: object, guess: float, scale: float = 0.02) -> float:
    """The load at which the softest eigenvalue passes through zero, near a guess."""
    curve = rods(cells, 2 * int(free.sum()))
    loads = guess * np.array([1 - scale, 1 + scale])
    return critical([(load, softest(curve, pressed(thrust_at(load)), free)) for load in loads])


def test_euler_load() -> None:
    # Pinned at both ends, which may turn; the ends are held along x, the thrust is that of the shortened rod.
    exact, errors = np.pi**2 * BENDING, []
    for cells in (10, 20, 40):
        free = np.zeros((cells + 1, 1, 3), dtype=bool)
        free[1:-1, :, 1] = True
        found = crossing(cells, free, lambda load, n=cells: np.full(n, load), exact, 0.05)
        errors.append(found / exact - 1)
    print(f"\nEuler load, 10, 20, 40 cells: errors {percent(errors)}, orders {orders(errors).round(2)}", end="")
    assert abs(errors[-1]) < 0.01
    assert orders(errors) == pytest.approx(2.0, abs=0.1)


def test_greenhill_height() -> None:
    # A column clamped at its foot, in the middle of the pinned segment, under its own weight: q L^3 / EI.
    exact, errors = 7.83735, []
    for cells in (10, 20, 40):
        free = np.zeros((cells + 1, 1, 3), dtype=bool)
        free[2:, :, 1] = True
        length = 1.0 - 0.5 / cells
        load_of = BENDING / length**3
        # The weight above each segment: nodes carry what is half a segment around them.
        above = (np.arange(cells, 0, -1) - 0.5) / cells
        found = crossing(cells, free, lambda q, above=above, unit=load_of: q * unit * above, exact, 0.2)
        errors.append(found / exact - 1)
    print(f"\nGreenhill load, 10, 20, 40 cells: errors {percent(errors)}, orders {orders(errors).round(2)}", end="")
    assert abs(errors[-1]) < 0.01


def test_twisted_rod_buckles_at_its_torque() -> None:
    # Clamped at both ends, no tension: M L / EI = 8.9868, the least root of tan(x/2) = x/2 (Love, article 272).
    exact, errors = 8.98682, []
    for cells in (20, 40):
        free = np.zeros((cells + 1, 1, 3), dtype=bool)
        free[2:-2, :, 1:] = True
        count = 2 * int(free.sum())
        span, stiffness = 1.0 - 1.0 / cells, []
        loads = exact * np.array([0.95, 1.05])
        for load in loads:
            curve = rods(cells, count, framed=True)
            held = np.zeros((cells, count), dtype=bool)
            held[[0, -1]] = True
            frames = curve.force.frames
            frames.hold(held)
            total = load * BENDING / span * span / 0.15
            for angle in np.linspace(0, total, 9)[1:]:
                directors = np.tile([0.0, 1.0, 0.0], (cells, count, 1))
                directors[-1] = [0.0, np.cos(angle), np.sin(angle)]
                frames.aim(directors)
                curve.linearise(curve.rest)
                frames.accept(curve._position)
            stiffness.append((load, softest(curve, curve.rest[:, :1], free)))
        errors.append(critical(stiffness) / exact - 1)
    print(f"\ntwisted rod, 20 and 40 cells: errors of M L / EI {percent(errors)}", end="")
    assert abs(errors[-1]) < 0.01
    assert abs(errors[-1]) < abs(errors[0])


def test_twisted_ring_leaves_its_plane_at_michells_twist() -> None:
    """Michell 1889: 2 pi sqrt(3) EI / GJ, of a rod straight by nature whose ends were turned and joined."""
    torsion, errors = 0.15, []
    exact = 2 * np.pi * np.sqrt(3) * BENDING / torsion
    for count in (20, 40, 80):
        phase = 2 * np.pi * np.arange(count) / count
        one = np.stack([np.cos(phase), np.sin(phase), 0 * phase], -1)[:, None] / (2 * np.pi)
        rest = np.repeat(one, 6 * count, axis=1)
        free, stiffness = np.ones((count, 1, 3), dtype=bool), []
        for load in exact * np.array([0.95, 1.1]):
            curve = Curve(rest, ROD, wp.float64, 8, closed=True, director=np.array([0.0, 0.0, 1.0]))
            frames = curve.force.frames
            natural = np.zeros((count, 6 * count, 3))
            natural[0, :, 2] = -load
            frames.natural.assign(curve.layout.pack(natural))
            curve.linearise(rest)
            # The six rigid motions have no stiffness; the softest of the others may lie on either side of them.
            found = spectrum(curve, one, free)
            stiffness.append((load, float(found[0] if found[0] < -1e-3 * BENDING else found[6])))
        errors.append(critical(stiffness) / exact - 1)
    print(f"\nMichell's ring, 20, 40, 80 nodes: errors {percent(errors)}, orders {orders(errors).round(2)}", end="")
    assert abs(errors[-1]) < 0.01
    assert orders(errors).min() > 1.8
