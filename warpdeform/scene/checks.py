"""What must be true of the packaged scenes, as the tests see them after the last frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpdeform.crossings import crossing_pairs
from warpdeform.scene.measure import (
    asymmetry,
    capsule_gaps,
    depth,
    folds,
    load_on_sphere,
    relative_volumes,
    samples,
)
from warpdeform.selectors import select_nodes
from warpdeform.simplices import Simplices

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation

Array = NDArray[np.float64]


DENT = 0.0214
"""Depth of the dent of `ball_on_solid` where the cells are a quarter as large [m]; tests/physics/test_dent.py."""


@dataclass(frozen=True)
class Claim:
    """Something that must be true of a run.

    Attributes:
        text: What, as a sentence.
        value: What was measured.
        low: The smallest value allowed.
        high: The largest value allowed.
    """

    text: str
    value: float
    low: float = -np.inf
    high: float = np.inf

    @property
    def holds(self) -> bool:
        """Whether it is true; never of a value that is not a number."""
        return bool(self.low <= self.value <= self.high)

    def __str__(self) -> str:
        return f"{self.text}: {self.value:.4g}, allowed {self.low:.4g} to {self.high:.4g}"


@dataclass
class History:
    """The frames of a run; `observe` is called at each of them.

    Attributes:
        times: Time of each frame [s].
        positions: Node positions at each frame [m], by body, each of shape (*nodes, 3).
        energies: Kinetic, elastic, gravitational and field energy together [J].
        work: Work of pins, wind, drag and friction since the start [J].
    """

    times: list[float] = field(default_factory=list)
    positions: dict[str, list[Array]] = field(default_factory=dict)
    energies: list[float] = field(default_factory=list)
    work: list[float] = field(default_factory=list)

    def observe(self, simulation: Simulation) -> None:
        """Keep the present frame."""
        self.times.append(simulation.time)
        for body in simulation.bodies:
            self.positions.setdefault(body.name, []).append(np.asarray(body.positions(), dtype=np.float64))
        energy = simulation.record().energy
        self.energies.append(energy.kinetic + energy.elastic + energy.gravity + energy.field)
        self.work.append(energy.work_in)

    def after(self, time: float) -> int:
        """The first frame at or after `time` [s]."""
        return int(np.searchsorted(self.times, time - 1e-9))


Check = Callable[["Simulation", History], list[Claim]]


def _pins_still(history: History, simulation: Simulation) -> Claim:
    """Nodes that are held without a path stay where they are, to the last bit."""
    moved = 0.0
    for handle in simulation.bodies:
        frames = np.array(history.positions[handle.name])
        for pin in handle.body.pins:
            if pin.track is None:
                nodes = select_nodes(pin.nodes, handle.nodes, handle.body.kind)
                held = frames[:, *nodes.T]
                moved = max(moved, float(np.abs(held - held[0]).max()))
    return Claim("pinned nodes move [m]", moved, 0.0, 0.0)


def _stretch(simulation: Simulation, high: float) -> Claim:
    return Claim("longest edge over its rest length", simulation.record().max_stretch, 1.0 - 1e-6, high)


def _nothing_inside(history: History, simulation: Simulation, name: str, deepest: float, every: int = 1) -> Claim:
    """Nodes, edges and cells stay outside all obstacles, at the last frame and every so many before it."""
    worst, grid = 0.0, simulation[name].model.grid
    for time, positions in list(zip(history.times, history.positions[name], strict=True))[::-every]:
        points = samples(grid.closed(positions))
        worst = max([worst, *(depth(obstacle, points, time) for obstacle in simulation.obstacles)])
    return Claim(f"depth of {name} inside an obstacle [m]", worst, 0.0, deepest)


def _nothing_crosses(history: History, simulation: Simulation) -> Claim:
    """No edge goes through a triangle, of its own body or another, in any frame."""
    simplices = Simplices.joined([Simplices.of_grid(handle.model.grid) for handle in simulation.bodies])
    frames = zip(*(history.positions[handle.name] for handle in simulation.bodies), strict=True)
    points = (np.concatenate([x.reshape(-1, 3) for x in frame]) for frame in frames)
    return Claim("edges through triangles", max(len(crossing_pairs(x, simplices)) for x in points), 0, 0)


def hanging(simulation: Simulation, history: History) -> list[Claim]:
    """Two corners hold; the sheet swings through below them, symmetric, and no energy comes out of nowhere.

    Symmetry is asked for until the sheet hangs: then folds form on its way up, and rounding decides which way.
    """
    frames = history.positions["sheet"]
    down = history.after(0.4)
    energies = np.array(history.energies)
    return [
        _pins_still(history, simulation),
        _stretch(simulation, 1.3),
        Claim("energy gained since the start [J]", float((energies - energies[0]).max()), -np.inf, 0.01),
        Claim("energy lost [J]", float(energies[0] - energies[-1]), 0.0, 0.2),
        Claim("asymmetry on the way down [m]", max(asymmetry(f, 0, 0) for f in frames[: down + 1]), 0.0, 0.01),
        Claim("lowest node at the lowest point, below the corners [m]", _fallen(frames), 0.9, 1.2),
    ]


def flag(simulation: Simulation, history: History) -> list[Claim]:
    """The pole's edge holds; the rest streams with the wind, and waves."""
    frames = np.array(history.positions["flag"])[history.after(1.5) :]
    outer = frames[:, -1].mean(axis=1)
    length = 1.5
    return [
        _pins_still(history, simulation),
        _stretch(simulation, 1.25),
        _nothing_crosses(history, simulation),
        Claim("mean distance of the outer edge downwind, of the length", float(outer[:, 0].mean()) / length, 0.7, 1.0),
        Claim("swing of the outer edge across the wind (rms) [m]", float(outer[:, 1].std()), 0.02, 0.6),
        Claim("mean sinking of the outer edge [m]", float(1.95 - outer[:, 2].mean()), -0.1, 0.6),
        _nothing_inside(history, simulation, "flag", 1e-3),
    ]


def carpet(simulation: Simulation, history: History) -> list[Claim]:
    """It lies on ball, log and ground, nothing of it inside them, and has come to rest."""
    frames = history.positions["carpet"]
    speed = np.linalg.norm(frames[-1] - frames[-2], axis=-1) / (history.times[-1] - history.times[-2])
    top = 0.6
    return [
        _stretch(simulation, 1.4),
        _nothing_inside(history, simulation, "carpet", 1e-3),
        _nothing_crosses(history, simulation),
        Claim("highest node above the ball's top [m]", float(frames[-1][..., 2].max()) - top, 0.0, 0.02),
        Claim("lowest node above the ground [m]", float(frames[-1][..., 2].min()), 0.0, 0.05),
        Claim("speed at the end (rms) [m/s]", float(np.sqrt(np.mean(speed**2))), 0.0, 0.05),
    ]


def bunny(simulation: Simulation, history: History) -> list[Claim]:
    """The scarf comes to lie on the bunny, then the ball carries it aside; nothing of it goes inside anything."""
    frames = history.positions["scarf"]
    draped = frames[history.after(1.6)]
    return [
        _stretch(simulation, 1.3),
        _nothing_inside(history, simulation, "scarf", 2e-3, every=40),
        Claim("highest node over the bunny's ears before the ball comes [m]", draped[..., 2].max() - 0.81, 0.0, 0.03),
        Claim("way of the scarf's rear with the ball [m]", float((frames[-1] - draped)[60:, :, 1].mean()), 0.05, 1.0),
    ]


def materials(simulation: Simulation, history: History) -> list[Claim]:
    """Rubber and cotton hang limp, paper bends, steel holds out."""
    sags = {name: float(0.4 - frames[-1][-1, :, 2].mean()) / 0.2 for name, frames in history.positions.items()}
    return [
        _pins_still(history, simulation),
        _stretch(simulation, 1.1),
        Claim("tip of the rubber sheet below its clamp, of the length", sags["rubber"], 0.85, 1.1),
        Claim("tip of the cotton sheet below its clamp, of the length", sags["cotton"], 0.85, 1.1),
        Claim("sag of paper over that of cotton", sags["paper"] / sags["cotton"], 0.5, 0.9),
        Claim("sag of steel over that of paper", sags["steel"] / sags["paper"], 0.35, 0.8),
    ]


def lifted_patch(simulation: Simulation, history: History) -> list[Claim]:
    """Both are lifted; the membrane crumples, the plate stays smooth and lifts more of itself."""
    ends = {name: frames[-1] for name, frames in history.positions.items()}
    return [
        _stretch(simulation, 1.15),
        *(Claim(f"height of the {name}'s corner [m]", float(r[0, 0, 2]), 0.25, 0.4) for name, r in ends.items()),
        Claim("folds of the membrane [degrees]", folds(ends["membrane"]), 60.0, 180.0),
        Claim("folds of the plate [degrees]", folds(ends["plate"]), 0.0, 15.0),
        *(_nothing_inside(history, simulation, name, 1e-3) for name in ends),
    ]


def spring_steel(simulation: Simulation, history: History) -> list[Claim]:
    """The cable bends the strip far without stretching it; let go, it rings as a clamped beam does."""
    tip = np.array([frame[-1].mean(axis=0) for frame in history.positions["strip"]])
    times, let_go = np.array(history.times), history.after(1.0)
    height = tip[let_go:, 2] - 0.2
    turns = times[let_go:-1][height[:-1] * height[1:] < 0.0]
    # 1.8751^2 / (2 pi L^2) sqrt(E h^2 / (12 rho)), the clamp in the middle between the two pinned rows.
    frequency = 1.8751**2 / (2.0 * np.pi * 0.295**2) * np.sqrt(2.0e11 * 5e-4**2 / (12.0 * 7850.0))
    return [
        _pins_still(history, simulation),
        _stretch(simulation, 1.001),
        Claim("height to which the cable bends the tip [m]", float(height[0]), 0.15, 0.25),
        Claim("depth that it swings to [m]", float(-height[: let_go // 4].min()), 0.15, 0.25),
        Claim("its frequency over that of a beam", 0.5 / float(np.diff(turns).mean()) / frequency, 0.9, 1.1),
    ]


def coiled_cord(simulation: Simulation, history: History) -> list[Claim]:
    """It bounces about where a close-coiled spring hangs under its own weight, as slowly, and loses its swing."""
    bottom = np.array([frame[-1, 0, 2] for frame in history.positions["cord"]])
    # k = G d^4 / (64 n R^3); a spring of mass m sags by m g / 2k and oscillates with sqrt(k/m) / 4.
    stiffness = 4e7 / 2.9 * 0.003**4 / (64.0 * 15.0 * 0.015**3)
    mass = float(simulation["cord"].model.node_mass.sum())
    sag, period = mass * 9.81 / (2.0 * stiffness), 4.0 * np.sqrt(mass / stiffness)
    last = bottom[history.after(3.0 - 2.0 * period) :]
    return [
        _pins_still(history, simulation),
        _stretch(simulation, 1.01),
        Claim("mean sag of its end over that of a spring", float(bottom[0] - last.mean()) / sag, 0.9, 1.1),
        Claim("its period over that of a spring", _period(bottom, simulation.settings.fps) / period, 0.85, 1.1),
        Claim("its last swing over its first", float(np.ptp(last) / np.ptp(bottom)), 0.3, 0.9),
    ]


def _period(height: Array, fps: float) -> float:
    """Mean time between the turns through the mean, twice [s]."""
    above = height > height.mean()
    turns = np.flatnonzero(above[1:] != above[:-1])
    return 2.0 * float(np.diff(turns).mean()) / fps


def shrink_wrap(simulation: Simulation, history: History) -> list[Claim]:
    """The shell comes to rest on the jack: it lies on all six tips, hangs between them, and nothing is inside."""
    frames, arms = history.positions["shell"], simulation.obstacles
    gaps = [capsule_gaps(arms, frames[k].reshape(-1, 3), history.times[k]) for k in (0, -1)]
    tips = 0.34 * np.concatenate([np.eye(3), -np.eye(3)])
    nearest = [np.linalg.norm(frames[-1] - tip, axis=-1).min() for tip in tips]
    speed = np.linalg.norm(frames[-1] - frames[-2], axis=-1) / (history.times[-1] - history.times[-2])
    return [
        _stretch(simulation, 2.6),
        _nothing_inside(history, simulation, "shell", 1e-4, every=6),
        Claim("mean gap between shell and jack at the start [m]", float(gaps[0].mean()), 0.15, 0.25),
        Claim("mean gap between shell and jack at the end [m]", float(gaps[1].mean()), 0.0, 0.02),
        Claim("widest gap at the end [m]", float(gaps[1].max()), 0.04, 0.08),
        Claim("tip of an arm from the nearest node [m]", float(max(nearest)), 0.0, 0.025),
        Claim("speed at the end (largest) [m/s]", float(speed.max()), 0.0, 0.01),
    ]


def crumple(simulation: Simulation, history: History) -> list[Claim]:
    """The sheet falls on its edge, folds up and comes to lie, through nothing of itself."""
    frames = history.positions["sheet"]
    return [
        _stretch(simulation, 1.3),
        _nothing_crosses(history, simulation),
        Claim("lowest node ever above the ground [m]", min(float(f[..., 2].min()) for f in frames), 0.0, 0.05),
        Claim("highest node at the end [m]", float(frames[-1][..., 2].max()), 0.03, 0.35),
        Claim("energy gained in any frame [J]", float(np.diff(history.energies).max()), -np.inf, 0.02),
    ]


def twist(simulation: Simulation, history: History) -> list[Claim]:
    """The ends turn where they are led, and the strip between them becomes a rope, through nothing of itself."""
    last, handle = history.positions["strip"][-1], simulation.bodies[0]
    middle = last[len(last) // 2]
    wide = float(np.linalg.norm(middle - middle.mean(axis=0), axis=1).max())
    return [
        _stretch(simulation, 2.2),
        _nothing_crosses(history, simulation),
        Claim("distance of the ends from their path [m]", handle.model.pin_lag(handle.state.x)[0], 0.0, 1e-3),
        Claim("radius of the rope at its middle [m]", wide, 0.0, 0.04),
    ]


def layers(simulation: Simulation, history: History) -> list[Claim]:
    """Ten cloths come to lie on the log and on each other, in their order."""
    tops = [history.positions[f"layer{k}"][-1][..., 2] for k in range(10)]
    heights = np.array([top[len(top) // 2, top.shape[1] // 2] for top in tops])
    return [
        _stretch(simulation, 1.3),
        _nothing_crosses(history, simulation),
        Claim("least distance of one layer above the last on the log [m]", float(np.diff(heights).min()), 5e-4, 4e-3),
        Claim("lowest layer above the log [m]", float(heights[0]) - 0.4, 0.0, 5e-3),
    ]


def curtain(simulation: Simulation, history: History) -> list[Claim]:
    """The leading ring takes the others along; all stay on the rod and in their order, the curtain with them."""
    rings = np.array(history.positions["rings"])
    places = rings[..., 0].mean(axis=1)
    middle, top = rings[..., 1:].mean(axis=1), rings[..., 2].max(axis=1)
    return [
        _stretch(simulation, 1.1),
        _nothing_inside(history, simulation, "curtain", 1e-3, every=6),
        Claim("leading ring at the end [m]", float(places[-1, -1]), 0.38, 0.44),
        Claim("least distance of a ring from the next [m]", float(np.diff(places[1:], axis=1).min()), 1e-3, 0.2),
        Claim("most rings pushed together at the end", float((np.diff(places[-1]) < 0.02).sum() + 1), 3, 9),
        Claim("middle of a ring below the rod's [m]", float(1.5 - middle[1:, :, 1].min()), 0.0, 0.02),
        Claim("lowest top of a ring over the middle of the rod [m]", float(top[1:].min() - 1.5), 0.01, 0.02),
    ]


def grass(simulation: Simulation, history: History) -> list[Claim]:
    """The blades bow with the wind without stretching or lying down; a gust bows neighbours alike, not all blades."""
    blades = np.array(history.positions["blades"][history.after(2.0) :])  # frames, nodes, blades, 3
    lean = (blades[:, -1] - blades[:, 0]) @ np.array([6.0, 1.0, 0.0]) / np.hypot(6.0, 1.0)
    gust = lean - lean.mean(axis=1, keepdims=True)
    rows = gust.reshape(len(gust), 40, 25)
    alike = float((rows[:, 1:] * rows[:, :-1]).mean() / (rows**2).mean())
    return [
        _pins_still(history, simulation),
        _stretch(simulation, 1.005),
        Claim("mean lean of the tips with the wind [m]", float(lean.mean()), 0.15, 0.25),
        Claim("lowest tip above the ground [m]", float(blades[:, -1, :, 2].min()), 0.05, 0.4),
        Claim("how differently tips lean (root mean square) [m]", float(gust.std()), 0.01, 0.05),
        Claim("correlation of neighbours, one mesh of 5 cm apart", alike, 0.7, 1.0),
    ]


def jelly_cube(simulation: Simulation, history: History) -> list[Claim]:
    """No cell turns over and nothing is in the table; it wobbles, and comes to rest as low as its weight makes it."""
    frames, rest = history.positions["jelly"], simulation["jelly"].body.shape.positions
    energies = np.array(history.energies)
    height = np.array([frame[..., 2].mean() for frame in frames])
    swing = height[history.after(0.8) : history.after(1.3)]
    # A column sinks by rho g H^2 / 2E.
    size = float(np.ptp(rest[..., 2]))
    column = 1050.0 * 9.81 * size**2 / (2.0 * 3e4)
    standing = np.array(frames[history.after(1.5) :])[..., 2]
    sunk = size - float((standing[..., -1] - standing[..., 0]).mean())
    speed = np.linalg.norm(frames[-1] - frames[-2], axis=-1) / (history.times[-1] - history.times[-2])
    return [
        Claim("smallest volume of a cell over that at rest", _least_volume(frames, rest), 0.3, 1.0),
        Claim("lowest node above the table [m]", min(float(frame[..., 2].min()) for frame in frames), 1e-5, 0.002),
        Claim("energy gained since the start, of that", float(energies.max() / energies[0]) - 1.0, 0.0, 0.01),
        Claim("squeezed on landing, mean height over half its side", float(height.min()) / (0.5 * size), 0.5, 0.9),
        Claim("swing of its mean height once it stands [m]", float(np.ptp(swing)), 0.02, 0.1),
        # Friction holds its foot as it came down, which makes it lean a little.
        Claim("sunk under its weight over a column's", sunk / column, 0.6, 1.4),
        Claim("speed at the end (rms) [m/s]", float(np.sqrt(np.mean(speed**2))), 0.0, 0.25),
    ]


def ball_on_solid(simulation: Simulation, history: History) -> list[Claim]:
    """The ball rests on the block, which bears its weight, is dented as one of finer cells is, and keeps its volume."""
    frames, handle = history.positions["block"], simulation["block"]
    ball, end = simulation.obstacles[0], frames[-1]
    middle = handle.nodes[0] // 2
    dents = [float(frames[0][middle, middle, -1, 2] - frame[middle, middle, -1, 2]) for frame in frames]
    masses = np.asarray(handle.model.node_mass).reshape(-1)
    load = load_on_sphere(ball, end.reshape(-1, 3), masses, history.times[-1], simulation.gravity)
    weight = 7.26 * 9.81
    return [
        _pins_still(history, simulation),
        Claim("what the block bears over the weight of the ball", float(load[2]) / weight, 0.95, 1.05),
        Claim("depth of the dent over that of a run refined twice", dents[-1] / DENT, 0.95, 1.05),
        Claim("way of the dent's bottom in the last tenth of a second [m]", abs(dents[-1] - dents[-7]), 0.0, 1e-5),
        Claim("depth of the top inside the ball [m]", depth(ball, samples(end[:, :, -1]), simulation.time), 0.0, 2e-3),
        Claim("smallest volume of a cell over that at rest", _least_volume(frames, frames[0]), 0.3, 1.0),
        Claim("its volume at the end over that at rest", float(relative_volumes(end, frames[0]).mean()), 0.97, 1.0),
    ]


def balloon(simulation: Simulation, history: History) -> list[Claim]:
    """In flight it is as large as a thin shell under its pressure and as round as a ball; it bounces, ever less."""
    frames, body = history.positions["balloon"], simulation["balloon"].body
    centre = np.array([frame.mean(axis=(0, 1)) for frame in frames])
    rest = float(np.linalg.norm(body.shape.positions[0, 0]))
    flight = range(history.after(0.3), history.after(0.5))
    radii = np.array([np.linalg.norm(frames[k] - centre[k], axis=-1) for k in flight])
    # N = E h (s^2 - 1) / (2 (1 - nu)) and p R s^2 / 2 = N s over the lengths of the rest shape.
    resultant = 1.2e5 * 8e-4 / (1.0 - 0.45)
    half = 0.5 * body.pressure * rest / resultant
    stretch = half + np.sqrt(half**2 + 1.0)
    size = np.array([np.ptp(frame[..., 2]) / np.ptp(frame[..., 0]) for frame in frames])
    rising = (centre[1:-1, 2] > centre[:-2, 2]) & (centre[1:-1, 2] >= centre[2:, 2])
    tops = centre[1:-1, 2][rising] - stretch * rest
    string = history.positions["string"]
    apart = max(float(np.linalg.norm(a - b[0, 0], axis=-1).min()) for a, b in zip(frames, string, strict=True))
    return [
        _nothing_inside(history, simulation, "balloon", 0.0, every=4),
        Claim("radius in flight over a thin shell's", float(radii.mean()) / (stretch * rest), 0.99, 1.01),
        Claim(
            "spread of that radius, of the one it is cut to", float(np.ptp(radii, axis=(1, 2)).max()) / rest, 0.0, 0.04
        ),
        Claim("height over width, flattened on the ground", float(size.min()), 0.5, 0.8),
        Claim("bounces", float(len(tops)), 3.0, 4.0),
        Claim("height of a bounce over that before, highest", float((tops[1:] / tops[:-1]).max()), 0.5, 1.0),
        Claim("way downwind [m]", float(centre[-1, 0] - centre[0, 0]), 0.8, 2.5),
        Claim("string from the balloon [m]", apart, 0.0, 1e-5),
    ]


def _least_volume(frames: list[Array], rest: Array) -> float:
    return min(float(relative_volumes(frame, rest).min()) for frame in frames)


def _fallen(frames: list[Array]) -> float:
    """How far below its start the lowest node of all frames is [m]."""
    return float(frames[0][..., 2].min() - min(frame[..., 2].min() for frame in frames))


CHECKS: dict[str, Check] = {
    check.__name__: check
    for check in (
        hanging,
        flag,
        carpet,
        bunny,
        materials,
        lifted_patch,
        spring_steel,
        coiled_cord,
        shrink_wrap,
        grass,
        jelly_cube,
        ball_on_solid,
        balloon,
        crumple,
        twist,
        layers,
        curtain,
    )
}
"""The check of each packaged scene, by the scene's name."""
