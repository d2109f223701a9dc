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
) -> None:
    """Validate a scene without running it, or the samples of a USD file."""
    from warpdeform.errors import InputError

    is_usd = Path(target).suffix in _USD_SUFFIXES
    mistakes: list[str] = []
    report: dict[str, Any] = {"target": target, "kind": "usd" if is_usd else "scene"}
    code = FAILED if is_usd else REFUSED
    try:
        if is_usd:
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
    if "bodies" not in report:
        return ""
    return (
        f": bodies {report['bodies']}, nodes {report['nodes']}, obstacles {report['obstacles']}, "
        f"samples {report['frames']} at {report['fps']:g} fps, dt {report['dt']:.4g} s"
    )
