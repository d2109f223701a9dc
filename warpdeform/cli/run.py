"""`warpdeform run`: a scene file to USD frames."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from warpdeform.cli.ending import FAILED, INTERRUPTED, complain, ending_well, print_json, stdout_for_json
from warpdeform.cli.options import Device, Fps, Frames, Integrator, Json, Precision, Quiet, Scene, Set, asked_scene
from warpdeform.cli.progress import progress_bar, summary
from warpdeform.cli.stopping import Stop, stopping

if TYPE_CHECKING:
    from warpdeform.scene import BuiltScene
    from warpdeform.scene.play import Played
    from warpdeform.simulation import Simulation


@ending_well
def run(
    scene: Scene,
    out: Annotated[str | None, typer.Option("--out", help="USD file to write: .usdc, .usda or .usdz.")] = None,
    device: Device = None,
    frames: Frames = None,
    fps: Fps = None,
    integrator: Integrator = None,
    precision: Precision = None,
    sets: Set = None,
    as_json: Json = False,
    quiet: Quiet = False,
    headless: Annotated[bool, typer.Option("--headless", help="Open no window. None is opened anyway.")] = False,
) -> None:
    """Simulate a scene and write its frames.

    Exit codes: 0 done, 1 the simulation failed, 2 wrong usage or scene, 130 interrupted. After a failure or an
    interruption the file holds the frames until then.
    """
    with stdout_for_json(as_json), stopping() as stop:
        built = asked_scene(
            scene, sets, frames=frames, fps=fps, device=device, integrator=integrator, precision=precision
        )
        output = out or built.spec.output.file or f"{built.name}.usdc"
        played = _played(built, output, stop, show=not (quiet or as_json), notes=not quiet, counted=as_json)
    if as_json:
        print_json(played.record.as_dict())
    elif not quiet:
        for line in summary(played.record):
            typer.echo(line)
    if played.failure is not None:
        complain([str(played.failure)])
        raise typer.Exit(FAILED)
    if played.interrupted:
        complain([f"interrupted after {played.record.frames} of {built.frames} frames"])
        raise typer.Exit(INTERRUPTED)


def _played(scene: BuiltScene, output: str, stop: Stop, show: bool, notes: bool, counted: bool) -> Played:
    from warpdeform.errors import InputError, Mistake
    from warpdeform.scene.play import play

    with progress_bar(scene, show) as advance:

        def on_frame(simulation: Simulation) -> None:
            if notes and not simulation.frame:
                complain(simulation.notes)
            stop.patient = True
            advance(simulation.frame + 1)

        try:
            return play(scene, output, on_frame=on_frame, stopped=stop, counted=counted)
        except InputError as error:
            raise InputError(
                [
                    Mistake("--out" if m.key == "output" else m.key, m.value, m.problem, m.remedy, m.file)
                    for m in error.mistakes
                ]
            ) from None
