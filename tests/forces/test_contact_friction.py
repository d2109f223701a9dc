"""Friction between bodies: a potential of what has been stretched, up to what the pressure holds."""

from typing import Any

import numpy as np
import pytest
from contacts import GAP, Scene, wrinkled

import warpdeform as wd
from warpdeform.kernels.fields import STICK

Array = np.ndarray[Any, Any]


def layers(precision: str = "float64", lane_width: int | None = None) -> tuple[Scene, list[Array], list[Array]]:
    """Two wrinkled layers; where a step began, and where it has come to: the upper one slid a little, by parts."""
    (lower, x), (upper, y) = wrinkled((14, 9), 1, 0.002), wrinkled((9, 12), 2, 0.002)
    y = y * [0.8, 1.1, 1.0] + [0.11, -0.03, 0.8 * GAP]
    shift = 4.0 * STICK * np.stack([np.sin(3.0 * y[..., 0]), 0.5 * np.cos(4.0 * y[..., 1]), 0.0 * y[..., 0]], axis=-1)
    return Scene([lower, upper], precision=precision, lane_width=lane_width, friction=0.4), [x, y], [x, y + shift]


def joined(positions: list[Array]) -> Array:
    return np.concatenate([x.reshape(-1, 3) for x in positions])


def test_gradient_is_the_derivative_of_the_potential_and_adds_up_to_nothing() -> None:
    s, before, now = layers()
    s.begin(before)
    s.linearise(now)
    gradient = s.gradient()
    rng = np.random.default_rng(0)
    for _ in range(4):
        direction, step = rng.normal(size=gradient.shape), 1e-8
        change = s.energy(s.split(joined(now) + step * direction)) - s.energy(s.split(joined(now) - step * direction))
        expected = float(np.sum(gradient * direction))
        assert change / (2.0 * step) == pytest.approx(expected, rel=1e-4, abs=1e-4 * np.abs(gradient).max())
    assert np.abs(gradient.sum(axis=0)).max() < 1e-12 * np.abs(gradient).sum()


def test_hessian_is_symmetric_and_positive_and_that_of_what_sticks() -> None:
    s, before, now = layers()
    s.begin(before)
    s.linearise(now)
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(2, *joined(now).shape))
    Hp, Hq = s.product(p), s.product(q)
    assert abs(np.sum(q * Hp) - np.sum(p * Hq)) < 1e-12 * np.linalg.norm(Hp) * np.linalg.norm(q)
    assert np.sum(p * Hp) > 0.0
    # Where nothing has slipped, moving sideways is resisted by exactly kt.
    flat = wd.sheet((5, 5), (0.3, 0.3))
    s = Scene([flat, flat], friction=0.4)
    x = [flat.positions, 0.6 * flat.positions + [0.05, 0.04, 0.7 * GAP]]
    s.begin(x)
    s.linearise(x)
    sideways = np.repeat([[0.0, 0.0, 0.0], [0.6, 0.8, 0.0]], 25, axis=0)
    product, step = s.product(sideways), 0.1 * STICK
    s.iteration.fill_(3)  # normals and loads are frozen
    sides = []
    for sign in (1.0, -1.0):
        s.linearise([a + sign * step * d for a, d in zip(x, s.split(sideways), strict=True)])
        sides.append(s.gradient())
    expected = (sides[0] - sides[1]) / (2.0 * step)
    assert np.abs(product - expected).max() < 1e-2 * np.abs(expected).max()  # at borders normals turn a little


def test_precisions_and_lane_widths_agree() -> None:
    results = {}
    for precision, width in (("float64", 1), ("float64", 8), ("float32", 16)):
        s, before, now = layers(precision, width)
        s.begin(before)
        s.linearise(now)
        results[precision, width] = (s.gradient(), s.product(np.random.default_rng(2).normal(size=joined(now).shape)))
    for a, b, c in zip(*results.values(), strict=True):
        assert np.array_equal(a, b)
        assert np.abs(b - c).max() < 5e-3 * np.abs(b).max()


def test_what_has_been_stretched_is_kept_for_the_next_step_up_to_the_circle() -> None:
    flat = wd.sheet((5, 5), (0.3, 0.3))
    s = Scene([flat, flat], friction=0.4)
    x, y = flat.positions, 0.6 * flat.positions + [0.05, 0.04, 0.7 * GAP]
    forces = []
    for _ in range(6):
        s.begin([x, y])
        y = y + [0.3 * STICK, 0.0, 0.0]
        s.iteration.fill_(0)
        s.linearise([x, y])
        forces.append(float(s.gradient()[25:, 0].sum()))
        s.finish()
        assert s.energy([x, y]) > 0.0
    slope = forces[0]
    assert forces[:3] == pytest.approx([slope, 2.0 * slope, 3.0 * slope], rel=1e-6)
    assert forces[3:] == pytest.approx([slope / 0.3] * 3, rel=1e-6)
    load = np.abs(s.gradient()[25:, 2].sum())
    assert forces[-1] == pytest.approx(0.4 * load, rel=0.02)  # at borders the pressure is not upright
    s.system.reset()
    s.begin([x, y])
    s.linearise([x, y])
    assert abs(s.gradient()[25:, 0].sum()) < 1e-9 * slope


@pytest.mark.parametrize("ratio", [0.95, 1.05])
def test_a_cloth_holds_on_a_slope_until_it_is_too_steep(ratio: float) -> None:
    angle = np.arctan(0.5 * ratio)
    cloth = wd.Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-3)
    table = wd.Body("table", wd.sheet((17, 9), (1.0, 0.5)), cloth, pins=[wd.Pin("all")])
    piece = wd.Body("piece", wd.sheet((6, 6), (0.2, 0.2)), cloth, position=(0.21, 0.14, 0.0022))
    gravity = (9.81 * np.sin(angle), 0.0, -9.81 * np.cos(angle))
    simulation = wd.Simulation(
        [table, piece],
        contacts=[wd.Contact(("table", "piece"), friction=0.5, gap=0.002)],
        settings=wd.Settings(newton_iterations=4, gravity=gravity, device="cpu"),
    )
    places = []
    for _ in range(75):
        simulation.step()
        places.append(simulation["piece"].positions()[..., 0].mean())
    if ratio < 1.0:
        assert abs(places[-1] - places[14]) < 1e-5
        assert abs(places[-1] - 0.31) < 5e-4
    else:
        acceleration = (places[-1] - 2.0 * places[-31] + places[-61]) / 0.5**2
        exact = 9.81 * (np.sin(angle) - 0.5 * np.cos(angle))
        assert acceleration == pytest.approx(exact, rel=0.03)
