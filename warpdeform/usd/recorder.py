"""Writes the frames of a simulation as they come."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpdeform.usd.description import BodyDescription
from warpdeform.usd.frames import FrameWriter
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


_KINDS: dict[str, Callable[[Body], BodyDescription]] = {"surface": _surface}


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
