"""`warpdeform study`: what accuracy costs, and where methods are stable."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from warpdeform.cli.bench import report
from warpdeform.cli.ending import ending_well
from warpdeform.cli.options import Json, Precision, Scene, Set

if TYPE_CHECKING:
    from warpdeform.cli.bench import Result

study = typer.Typer(no_args_is_help=True, help="What accuracy costs, and where methods are stable.")

Out = Annotated[Path, typer.Option("--out", metavar="FOLDER", help="Where CSV, JSON and picture are written.")]
Name = Annotated[str | None, typer.Option("--name", help="Name of those files; the scene's by default.")]
StudyDevice = Annotated[str, typer.Option("--device", help="cpu, cuda:0, ... or auto.")]


@study.command()
@ending_well
def tradeoff(
    scene: Scene,
    out: Out = Path(),
    name: Name = None,
    horizon: Annotated[
        float | None, typer.Option("--horizon", help="When positions are compared [s]; by the noise floor by default.")
    ] = None,
    target: Annotated[
        float | None, typer.Option("--target", help="Error over the body's size to find the cheapest setting for.")
    ] = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Runs under the clock; the fastest counts.")] = 3,
    device: StudyDevice = "cpu",
    sets: Set = None,
    as_json: Json = False,
) -> None:
    """Sweep integrators, steps, iterations, tolerances and grids: error against time, and the settings on the front."""

    def run() -> Result:
        from warpdeform.scene import load_scene, parse_override
        from warpdeform.study.files import StudyFiles
        from warpdeform.study.tradeoff.course import Asked
        from warpdeform.study.tradeoff.tradeoff import study_tradeoff

        overrides = tuple(parse_override(text) for text in sets or ())
        asked = Asked(scene, overrides, device)
        files = StudyFiles(out, name or f"tradeoff-{load_scene(scene, overrides).name}")
        return study_tradeoff(asked, files, horizon_s=horizon, target=target, repeats=repeats, said=_say)

    report(run, as_json)


@study.command()
@ending_well
def stability(
    scene: Scene,
    out: Out = Path(),
    name: Name = None,
    precision: Precision = None,
    densities: Annotated[
        str, typer.Option("--densities", metavar="X,X,...", help="Densities over the scene's, beside 1; may be empty.")
    ] = "0.01,100",
    strain: Annotated[
        float, typer.Option("--strain", help="How much longer bodies start along their first axis; -0.05: compressed.")
    ] = 0.0,
    quick: Annotated[bool, typer.Option("--quick", help="Every other stiffness and step.")] = False,
    device: StudyDevice = "cpu",
    sets: Set = None,
    as_json: Json = False,
) -> None:
    """Map where methods are stable: stiffness, time step, density and disorder of the start; each cell a short run."""

    def run() -> Result:
        from warpdeform.scene import Override, load_scene, parse_override
        from warpdeform.study.files import StudyFiles
        from warpdeform.study.stability.stability import STIFFNESSES, TIME_STEPS, study_stability

        overrides = [*(parse_override(text) for text in sets or ()), Override("solver.device", device, "--device")]
        if precision is not None:
            overrides.append(Override("solver.precision", precision, "--precision"))
        built = load_scene(scene, overrides)
        files, every = StudyFiles(out, name or f"stability-{built.name}"), 2 if quick else 1
        return study_stability(
            built,
            files,
            stiffnesses=STIFFNESSES[::every],
            time_steps=TIME_STEPS[::-every],
            densities=_factors(densities),
            strain=strain,
            said=_say,
        )

    report(run, as_json)


@study.command()
@ending_well
def estimate(
    scenes: Annotated[list[str] | None, typer.Argument(help="Scenes; all packaged ones by default.")] = None,
    out: Out = Path(),
    name: Annotated[str, typer.Option("--name", help="Name of the files.")] = "estimates",
    time: Annotated[float, typer.Option("--time", min=1e-3, help="How long they run [s].")] = 0.1,
    device: StudyDevice = "cpu",
    sets: Set = None,
    as_json: Json = False,
) -> None:
    """Compare the error of the time step that runs estimate themselves with the error that they have."""

    def run() -> Result:
        from warpdeform.scene import parse_override, scene_names
        from warpdeform.study.files import StudyFiles
        from warpdeform.study.tradeoff.estimates import study_estimates

        overrides = [parse_override(text) for text in sets or ()]
        chosen, files = scenes or scene_names(), StudyFiles(out, name)
        return study_estimates(chosen, files, time_s=time, overrides=overrides, device=device, said=_say)

    report(run, as_json)


def _factors(text: str) -> list[float]:
    from warpdeform.errors import InputError, Mistake

    try:
        factors = [float(word) for word in text.split(",") if word.strip()]
    except ValueError:
        factors = [0.0]
    if not all(0.0 < factor < float("inf") for factor in factors):
        raise InputError(Mistake("--densities", text, "must be positive numbers with commas", "Use 0.01,100."))
    return factors


def _say(line: str) -> None:
    typer.echo(line, err=True)
