"""Scenes of solids: jelly and rubber."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from warpdeform.scene.checks.claims import Array, Claim, History, pins_still
from warpdeform.scene.measure import depth, load_on_sphere, relative_volumes, samples

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation


DENT = 0.0214
"""Depth of the dent of `ball_on_solid` where the cells are a quarter as large [m]; tests/physics/test_dent.py."""


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
        pins_still(history, simulation),
        Claim("what the block bears over the weight of the ball", float(load[2]) / weight, 0.95, 1.05),
        Claim("depth of the dent over that of a run refined twice", dents[-1] / DENT, 0.95, 1.05),
        Claim("way of the dent's bottom in the last tenth of a second [m]", abs(dents[-1] - dents[-7]), 0.0, 1e-5),
        Claim("depth of the top inside the ball [m]", depth(ball, samples(end[:, :, -1]), simulation.time), 0.0, 2e-3),
        Claim("smallest volume of a cell over that at rest", _least_volume(frames, frames[0]), 0.3, 1.0),
        Claim("its volume at the end over that at rest", float(relative_volumes(end, frames[0]).mean()), 0.97, 1.0),
    ]


def _least_volume(frames: list[Array], rest: Array) -> float:
    return min(float(relative_volumes(frame, rest).min()) for frame in frames)
