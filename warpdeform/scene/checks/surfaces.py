"""Scenes of surfaces: cloth, carpets, paper, steel, shells."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpdeform.scene.checks.claims import Array, Claim, History, nothing_crosses, nothing_inside, pins_still, stretch
from warpdeform.scene.measure import asymmetry, capsule_gaps, folds

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation


def hanging(simulation: Simulation, history: History) -> list[Claim]:
    """Two corners hold; the sheet swings through below them, symmetric, and no energy comes out of nowhere.

    Symmetry is asked for until the sheet hangs: then folds form on its way up, and rounding decides which way.
    """
    frames = history.positions["sheet"]
    down = history.after(0.4)
    energies = np.array(history.energies)
    return [
        pins_still(history, simulation),
        stretch(simulation, 1.3),
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
        pins_still(history, simulation),
        stretch(simulation, 1.25),
        nothing_crosses(history, simulation),
        Claim("mean distance of the outer edge downwind, of the length", float(outer[:, 0].mean()) / length, 0.7, 1.0),
        Claim("swing of the outer edge across the wind (rms) [m]", float(outer[:, 1].std()), 0.02, 0.6),
        Claim("mean sinking of the outer edge [m]", float(1.95 - outer[:, 2].mean()), -0.1, 0.6),
        nothing_inside(history, simulation, "flag", 1e-3),
    ]


def carpet(simulation: Simulation, history: History) -> list[Claim]:
    """It lies on ball, log and ground, nothing of it inside them, and has come to rest."""
    frames = history.positions["carpet"]
    speed = np.linalg.norm(frames[-1] - frames[-2], axis=-1) / (history.times[-1] - history.times[-2])
    top = 0.6
    return [
        stretch(simulation, 1.4),
        nothing_inside(history, simulation, "carpet", 1e-3),
        nothing_crosses(history, simulation),
        Claim("highest node above the ball's top [m]", float(frames[-1][..., 2].max()) - top, 0.0, 0.02),
        Claim("lowest node above the ground [m]", float(frames[-1][..., 2].min()), 0.0, 0.05),
        Claim("speed at the end (rms) [m/s]", float(np.sqrt(np.mean(speed**2))), 0.0, 0.05),
    ]


def bunny(simulation: Simulation, history: History) -> list[Claim]:
    """The scarf comes to lie on the bunny, then the ball carries it aside; nothing of it goes inside anything."""
    frames = history.positions["scarf"]
    draped = frames[history.after(1.6)]
    return [
        stretch(simulation, 1.3),
        nothing_inside(history, simulation, "scarf", 2e-3, every=40),
        Claim("highest node over the bunny's ears before the ball comes [m]", draped[..., 2].max() - 0.81, 0.0, 0.03),
        Claim("way of the scarf's rear with the ball [m]", float((frames[-1] - draped)[60:, :, 1].mean()), 0.05, 1.0),
    ]


def materials(simulation: Simulation, history: History) -> list[Claim]:
    """Rubber and cotton hang limp, paper bends, steel holds out."""
    sags = {name: float(0.4 - frames[-1][-1, :, 2].mean()) / 0.2 for name, frames in history.positions.items()}
    return [
        pins_still(history, simulation),
        stretch(simulation, 1.1),
        Claim("tip of the rubber sheet below its clamp, of the length", sags["rubber"], 0.85, 1.1),
        Claim("tip of the cotton sheet below its clamp, of the length", sags["cotton"], 0.85, 1.1),
        Claim("sag of paper over that of cotton", sags["paper"] / sags["cotton"], 0.5, 0.9),
        Claim("sag of steel over that of paper", sags["steel"] / sags["paper"], 0.35, 0.8),
    ]


def lifted_patch(simulation: Simulation, history: History) -> list[Claim]:
    """Both are lifted; the membrane crumples, the plate stays smooth and lifts more of itself."""
    ends = {name: frames[-1] for name, frames in history.positions.items()}
    return [
        stretch(simulation, 1.15),
        *(Claim(f"height of the {name}'s corner [m]", float(r[0, 0, 2]), 0.25, 0.4) for name, r in ends.items()),
        Claim("folds of the membrane [degrees]", folds(ends["membrane"]), 60.0, 180.0),
        Claim("folds of the plate [degrees]", folds(ends["plate"]), 0.0, 15.0),
        *(nothing_inside(history, simulation, name, 1e-3) for name in ends),
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
        pins_still(history, simulation),
        stretch(simulation, 1.001),
        Claim("height to which the cable bends the tip [m]", float(height[0]), 0.15, 0.25),
        Claim("depth that it swings to [m]", float(-height[: let_go // 4].min()), 0.15, 0.25),
        Claim("its frequency over that of a beam", 0.5 / float(np.diff(turns).mean()) / frequency, 0.9, 1.1),
    ]


def shrink_wrap(simulation: Simulation, history: History) -> list[Claim]:
    """The shell comes to rest on the jack: it lies on all six tips, hangs between them, and nothing is inside."""
    frames, arms = history.positions["shell"], simulation.obstacles
    gaps = [capsule_gaps(arms, frames[k].reshape(-1, 3), history.times[k]) for k in (0, -1)]
    tips = 0.34 * np.concatenate([np.eye(3), -np.eye(3)])
    nearest = [np.linalg.norm(frames[-1] - tip, axis=-1).min() for tip in tips]
    speed = np.linalg.norm(frames[-1] - frames[-2], axis=-1) / (history.times[-1] - history.times[-2])
    return [
        stretch(simulation, 2.6),
        nothing_inside(history, simulation, "shell", 1e-4, every=6),
        Claim("mean gap between shell and jack at the start [m]", float(gaps[0].mean()), 0.15, 0.25),
        Claim("mean gap between shell and jack at the end [m]", float(gaps[1].mean()), 0.0, 0.02),
        Claim("widest gap at the end [m]", float(gaps[1].max()), 0.04, 0.08),
        Claim("tip of an arm from the nearest node [m]", float(max(nearest)), 0.0, 0.025),
        Claim("speed at the end (largest) [m/s]", float(speed.max()), 0.0, 0.01),
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
        nothing_inside(history, simulation, "balloon", 0.0, every=4),
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


def _fallen(frames: list[Array]) -> float:
    """How far below its start the lowest node of all frames is [m]."""
    return float(frames[0][..., 2].min() - min(frame[..., 2].min() for frame in frames))
