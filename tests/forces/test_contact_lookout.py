"""The lookout: where it says that nothing comes near, nothing does, and nothing is searched or guarded."""

import functools
from typing import Any

import numpy as np
import pytest
from contacts import GAP, Scene, folded, wrinkled

import warpdeform as wd
from warpdeform.crossings import crossing_pairs
from warpdeform.kernels.contact_impulses import PUSHED, UPDATES

Array = np.ndarray[Any, Any]

ON_THE_WAY = (0.0, 0.21, 0.5, 0.84, 1.0)


@functools.cache
def scene(nodes: tuple[int, int], precision: str = "float64", lane_width: int | None = None) -> Scene:
    return Scene([wd.sheet(nodes, (1.0, 1.0))], precision=precision, lane_width=lane_width)


def is_near(s: Scene, *ways: tuple[Array, Array]) -> bool:
    """Whether something may come near when bodies go from positions by displacements."""
    guarded = s.guard([x for x, _ in ways], [d for _, d in ways])
    near = bool(s.system.lookout.near.numpy()[0])
    if not near:
        assert all(np.allclose(a, d, 1e-6, 0.0) for a, (_, d) in zip(guarded, ways, strict=True))
    return near


def rolled(x: Array, angle: float) -> Array:
    """A flat sheet bent along u by an angle, stretched and turned."""
    radius = 1.0 / angle
    bent = np.stack([radius * np.sin(angle * x[..., 0]), 1.2 * x[..., 1], radius * np.cos(angle * x[..., 0])], axis=-1)
    c, t = np.cos(0.7), np.sin(0.7)
    return np.asarray(bent @ np.array([[c, t, 0.0], [-t, c, 0.0], [0.0, 0.0, 1.0]]))


def test_smooth_sheets_are_passed_over_however_they_move() -> None:
    s = scene((33, 21))
    x = s.models[0].body.shape.positions
    for start, end in ((x, x + [3.0, -40.0, 1.0]), (rolled(x, 0.5), rolled(x, 1.0)), (rolled(x, 2.5), rolled(x, 2.7))):
        assert not is_near(s, (start, end - start))


@pytest.mark.parametrize(("nodes", "layers"), [((33, 21), 1), ((17, 9), 2), ((10, 14), 1)])
def test_what_is_passed_over_does_not_cross_on_the_way(nodes: tuple[int, int], layers: int) -> None:
    rng = np.random.default_rng(3)
    shape = wd.sheet(nodes, (1.0, 1.0))
    s = scene(nodes) if layers == 1 else Scene([shape] * layers)
    outcomes = []
    for size in np.geomspace(0.003, 0.8, 24):
        ways = []
        for layer in range(layers):
            x = shape.positions + [0.0, 0.0, 0.06 * layer]
            waves = [
                sum(rng.normal(size=3) * np.sin(x @ rng.normal(0.0, 6.0, 3))[..., None] for _ in range(3))
                for _ in range(2)
            ]
            ways.append((x + 0.2 * size * waves[0] / layers, size * waves[1] / layers))
        near = is_near(s, *ways)
        start, way = (np.concatenate([w[k].reshape(-1, 3) for w in ways]) for k in range(2))
        crossings = [len(crossing_pairs(start + share * way, s.simplices)) for share in ON_THE_WAY]
        outcomes.append((near, max(crossings) > 0))
    assert (False, True) not in outcomes
    assert {(False, False), (True, True)} <= set(outcomes)


def test_a_flat_spiral_is_near_itself_although_its_normals_agree() -> None:
    s = scene((81, 5))
    x = s.models[0].body.shape.positions
    angle, radius = 2.6 * np.pi * x[..., 0], 1.0 + 0.2 * x[..., 1]
    spiral = np.stack([radius * np.cos(angle), radius * np.sin(angle), 1e-3 * angle], axis=-1)
    assert is_near(s, (spiral, np.zeros_like(spiral)))
    spiral[..., 2] *= 100.0
    assert not is_near(s, (spiral, np.zeros_like(spiral)))


def test_what_turns_over_on_the_way_is_near() -> None:
    s = scene((17, 9))
    x = s.models[0].body.shape.positions
    assert is_near(s, (x, x * [-1.0, 1.0, 1.0] - x))


def test_closed_surfaces_are_always_near_themselves() -> None:
    shape = wd.tube((12, 9), 0.3, 1.0)
    s = Scene([shape])
    assert is_near(s, (shape.positions, np.zeros_like(shape.positions)))


def test_lists_follow_what_is_near() -> None:
    shape, x = folded((19, 18), 0.9 * GAP)
    s, fresh = Scene([shape]), Scene([shape])
    fresh.linearise([x])
    expected, nothing, still = fresh.pairs(), (set(), set(), set()), np.zeros_like(x)
    assert expected[0]
    s.place([x], "x")
    s.system.begin()
    for vector, positions, pairs in (("z", x, expected), ("trial", shape.positions, nothing), ("z", x, expected)):
        s.place([positions], vector)
        s.place([still], "direction")
        s.system.guard(vector, "direction")
        s.system.linearise(vector)
        assert s.pairs() == pairs
    state = s.system.guarding.state.numpy()
    assert (state[UPDATES], state[PUSHED]) == (3, 0)


def test_between_steps_nothing_is_taken_for_far() -> None:
    shape, x = folded((19, 18), 0.9 * GAP)
    s = Scene([shape])
    assert not is_near(s, (shape.positions, np.zeros_like(x)))
    s.system.finish()
    s.linearise([x])
    assert s.pairs()[0]


def test_lane_widths_and_precisions_agree() -> None:
    scenes = [scene((17, 9), "float64", 1), scene((17, 9), "float64", 8), scene((17, 9), "float32")]
    found = []
    for seed in range(10):
        _, x = wrinkled((17, 9), seed, 0.03 * seed)
        found.append([is_near(s, (x, 0.1 * x[..., ::-1])) for s in scenes])
        assert len(set(found[-1])) == 1
    assert len({near[0] for near in found}) == 2
