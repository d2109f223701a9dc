"""Scenes of bodies that touch themselves and each other."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpdeform.scene.checks.claims import Claim, History, nothing_crosses, stretch

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation


def crumple(simulation: Simulation, history: History) -> list[Claim]:
    """The sheet falls on its edge, folds up and comes to lie, through nothing of itself."""
    frames = history.positions["sheet"]
    return [
        stretch(simulation, 1.3),
        nothing_crosses(history, simulation),
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
        stretch(simulation, 2.2),
        nothing_crosses(history, simulation),
        Claim("distance of the ends from their path [m]", handle.model.pin_lag(handle.state.x)[0], 0.0, 1e-3),
        Claim("radius of the rope at its middle [m]", wide, 0.0, 0.04),
    ]


def layers(simulation: Simulation, history: History) -> list[Claim]:
    """Ten cloths come to lie on the log and on each other, in their order."""
    tops = [history.positions[f"layer{k}"][-1][..., 2] for k in range(10)]
    heights = np.array([top[len(top) // 2, top.shape[1] // 2] for top in tops])
    return [
        stretch(simulation, 1.3),
        nothing_crosses(history, simulation),
        Claim("least distance of one layer above the last on the log [m]", float(np.diff(heights).min()), 5e-4, 4e-3),
        Claim("lowest layer above the log [m]", float(heights[0]) - 0.4, 0.0, 5e-3),
    ]
