"""Kernels of the loads against NumPy, for every lane width and precision, on grids of any size."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.surface_bending import difference_weights
from warpdeform.grid import Layout
from warpdeform.kernels import loads

NODES = [(2, 2), (3, 5), (17, 33)]
WIDTHS = {wp.float64: (1, 8), wp.float32: (1, 16)}
TOLERANCE = {wp.float64: 1e-13, wp.float32: 2e-5}
GRAVITY = np.array([0.3, -1.2, -9.81])
DAMPING, C, INVERSE_TAU = 7.0, 1.5, 40.0
WIND = np.array([4.0, -2.0, 1.0])
Field = NDArray[np.float64]


class Inputs:
    """Random state of a wavy sheet, shape (nu, nv, n), the same numbers for every layout."""

    def __init__(self, nodes: tuple[int, int], real: Any) -> None:
        random = np.random.default_rng(3)
        self.nodes, self.real, self.np = nodes, real, wp.dtype_to_numpy(real)
        u, v = np.meshgrid(*(np.arange(n) * 0.1 for n in nodes), indexing="ij")
        self.x = np.stack([u, v, 0.1 * np.sin(3 * u + 5 * v)], axis=-1) + random.normal(0, 0.01, (*nodes, 3))
        self.w = self.x + random.normal(0, 0.01, (*nodes, 3))
        self.z = self.x + random.normal(0, 0.01, (*nodes, 3))
        self.mass, self.area = random.uniform(0.1, 1.0, (*nodes, 1)), random.uniform(0.1, 1.0, (*nodes, 1))
        self.before = random.normal(size=(*nodes, 6))
        self.waves = random.normal(size=(5, 6))
        self.phases = random.uniform(-3, 3, 5)
        every = np.argwhere(np.ones(nodes))
        self.places = random.permutation(every)[: max(1, len(every) // 3)]
        self.stiffness, self.points = random.uniform(1, 9, len(self.places)), random.normal(size=(len(self.places), 3))
        self.facing = random.normal(size=(*nodes, 4))
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray) and name != "places":
                setattr(self, name, value.astype(self.np).astype(np.float64))


def run(
    kernel: Any, inp: Inputs, width: int, arguments: list[Any], components: int | str, *, by: str = "group"
) -> Field:
    """Launch a kernel and unpack its output; names among the arguments stand for per-node inputs.

    The output is "energy", or so many components: added to `before` if positive, else written over NaN.
    """
    layout = Layout(inp.nodes, width)
    arrays = [
        wp.array(layout.pack(getattr(inp, a)), dtype=inp.real, device="cpu") if isinstance(a, str) else a
        for a in arguments
    ]
    if components == "energy":
        out = wp.zeros((layout.rows, layout.columns), dtype=wp.float64, device="cpu")
    elif isinstance(components, int) and components > 0:
        out = wp.array(layout.pack(inp.before[..., :components]), dtype=inp.real, device="cpu")
    else:
        assert isinstance(components, int)
        out = wp.full((-components, layout.rows, layout.columns), np.nan, dtype=inp.real, device="cpu")
    dim: Any = {"group": layout.lane_dim, "node": layout.nodes, "spring": len(inp.places)}[by]
    wp.launch(kernel, dim=dim, inputs=arrays, outputs=[out], device="cpu")
    values = out.numpy().astype(np.float64)
    if components == "energy":
        sums = values[1:-1, layout.halo : -layout.halo]
        assert values.sum() == pytest.approx(sums.sum(), rel=1e-14)
        return sums
    if isinstance(components, int) and components > 0:
        inside = layout.pack(np.ones((*inp.nodes, 1)))[0] > 0
        assert not values[:, ~inside].any()
    return np.asarray(layout.unpack(values), dtype=np.float64)


def small(values: Any, inp: Inputs) -> wp.array:
    return wp.array(np.asarray(values), dtype=inp.real, device="cpu")


def places(inp: Inputs, width: int) -> wp.array:
    return wp.array(inp.places + [1, width], dtype=int, device="cpu")


def energies(inp: Inputs, width: int, kernel: Any, arguments: list[Any], by: str = "group") -> Field:
    return run(kernel, inp, width, arguments, "energy", by=by)


def slopes(inp: Inputs, width: int) -> tuple[wp.array, wp.array]:
    slopes_u, slopes_v = difference_weights(Layout(inp.nodes, width))
    return small(slopes_u, inp), small(slopes_v, inp)


def normals(r: Field) -> Field:
    a = np.cross(np.gradient(r, axis=0), np.gradient(r, axis=1))
    return a / np.linalg.norm(a, axis=-1, keepdims=True)


def outer(n: Field) -> Field:
    return np.stack([n[..., a] * n[..., b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))], axis=-1)


def isotropic(k: Field) -> Field:
    return k * np.array([1, 1, 1, 0, 0, 0])


def scatter(inp: Inputs, values: Field) -> Field:
    field = np.zeros((*inp.nodes, values.shape[1]))
    field[tuple(inp.places.T)] = values
    return field


# Each case: what a layout of some width computes, and the oracle of it (float64). "before" is added for accumulations.
def gravity_energy(inp: Inputs, width: int) -> tuple[Field, Field]:
    return energies(
        inp, width, loads.gravity(width, inp.real).add_energy, ["mass", "x", "z", small(GRAVITY, inp)]
    ), -inp.mass[..., 0] * ((inp.z - inp.x) @ GRAVITY)


def gravity_gradient(inp: Inputs, width: int) -> tuple[Field, Field]:
    kernel = loads.gravity(width, inp.real).add_gradient
    return run(kernel, inp, width, ["mass", small(GRAVITY, inp)], 3), inp.before[..., :3] - inp.mass * GRAVITY


def drag_energy(inp: Inputs, width: int) -> tuple[Field, Field]:
    kernel = loads.drag(width, inp.real).add_energy
    expected = 0.5 * DAMPING * inp.mass[..., 0] * np.sum((inp.z - inp.w) ** 2, axis=-1)
    return energies(inp, width, kernel, ["mass", "w", "z", small([DAMPING], inp)]), expected


def drag_gradient(inp: Inputs, width: int) -> tuple[Field, Field]:
    kernel = loads.drag(width, inp.real).add_gradient
    expected = inp.before[..., :3] + DAMPING * inp.mass * (inp.z - inp.w)
    return run(kernel, inp, width, ["mass", "w", "z", small([DAMPING], inp)], 3), expected


def drag_blocks(inp: Inputs, width: int) -> tuple[Field, Field]:
    kernel = loads.drag(width, inp.real).add_blocks
    return run(kernel, inp, width, ["mass", small([DAMPING], inp)], 6), inp.before + isotropic(DAMPING * inp.mass)


def spring_arguments(inp: Inputs, width: int) -> list[Any]:
    return [places(inp, width), small(inp.stiffness, inp), small(inp.points, inp)]


def spring_energy(inp: Inputs, width: int) -> tuple[Field, Field]:
    z, x = inp.z[tuple(inp.places.T)], inp.x[tuple(inp.places.T)]
    each = 0.5 * inp.stiffness * (np.sum((z - inp.points) ** 2, axis=1) - np.sum((x - inp.points) ** 2, axis=1))
    kernel = loads.springs(inp.real).add_energy
    actual = energies(inp, width, kernel, [*spring_arguments(inp, width), "x", "z"], "spring")
    return actual, scatter(inp, each[:, None])[..., 0]


def spring_gradient(inp: Inputs, width: int) -> tuple[Field, Field]:
    force = inp.stiffness[:, None] * (inp.z[tuple(inp.places.T)] - inp.points)
    kernel = loads.springs(inp.real).add_gradient
    actual = run(kernel, inp, width, [*spring_arguments(inp, width), "z"], 3, by="spring")
    return actual, inp.before[..., :3] + scatter(inp, force)


def spring_blocks(inp: Inputs, width: int) -> tuple[Field, Field]:
    kernel = loads.springs(inp.real).add_blocks
    actual = run(kernel, inp, width, spring_arguments(inp, width)[:2], 6, by="spring")
    return actual, inp.before + scatter(inp, isotropic(inp.stiffness[:, None]))


def iteration(number: int) -> wp.array:
    return wp.array([number], dtype=int, device="cpu")


def wind_facing(inp: Inputs, width: int) -> tuple[Field, Field]:
    kernel = loads.wind(width, inp.real).face_stream
    actual = run(kernel, inp, width, [iteration(2), 3, "z", *slopes(inp, width), small(WIND, inp)], -4)
    n = normals(inp.z)
    return actual, np.concatenate([n, (n @ WIND)[..., None]], axis=-1)


def wind_energy(inp: Inputs, width: int) -> tuple[Field, Field]:
    q = np.sum(inp.facing[..., :3] * (inp.z - inp.w), axis=-1)
    expected = C * inp.area[..., 0] * q * (0.5 * INVERSE_TAU * q - inp.facing[..., 3])
    kernel = loads.wind(width, inp.real).add_energy
    return energies(inp, width, kernel, ["area", "facing", "w", "z", small([C, INVERSE_TAU], inp)]), expected


def wind_gradient(inp: Inputs, width: int) -> tuple[Field, Field]:
    n = inp.facing[..., :3]
    slip = inp.facing[..., 3:] - INVERSE_TAU * np.sum(n * (inp.z - inp.w), axis=-1, keepdims=True)
    kernel = loads.wind(width, inp.real).add_gradient
    actual = run(kernel, inp, width, ["area", "facing", "w", "z", small([C, INVERSE_TAU], inp)], 3)
    return actual, inp.before[..., :3] - C * inp.area * slip * n


def wind_blocks(inp: Inputs, width: int) -> tuple[Field, Field]:
    kernel = loads.wind(width, inp.real).add_blocks
    actual = run(kernel, inp, width, ["area", "facing", small([C, INVERSE_TAU], inp)], 6)
    return actual, inp.before + C * INVERSE_TAU * inp.area * outer(inp.facing[..., :3])


def gust_arguments(inp: Inputs, width: int, number: int = 2) -> list[Any]:
    faced = [iteration(number), 3, "z", *slopes(inp, width)]
    return [*faced, small(WIND, inp), small(inp.waves, inp), small(inp.phases, inp)]


def gust_facing(inp: Inputs, width: int) -> tuple[Field, Field]:
    actual = run(loads.gusts(width, inp.real).face_gusts, inp, width, gust_arguments(inp, width), -4)
    stream = WIND + np.cos(2 * np.pi * (inp.z @ inp.waves[:, :3].T + inp.phases)) @ inp.waves[:, 3:]
    n = normals(inp.z)
    return actual, np.concatenate([n, np.sum(n * stream, axis=-1, keepdims=True)], axis=-1)


Case = Callable[[Inputs, int], tuple[Field, Field]]
CASES: list[Case] = [
    gravity_energy, gravity_gradient, drag_energy, drag_gradient, drag_blocks, spring_energy, spring_gradient,
    spring_blocks, wind_facing, wind_energy, wind_gradient, wind_blocks, gust_facing,
]  # fmt: skip


@pytest.mark.parametrize("real", [wp.float64, wp.float32], ids=["float64", "float32"])
@pytest.mark.parametrize("nodes", NODES, ids=str)
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.__name__)
def test_against_numpy_and_equal_for_all_widths(case: Case, nodes: tuple[int, int], real: Any) -> None:
    inp = Inputs(nodes, real)
    (narrow, expected), (wide, _) = (case(inp, width) for width in WIDTHS[real])
    tolerance = (1e-9 if case is gust_facing and real is wp.float64 else TOLERANCE[real]) * max(
        1.0, np.abs(expected).max()
    )
    if case.__name__.endswith("energy"):
        width = WIDTHS[real][1]
        assert np.abs(narrow - expected).max() < tolerance
        if case is spring_energy:
            np.testing.assert_array_equal(wide[:, : nodes[1]], narrow)
            return
        lanes = np.zeros((nodes[0], -(-nodes[1] // width), width))
        lanes.reshape(nodes[0], -1)[:, : nodes[1]] = narrow
        while lanes.shape[-1] > 1:  # pair by pair, as the lanes are summed
            lanes = lanes[..., : lanes.shape[-1] // 2] + lanes[..., lanes.shape[-1] // 2 :]
        sums = np.zeros_like(wide)
        sums[:, ::width] = lanes[..., 0]
        np.testing.assert_array_equal(wide, sums)
    else:
        assert np.abs(narrow - expected).max() < tolerance
        np.testing.assert_array_equal(wide, narrow)


@pytest.mark.parametrize("width", [1, 8])
def test_lagged_quantities_freeze(width: int) -> None:
    inp = Inputs((3, 5), wp.float64)
    wind, gusts = loads.wind(width, inp.real), loads.gusts(width, inp.real)
    faced = run(wind.face_stream, inp, width, [iteration(3), 3, "z", *slopes(inp, width), small(WIND, inp)], -4)
    assert np.isnan(faced).all()
    assert np.isnan(run(gusts.face_gusts, inp, width, gust_arguments(inp, width, 3), -4)).all()


def test_normal_of_a_sheet_folded_to_a_point_is_finite() -> None:
    inp = Inputs((3, 5), wp.float32)
    inp.z = np.zeros_like(inp.z)
    faced = run(
        loads.wind(16, inp.real).face_stream, inp, 16, [iteration(0), 3, "z", *slopes(inp, 16), small(WIND, inp)], -4
    )
    np.testing.assert_array_equal(faced, 0.0)


@pytest.mark.parametrize("real", [wp.float64, wp.float32], ids=["float64", "float32"])
def test_compiles_for_cuda_without_a_gpu(real: Any, tmp_path: Path) -> None:
    makers = [
        loads.gravity(1, real),
        loads.drag(1, real),
        loads.springs(real),
        loads.wind(1, real),
        loads.gusts(1, real),
    ]
    for kernels in makers:
        module = next(iter(vars(kernels).values())).module
        wp.compile_aot_module(module, arch=[75], use_ptx=False, module_dir=tmp_path)
    assert len(list(tmp_path.rglob("*.cubin"))) == len(makers)
