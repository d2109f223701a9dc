"""Kernels of the loads against NumPy, for every lane width and precision, on grids of any size."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.wind_load import difference_weights
from warpdeform.grid import Layout
from warpdeform.kernels import loads, wind

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
        self.mass, self.area = random.uniform(0.1, 1.0, (*nodes, 1)), random.uniform(0.1, 1.0, (*nodes, 3))
        self.before = random.normal(size=(*nodes, 6))
        self.waves = random.normal(size=(5, 6))
        self.phases = random.uniform(-3, 3, 5)
        every = np.argwhere(np.ones(nodes))
        self.places = random.permutation(every)[: max(1, len(every) // 3)]
        self.stiffness, self.points = random.uniform(1, 9, len(self.places)), random.normal(size=(len(self.places), 3))
        self.facing = random.normal(size=(*nodes, 12))
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


def faced(inp: Inputs, width: int, kind: str, number: int = 2, gusting: bool = False) -> Field:
    kernel = wind.facing(width, inp.real, kind, gusting).face
    waves, phases = (inp.waves, inp.phases) if gusting else (np.zeros((0, 6)), np.zeros(0))
    air = [small(WIND, inp), small(waves, inp), small(phases, inp)]
    return run(kernel, inp, width, [iteration(number), 3, 1, 1, "z", *slopes(inp, width), *air], -6)


def wind_facing(inp: Inputs, width: int) -> tuple[Field, Field]:
    stream = np.broadcast_to(WIND, inp.z.shape)
    return faced(inp, width, "surface"), np.concatenate([normals(inp.z), stream], axis=-1)


def wind_facing_curves(inp: Inputs, width: int) -> tuple[Field, Field]:
    tangents = np.gradient(inp.z, axis=0)
    tangents /= np.linalg.norm(tangents, axis=-1, keepdims=True)
    return faced(inp, width, "curve"), np.concatenate([tangents, np.broadcast_to(WIND, inp.z.shape)], axis=-1)


def gust_facing(inp: Inputs, width: int) -> tuple[Field, Field]:
    stream = WIND + np.cos(2 * np.pi * (inp.z @ inp.waves[:, :3].T + inp.phases)) @ inp.waves[:, 3:]
    return faced(inp, width, "surface", gusting=True), np.concatenate([normals(inp.z), stream], axis=-1)


def catching(inp: Inputs, kind: str) -> Field:
    """What the faces of each node catch of a velocity, times their areas, shape (nu, nv, 3, 3)."""
    f = inp.facing[..., :-3].reshape(*inp.nodes, -1, 3) if kind == "solid" else inp.facing[..., None, :3]
    along = f[..., :, None] * f[..., None, :]
    area = inp.area[..., : f.shape[-2], None, None]
    return np.asarray((area * (np.eye(3) - along if kind == "curve" else along)).sum(axis=-3))


def wind_case(kind: str, what: str) -> "Case":
    """Energy, gradient or blocks of the force on one kind of body."""
    components = 3 if kind == "solid" else 1

    def case(inp: Inputs, width: int) -> tuple[Field, Field]:
        part = vars(inp) | {
            "area": inp.area[..., :components],
            "facing": inp.facing[..., -3 * components - 3 :],
        }
        inp = SimpleNamespace(**part)  # type: ignore[assignment]
        M, d, u = catching(inp, kind), inp.z - inp.w, inp.facing[..., -3:]
        kernels, air = wind.wind(width, inp.real, kind), small([C, INVERSE_TAU], inp)
        if what == "energy":
            expected = C * np.einsum("...a,...ab,...b", d, M, 0.5 * INVERSE_TAU * d - u)
            return energies(inp, width, kernels.add_energy, ["area", "facing", "w", "z", air]), expected
        if what == "gradient":
            expected = inp.before[..., :3] + C * np.einsum("...ab,...b", M, INVERSE_TAU * d - u)
            return run(kernels.add_gradient, inp, width, ["area", "facing", "w", "z", air], 3), expected
        expected = inp.before + C * INVERSE_TAU * M[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
        return run(kernels.add_blocks, inp, width, ["area", "facing", air], 6), expected

    case.__name__ = f"wind_{kind}_{what}"
    return case


Case = Callable[[Inputs, int], tuple[Field, Field]]
CASES: list[Case] = [
    gravity_energy, gravity_gradient, drag_energy, drag_gradient, drag_blocks, spring_energy, spring_gradient,
    spring_blocks, wind_facing, wind_facing_curves, gust_facing,
    *(wind_case(kind, what) for kind in wind.FACES for what in ("energy", "gradient", "blocks")),
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
    assert np.isnan(faced(inp, width, "surface", 3)).all()
    assert np.isnan(faced(inp, width, "surface", 3, gusting=True)).all()


def test_normal_of_a_sheet_folded_to_a_point_is_finite() -> None:
    inp = Inputs((3, 5), wp.float32)
    inp.z = np.zeros_like(inp.z)
    np.testing.assert_array_equal(faced(inp, 16, "surface")[..., :3], 0.0)
