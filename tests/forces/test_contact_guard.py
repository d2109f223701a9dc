"""The guard: whatever the displacements, nothing crosses on the way, and what is not at risk goes its way."""

import functools
from typing import Any

import numpy as np
import pytest
from contacts import GAP, Scene, folded, wrinkled

import warpdeform as wd
from warpdeform.crossings import crossing_pairs
from warpdeform.kernels.contact_impulses import PUSHED, SHORTENED

Array = np.ndarray[Any, Any]

ON_THE_WAY = (0.13, 0.5, 0.77, 1.0)
CASES = ["folded", "stacked"]


@functools.cache
def scene(kind: str, precision: str = "float64", lane_width: int | None = None) -> tuple[Scene, tuple[Array, ...]]:
    if kind == "folded":
        shape, x = folded((19, 18), 0.9 * GAP)
        return Scene([shape], precision=precision, lane_width=lane_width, pins=["corner:0,0"]), (x,)
    (lower, x), (upper, y) = wrinkled((14, 9), 1, 0.002), wrinkled((9, 12), 2, 0.002)
    y = y * [0.8, 1.1, 1.0] + [0.11, -0.03, 0.8 * GAP]
    return Scene([lower, upper], precision=precision, lane_width=lane_width), (x, y)


def joined(positions: Any) -> Array:
    return np.concatenate([np.asarray(x).reshape(-1, 3) for x in positions])


def waves(positions: tuple[Array, ...], size: float, seed: int, noise: float = 0.0) -> list[Array]:
    """Displacements that vary over the bodies, towards each other in places, with some noise from node to node."""
    rng = np.random.default_rng(seed)
    found = []
    for x in positions:
        d = sum(
            rng.normal(size=3) * np.sin(x @ rng.normal(0.0, 9.0, 3) + rng.uniform(0.0, 6.0))[..., None]
            for _ in range(3)
        )
        found.append(size * (d + noise * rng.normal(size=x.shape)))
    return found


def crossings_on_the_way(s: Scene, positions: Any, directions: Any) -> list[int]:
    x, d = joined(positions), joined(directions)
    return [len(crossing_pairs(x + share * d, s.simplices)) for share in ON_THE_WAY]


@pytest.mark.parametrize("kind", CASES)
@pytest.mark.parametrize(("size", "noise"), [(0.05, 0.0), (0.1, 0.0), (0.03, 1.0)])
def test_nothing_crosses_whatever_the_displacements(kind: str, size: float, noise: float) -> None:
    s, positions = scene(kind)
    unguarded = []
    for seed in range(3):
        wild = waves(positions, size, seed, noise)
        if kind == "folded":
            wild[0][0, 0] = 0.0
        unguarded += crossings_on_the_way(s, positions, wild)
        guarded = s.guard(positions, wild)
        assert crossings_on_the_way(s, positions, guarded) == [0] * len(ON_THE_WAY)
        if kind == "folded":
            assert (guarded[0][0, 0] == 0.0).all()
    assert max(unguarded) > 0


def test_update_after_update_nothing_crosses_in_single_precision() -> None:
    s, positions = scene("stacked", "float32")
    x = [np.float32(each).astype(np.float64) for each in positions]
    for seed in range(12):
        d = s.guard(x, waves(positions, 0.05, seed))
        x = [np.float32(np.float32(a) + np.float32(b)).astype(np.float64) for a, b in zip(x, d, strict=True)]
        assert len(crossing_pairs(joined(x), s.simplices)) == 0


@pytest.mark.parametrize("kind", CASES)
def test_what_is_not_at_risk_goes_its_way_to_the_bit(kind: str) -> None:
    s, positions = scene(kind)
    together = [np.broadcast_to([0.7, -3.0, 12.0], x.shape) for x in positions]
    c, t = np.cos(0.03), np.sin(0.03)
    turning = [x @ np.array([[c, t, 0.0], [-t, c, 0.0], [0.0, 0.0, 1.0]]) - x for x in positions]
    apart = [(3.0 - k) * np.broadcast_to([0.0, 0.0, -1.0], x.shape) for k, x in enumerate(positions)]
    for displacements in (together, turning, apart):
        guarded = s.guard(positions, displacements)
        assert all(np.array_equal(a, b) for a, b in zip(guarded, displacements, strict=True))
        assert s.system.guarding.state.numpy()[PUSHED] == 0


def test_impulses_give_no_momentum() -> None:
    s, positions = scene("stacked")
    wild = waves(positions, 0.04, 1)
    guarded = s.guard(positions, wild)
    assert s.system.guarding.state.numpy()[SHORTENED] == 0
    masses = np.concatenate([model.node_mass.reshape(-1) for model in s.models])[:, None]
    change = masses * (joined(guarded) - joined(wild))
    assert np.abs(change).sum() > 0.0
    assert np.abs(change.sum(axis=0)).max() < 1e-13 * np.abs(change).sum()


@pytest.mark.parametrize(
    "limits", [{"RISKS_PER_NODE": 0.02}, {"SWEEPS": 1}, {"ROUNDS": 1}, {"ROUNDS": 0, "HALVINGS": 0}], ids=str
)
def test_what_does_not_fit_and_what_does_not_end_is_safe(
    limits: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in limits.items():
        monkeypatch.setattr(f"warpdeform.forces.contact_guard.{name}", value)
    models, positions = scene("stacked")[0].models, scene("stacked")[1]
    s = Scene([model.body.shape for model in models])
    wild = waves(positions, 0.05, 2)
    guarded = s.guard(positions, wild)
    assert crossings_on_the_way(s, positions, guarded) == [0] * len(ON_THE_WAY)
    shortened = s.system.guarding.state.numpy()[SHORTENED]
    if "ROUNDS" in limits:
        assert shortened > 0
    if "HALVINGS" in limits:
        # All of it is shortened to the same share.
        share = joined(guarded)[0, 0] / joined(wild)[0, 0]
        assert 0.0 < share < 1.0
        assert np.allclose(joined(guarded), share * joined(wild), rtol=1e-12)


@pytest.mark.parametrize("kind", CASES)
def test_lane_widths_agree_to_the_bit(kind: str) -> None:
    results = []
    for width in (1, 8):
        s, positions = scene(kind, "float64", width)
        results.append(joined(s.guard(positions, waves(positions, 0.03, 4))))
    assert np.array_equal(*results)


def test_bodies_that_are_not_named_may_cross() -> None:
    shape = wd.sheet((6, 6), (0.3, 0.3))
    s = Scene([shape, shape], pairs=Scene([shape]).system.touching)
    x = [shape.positions, shape.positions + [0.01, 0.02, 0.02]]
    d = [np.zeros_like(shape.positions), np.broadcast_to([0.0, 0.0, -0.1], shape.positions.shape)]
    assert np.array_equal(s.guard(x, d)[1], d[1])
