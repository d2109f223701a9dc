"""The stream of air: statistics of the gusts, repeatability, functions of time, refusals."""

from typing import Any

import numpy as np
import pytest

from warpdeform.errors import InputError
from warpdeform.wind import Wind


def test_steady_wind_is_the_same_everywhere() -> None:
    wind = Wind((3, 0, 1))
    np.testing.assert_array_equal(wind.stream(np.random.default_rng(0).normal(size=(4, 5, 3)), 2.0)[2, 3], [3, 0, 1])
    assert not wind.gusting
    assert not Wind((0, 0, 0), gust=0.3).gusting


@pytest.mark.parametrize("seed", range(4))
def test_gusts_have_the_stated_mean_and_strength_along_every_direction(seed: int) -> None:
    wind = Wind((6.0, 2.0, 0.0), gust=0.25, seed=seed)
    random = np.random.default_rng(1)
    samples = np.concatenate([wind.stream(random.uniform(-300, 300, (1000, 3)), t) for t in random.uniform(0, 900, 60)])
    np.testing.assert_allclose(samples.mean(axis=0), [6.0, 2.0, 0.0], atol=0.05)
    strength = 0.25 * np.hypot(6.0, 2.0)
    np.testing.assert_allclose(np.cov(samples.T), strength**2 * np.eye(3), atol=0.05 * strength**2)


def test_gusts_at_a_place_have_the_stated_strength_over_time() -> None:
    wind = Wind((6.0, 0.0, 0.0), gust=0.25)
    series = np.array([wind.stream(np.array([0.3, 0.7, 1.0]), t)[0] for t in np.arange(0.0, 400.0, 0.17)])
    assert series.mean() == pytest.approx(6.0, abs=0.03)
    assert series.std() == pytest.approx(1.5, rel=0.05)


def test_gusts_have_no_divergence_and_vary_over_their_length() -> None:
    wind = Wind((6.0, 0.0, 0.0), gust=0.5, gust_length=1.5)
    points = np.random.default_rng(2).uniform(-3, 3, (50, 3))
    h = 1e-5
    slopes = [(wind.stream(points + h * e, 0.4) - wind.stream(points - h * e, 0.4)) / (2 * h) for e in np.eye(3)]
    divergence = sum(slopes[c][:, c] for c in range(3))
    assert np.abs(divergence).max() < 1e-7
    assert np.abs(slopes).max() > 1.0


def test_gusts_are_carried_by_the_mean_wind() -> None:
    wind = Wind((6.0, 0.0, 1.0), gust=0.4, gust_period=1e9)
    points = np.random.default_rng(2).uniform(-3, 3, (50, 3))
    np.testing.assert_allclose(
        wind.stream(points + 5.0 * np.array([6, 0, 1]), 5.0), wind.stream(points, 0.0), atol=1e-6
    )
    lively = Wind((6.0, 0.0, 1.0), gust=0.4, gust_period=1.0)
    change = lively.stream(points + 5.0 * np.array([6, 0, 1]), 5.0) - lively.stream(points, 0.0)
    assert change.std() > 1.0


def test_equal_seeds_blow_equally() -> None:
    points = np.random.default_rng(2).uniform(-3, 3, (50, 3))
    first, again, other = (Wind((6.0, 0.0, 0.0), gust=0.4, seed=s).stream(points, 1.3) for s in (7, 7, 8))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 0.5


def test_phases_stay_precise() -> None:
    waves = Wind((6.0, 0.0, 0.0), gust=0.4).waves()
    turns = waves.turns_at(1e5)
    assert np.abs(turns).max() <= 0.5
    expected = np.exp(1j * (waves.phases + waves.rates * 1e5))
    np.testing.assert_allclose(np.exp(2j * np.pi * turns), expected, atol=1e-8)


def test_function_of_time() -> None:
    wind = Wind(lambda t: (t, 0.0, -2.0 * t))
    np.testing.assert_array_equal(wind.stream(np.zeros((2, 2, 3)), 1.5)[1, 1], [1.5, 0.0, -3.0])


@pytest.mark.parametrize("returned", [(1.0, 2.0), "north", (np.nan, 0.0, 0.0), None])
def test_function_that_returns_no_velocity_is_refused(returned: Any) -> None:
    with pytest.raises(InputError, match="velocity"):
        Wind(lambda t: returned if t > 0.1 else (1.0, 0.0, 0.0)).mean(0.5)


@pytest.mark.parametrize(
    ("key", "arguments"),
    [
        ("velocity", {"velocity": (1.0, 2.0)}),
        ("velocity", {"velocity": (np.nan, 0.0, 0.0)}),
        ("velocity", {"velocity": (1e4, 0.0, 0.0)}),
        ("velocity", {"velocity": "west"}),
        ("gust", {"gust": -0.1}),
        ("gust", {"gust": np.inf}),
        ("gust", {"velocity": lambda t: (t, 0.0, 0.0), "gust": 0.2}),
        ("gust_length", {"gust_length": 0.0}),
        ("gust_period", {"gust_period": -1.0}),
        ("seed", {"seed": -1}),
        ("seed", {"seed": 0.5}),
    ],
)
def test_refused(key: str, arguments: dict[str, Any]) -> None:
    with pytest.raises(InputError) as caught:
        Wind(**arguments)
    assert [mistake.key for mistake in caught.value.mistakes] == [key]
    assert caught.value.mistakes[0].remedy
