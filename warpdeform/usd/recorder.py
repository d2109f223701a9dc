"""Writes the frames of a simulation as they come."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from warpdeform.usd.curves import CurveSet
from warpdeform.usd.description import BodyDescription
from warpdeform.usd.frames import FrameWriter
from warpdeform.usd.solid import SolidBlock
from warpdeform.usd.surface import SurfaceMesh

if TYPE_CHECKING:
    from warpdeform.body import Body
    from warpdeform.simulation import Simulation


def describe(body: Body) -> BodyDescription:
    """How a body of a simulation appears in a file."""
    return _KINDS[body.kind](body).outward(body.shape.positions)


def _surface(body: Body) -> BodyDescription:
    shape = body.shape
    return SurfaceMesh(
        body.name,
        (body.nodes[0], body.nodes[1]),
        periodic=(shape.periodic[0], shape.periodic[1]),
        thickness=body.material.mean_thickness(shape.grid),
        caps=shape.grid.poles,
        color=body.color,
        roughness=body.roughness,
    )


def _curve(body: Body) -> BodyDescription:
    return CurveSet(
        body.name,
        body.nodes,
        drawn_radius(body),
        closed=body.shape.periodic[0],
        color=body.color,
        roughness=body.roughness,
    )


def drawn_radius(body: Body) -> float:
    """The radius of a curve's section, or a two-hundredth of its length if its material is that of no section [m]."""
    if body.section is not None:
        return body.section.radius
    return float(np.linalg.norm(np.diff(body.shape.positions[:, 0], axis=0), axis=-1).sum()) / 200.0


def _solid(body: Body) -> BodyDescription:
    nodes, periodic = body.nodes, body.shape.periodic
    return SolidBlock(
        body.name,
        (nodes[0], nodes[1], nodes[2]),
        periodic=(periodic[0], periodic[1], periodic[2]),
        color=body.color,
        roughness=body.roughness,
    )


_KINDS: dict[str, Callable[[Body], BodyDescription]] = {"curve": _curve, "surface": _surface, "solid": _solid}


class Recorder(FrameWriter):
    """A frame writer that knows the bodies, obstacles and frame rate of its simulation.

    Args:
        simulation: The simulation.
        path: The file to write: .usdc, .usda or .usdz.
        options: Further options of `FrameWriter`: up_axis, meters_per_unit, metadata, chunk_frames.

    Raises:
        InputError: The path cannot be written.
    """

    def __init__(self, simulation: Simulation, path: str | Path, **options: Any) -> None:
        self.simulation = simulation
        bodies = [describe(handle.body) for handle in simulation.bodies]
        fps = simulation.settings.fps
        super().__init__(path, bodies=bodies, obstacles=simulation.obstacles, fps=fps, **options)

    def write_frame(self) -> None:
        """Write the present state as the next frame.

        Raises:
            SimulationFailure: The state is not finite; nothing of it is written.
        """
        bodies = self.simulation.bodies
        points = {body.name: body.positions() for body in bodies}
        self.write(self.simulation.time, points, {body.name: body.velocities() for body in bodies})
