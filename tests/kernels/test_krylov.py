"""Vector updates, sums and scalar steps of conjugate gradient against NumPy, for every lane width and precision."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import GRIDS, REALS, WIDTHS

from warpdeform.grid import Layout
from warpdeform.kernels import krylov as entries
from warpdeform.kernels.krylov import krylov, reductions

Array = np.ndarray[Any, Any]

FULL = [0, 3, 4, 3, 1, 5, 4, 5, 2]
SCALARS = np.array([0.75, -1.25, 3.0, 5.0])
INERTIA = 40.0


class Run:
    """Random fields of one grid, the same numbers for every lane width; results of all lane kernels."""

    def __init__(self, nodes: tuple[int, int], real: Any, width: int) -> None:
        random = np.random.default_rng(5)
        self.layout, self.real, self.width = Layout(nodes, width), real, width
        self.dtype = wp.dtype_to_numpy(real)
        self.a, self.b = (self.rounded(random.normal(size=(*nodes, 3))) for _ in range(2))
        root = random.normal(size=(*nodes, 3, 3))
        self.matrix = root @ root.swapaxes(-1, -2) + np.eye(3)
        self.blocks = self.rounded(self.matrix[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        self.matrix = self.blocks[..., FULL].reshape(*nodes, 3, 3)
        self.mass = self.rounded(random.uniform(0.5, 2.0, (*nodes, 1)))
        self.free = (random.uniform(size=(*nodes, 1)) > 0.3).astype(np.float64)
        self.scalars = wp.array(SCALARS, dtype=wp.float64, device="cpu")
        self.inertia = wp.array([INERTIA], dtype=real, device="cpu")

    def rounded(self, values: Array) -> Array:
        return np.asarray(values.astype(self.dtype), dtype=np.float64)

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device="cpu")

    def poisoned(self, components: int) -> wp.array:
        return self.upload(np.full((*self.layout.nodes, components), np.nan))

    def launch(self, name: str, *inputs: Any) -> list[Array]:
        """Run a kernel; fields are NumPy arrays, results the outputs among them and the sums per lane group."""
        arrays = [self.upload(a) if isinstance(a, np.ndarray) else a for a in inputs]
        kernel = getattr(krylov(self.width, self.real), name)
        wp.launch(kernel, dim=self.layout.lane_dim, inputs=arrays, device="cpu")
        results = []
        for array in arrays:
            if array.ndim == 3:
                results.append(self.layout.unpack(array.numpy()))
            elif array.ndim == 2:
                results.append(array.numpy()[1:-1, self.width :: self.width][:, : self.layout.groups])
        return results

    def sums(self) -> wp.array:
        return wp.array(np.full((self.layout.rows, self.layout.columns), np.nan), dtype=wp.float64, device="cpu")

    def outputs(self) -> dict[str, Array]:
        """Last output of every kernel that writes a field; sums are checked apart."""
        a, b, blocks, free, mass = self.a, self.b, self.blocks, self.free, self.mass
        return {
            "start_solve x": self.launch("start_solve", a, self.poisoned(3), self.poisoned(3))[1],
            "start_solve r": self.launch("start_solve", a, self.poisoned(3), self.poisoned(3))[2],
            "clear": self.launch("clear", self.poisoned(3))[-1],
            "copy": self.launch("copy", a, self.poisoned(3))[-1],
            "copy_blocks": self.launch("copy_blocks", blocks, self.poisoned(6))[-1],
            "mask": self.launch("mask", free, a)[-1],
            "mask_dot": self.launch("mask_dot", free, a, b, self.sums())[2],
            "start_blocks": self.launch("start_blocks", mass, self.inertia, self.poisoned(6))[-1],
            "invert_blocks": self.launch("invert_blocks", blocks, self.poisoned(6))[-1],
            "invert_traces": self.launch("invert_traces", blocks, self.poisoned(6))[-1],
            "advance x": self.launch("advance", self.scalars, a, b, b, a)[2],
            "advance r": self.launch("advance", self.scalars, a, b, b, a)[3],
            "apply_blocks": self.launch("apply_blocks", free, blocks, a, self.poisoned(3), self.sums())[3],
            "turn": self.launch("turn", self.scalars, a, b)[-1],
        }


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("nodes", [(2, 2), (3, 19)], ids=str)
def test_fields_are_what_their_kernels_say(nodes: tuple[int, int], real: Any) -> None:
    run = Run(nodes, real, 1)
    a, b, free = run.a, run.b, run.free
    applied = np.einsum("...ab,...b->...a", run.matrix, a)
    one = np.array([1, 1, 1, 0, 0, 0])
    trace = np.trace(run.matrix, axis1=-2, axis2=-1)[..., None]
    expected = {
        "start_solve x": 0.0 * a,
        "start_solve r": -a,
        "clear": 0.0 * a,
        "copy": a,
        "copy_blocks": run.blocks,
        "mask": free * a,
        "mask_dot": free * b,
        "start_blocks": INERTIA * run.mass * one,
        "invert_blocks": np.linalg.inv(run.matrix)[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
        "invert_traces": 3 / trace * one,
        "advance x": b + SCALARS[0] * a,
        "advance r": a - SCALARS[0] * b,
        "apply_blocks": free * applied,
        "turn": a + SCALARS[1] * b,
    }
    found = run.outputs()
    assert set(found) == set(expected)
    for name, values in expected.items():
        tolerance = (1e4 if name == "invert_blocks" else 8) * np.finfo(run.dtype).eps
        np.testing.assert_allclose(found[name], values, atol=tolerance * np.abs(values).max(), err_msg=name)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("nodes", GRIDS, ids=str)
def test_lane_widths_agree_to_the_bit(nodes: tuple[int, int], real: Any) -> None:
    narrow, wide = (Run(nodes, real, width).outputs() for width in WIDTHS[real])
    for name, values in narrow.items():
        np.testing.assert_array_equal(values, wide[name], err_msg=name)


@pytest.mark.parametrize(("real", "width"), [(real, width) for real in REALS for width in WIDTHS[real]])
@pytest.mark.parametrize("nodes", [(2, 2), (3, 19)], ids=str)
def test_sums_per_lane_group(nodes: tuple[int, int], real: Any, width: int) -> None:
    run = Run(nodes, real, width)
    a, b, free = run.a, run.b, run.free

    def grouped(values: Array) -> Array:
        padded = np.zeros((nodes[0], run.layout.groups * width))
        padded[:, : nodes[1]] = values
        return padded.reshape(nodes[0], -1, width)

    products = {
        "dot": (run.launch("dot", a, b, run.sums())[-1], np.sum(a * b, -1)),
        "mask_dot": (run.launch("mask_dot", free, a, b, run.sums())[-1], np.sum(free * a * b, -1)),
        "apply_blocks": (
            run.launch("apply_blocks", free, run.blocks, a, run.poisoned(3), run.sums())[-1],
            np.sum(free * a * np.einsum("...ab,...b->...a", run.matrix, a), -1),
        ),
    }
    tolerance = 20 * np.finfo(run.dtype).eps
    for name, (found, expected) in products.items():
        np.testing.assert_allclose(
            found, grouped(expected).sum(-1), atol=tolerance * np.abs(expected).max(), err_msg=name
        )
    length = np.linalg.norm(free * a, axis=-1) / run.mass[..., 0]
    found = run.launch("largest", a, run.mass, free, run.sums())[-1]
    np.testing.assert_allclose(found, grouped(length).max(-1), rtol=tolerance)


@pytest.mark.parametrize(("real", "width"), [(real, width) for real in REALS for width in WIDTHS[real]])
def test_largest_sees_a_node_that_is_not_finite(real: Any, width: int) -> None:
    run = Run((2, 19), real, width)
    run.free[:] = 1.0
    for node in ((0, 0), (1, 7), (0, 18)):
        for value in (np.nan, np.inf):
            a = run.a.copy()
            a[node] = value
            found = run.launch("largest", a, run.mass, run.free, run.sums())[-1]
            assert not np.isfinite(found[node[0], node[1] // width])
            assert np.isfinite(found).sum() == found.size - 1


def test_singular_blocks_have_no_inverse_and_nothing_outside_has() -> None:
    run = Run((2, 3), wp.float64, 8)
    blocks = run.blocks.copy()
    blocks[0, 1] = [1, 1, 0, 0, 0, 0]
    blocks[1, 1] = [1, 1, -1, 0, 0, 0]
    inverse = run.upload(blocks)
    wp.launch(krylov(8, wp.float64).invert_blocks, dim=run.layout.lane_dim, inputs=[inverse, inverse], device="cpu")
    inside = run.layout.unpack(inverse.numpy())
    assert not inside[0, 1].any()
    assert not inside[1, 1].any()
    assert np.count_nonzero(inverse.numpy()) == np.count_nonzero(inside) == 4 * 6


class Scalars:
    """The single-thread kernels on their scalars and state."""

    def __init__(self, scalars: Array, state: list[int]) -> None:
        self.scalars = wp.array(scalars, dtype=wp.float64, device="cpu")
        self.state = wp.array(state, dtype=wp.int32, device="cpu")

    def launch(self, name: str, rows: list[float], *inputs: Any) -> "Scalars":
        sums = wp.array([rows, [0.0] * len(rows)], dtype=wp.float64, device="cpu")
        kernel = getattr(reductions(), name)
        wp.launch(kernel, dim=1, inputs=[sums, *inputs, self.scalars, self.state], device="cpu")
        return self

    def __getitem__(self, entry: int) -> float:
        return float(self.scalars.numpy()[entry])

    def read(self, entry: int) -> int:
        return int(self.state.numpy()[entry])


def test_rows_are_summed_in_the_order_of_a_plain_loop() -> None:
    random = np.random.default_rng(1)
    partials = random.normal(size=(5, 24)) * 10.0 ** random.integers(-8, 8, (5, 24))
    rows = wp.array(np.full((2, 4), np.nan), dtype=wp.float64, device="cpu")
    for stride in (1, 8):
        given = wp.array(partials, dtype=wp.float64, device="cpu")
        wp.launch(reductions().sum_rows, dim=3, inputs=[given, stride, rows[:, 1:]], device="cpu")
        for i in range(3):
            total = size = 0.0
            for x in partials[i + 1, ::stride]:
                total, size = total + x, size + abs(x)
            assert rows.numpy()[:, i + 1].tolist() == [total, size]
        assert np.isnan(rows.numpy()[:, 0]).all()


def test_total_adds_all_rows_and_their_magnitudes() -> None:
    rows = wp.array([[1.0, -2.5, 4.0], [1.0, 2.5, 7.0]], dtype=wp.float64, device="cpu")
    scalars = wp.array([9.0, 9.0, 9.0, 9.0], dtype=wp.float64, device="cpu")
    wp.launch(reductions().total, dim=1, inputs=[rows, 1, scalars], device="cpu")
    assert scalars.numpy().tolist() == [9.0, 2.5, 10.5, 9.0]


@pytest.mark.parametrize("worst", [7.0, np.inf, np.nan])
def test_greatest_row_and_entry(worst: float) -> None:
    partials = np.zeros((4, 32))
    partials[1, 8:24:8], partials[2, 8:24:8] = (3.0, 2.0), (worst, 1.0)
    partials[:, 0], partials[:, 24] = 99.0, 99.0  # the halo of the columns does not count
    rows = wp.array(np.zeros((2, 2)), dtype=wp.float64, device="cpu")
    scalars = wp.zeros(2, dtype=wp.float64, device="cpu")
    given = wp.array(partials, dtype=wp.float64, device="cpu")
    wp.launch(reductions().max_rows, dim=2, inputs=[given, 8, rows], device="cpu")
    np.testing.assert_array_equal(rows.numpy()[0], [3.0, worst])
    wp.launch(reductions().greatest, dim=1, inputs=[rows, 1, scalars], device="cpu")
    np.testing.assert_array_equal(scalars.numpy(), [0.0, worst])


@pytest.mark.parametrize(("rz", "active", "breakdown"), [(4.5, 1, 0), (0.0, 0, 0), (np.nan, 0, 1), (np.inf, None, 1)])
def test_solve_starts_only_with_a_residual(rz: float, active: int | None, breakdown: int) -> None:
    run = Scalars(np.full(4, 9.0), [7, 7, 7]).launch("cg_start", [rz, 0.0])
    np.testing.assert_array_equal([run[entries.RZ], run[entries.RZ_START]], [rz, rz])
    assert active is None or run.read(entries.ACTIVE) == active
    assert run.read(entries.ITERATIONS) == 0
    assert run.read(entries.BREAKDOWN) == breakdown


@pytest.mark.parametrize(("curvature", "alpha"), [(2.0, 1.5), (0.0, 0.0), (-2.0, 0.0), (np.nan, 0.0), (np.inf, 0.0)])
def test_direction_without_curvature_is_a_breakdown(curvature: float, alpha: float) -> None:
    run = Scalars(SCALARS, [1, 3, 0]).launch("cg_step", [curvature / 2, curvature / 2])
    assert run[entries.ALPHA] == alpha
    assert run.read(entries.BREAKDOWN) == (alpha == 0)


@pytest.mark.parametrize(
    ("rz", "iterations", "breakdown", "active"),
    [
        (1.0, 3, 0, 1), (0.0124, 3, 0, 0), (0.0126, 3, 0, 1), (1.0, 9, 0, 0), (1.0, 3, 1, 0), (np.nan, 3, 0, 0),
        (-1.0, 3, 0, 0),
    ],
)  # fmt: skip
def test_solve_stops_at_the_tolerance_the_cap_and_a_breakdown(
    rz: float, iterations: int, breakdown: int, active: int
) -> None:
    # sqrt(r.z) shall drop by 0.05 from sqrt(5): r.z to 0.0125.
    tolerance = wp.array([0.05], dtype=wp.float64, device="cpu")
    cap = wp.array([10], dtype=wp.int32, device="cpu")
    run = Scalars(SCALARS, [1, iterations, breakdown]).launch("cg_turn", [rz], tolerance, cap)
    assert run.read(entries.ACTIVE) == active
    assert run.read(entries.ITERATIONS) == iterations + 1
    np.testing.assert_array_equal([run[entries.BETA], run[entries.RZ]], [rz / 3.0, rz])
    assert run.read(entries.BREAKDOWN) == (breakdown or not rz >= 0)
