"""`warpdeform check`: is a scene, or a USD file, in order?"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any

import typer

from warpdeform.cli.ending import FAILED, REFUSED, complain, ending_well, print_json
from warpdeform.cli.options import Device, Json, Set, asked_scene

_USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


@ending_well
def check(
    target: Annotated[str, typer.Argument(metavar="SCENE|FILE.usd*", help="A scene, by name or path, or a USD file.")],
    sets: Set = None,
    device: Device = None,
    as_json: Json = False,
    crossings: Annotated[
        bool,
        typer.Option("--crossings", help="Count what crosses in every frame of a USD file, and measure distances."),
    ] = False,
) -> None:
    """Validate a scene without running it, or the samples of a USD file."""
    from warpdeform.errors import InputError, Mistake

    is_usd = Path(target).suffix in _USD_SUFFIXES
    mistakes: list[str] = []
    report: dict[str, Any] = {"target": target, "kind": "usd" if is_usd else "scene"}
    code = FAILED if is_usd else REFUSED
    try:
        if crossings and not is_usd:
            remedy = "Give a file that a run has written."
            raise InputError(Mistake("--crossings", target, "needs a USD file and not a scene", remedy))
        if crossings:
            mistakes = _count_crossings(target, report)
        elif is_usd:
            mistakes = _usd_mistakes(target)
        else:
            report |= _summary(target, sets, device)
    except InputError as error:
        mistakes, code = str(error).splitlines(), REFUSED
    if as_json:
        print_json({**report, "ok": not mistakes, "mistakes": mistakes})
    elif mistakes:
        complain(mistakes)
    else:
        typer.echo(f"{target}: in order{_words(report)}")
    if mistakes:
        raise typer.Exit(code)


def _usd_mistakes(target: str) -> list[str]:
    from warpdeform.usd.check import check_stage, schema_errors

    return [f"{target}: {line}" for line in (*check_stage(target), *schema_errors(target))]


def _count_crossings(target: str, report: dict[str, Any]) -> list[str]:
    """Put the counts of all frames into the report; what crosses is a mistake, frame by frame."""
    from warpdeform.usd.crossings import count_crossings

    found = count_crossings(target)
    distance = found.smallest_distance
    report |= {
        "frames": len(found.frames),
        "crossings": [found.largest, found.at_end],
        "crossings_per_frame": [frame.crossings for frame in found.frames],
        "smallest_distance": distance if math.isfinite(distance) else None,
    }
    lines = []
    for frame in found.frames:
        where = ", ".join(f"{count} of {edge} through {face}" for (edge, face), count in frame.between.items())
        if frame.crossings:
            lines.append(f"{target}: frame {frame.frame:g}: {frame.crossings} crossings ({where})")
    return lines


def _summary(target: str, sets: list[str] | None, device: str | None) -> dict[str, Any]:
    scene = asked_scene(target, sets, device=device)
    return {
        "bodies": len(scene.bodies),
        "nodes": sum(math.prod(body.nodes) for body in scene.bodies),
        "obstacles": len(scene.obstacles),
        "frames": scene.frames,
        "fps": scene.settings.fps,
        "dt": scene.settings.dt,
    }


def _words(report: dict[str, Any]) -> str:
    if "crossings" in report:
        distance = report["smallest_distance"]
        near = "no distance below the longest edge" if distance is None else f"smallest distance {distance:.4g} m"
        return f": frames {report['frames']}, no crossings, {near}"
    if "bodies" not in report:
        return ""
    return (
        f": bodies {report['bodies']}, nodes {report['nodes']}, obstacles {report['obstacles']}, "
        f"samples {report['frames']} at {report['fps']:g} fps, dt {report['dt']:.4g} s"
    )
