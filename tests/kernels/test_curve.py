"""Words of the curve kernels against NumPy, at every lane width."""

import functools
from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import REALS, WIDTHS

from warpdeform.grid import Layout
from warpdeform.kernels.angles import angles
from warpdeform.kernels.curve_geometry import curve_geometry
from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.strand_words import strand_words

Array = np.ndarray[Any, Any]

WIDE = [(real, width) for real in REALS for width in WIDTHS[real]]


@functools.cache
def words_kernel(width: int, real: Any) -> Any:
    words, turns, shape = lanes(width, real), angles(width, real), curve_geometry(width, real)
    load1, load3, store1, store3 = words.load1, words.load3, words.store1, words.store3
    cos_sin, angle_of = turns.cos_sin, turns.angle_of
    transported, row_before, row_after = shape.transported, shape.row_before, shape.row_after

    @wp.kernel(module=kernel_module("curve_words", width, real))
    def use_words(a: wp.array3d(dtype=real), loop: int, out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        c, s = cos_sin(load1(a, 0, i, j))
        store1(out, 0, i, j, c)
        store1(out, 1, i, j, s)
        store1(out, 2, i, j, angle_of(load1(a, 1, i, j), load1(a, 2, i, j)))
        store3(out, 3, i, j, transported(load3(a, 3, i, j), load3(a, 6, i, j), load3(a, 9, i, j)))
        store1(out, 6, i, j, load1(a, 0, row_before(i, loop), j))
        store1(out, 7, i, j, load1(a, 0, row_after(i, loop), j))

    return use_words


def unit(a: Array) -> Array:
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def run(real: Any, width: int, loop: int) -> tuple[Array, Array]:
    random = np.random.default_rng(2)
    layout = Layout((40, 9), width)
    numbers = np.empty((40, 9, 12))
    numbers[..., 0] = np.linspace(-6.2, 6.2, 360).reshape(40, 9)
    around = np.linspace(-np.pi, np.pi, 362)[1:-1].reshape(40, 9)
    numbers[..., 1], numbers[..., 2] = np.cos(around), np.sin(around)
    t0, t1 = unit(random.normal(size=(40, 9, 3))), unit(random.normal(size=(40, 9, 3)))
    numbers[..., 3:6] = unit(np.cross(t0, random.normal(size=(40, 9, 3))))
    numbers[..., 6:9], numbers[..., 9:12] = t0, t1
    numbers = numbers.astype(wp.dtype_to_numpy(real))
    out = wp.array(np.full((8, layout.rows, layout.columns), np.nan), dtype=real, device="cpu")
    arrays = [wp.array(layout.pack(numbers), dtype=real, device="cpu"), loop, out]
    wp.launch(words_kernel(width, real), dim=layout.lane_dim, inputs=arrays, device="cpu")
    return numbers.astype(np.float64), layout.unpack(out.numpy())


@pytest.mark.parametrize(("real", "width"), WIDE)
def test_words_are_what_they_say(real: Any, width: int) -> None:
    numbers, out = run(real, width, 0)
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    angle = numbers[..., 0]
    np.testing.assert_allclose(out[..., 0], np.cos(angle), atol=12 * epsilon)
    np.testing.assert_allclose(out[..., 1], np.sin(angle), atol=12 * epsilon)
    # Close to half a turn the cosine has no digits left for the angle.
    expected = np.arctan2(numbers[..., 2], numbers[..., 1])
    np.testing.assert_allclose(out[..., 2], expected, atol=100 * epsilon / np.abs(np.pi - np.abs(expected)).min())
    middle = np.abs(expected) < 2.0
    np.testing.assert_allclose(out[..., 2][middle], expected[middle], rtol=16 * epsilon, atol=4 * epsilon)
    d, t0, t1 = numbers[..., 3:6], numbers[..., 6:9], numbers[..., 9:12]
    axis, cosine = np.cross(t0, t1), np.sum(t0 * t1, -1, keepdims=True)
    rotated = cosine * d + np.cross(axis, d) + axis * np.sum(axis * d, -1, keepdims=True) / (1 + cosine)
    np.testing.assert_allclose(out[..., 3:6], rotated, atol=64 * epsilon)


@pytest.mark.parametrize("loop", [0, 40])
def test_rows_of_neighbours(loop: int) -> None:
    numbers, out = run(wp.float64, 8, loop)
    before, after = np.roll(numbers[..., 0], 1, axis=0), np.roll(numbers[..., 0], -1, axis=0)
    if not loop:
        before[0] = after[-1] = 0.0
    np.testing.assert_array_equal(out[..., 6], before)
    np.testing.assert_array_equal(out[..., 7], after)


@pytest.mark.parametrize("real", REALS)
def test_lane_widths_agree_to_the_bit(real: Any) -> None:
    narrow, wide = (run(real, width, 0)[1] for width in WIDTHS[real])
    np.testing.assert_array_equal(narrow, wide)


@pytest.mark.parametrize("width", [1, 8])
def test_blocks_are_factorised_however_stiff_one_direction_is(width: int) -> None:
    double, system = lanes(width, wp.float64), strand_words(width, False)
    load3, load6, store3 = double.load3, double.load6, double.store3
    factor6, solve6, none = system.factor6, system.solve6, double.S

    @wp.kernel(module=kernel_module("strand_blocks", width, wp.float64))
    def solve_blocks(a: wp.array3d(dtype=wp.float64), out: wp.array3d(dtype=wp.float64)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(out, 0, i, j, solve6(factor6(load6(a, 0, i, j), none()), load3(a, 6, i, j)))

    random = np.random.default_rng(1)
    w = random.normal(size=(4, 9, 3))
    matrix = 1e10 * w[..., None] * w[..., None, :] + np.eye(3)
    b = random.normal(size=(4, 9, 3))
    numbers = np.concatenate([matrix.reshape(4, 9, 9)[..., [0, 4, 8, 1, 2, 5]], b], -1)
    layout = Layout((4, 9), width)
    out = wp.zeros((3, layout.rows, layout.columns), dtype=wp.float64, device="cpu")
    inputs = [wp.array(layout.pack(numbers), dtype=wp.float64, device="cpu"), out]
    wp.launch(solve_blocks, dim=layout.lane_dim, inputs=inputs, device="cpu")
    # Across w the matrix is the identity; an inverse by cofactors would have no digit of it.
    normal = unit(np.cross(w, random.normal(size=(4, 9, 3))))
    np.testing.assert_allclose(np.sum(layout.unpack(out.numpy()) * normal, -1), np.sum(b * normal, -1), atol=1e-4)
