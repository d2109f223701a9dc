"""The loads as the solver sees them: potential, gradient and blocks agree; closed forms."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
import warp as wp
from numpy.typing import NDArray
from surfaces import CLOSED

from warpdeform.body import Spring
from warpdeform.forces.drag import Drag
from warpdeform.forces.force import Force
from warpdeform.forces.gravity import Gravity
from warpdeform.forces.springs import Springs
from warpdeform.forces.wind_load import WindLoad
from warpdeform.grid import Layout
from warpdeform.track import Track
from warpdeform.wind import Wind

TAU = 0.01
AREAL_DENSITY = 0.2
REALS = [wp.float64, wp.float32]
Field = NDArray[np.float64]


@dataclass
class SheetArrays:
    """A sheet of 0.1 m spacing in the arrays that terms read."""

    nodes: tuple[int, int]
    real: Any = wp.float64
    lane_width: int = 1
    wavy: bool = True
    periodic: tuple[bool, ...] = ()
    device: str = "cpu"
    layout: Layout = field(init=False)

    def __post_init__(self) -> None:
        random = np.random.default_rng(5)
        self.layout = Layout(self.nodes, self.lane_width, self.periodic)
        u, v = np.meshgrid(*(np.arange(n) * 0.1 for n in self.nodes), indexing="ij")
        self.rest = np.stack([u, v, np.zeros_like(u)], axis=-1)
        wave = 0.1 * np.sin(3 * u + 5 * v)[..., None] * np.array([0, 0, 1]) + random.normal(0, 0.01, (*self.nodes, 3))
        self.start = self.rest + wave if self.wavy else self.rest
        share = [np.where((np.arange(n) == 0) | (np.arange(n) == n - 1), 0.5, 1.0) for n in self.nodes]
        self.areas = 0.01 * np.outer(*share)
        self.masses = AREAL_DENSITY * self.areas
        self.x, self.w = self.upload(self.start), self.upload(self.start)
        self.mass = self.upload(self.masses)
        self.free = self.upload(np.ones(self.nodes))
        self.iteration = wp.zeros(1, dtype=int, device=self.device)

    def upload(self, values: Field) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device=self.device)

    def download(self, array: wp.array) -> Field:
        return np.asarray(self.layout.unpack(array.numpy()), dtype=np.float64)

    def energies(self, force: Force, z: Field) -> Field:
        partials = wp.zeros((self.layout.rows, self.layout.columns), dtype=wp.float64, device=self.device)
        force.add_energy(self, self.upload(z), partials)
        return np.asarray(self.layout.unpack(partials.numpy()[None])[..., 0], dtype=np.float64)

    def gradient(self, force: Force, z: Field) -> Field:
        out = self.upload(np.zeros((*self.nodes, 3)))
        force.add_gradient(self, self.upload(z), out)
        return self.download(out)

    def blocks(self, force: Force) -> Field:
        """Shape (nu, nv, 3, 3)."""
        out = self.upload(np.zeros((*self.nodes, 6)))
        force.add_node_blocks(self, out)
        s = self.download(out)
        return s[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(*self.nodes, 3, 3)


def gravity(body: SheetArrays) -> Force:
    return Gravity(body, (0.3, -0.4, -9.81))


def drag(body: SheetArrays) -> Force:
    return Drag(body, 3.0)


def blown(body: SheetArrays, air: Wind, coefficient: float) -> WindLoad:
    return WindLoad(body, air, coefficient, "surface", body.areas[..., None])


def steady_wind(body: SheetArrays) -> Force:
    return blown(body, Wind((6.0, 1.0, -2.0)), 1.7)


def gusting_wind(body: SheetArrays) -> Force:
    return blown(body, Wind((6.0, 1.0, -2.0), gust=0.4, gust_length=0.7), 1.7)


def blown_by_a_function(body: SheetArrays) -> Force:
    return blown(body, Wind(lambda t: (5.0 * t, 1.0, np.sin(t))), 1.7)


def springs(body: SheetArrays) -> Force:
    path = Track.line((0, 0, 0), (1, 2, 3), 0.0, 1.0)
    specs = [
        Spring("corner:0,0", 40.0),
        Spring("edge:u,0", 25.0, point=(0.1, 0.2, 0.3), track=path),
        Spring([[1, 1], [0, 1]], 10.0, point=(1.0, 0.0, 0.0)),
    ]
    return Springs(body, specs, body.rest)


TERMS = [gravity, drag, steady_wind, gusting_wind, blown_by_a_function, springs]
Term = Callable[[SheetArrays], Force]


def iterate(body: SheetArrays, force: Force) -> Field:
    """Prepare and linearise at a random iterate, and return it."""
    random = np.random.default_rng(11)
    z = body.start + random.normal(0, 0.01, (*body.nodes, 3))
    body.w.assign(body.layout.pack(body.start + random.normal(0, 0.01, (*body.nodes, 3))))
    force.prepare(0.7, 0.015, TAU)
    force.begin(body)
    force.linearise(body, body.upload(z))
    return z


@pytest.mark.parametrize("nodes", [(2, 2), (3, 5), (7, 11)], ids=str)
@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.__name__)
def test_gradient_and_blocks_are_derivatives(term: Term, nodes: tuple[int, int]) -> None:
    body = SheetArrays(nodes)
    force = term(body)
    z = iterate(body, force)
    gradient, blocks = body.gradient(force, z), body.blocks(force)
    assert np.abs(gradient).max() > 0
    step = 1e-4  # potentials are quadratic: central differences are exact, so a large step keeps digits
    for c in range(3):
        shift = step * np.eye(3)[c]
        slope = (body.energies(force, z + shift) - body.energies(force, z - shift)) / (2 * step)
        assert np.abs(slope - gradient[..., c]).max() < 1e-6 * np.abs(gradient).max()
        change = (body.gradient(force, z + shift) - body.gradient(force, z - shift)) / (2 * step)
        assert np.abs(change - blocks[..., c]).max() < 1e-6 * max(np.abs(blocks).max(), 1.0)
    assert np.linalg.eigvalsh(blocks).min() > -1e-12 * np.abs(blocks).max() - 1e-300


@pytest.mark.parametrize("real", REALS, ids=["float64", "float32"])
@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.__name__)
def test_lane_widths_agree_to_the_bit_and_precisions_to_round_off(term: Term, real: Any) -> None:
    results = []
    for precision, width in ((wp.float64, 1), (real, 1), (real, 16 if real is wp.float32 else 8)):
        body = SheetArrays((5, 19), precision, width)
        force = term(body)
        z = iterate(body, force)
        results.append((body.gradient(force, z), body.blocks(force), body.energies(force, z).sum()))
    exact, narrow, wide = results
    np.testing.assert_array_equal(narrow[0], wide[0])
    np.testing.assert_array_equal(narrow[1], wide[1])
    assert narrow[2] == pytest.approx(wide[2], rel=1e-12)
    for k in range(3):
        assert np.abs(narrow[k] - exact[k]).max() <= 2e-5 * np.abs(exact[k]).max()


def test_gravity_pulls_with_the_weight_and_follows_a_change() -> None:
    body = SheetArrays((7, 11))
    force = Gravity(body)
    weight = AREAL_DENSITY * 0.6 * 1.0 * 9.81
    np.testing.assert_allclose(-body.gradient(force, body.start).sum((0, 1)), [0, 0, -weight], atol=1e-12)
    higher = body.start + np.array([0.2, 0.1, 0.5])
    rise = force.stored_energy(body, body.upload(higher)) - force.stored_energy(body, body.x)
    assert rise == pytest.approx(0.5 * weight, rel=1e-12)
    assert body.energies(force, higher).sum() == pytest.approx(0.5 * weight, rel=1e-12)
    force.acceleration = (1.62, 0.0, 0.0)
    force.prepare(0.0, TAU, TAU)
    np.testing.assert_allclose(-body.gradient(force, body.start).sum((0, 1)), [AREAL_DENSITY * 0.6 * 1.62, 0, 0])


@pytest.mark.parametrize("real", REALS, ids=["float64", "float32"])
@pytest.mark.parametrize("nodes", [(2, 2), (3, 5), (17, 33)], ids=str)
def test_flat_plate_in_the_wind(nodes: tuple[int, int], real: Any) -> None:
    body = SheetArrays(nodes, real, wavy=False)
    area = 0.01 * (nodes[0] - 1) * (nodes[1] - 1)
    for velocity, expected in (((0, 0, 6.0), (0, 0, 6.0)), ((5.0, 3.0, 0), (0, 0, 0)), ((4.0, 0, -3.0), (0, 0, -3.0))):
        force = blown(body, Wind(velocity), 1.3)
        force.prepare(0.0, TAU, TAU)
        force.linearise(body, body.x)
        total = -body.gradient(force, body.start).sum((0, 1))
        np.testing.assert_allclose(total, 1.3 * area * np.array(expected), rtol=1e-5, atol=1e-5 * area)


@pytest.mark.parametrize("width", [1, 8])
@pytest.mark.parametrize("gust", [0.0, 0.3])
@pytest.mark.parametrize("kind", ["tube", "tube along u"])
def test_normals_of_a_tube_point_outwards_at_its_seam_too(kind: str, gust: float, width: int) -> None:
    shape = CLOSED[kind]((9, 11))
    body = SheetArrays((9, 11), lane_width=width, periodic=shape.periodic)
    body.x.assign(body.layout.pack(shape.positions))
    force = blown(body, Wind((6.0, 1.0, -2.0), gust=gust), 1.3)
    force.prepare(0.0, TAU, TAU)
    force.linearise(body, body.x)
    outwards = shape.positions * [1.0, 1.0, 0.0] / 0.3
    normals = outwards if kind == "tube" else -outwards
    np.testing.assert_allclose(body.download(force.facing)[..., :3], normals, atol=1e-12)


def newton_step(body: SheetArrays, forces: list[Force], velocity: Field, time: float) -> tuple[Field, Field]:
    """One backward Euler step of nodes that only loads act on: positions and velocities at its end."""
    x = body.download(body.x)
    body.w.assign(body.x)
    y = x + TAU * velocity
    gradient = body.masses[..., None] * (x - y) / TAU**2
    blocks = (body.masses / TAU**2)[..., None, None] * np.eye(3)
    for force in forces:
        force.prepare(time, TAU, TAU)
        force.linearise(body, body.x)
        gradient = gradient + body.gradient(force, x)
        blocks = blocks + body.blocks(force)
    z = x - np.linalg.solve(blocks, gradient[..., None])[..., 0]
    body.x.assign(body.layout.pack(z))
    return z, (z - x) / TAU


def test_terminal_velocity_of_a_falling_sheet() -> None:
    body = SheetArrays((3, 5), wavy=False)
    forces: list[Force] = [Gravity(body), blown(body, Wind((0.0, 0.0, 1.0)), 1.3)]
    velocity = np.zeros((3, 5, 3))
    for k in range(400):
        _, velocity = newton_step(body, forces, velocity, (k + 1) * TAU)
    terminal = 1.0 - AREAL_DENSITY * 9.81 / 1.3
    np.testing.assert_allclose(velocity, np.broadcast_to([0, 0, terminal], (3, 5, 3)), rtol=1e-9, atol=1e-12)


def test_drag_slows_down_by_its_rate() -> None:
    body = SheetArrays((3, 5))
    velocity = np.broadcast_to([1.0, -2.0, 3.0], (3, 5, 3))
    for k in range(10):
        _, velocity = newton_step(body, [Drag(body, 3.0)], velocity, (k + 1) * TAU)
    np.testing.assert_allclose(velocity[0, 0], np.array([1.0, -2.0, 3.0]) / (1 + 3.0 * TAU) ** 10, rtol=1e-10)


def test_springs_pull_to_their_moving_points() -> None:
    body = SheetArrays((3, 5))
    turn = Track([0.0, 1.0], np.array([[0, 0, 0], [0, 0, 2.0]]), np.sqrt([[0, 0, 0, 1.0], [0, 0, 0.5, 0.5]]))
    force = Springs(body, [Spring("all", 30.0, track=turn), Spring("corner:0,0", 70.0, point=(1, 1, 1))], body.rest)
    force.prepare(1.0, TAU, TAU)
    points = np.stack([-body.rest[..., 1], body.rest[..., 0], body.rest[..., 2] + 2.0], axis=-1)
    pull = 30.0 * (points - body.start)
    pull[0, 0] += 70.0 * (1.0 - body.start[0, 0])
    np.testing.assert_allclose(-body.gradient(force, body.start), pull, rtol=1e-12, atol=1e-12)
    rise = force.stored_energy(body, body.upload(body.rest)) - force.stored_energy(body, body.x)
    assert rise == pytest.approx(body.energies(force, body.rest).sum(), rel=1e-12)


def test_gusts_blow_as_described_however_long_the_run() -> None:
    wind = Wind((6.0, 0.0, 1.0), gust=0.3, gust_length=0.9, seed=4)
    for real, tolerance in ((wp.float64, 1e-9), (wp.float32, 3e-5)):
        body = SheetArrays((4, 9), real)
        force = blown(body, wind, 1.0)
        for time in (0.0, 0.3, 3600.0):
            force.prepare(time, TAU, TAU)
            force.linearise(body, body.x)
            stream = body.download(force.facing)[..., 3:]
            assert np.abs(stream - wind.stream(body.start, time)).max() < tolerance


def test_terms_replay_in_a_graph_with_the_numbers_of_each_step() -> None:
    body = SheetArrays((4, 9))
    terms = [term(body) for term in TERMS]
    gradient, position = body.upload(np.zeros((4, 9, 3))), body.upload(body.start + 0.01)

    def evaluate() -> None:
        gradient.zero_()
        for force in terms:
            force.begin(body)
            force.linearise(body, position)
            force.add_gradient(body, position, gradient)

    evaluate()
    with wp.ScopedCapture(device="cpu") as capture:
        evaluate()
    for time in (0.2, 0.9):
        for force in terms:
            force.prepare(time, TAU, TAU)
        wp.capture_launch(capture.graph)
        replayed = body.download(gradient)
        evaluate()
        np.testing.assert_array_equal(replayed, body.download(gradient))


def test_only_what_a_scene_requires_is_kept() -> None:
    body = SheetArrays((4, 9), wp.float32, 16)
    one_array = 4 * body.layout.rows * body.layout.columns
    steady, gusting = steady_wind(body), gusting_wind(body)
    assert gusting.bytes() - steady.bytes() == 4 * 12 * 7
    assert 7 * one_array < steady.bytes() < 7.7 * one_array
    assert gravity(body).bytes() == 12
    assert not any("gusts" in kernel for kernel in steady.kernels)
    for force in (steady, gusting, gravity(body), drag(body), springs(body)):
        assert force.kernels
        assert not force.elastic
