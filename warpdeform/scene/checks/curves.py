"""Scenes of curves: cords, grass, rings on a rod."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpdeform.scene.checks.claims import Array, Claim, History, nothing_inside, pins_still, stretch

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation


def coiled_cord(simulation: Simulation, history: History) -> list[Claim]:
    """It bounces about where a close-coiled spring hangs under its own weight, as slowly, and loses its swing."""
    bottom = np.array([frame[-1, 0, 2] for frame in history.positions["cord"]])
    # k = G d^4 / (64 n R^3); a spring of mass m sags by m g / 2k and oscillates with sqrt(k/m) / 4.
    stiffness = 4e7 / 2.9 * 0.003**4 / (64.0 * 15.0 * 0.015**3)
    mass = float(simulation["cord"].model.node_mass.sum())
    sag, period = mass * 9.81 / (2.0 * stiffness), 4.0 * np.sqrt(mass / stiffness)
    last = bottom[history.after(3.0 - 2.0 * period) :]
    return [
        pins_still(history, simulation),
        stretch(simulation, 1.01),
        Claim("mean sag of its end over that of a spring", float(bottom[0] - last.mean()) / sag, 0.9, 1.1),
        Claim("its period over that of a spring", _period(bottom, simulation.settings.fps) / period, 0.85, 1.1),
        Claim("its last swing over its first", float(np.ptp(last) / np.ptp(bottom)), 0.3, 0.9),
    ]


def _period(height: Array, fps: float) -> float:
    """Mean time between the turns through the mean, twice [s]."""
    above = height > height.mean()
    turns = np.flatnonzero(above[1:] != above[:-1])
    return 2.0 * float(np.diff(turns).mean()) / fps


def grass(simulation: Simulation, history: History) -> list[Claim]:
    """The blades bow with the wind without stretching or lying down; a gust bows neighbours alike, not all blades."""
    blades = np.array(history.positions["blades"][history.after(2.0) :])  # frames, nodes, blades, 3
    lean = (blades[:, -1] - blades[:, 0]) @ np.array([6.0, 1.0, 0.0]) / np.hypot(6.0, 1.0)
    gust = lean - lean.mean(axis=1, keepdims=True)
    rows = gust.reshape(len(gust), 40, 25)
    alike = float((rows[:, 1:] * rows[:, :-1]).mean() / (rows**2).mean())
    return [
        pins_still(history, simulation),
        stretch(simulation, 1.005),
        Claim("mean lean of the tips with the wind [m]", float(lean.mean()), 0.15, 0.25),
        Claim("lowest tip above the ground [m]", float(blades[:, -1, :, 2].min()), 0.05, 0.4),
        Claim("how differently tips lean (root mean square) [m]", float(gust.std()), 0.01, 0.05),
        Claim("correlation of neighbours, one mesh of 5 cm apart", alike, 0.7, 1.0),
    ]


def curtain(simulation: Simulation, history: History) -> list[Claim]:
    """The leading ring takes the others along; all stay on the rod and in their order, the curtain with them."""
    rings = np.array(history.positions["rings"])
    places = rings[..., 0].mean(axis=1)
    middle, top = rings[..., 1:].mean(axis=1), rings[..., 2].max(axis=1)
    return [
        stretch(simulation, 1.1),
        nothing_inside(history, simulation, "curtain", 1e-3, every=6),
        Claim("leading ring at the end [m]", float(places[-1, -1]), 0.38, 0.44),
        Claim("least distance of a ring from the next [m]", float(np.diff(places[1:], axis=1).min()), 1e-3, 0.2),
        Claim("most rings pushed together at the end", float((np.diff(places[-1]) < 0.02).sum() + 1), 3, 9),
        Claim("middle of a ring below the rod's [m]", float(1.5 - middle[1:, :, 1].min()), 0.0, 0.02),
        Claim("lowest top of a ring over the middle of the rod [m]", float(top[1:].min() - 1.5), 0.01, 0.02),
    ]
