"""A scene becomes frames: simulated, written, and stopped in good order when it fails or is interrupted."""

from __future__ import annotations

import platform
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from warpdeform.errors import InputError, Mistake, SimulationFailure
from warpdeform.result import RunRecord
from warpdeform.scene.build import BuiltScene
from warpdeform.scene.schema import SolverTable

if TYPE_CHECKING:
    from warpdeform.simulation import Simulation
    from warpdeform.usd.recorder import Recorder


@dataclass(frozen=True)
class Played:
    """What became of a run.

    Attributes:
        record: Its statistics.
        interrupted: Whether it was stopped before its last frame.
        failure: Why it ended early, if a step failed.
    """

    record: RunRecord
    interrupted: bool = False
    failure: SimulationFailure | None = None


def simulation_of(scene: BuiltScene) -> Simulation:
    """The simulation that a scene describes, at its first frame."""
    from warpdeform.simulation import Simulation  # Warp is loaded only when something runs

    try:
        return Simulation(
            scene.bodies,
            obstacles=scene.obstacles,
            contacts=scene.contacts,
            attachments=scene.attachments,
            wind=scene.wind,
            settings=scene.settings,
        )
    except InputError as error:
        raise InputError([_in_file(mistake, scene) for mistake in error.mistakes]) from None


def _in_file(mistake: Mistake, scene: BuiltScene) -> Mistake:
    """A mistake in the settings of a simulation, by the key that it has in the scene's file."""
    if mistake.key not in SolverTable.model_fields:
        return mistake
    return replace(mistake, key=f"solver.{mistake.key}", file=str(scene.file))


def play(
    scene: BuiltScene,
    output: str | Path | None = None,
    *,
    on_frame: Callable[[Simulation], None] = lambda simulation: None,
    stopped: Callable[[], bool] = lambda: False,
    counted: bool = False,
) -> Played:
    """Simulate a scene and write its frames.

    Args:
        scene: The scene.
        output: The USD file; `None` writes nothing.
        on_frame: Called with the simulation at each frame, the initial state included, once it is written.
        stopped: Asked after each frame whether to stop there.
        counted: Count what crosses in every frame, of bodies in contact; not on the record's clock.

    Returns:
        The record, also of a run that failed or was stopped: the frames until then are written.

    Raises:
        InputError: The output cannot be written.
        WarpdeformError: Writing failed on the way.
    """
    if output is None:
        return _play(simulation_of(scene), scene, None, on_frame, stopped, counted)
    from warpdeform.usd.output import check_output  # USD is loaded only when something is written

    check_output(output)
    simulation = simulation_of(scene)
    writer = recorder(scene, simulation, output)
    with writer:
        played = _play(simulation, scene, writer, on_frame, stopped, counted)
        written = writer.close(played.record.as_dict(), interrupted=played.interrupted or played.failure is not None)
    return replace(played, record=replace(played.record, output=str(written) if written else ""))


def recorder(scene: BuiltScene, simulation: Simulation, output: str | Path) -> Recorder:
    """The writer of a scene's frames, which keeps the scene and the versions that made them in the file."""
    from warpdeform.usd.recorder import Recorder

    return Recorder(
        simulation,
        output,
        up_axis=scene.spec.scene.up_axis,
        meters_per_unit=scene.spec.scene.meters_per_unit,
        metadata={"scene": scene.name, "file": scene.raw, "versions": _versions()},
    )


def _play(
    simulation: Simulation,
    scene: BuiltScene,
    writer: Recorder | None,
    on_frame: Callable[[Simulation], None],
    stopped: Callable[[], bool],
    counted: bool,
) -> Played:
    """Step through the frames; the clock runs while stepping and writing."""
    wall, written, crossings = 0.0, 0, [0, 0]
    failure, interrupted = None, False
    for frame in range(scene.frames):
        start = perf_counter()
        try:
            if frame:
                simulation.advance_frame()
            if writer:
                writer.write_frame()
        except SimulationFailure as error:
            failure = error
            break
        finally:
            wall += perf_counter() - start
        written = frame + 1
        on_frame(simulation)
        if counted:
            now = simulation.count_crossings()
            crossings = [max(crossings[0], now), now]
        if written < scene.frames and stopped():
            interrupted = True
            break
    record = replace(simulation.record(), frames=written, wall_s=wall)
    if counted and record.contact is not None:
        record = replace(record, contact=replace(record.contact, crossings=crossings))
    return Played(record, interrupted, failure)


def _versions() -> dict[str, str]:
    versions = {"python": platform.python_version()}
    for package in ("warpdeform", "warp-lang", "usd-core"):
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            versions[package] = "not installed"
    return versions
