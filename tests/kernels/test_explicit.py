"""Kicks, drifts and the bound on frequencies against NumPy, for every kind of kick and both lane widths."""

from itertools import product
from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import REALS, WIDTHS

from warpdeform.grid import Layout
from warpdeform.kernels import explicit as entries
from warpdeform.kernels.explicit import Kick, bursts, counting, kicks, no_gathering

Array = np.ndarray[Any, Any]

NODES = (3, 19)
PACE = np.zeros(entries.PACE)
PACE[[int(e) for e in (entries.DT, entries.PER_DT, entries.DRIFT, entries.THETA, entries.PER_BURST)]] = (
    0.125, 8.0, 0.0625, 0.5, 2.0,
)  # fmt: skip
PUSH = np.array([0.5, -1.0, -9.0])
KICKS = [Kick(None, *flags) for flags in product((False, True), repeat=5) if flags[4] or sum(flags) < 4]


class Run:
    """Random fields through the kernels, the same numbers for every lane width."""

    def __init__(self, real: Any, width: int) -> None:
        random = np.random.default_rng(7)
        self.layout, self.real, self.width = Layout(NODES, width), real, width
        dtype = wp.dtype_to_numpy(real)
        fields = random.normal(size=(6, *NODES, 3)).astype(dtype).astype(np.float64)
        self.x, self.v, self.g, self.loads, self.z, self.target = fields
        self.per_mass = random.uniform(0.5, 2.0, (*NODES, 1)).astype(dtype).astype(np.float64)
        self.free = (random.uniform(size=(*NODES, 1)) > 0.4).astype(np.float64)
        self.pace, self.push = (wp.array(values, dtype=real, device="cpu") for values in (PACE, PUSH))

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device="cpu")

    def poison(self, components: int = 3) -> wp.array:
        return self.upload(np.full((*NODES, components), np.nan))

    def launch(self, kernel: Any, *inputs: Any) -> list[Array]:
        """Run a kernel; fields are NumPy arrays; results are the component arrays after it."""
        arrays = [self.upload(a) if isinstance(a, np.ndarray) else a for a in inputs]
        wp.launch(kernel, dim=self.layout.lane_dim, inputs=arrays, device="cpu")
        return [self.layout.unpack(a.numpy()) for a in arrays if isinstance(a, wp.array) and a.ndim == 3]

    def sums(self, value: float) -> wp.array:
        return wp.array(np.full((self.layout.rows, self.layout.columns), value), dtype=wp.float64, device="cpu")

    def by_groups(self, sums: wp.array) -> Array:
        return sums.numpy()[1:-1, self.width :: self.width][:, : self.layout.groups]

    def advance(self, kick: Kick) -> tuple[dict[str, Array], Array]:
        """Velocity, what comes next, w; and the work of each lane group, on top of 3."""
        fluxes = no_gathering(self.width, self.real).Fluxes()
        fluxes.none = self.upload(np.zeros(NODES))
        work = self.sums(3.0)
        inputs = [self.g, self.loads, self.per_mass, self.free, self.push, self.pace, self.x, self.v]
        kernel = kicks(self.width, self.real, kick).advance
        results = self.launch(kernel, fluxes, *inputs, self.poison(), self.poison(), work)
        return dict(zip(("v", "next", "w"), results[-3:], strict=True)), self.by_groups(work)


def expected(run: Run, kick: Kick) -> tuple[dict[str, Array], Array]:
    dt = PACE[int(entries.DT)]
    force = run.g if kick.loaded else 0.0 * run.g
    kicked = run.v + run.free * dt * ((PUSH if kick.pushed else 0.0) - run.per_mass * force)
    unwritten = np.full_like(run.v, np.nan)
    fields = {"v": kicked, "next": run.x + dt * kicked, "w": unwritten}
    if kick.displacing:
        fields = {"v": run.v, "next": dt * kicked, "w": unwritten}
    elif kick.trailing:
        fields["w"] = run.x + dt * kicked - (kicked + 0.5 * (kicked - run.v))
    given = (1.0 - run.free) * force - (run.loads if kick.trailing else 0.0)
    return fields, np.sum(given * dt * kicked, -1) if kick.working else 0.0 * run.v[..., 0]


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("kick", [KICKS[0], KICKS[-1], Kick(None, True, True, True, False, True)], ids=lambda k: k.name)
def test_kicks(kick: Kick, real: Any) -> None:
    found = []
    for width in WIDTHS[real]:
        run = Run(real, width)
        fields, work = run.advance(kick)
        found.append(fields)
        wanted, each = expected(run, kick)
        epsilon = float(np.finfo(wp.dtype_to_numpy(real)).eps)
        for name, values in wanted.items():
            np.testing.assert_allclose(fields[name], values, atol=100 * epsilon, err_msg=name)
        padded = np.zeros((NODES[0], run.layout.groups * width))
        padded[:, : NODES[1]] = each
        np.testing.assert_allclose(work - 3.0, padded.reshape(NODES[0], -1, width).sum(-1), atol=400 * epsilon)
    for name in found[0]:
        np.testing.assert_array_equal(found[0][name], found[1][name], err_msg=name)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("width_index", [0, 1])
def test_begin_drift_and_move(real: Any, width_index: int) -> None:
    run = Run(real, WIDTHS[real][width_index])
    k, kick = bursts(run.width, real), Kick(None, True, True, True, True, False)
    epsilon = float(np.finfo(wp.dtype_to_numpy(real)).eps)
    dt, per_burst, ahead = 0.125, 2.0, 0.0625
    v, x_before, v_before = run.launch(
        k.begin, run.free, run.target, run.pace, run.x, run.v, run.poison(), run.poison()
    )[-3:]
    led = run.free * run.v + (1.0 - run.free) * per_burst * (run.target - run.x)
    np.testing.assert_allclose(v, led, atol=20 * epsilon)
    np.testing.assert_array_equal(x_before, run.x)
    np.testing.assert_array_equal(v_before, run.v)
    back = run.launch(k.drift, run.pace, real(-1.0), run.v, run.x)[-1]
    np.testing.assert_allclose(back, run.x - ahead * run.v, atol=4 * epsilon)
    ahead_of = run.launch(k.drift_ahead, run.pace, run.v, run.poison())[-1]
    np.testing.assert_allclose(ahead_of, ahead * run.v, atol=4 * epsilon)
    np.testing.assert_allclose(run.launch(k.add, run.z, run.x)[-1], run.x + run.z, atol=4 * epsilon)
    for fresh, u in ((1.0, run.v), (0.0, run.z)):
        before = wp.array([*PACE[:5], fresh], dtype=real, device="cpu")
        found = run.launch(k.trail, before, run.x, run.v, np.full_like(run.z, np.nan) if fresh else run.z)[-1]
        np.testing.assert_allclose(found, run.x - u, atol=4 * epsilon)
    move = kicks(run.width, real, kick).move
    d = run.g
    x, v, w = run.launch(move, run.pace, d, run.z, run.x, run.v, run.poison())[-3:]
    np.testing.assert_allclose(x, run.z + d, atol=8 * epsilon)
    np.testing.assert_allclose(v, (run.z + d - run.x) / dt, atol=100 * epsilon)
    np.testing.assert_allclose(w, x - (v + 0.5 * (v - run.v)), atol=100 * epsilon)


@pytest.mark.parametrize("real", REALS)
def test_rates_are_bounded_by_two_percent_at_most(real: Any) -> None:
    run = Run(real, WIDTHS[real][1])
    random = np.random.default_rng(3)
    roots = random.normal(size=(*NODES, 3, 3)) * 10.0 ** random.uniform(-3, 3, (*NODES, 1, 1))
    roots[0, :5] = 0.0  # nodes that nothing acts on
    roots[1, :5, :, 1:] = 0.0  # of rank one
    roots[2, :5] = np.eye(3)  # alike in every direction
    blocks = roots @ roots.swapaxes(-1, -2)
    packed = blocks[..., [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    largest = np.linalg.eigvalsh(blocks)[..., -1] * run.per_mass[..., 0] * run.free[..., 0]
    sums = run.sums(np.nan)
    run.launch(bursts(run.width, real).bound_rates, packed, run.per_mass, run.free, sums)
    padded = np.zeros((NODES[0], run.layout.groups * run.width))
    padded[:, : NODES[1]] = largest
    wanted = padded.reshape(NODES[0], -1, run.width).max(-1)
    found = run.by_groups(sums)
    assert (found >= wanted * (1.0 - 1e-5)).all()
    assert (found <= wanted * 1.0175).all()
    fastest = run.sums(np.nan)
    run.launch(bursts(run.width, real).greatest_speed, run.v, fastest)
    assert run.by_groups(fastest).max() == pytest.approx(np.linalg.norm(run.v, axis=-1).max(), rel=1e-6)


@pytest.mark.parametrize(("count", "together", "left", "odd"), [(7, 2, 3, 1), (8, 2, 4, 0), (1, 2, 0, 1), (5, 1, 5, 0)])
def test_steps_are_counted(count: int, together: int, left: int, odd: int) -> None:
    counts, iteration = (wp.full(n, 9, dtype=wp.int32, device="cpu") for n in (entries.COUNTS, 1))
    asked = wp.array([count], dtype=wp.int32, device="cpu")
    wp.launch(counting().begin_burst, dim=1, inputs=[asked, together, counts, iteration], device="cpu")
    assert (counts.numpy()[int(entries.LEFT)], counts.numpy()[int(entries.ODD)]) == (left, odd)
    assert iteration.numpy()[0] == 0
    wp.launch(counting().count_down, dim=1, inputs=[counts], device="cpu")
    assert counts.numpy()[int(entries.LEFT)] == left - 1
