"""Writes the frames of a simulation as they come."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpdeform.usd.frames import FrameWriter
from warpdeform.usd.topology import SurfaceMesh

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation


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
        bodies = [handle.body for handle in simulation.bodies]
        meshes = [
            SurfaceMesh(
                body.name,
                (body.nodes[0], body.nodes[1]),
                periodic=(body.shape.periodic[0], body.shape.periodic[1]),
                color=body.color,
                roughness=body.roughness,
                thickness=body.material.thickness or 0.0,
            )
            for body in bodies
        ]
        fps = simulation.settings.fps
        super().__init__(path, bodies=meshes, obstacles=simulation.obstacles, fps=fps, **options)

    def write_frame(self) -> None:
        """Write the present state as the next frame.

        Raises:
            SimulationFailure: The state is not finite; nothing of it is written.
        """
        bodies = self.simulation.bodies
        points = {body.name: body.positions() for body in bodies}
        self.write(self.simulation.time, points, {body.name: body.velocities() for body in bodies})
