"""Every word of the lane type against NumPy, and every lane width against the scalar form, to the bit."""

import functools
from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import REALS, WIDTHS

from warpdeform.grid import Layout
from warpdeform.kernels.lanes import kernel_module, lanes

Array = np.ndarray[Any, Any]

NODES = (4, 21)
FULL = [[0, 3, 4], [3, 1, 5], [4, 5, 2]]
"""Places of a symmetric block's components in the full matrix."""

WIDE = [(real, width) for real in REALS for width in WIDTHS[real]]
OUTPUTS = {
    "mul": 1, "div": 1, "root": 1, "at_least": 1, "splat": 1, "along_u": 1, "dot3": 1, "cross3": 3, "scale": 3,
    "neighbour": 3, "outer": 6, "symmetric": 6, "isotropic": 6, "scale6": 6, "apply6": 3, "inverse6": 6,
    "larger": 1, "exceeds": 1, "normal3": 3, "read1": 1, "read3": 3, "read6": 6,
    "above": 1,
}  # fmt: skip
"""Words in the order in which the kernel stores their results, with their components."""


@functools.cache
def words_kernel(width: int, real: Any) -> Any:
    words = lanes(width, real)
    load1, load3, load6, store1, store3 = words.load1, words.load3, words.load6, words.store1, words.store3
    store6, splat, mul, div, root, at_least = (
        words.store6,
        words.splat,
        words.mul,
        words.div,
        words.root,
        words.at_least,
    )
    dot3, cross3, scale, scale6, outer = words.dot3, words.cross3, words.scale, words.scale6, words.outer
    symmetric, isotropic, apply6, inverse6 = words.symmetric, words.isotropic, words.apply6, words.inverse6
    along_u, sum_lanes, max_lanes = words.along_u, words.sum_lanes, words.max_lanes
    larger, exceeds, above, normal3 = words.larger, words.exceeds, words.above, words.normal3
    add1, add3, add6 = words.add1, words.add3, words.add6

    read1, read3, read6, write3 = words.read1, words.read3, words.read6, words.write3
    vector64 = lanes(width, wp.float64).vector

    @wp.kernel(module=kernel_module("words", width, real))
    def use_words(
        a: wp.array3d(dtype=real),
        row: wp.array3d(dtype=real),
        floor: real,
        out: wp.array3d(dtype=real),
        added_out: wp.array3d(dtype=real),
        sums_out: wp.array2d(dtype=wp.float64),
        most_out: wp.array2d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        v, w, x = load3(a, 0, i, j), load3(a, 3, i, j), load3(a, 6, i, j)
        s, t, block = load1(a, 9, i, j), load1(a, 10, i, j), load6(a, 11, i, j)
        store1(out, 0, i, j, mul(s, t))
        store1(out, 1, i, j, div(s, t))
        store1(out, 2, i, j, root(mul(t, t)))
        store1(out, 3, i, j, at_least(s, floor))
        store1(out, 4, i, j, splat(floor))
        store1(out, 5, i, j, along_u(row, 1, i))
        store1(out, 6, i, j, dot3(v, w))
        store3(out, 7, i, j, cross3(v, w))
        store3(out, 10, i, j, scale(s, v))
        store3(out, 13, i, j, load3(a, 0, i + 1, j + 1) - load3(a, 0, i, j - 1))
        store6(out, 16, i, j, outer(v, w))
        store6(out, 22, i, j, symmetric(v, w, x))
        store6(out, 28, i, j, isotropic(s))
        store6(out, 34, i, j, scale6(s, block))
        store3(out, 40, i, j, apply6(block, v))
        store6(out, 43, i, j, inverse6(block))
        store1(out, 49, i, j, larger(s, t))
        store1(out, 50, i, j, exceeds(s, floor))
        store3(out, 51, i, j, normal3(scale(div(splat(real(1.0)), root(at_least(dot3(v, v), real(1.0e-12)))), v)))
        once = read1(a, 9, i, j)
        write3(out, 54, i, j, vector64(once, once, once))
        write3(out, 55, i, j, read3(a, 3, i, j))
        wide = read6(a, 11, i, j)
        write3(out, 58, i, j, vector64(wide[0], wide[1], wide[2]))
        write3(out, 61, i, j, vector64(wide[3], wide[4], wide[5]))
        store1(out, 64, i, j, above(s, floor, t, s))
        add1(added_out, 0, i, j, s)
        add3(added_out, 1, i, j, v)
        add6(added_out, 4, i, j, block)
        sums_out[i, j] = sum_lanes(s)
        most_out[i, j] = max_lanes(s)

    return use_words


def blocks(m: Array) -> Array:
    """Full matrices, shape (..., 3, 3), as symmetric components, shape (..., 6)."""
    return m[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]


class Run:
    """Random inputs through the kernel for one precision and lane width; outputs start as not a number."""

    def __init__(self, real: Any, width: int) -> None:
        random = np.random.default_rng(3)
        layout = self.layout = Layout(NODES, width)
        self.rows = random.normal(size=(2, layout.rows, 1))
        numbers = random.normal(size=(*NODES, 17))
        root = random.normal(size=(*NODES, 3, 3))
        numbers[..., 11:] = blocks(root @ root.swapaxes(-1, -2) + 0.1 * np.eye(3))
        numbers[2, 3, 11:] = 0.0
        numbers[..., 10] += np.copysign(0.5, numbers[..., 10])
        dtype = wp.dtype_to_numpy(real)
        self.numbers, self.rows = numbers.astype(dtype), self.rows.astype(dtype)
        inside = np.ones((*NODES, 1))
        self.before = random.normal(size=(*NODES, 10)).astype(dtype)
        out, sums, most = self.poisoned(sum(OUTPUTS.values())), self.poisoned(1)[0], self.poisoned(1)[0]
        arrays = [wp.array(values, dtype=real, device="cpu") for values in (layout.pack(self.numbers), self.rows)]
        results = [wp.array(values, dtype=real, device="cpu") for values in (out, layout.pack(self.before))]
        reduced = [wp.array(sums, dtype=wp.float64, device="cpu"), wp.array(most, dtype=real, device="cpu")]
        inputs = [*arrays, real(0.25), *results, *reduced]
        wp.launch(words_kernel(width, real), dim=layout.lane_dim, inputs=inputs, device="cpu")
        stored = layout.unpack(results[0].numpy())
        first = np.cumsum([0, *OUTPUTS.values()])
        self.words = {name: stored[..., k : k + n].squeeze(-1) if n == 1 else stored[..., k : k + n]
                      for (name, n), k in zip(OUTPUTS.items(), first[:-1], strict=True)}  # fmt: skip
        self.added, self.inside = layout.unpack(results[1].numpy()), inside
        self.sums, self.most = (r.numpy()[1:-1, width::width][:, : layout.groups] for r in reduced)
        self.packed = results[0].numpy()

    def poisoned(self, components: int) -> Array:
        return np.full((components, self.layout.rows, self.layout.columns), np.nan)


@functools.cache
def run(real: Any, width: int) -> Run:
    return Run(real, width)


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_words_are_what_they_say(real: Any, width: int) -> None:
    result = run(real, width)
    n = result.numbers.astype(np.float64)
    v, w, x, s, t, block = n[..., :3], n[..., 3:6], n[..., 6:9], n[..., 9], n[..., 10], n[..., 11:]
    matrix = block[..., FULL]
    around = np.zeros((NODES[0] + 2, NODES[1] + 2, 3))
    around[1:-1, 1:-1] = v
    singular = np.linalg.det(matrix) == 0
    inverse = np.linalg.inv(np.where(singular[..., None, None], np.eye(3), matrix))
    inverse[singular] = 0.0
    outer = v[..., :, None] * w[..., None, :]
    expected = {
        "mul": s * t, "div": s / t, "root": np.abs(t), "at_least": np.maximum(s, 0.25), "splat": 0 * s + 0.25,
        "along_u": np.broadcast_to(result.rows[1, 1:-1], NODES), "dot3": np.sum(v * w, -1), "cross3": np.cross(v, w),
        "scale": s[..., None] * v, "neighbour": around[2:, 2:] - around[1:-1, :-2],
        "outer": blocks((outer + outer.swapaxes(-1, -2)) / 2),
        "symmetric": np.stack([v[..., 0], w[..., 1], x[..., 2], v[..., 1], v[..., 2], w[..., 2]], -1),
        "isotropic": s[..., None] * [1, 1, 1, 0, 0, 0], "scale6": s[..., None] * block,
        "apply6": np.einsum("...ab,...b->...a", matrix, v), "inverse6": blocks(inverse),
        "larger": np.maximum(s, t), "exceeds": s > 0.25, "normal3": result.words["normal3"],
        "read1": s, "read3": w, "read6": block,
        "above": np.where(s > 0.25, t, s),
    }  # fmt: skip
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    assert set(expected) == set(OUTPUTS)
    for name, values in expected.items():
        condition = 1e4 if name == "inverse6" else 8.0
        np.testing.assert_allclose(
            result.words[name], values, rtol=condition * epsilon, atol=8 * epsilon * np.abs(values).max(), err_msg=name
        )
    normal, unit = result.words["normal3"], v / np.linalg.norm(v, axis=-1, keepdims=True)
    np.testing.assert_allclose(np.sum(normal * normal, -1), 1.0, rtol=8 * epsilon)
    np.testing.assert_allclose(np.sum(normal * unit, -1), 0.0, atol=8 * epsilon)
    np.testing.assert_allclose(
        result.added, result.before + np.concatenate([s[..., None], v, block], -1), atol=8 * epsilon
    )


@pytest.mark.parametrize("real", REALS)
def test_lane_widths_agree_to_the_bit(real: Any) -> None:
    narrow, wide = (run(real, width) for width in WIDTHS[real])
    for name in OUTPUTS:
        np.testing.assert_array_equal(narrow.words[name], wide.words[name], err_msg=name)
    np.testing.assert_array_equal(narrow.added, wide.added)


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_reductions_cover_the_lanes_of_a_group(real: Any, width: int) -> None:
    result = run(real, width)
    grouped = np.zeros((NODES[0], result.layout.groups * width))
    grouped[:, : NODES[1]] = result.numbers[..., 9]
    grouped = grouped.reshape(NODES[0], -1, width)
    np.testing.assert_allclose(result.sums, grouped.sum(-1), rtol=1e-14, atol=1e-14)
    np.testing.assert_array_equal(result.most, grouped.max(-1).astype(result.most.dtype))


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_nothing_is_written_outside_the_lane_groups(real: Any, width: int) -> None:
    packed = np.delete(run(real, width).packed, list(OUTPUTS).index("div"), axis=0)  # 0 / 0 beside the body
    assert np.isfinite(packed[:, 1:-1, width:-width]).all()
    for halo in (packed[:, 0], packed[:, -1], packed[..., :width], packed[..., -width:]):
        assert np.isnan(halo).all()


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_a_group_with_a_lane_that_is_not_a_number_has_no_largest(real: Any, width: int) -> None:
    words = lanes(width, real)
    load1, max_lanes = words.load1, words.max_lanes

    @wp.kernel(module=kernel_module("largest_lane", width, real))
    def largest_lane(a: wp.array3d(dtype=real), most_out: wp.array(dtype=real)):
        g = wp.tid()
        most_out[g] = max_lanes(load1(a, 0, 0, g * width))

    values = np.ones((1, 1, width * width))
    values[0, 0, np.arange(width) * (width + 1)] = np.nan
    most = wp.zeros(width, dtype=real, device="cpu")
    wp.launch(largest_lane, dim=width, inputs=[wp.array(values, dtype=real, device="cpu"), most], device="cpu")
    assert np.isnan(most.numpy()).all()


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_vector_of_one_place_in_every_lane(real: Any, width: int) -> None:
    words = lanes(width, real)
    spread3, store3 = words.spread3, words.store3

    @wp.kernel(module=kernel_module("spread", width, real))
    def spread(a: wp.array3d(dtype=real), b_out: wp.array3d(dtype=real)):
        store3(b_out, 0, 0, wp.tid() * width, spread3(a, 1, 2, 3))

    values = np.random.default_rng(1).normal(size=(4, 3, 5)).astype(wp.dtype_to_numpy(real))
    found = wp.array(np.full((3, 1, 2 * width), np.nan), dtype=real, device="cpu")
    wp.launch(spread, dim=2, inputs=[wp.array(values, dtype=real, device="cpu"), found], device="cpu")
    np.testing.assert_array_equal(found.numpy(), np.broadcast_to(values[1:, 2, 3][:, None, None], (3, 1, 2 * width)))


def test_modules_are_separate_for_every_width_and_precision() -> None:
    modules = {words_kernel(width, real).module for real, width in WIDE}
    assert len(modules) == len(WIDE)
    assert {module.name for module in modules} >= {"warpdeform_words_float32_16", "warpdeform_words_float64_1"}
    assert not any(module.options["enable_backward"] for module in modules)


@functools.cache
def comparing_kernel(width: int, real: Any) -> Any:
    words = lanes(width, real)
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    least, most, where1, where3 = words.least, words.most, words.where1, words.where3
    lane3, spread, min_lanes, below, first_lane = (
        words.lane3, words.spread, words.min_lanes, words.below, words.first_lane,
    )  # fmt: skip

    @wp.kernel(module=kernel_module("comparing_words", width, real))
    def use_comparisons(
        a: wp.array3d(dtype=real),
        limit: real,
        out: wp.array3d(dtype=real),
        least_out: wp.array(dtype=real),
        sets_out: wp.array2d(dtype=wp.int32),
    ):
        group = wp.tid()
        j = group * width
        s, t, v, w = load1(a, 0, 0, j), load1(a, 1, 0, j), load3(a, 2, 0, j), load3(a, 5, 0, j)
        store1(out, 0, 0, j, least(s, t))
        store1(out, 1, 0, j, most(s, t))
        store1(out, 2, 0, j, where1(s, t, s))
        store3(out, 3, 0, j, where3(s, v, w))
        store3(out, 6, 0, j, spread(lane3(v, width - 1)))
        least_out[group] = min_lanes(s)
        found = below(s, limit)
        sets_out[0, group] = found
        if found != 0:
            sets_out[1, group] = first_lane(found)

    return use_comparisons


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_words_that_compare_are_what_they_say(real: Any, width: int) -> None:
    groups, dtype = 5, wp.dtype_to_numpy(real)
    values = np.random.default_rng(7).normal(size=(8, 1, groups * width)).astype(dtype)
    values[0, 0, : 2 * width] = np.abs(values[0, 0, : 2 * width])
    out = wp.array(np.full((9, 1, groups * width), np.nan), dtype=real, device="cpu")
    lowest: wp.array = wp.zeros(groups, dtype=real, device="cpu")
    sets = wp.array(np.full((2, groups), -1), dtype=wp.int32, device="cpu")
    inputs = [wp.array(values, dtype=real, device="cpu"), real(-0.1), out, lowest, sets]
    wp.launch(comparing_kernel(width, real), dim=groups, inputs=inputs, device="cpu")
    s, t, v, w = values[0, 0], values[1, 0], values[2:5, 0], values[5:8, 0]
    last = v[:, width - 1 :: width].repeat(width, axis=1)
    expected = [
        np.minimum(s, t)[None],
        np.maximum(s, t)[None],
        np.where(s > 0, t, s)[None],
        np.where(s > 0, v, w),
        last,
    ]
    assert np.array_equal(out.numpy()[:, 0], np.concatenate(expected))
    in_groups = s.reshape(groups, width)
    assert np.array_equal(lowest.numpy(), in_groups.min(axis=1))
    is_below = in_groups < dtype(-0.1)
    first = np.where(is_below.any(axis=1), is_below.argmax(axis=1), -1)
    assert np.array_equal(sets.numpy(), [(is_below << np.arange(width)).sum(axis=1), first])


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_what_is_not_a_number_is_neither_below_nor_above(real: Any, width: int) -> None:
    values = np.ones((8, 1, width))
    values[0] = np.nan
    out: wp.array = wp.zeros((9, 1, width), dtype=real, device="cpu")
    sets: wp.array = wp.zeros((2, 1), dtype=wp.int32, device="cpu")
    inputs = [wp.array(values, dtype=real, device="cpu"), real(0.5), out, wp.zeros(1, dtype=real, device="cpu"), sets]
    wp.launch(comparing_kernel(width, real), dim=1, inputs=inputs, device="cpu")
    assert sets.numpy()[0, 0] == 0
    assert np.isnan(out.numpy()[2]).all()
