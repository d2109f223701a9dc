"""Material frames: how they start, follow, and are held; twist of any number of turns; natural shapes without force."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from curves import FLAT, ROD, ROUND, RUBBER, SHAPES, Curve, crumpled, helix, line, noise
from surfaces import REALS, WIDTHS, turned

from warpdeform.material import Material

Array = np.ndarray[Any, Any]

TWISTABLE = Material(linear_density=0.1, axial_stiffness=1e3, bending_stiffness=0.4, torsional_stiffness=0.3)


def rod(count: int = 21, strands: int = 2, real: Any = wp.float64, length: float = 2.0) -> Curve:
    """Straight rods whose first and last directors are held."""
    rest = np.linspace(0, length, count)[:, None, None] * np.array([1.0, 0.0, 0.0]) + np.zeros((1, strands, 1))
    curve = Curve(rest, TWISTABLE, real, WIDTHS[real][1], framed=True, director=(0.0, 1.0, 0.0))
    held = np.zeros((count - 1, strands), dtype=bool)
    held[[0, -1]] = True
    curve.force.frames.hold(held)
    return curve


def roll(curve: Curve, angles: Array) -> None:
    """Roll the last directors about the rods by these angles in steps of less than half a turn, one per time step."""
    frames = curve.force.frames
    directors = np.tile([0.0, 1.0, 0.0], (*frames.start.directors.shape[:2], 1))
    count = int(np.ceil(np.abs(angles).max() / 2.0))
    for k in range(1, count + 1):
        now = angles * k / count
        directors[-1, :, 1], directors[-1, :, 2] = np.cos(now), np.sin(now)
        frames.aim(3.0 * directors)
        curve.linearise(curve.rest)
        curve.force.finish(SimpleNamespace(x=curve._position))


@pytest.mark.parametrize("real", REALS)
def test_a_rod_twisted_by_its_ends_carries_the_torque_of_its_section(real: Any) -> None:
    # Directors sit in the middle of their segments: the twisted length is that between the last two middles.
    count, length = 21, 2.0
    curve, angles = rod(count, 2, real, length), np.array([1.0, 15.0])
    roll(curve, angles)
    twist = curve.force.frames.strains(curve._position)[1:-1, :, 2]
    span = length * (count - 2) / (count - 1)
    tolerance = 1e-12 if real is wp.float64 else 1e-5
    torque = 0.3 * twist / (length / (count - 1))
    np.testing.assert_allclose(torque, np.broadcast_to(0.3 * angles / span, twist.shape), rtol=tolerance)
    energy = 0.3 * np.sum(angles**2) / (2 * span)
    assert curve.energy(curve.rest) == pytest.approx(energy, rel=tolerance)
    # The positions feel nothing of it as long as the rod is straight.
    assert np.abs(curve.gradient(curve.rest)[..., 1:]).max() < 1e-12


def test_the_gradient_of_a_twisted_rod_is_the_difference_of_its_energy() -> None:
    curve = rod()
    roll(curve, np.array([4.0, -9.0]))
    z, p = curve.rest + noise(curve.rest, 0.1), noise(curve.rest, 1.0, 2)
    for fixed in (z, p):
        fixed[[0, 1, -2, -1]] = curve.rest[[0, 1, -2, -1]] if fixed is z else 0.0
    curve.linearise(z)
    step = 1e-6
    slope = (curve.energy(z + step * p) - curve.energy(z - step * p)) / (2 * step)
    assert abs(np.sum(curve.gradient(z) * p) - slope) < 1e-7 * abs(slope)
    H = curve.hessian()
    assert np.linalg.eigvalsh((H + H.T) / 2).min() > -1e-13 * np.abs(H).max()


@pytest.mark.parametrize("name", ["helix", "ring"])
@pytest.mark.parametrize("section", [ROUND, FLAT], ids=["round", "flat"])
@pytest.mark.parametrize("real", REALS)
def test_natural_shapes_are_force_free_wherever_they_are_placed(name: str, section: Any, real: Any) -> None:
    rest = SHAPES[name](17, 3)
    curve = Curve(rest, RUBBER, real, WIDTHS[real][1], section=section, closed=name == "ring")
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    scale = np.abs(curve.gradient(rest + noise(rest, 1e-3))).max() / 1e-3
    placed = turned(rest, (0.3, -1.0, 2.0), 3.0)
    curve.force.frames.place(placed, np.append(np.sin(1.5) * np.array([0.3, -1.0, 2.0]) / np.sqrt(5.09), np.cos(1.5)))
    for z in (placed, turned(placed, (1.0, 1.0, 0.0), 2.0)):
        assert np.abs(curve.gradient(z)).max() < 32 * epsilon * scale
        assert np.abs(curve.download(curve.force.frames._angle)).max() < np.pi


def test_a_straight_strand_is_placed_with_its_section() -> None:
    rest = line(9, 1)
    curve = Curve(rest, RUBBER, section=FLAT, director=(0.0, 0.3, 1.0))
    frames, axis = curve.force.frames, rest[-1, 0] / np.linalg.norm(rest[-1, 0])
    first = frames.start.directors.copy()
    frames.place(rest, [*(np.sin(np.pi / 4) * axis), np.cos(np.pi / 4)])
    np.testing.assert_allclose(frames.start.directors, turned(first, tuple(axis), np.pi / 2), atol=1e-14)
    frames.place(rest)
    np.testing.assert_allclose(frames.start.directors, first, atol=1e-14)


def test_frames_do_not_depend_on_the_way_they_came() -> None:
    """The energy of a shape is the same after steps through others: the angles are of least energy there."""
    curve = Curve(helix(9, 2), RUBBER, section=FLAT)
    z = crumpled(curve.rest)
    energy, gradient = curve.energy(z), curve.gradient(z)
    for seed in range(4):
        curve.linearise(curve.rest + noise(curve.rest, 0.15, seed))
        curve.force.finish(SimpleNamespace(x=curve._position))
    curve.linearise(z)
    assert curve.energy(z) == pytest.approx(energy, rel=1e-10)
    np.testing.assert_allclose(curve.gradient(z), gradient, atol=1e-7 * np.abs(gradient).max())
    curve.force.reset()
    assert curve.energy(z) == energy


@pytest.mark.parametrize("real", REALS)
def test_directors_stay_normal_and_of_unit_length(real: Any) -> None:
    curve = Curve(helix(9, 2), RUBBER, real, WIDTHS[real][1], section=FLAT)
    frames = curve.force.frames
    for step in range(50):
        curve.linearise(turned(curve.rest, (1.0, 2.0, 3.0), 0.5 * step))
        curve.force.finish(SimpleNamespace(x=curve._position))
    d, t = curve.download(frames._director)[:-1], curve.download(frames._tangent)[:-1]
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    np.testing.assert_allclose(np.sum(d * d, -1), 1.0, atol=8 * epsilon)
    np.testing.assert_allclose(np.sum(d * t, -1), 0.0, atol=8 * epsilon)
    assert np.abs(curve.gradient(turned(curve.rest, (1.0, 2.0, 3.0), 24.5))).max() < 1e6 * epsilon


@pytest.mark.parametrize("real", REALS)
def test_a_strand_that_spins_freely_does_not_spin(real: Any) -> None:
    curve = Curve(line(33, 5), ROD, real, WIDTHS[real][1], framed=True)
    z = crumpled(curve.rest)
    curve.linearise(z)
    angles = curve.download(curve.force.frames._angle)
    for _ in range(3):
        curve.linearise(z)
    assert np.abs(curve.download(curve.force.frames._angle) - angles).max() < 1e-3


def test_directors_that_wind_are_natural_twist() -> None:
    rest, turns = line(9, 2), 0.4 * np.arange(8)
    plain = Curve(rest, RUBBER, section=FLAT)
    directors = plain.force.frames.start.directors
    tangent = plain.force.frames.start.tangents
    wound = np.cos(turns)[:, None, None] * directors + np.sin(turns)[:, None, None] * np.cross(tangent, directors)
    curve = Curve(rest, RUBBER, section=FLAT, director=wound)
    natural = curve.download(curve.force.frames.natural)
    np.testing.assert_allclose(natural[1:-1, :, 2], 0.4, rtol=1e-12)
    assert curve.energy(rest) < 1e-20
    assert plain.energy(rest) < 1e-20


def test_a_ribbon_that_may_turn_bends_its_easy_way() -> None:
    # Clamped with its stiff side to the load it pays for bending or for twist; free it turns and pays for neither.
    count, radius = 17, 2.0
    rest = np.linspace(0, 1, count)[:, None, None] * np.array([1.0, 0.0, 0.0])
    angle = rest[..., 0] / radius
    bent = radius * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], -1)
    free = Curve(rest, RUBBER, section=FLAT, director=(0.0, 1.0, 0.05))
    held = Curve(rest, RUBBER, section=FLAT, director=(0.0, 1.0, 0.05))
    held.force.frames.hold(np.ones((count - 1, 1), dtype=bool))
    easy, hard = (1e6 * moment / (2 * radius**2) for moment in sorted(FLAT.moments))
    assert free.energy(bent) == pytest.approx(easy * (count - 2) / (count - 1), rel=0.02)
    assert held.energy(bent) == pytest.approx(hard * (count - 2) / (count - 1), rel=0.02)
