"""Bodies against themselves and each other: the acceptance scenes of design 5.3, crossings counted in every frame."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import warpdeform as wd
from warpdeform.crossings import crossing_pairs
from warpdeform.simplices import Simplices
from warpdeform.study.accordion import accordion

Array = NDArray[np.float64]

CLOTH = wd.Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-4)
RUBBER = wd.Material(density=1000.0, youngs_modulus=2e5, poisson_ratio=0.4, damping=1.0)
ROPE = wd.Material(density=1200.0, youngs_modulus=1e7, poisson_ratio=0.4, damping=1.0)
ROD = wd.Section.circular(0.003)


class Watched:
    """A simulation whose crossings are counted after every frame.

    Attributes:
        crossings: The most in any frame.
    """

    def __init__(self, simulation: wd.Simulation) -> None:
        self.simulation = simulation
        self.simplices = Simplices.joined([Simplices.of_grid(h.model.grid) for h in simulation.bodies])
        self.crossings = 0

    def points(self) -> Array:
        return np.concatenate([h.positions().reshape(-1, 3).astype(np.float64) for h in self.simulation.bodies])

    def run(self, frames: int) -> "Watched":
        for _ in range(frames):
            self.simulation.advance_frame()
            self.crossings = max(self.crossings, len(crossing_pairs(self.points(), self.simplices)))
        return self

    def say(self, name: str, *more: str) -> None:
        """Print what docs/contact.md tells, and hold the counter to nothing."""
        record = self.simulation.record()
        found = record.contact
        assert found is not None
        near = "nothing near" if found.smallest_distance is None else f"nearest {1e3 * found.smallest_distance:.3f} mm"
        print(
            f"\n{name}: {record.nodes} nodes, {record.frames - 1} frames, crossings {self.crossings}, {near}, "
            f"pairs {found.pairs}, guard {100 * found.guard_active:.2f} % (worst {100 * found.guard_active_most:.1f}), "
            f"stretch {record.max_stretch:.3f}, {1e3 * record.wall_s / record.steps:.1f} ms a step",
            *more,
            sep=", ",
        )
        assert self.crossings == 0
        assert found.lost == 0


def settings(**words: Any) -> wd.Settings:
    return wd.Settings(device="cpu", **{"substeps": 2} | words)


@pytest.mark.parametrize(("nodes", "frames"), [(17, 40), pytest.param(65, 90, marks=pytest.mark.slow)])
def test_cloth_on_jelly(nodes: int, frames: int) -> None:
    """A cloth falls over a block of rubber, which falls on the ground, and comes to lie on its top."""
    side = 5 if nodes < 30 else 9
    jelly = wd.Body("jelly", wd.block((side,) * 3, (0.2,) * 3), RUBBER, position=(-0.1, -0.1, 0.02))
    cloth = wd.Body("cloth", wd.sheet((nodes, nodes), (0.5, 0.5)), CLOTH, position=(-0.25, -0.25, 0.24))
    simulation = wd.Simulation(
        [jelly, cloth],
        obstacles=[wd.Obstacle("plane", friction=0.5)],
        contacts=[wd.Contact(("jelly", "cloth"), friction=0.3), wd.Contact(("cloth", "cloth"), friction=0.3)],
        settings=settings(),
    )
    watched = Watched(simulation).run(frames)
    top = simulation["cloth"].positions()[nodes // 2, nodes // 2, 2] - simulation["jelly"].positions()[..., 2].max()
    watched.say("cloth_on_jelly", f"middle of the cloth {1e3 * top:.2f} mm over the block")
    assert 0.0 < top < 0.006


@pytest.mark.parametrize(("nodes", "frames"), [(17, 24), pytest.param(65, 60, marks=pytest.mark.slow)])
def test_rod_through_cloth(nodes: int, frames: int) -> None:
    """A rod thrown at 5 m/s against a cloth that is held at its corners does not go through."""
    cloth = wd.Body(
        "cloth",
        wd.sheet((nodes, nodes), (0.6, 0.6)),
        CLOTH,
        pins=[wd.Pin(f"corner:{i},{j}") for i in (0, 1) for j in (0, 1)],
    )
    rod = wd.Body(
        "rod", wd.line((41,), 0.4), ROPE, section=ROD, position=(0.1, 0.31, 0.1), rotation=(0.0, 0.1, 0.0, 1.0),
        velocity=(0.0, 0.0, -5.0),
    )  # fmt: skip
    simulation = wd.Simulation(
        [cloth, rod],
        contacts=[wd.Contact(("rod", "cloth"), friction=0.3), wd.Contact(("cloth", "cloth"))],
        settings=settings(),
    )
    watched = Watched(simulation).run(frames)
    above = simulation["rod"].positions()[..., 2].min() - simulation["cloth"].positions()[..., 2].min()
    watched.say("rod_through_cloth", f"rod above the lowest node of the cloth {1e3 * above:.1f} mm")
    assert above > 0.0


def test_momentum_of_a_rod_and_a_cloth_that_meet_in_free_flight() -> None:
    cloth = wd.Body("cloth", wd.sheet((9, 9), (0.3, 0.3)), CLOTH)
    rod = wd.Body(
        "rod",
        wd.line((21,), 0.2),
        replace(ROPE, damping=0.0),
        section=ROD,
        position=(0.06, 0.16, 0.03),
        velocity=(0.3, 0, -5),
    )
    precise = {"gravity": (0.0, 0.0, 0.0), "precision": "float64", "newton_iterations": 0, "cg_tolerance": 1e-9}
    simulation = wd.Simulation(
        [cloth, rod],
        contacts=[wd.Contact(("rod", "cloth")), wd.Contact(("cloth", "cloth"))],
        settings=settings(**precise),
    )

    def momentum() -> Array:
        found = [(h.model.node_mass[..., None] * h.velocities()).reshape(-1, 3).sum(axis=0) for h in simulation.bodies]
        return np.sum(found, axis=0)

    before = momentum()
    watched = Watched(simulation).run(6)
    change = float(np.abs(momentum() - before).max() / np.abs(before).max())
    watched.say("free pair", f"momentum changed by {change:.1e} of it")
    assert np.abs(simulation["cloth"].velocities()).max() > 1.0
    assert change < 1e-5


def trefoil(count: int, size: float) -> Array:
    """An open overhand knot, its ends led out along x, resampled to edges alike, shape (count, 1, 3)."""
    t = np.linspace(-2.6, 2.6, 4001)
    knot = np.stack([t**3 - 3.0 * t, t**4 - 4.0 * t**2, 0.5 * t**5 - 5.0 * t], axis=-1)
    knot *= size / np.ptp(knot[:, 1])
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(knot, axis=0), axis=1))])
    even = np.linspace(0.0, length[-1], count)
    return np.stack([np.interp(even, length, knot[:, k]) for k in range(3)], axis=-1)[:, None]


def fewest_crossings(points: Array, projections: int = 24) -> int:
    """Fewest crossings of a strand with itself in pictures of it from many sides: 3 or more of an overhand knot."""
    rng = np.random.default_rng(0)
    fewest = 1 << 30
    i, j = np.triu_indices(len(points) - 1, 2)
    for _ in range(projections):
        frame, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        p = points @ frame[:, :2]
        a, b, c, d = p[i], p[i + 1], p[j], p[j + 1]
        fewest = min(fewest, int(np.sum((_turn(a, b, c) != _turn(a, b, d)) & (_turn(c, d, a) != _turn(c, d, b)))))
    return fewest


def _turn(a: Array, b: Array, c: Array) -> NDArray[np.bool_]:
    u, v = b - a, c - a
    return u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0]


@pytest.mark.parametrize(("nodes", "seconds"), [(61, 0.8), pytest.param(161, 2.0, marks=pytest.mark.slow)])
def test_knot(nodes: int, seconds: float) -> None:
    """A rope with an overhand knot is pulled tight by its ends: the knot stays."""
    start = trefoil(nodes, 0.3)
    length = float(np.linalg.norm(np.diff(start[:, 0], axis=0), axis=1).sum())
    ends, pull = np.linalg.norm(start[-1] - start[0]), 0.0
    pull = 0.5 * (0.72 * length - ends)
    away = (start[-1, 0] - start[0, 0]) / ends
    pins = [
        wd.Pin(f"end:{end},1", wd.Track.line((0.0, 0.0, 0.0), tuple(sign * pull * away), 0.0, seconds))
        for end, sign in ((0, -1.0), (1, 1.0))
    ]
    rope = wd.Body(
        "rope", wd.line((nodes,), length), ROPE, section=wd.Section.circular(0.002), initial_positions=start, pins=pins,
        self_contact=True,
    )  # fmt: skip
    contacts = [wd.Contact(("rope", "rope"), friction=0.2)]
    simulation = wd.Simulation(
        [rope], contacts=contacts, settings=settings(gravity=(0.0, 0.0, 0.0), substeps=4, newton_iterations=3)
    )
    watched = Watched(simulation)
    fewest = fewest_crossings(start[:, 0])
    for _ in range(round(60 * seconds) + 6):
        watched.run(1)
        fewest = min(fewest, fewest_crossings(simulation["rope"].positions()[:, 0]))
    watched.say("knot", f"fewest crossings in any picture {fewest}")
    assert fewest >= 3


@pytest.mark.parametrize(("nodes", "layers"), [(33, 4), pytest.param(257, 16, marks=pytest.mark.slow)])
def test_accordion(nodes: int, layers: int) -> None:
    """A sheet folded up in layers falls together and lies on the ground, every layer on the one below."""
    simulation = accordion(nodes, layers, device="cpu")
    watched = Watched(simulation).run(24)
    found = simulation.record().contact
    assert found is not None
    height = float(simulation["sheet"].positions()[..., 2].max())
    watched.say("accordion", f"{layers} layers {1e3 * height:.1f} mm high")
    assert found.pairs > nodes * nodes // 2


def top_of_the_heap(nodes: int, substeps: int, newton: int = 1) -> tuple[float, Watched]:
    """A sheet of 1 m dropped on its edge at 2 m/s with a gap of 0.3 spacings: its highest node after 0.75 s [m]."""
    shape = wd.sheet((nodes, nodes), (1.0, 1.0))
    tilt = np.radians(86.0)
    turn = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    upright = shape.positions @ turn.T + [-0.5, 0.0, 0.02]
    sheet = wd.Body("sheet", shape, CLOTH, initial_positions=upright, velocity=(0.0, 0.0, -2.0))
    simulation = wd.Simulation(
        [sheet],
        obstacles=[wd.Obstacle("plane", friction=0.4, gap=0.005)],
        contacts=[wd.Contact(("sheet", "sheet"), gap=0.3 / (nodes - 1), friction=0.2)],
        settings=settings(substeps=substeps, newton_iterations=newton),
    )
    watched = Watched(simulation).run(45)
    return float(simulation["sheet"].positions()[..., 2].max()), watched


@pytest.mark.slow
@pytest.mark.parametrize("nodes", [33, 65])
def test_drag_against_a_quarter_of_the_step(nodes: int) -> None:
    tops = {}
    for substeps, newton in ((2, 1), (2, 2), (8, 1)):
        tops[substeps, newton], watched = top_of_the_heap(nodes, substeps, newton)
        top = tops[substeps, newton]
        watched.say(f"crumple, dt 1/{60 * substeps}, Newton {newton}", f"top of the heap {top:.3f} m")
