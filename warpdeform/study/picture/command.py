"""`warpdeform picture RESULT --out still.png`: the command, in the form that typer registers."""

from __future__ import annotations

import json
import sys
import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import typer

from warpdeform.errors import InputError, Mistake
from warpdeform.study.picture.camera import Camera
from warpdeform.study.picture.render import SAMPLES, render_still, render_strip

_VIEW = Camera()


def picture_command(
    result: Annotated[Path, typer.Argument(help="A USD file, as `warpdeform run` writes it.", show_default=False)],
    out: Annotated[Path, typer.Option("--out", "-o", help="The PNG file to write.")] = Path("still.png"),
    frame: Annotated[float | None, typer.Option(help="Frame (time code); the last by default.")] = None,
    strip: Annotated[
        str, typer.Option(help="Frames side by side: how many (4), or which (1,30,60).", show_default=False)
    ] = "",
    size: Annotated[str, typer.Option(help="Pixels; 1280x720 by default, 1920x480 for a strip.")] = "",
    engine: Annotated[Literal["auto", "blender", "matplotlib"], typer.Option(help="What draws it.")] = "auto",
    samples: Annotated[int, typer.Option(help="Light paths per pixel (Blender).")] = SAMPLES,
    azimuth: Annotated[float, typer.Option(help="Camera's direction about z, degrees.")] = _VIEW.azimuth,
    elevation: Annotated[float, typer.Option(help="Camera's height above the horizon, degrees.")] = _VIEW.elevation,
    distance: Annotated[float, typer.Option(help="Camera's distance; 1 fills the picture.")] = _VIEW.distance,
    lens: Annotated[float, typer.Option(help="Focal length, mm of a 36 mm film.")] = _VIEW.lens,
    position: Annotated[str, typer.Option(help="Explicit camera position x,y,z, m.", show_default=False)] = "",
    target: Annotated[str, typer.Option(help="Explicit point looked at x,y,z, m.", show_default=False)] = "",
    exposure: Annotated[float, typer.Option(help="Brighter (+) or darker (-), stops.")] = 0.0,
    threads: Annotated[int, typer.Option(help="Cores for Blender; 0 for all.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout.")] = False,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="Print nothing.")] = False,
) -> None:
    """Draw a still of a result, or a strip of several frames, as a PNG file (no screen needed)."""
    camera = Camera(azimuth, elevation, distance, lens, _point("position", position), _point("target", target))
    if strip and frame is not None:
        raise InputError(Mistake("frame", frame, "goes with a still, not with --strip", "Leave out one of the two."))
    pixels = _size(size or ("1920x480" if strip else "1280x720"))
    began = time.perf_counter()
    common = {"size": pixels, "engine": engine, "samples": samples, "camera": camera, "threads": threads}
    if strip:
        picture = render_strip(result, out, frames=_frames(strip), exposure=exposure, **common)  # type: ignore[arg-type]
    else:
        picture = render_still(result, out, frame=frame, exposure=exposure, **common)  # type: ignore[arg-type]
    wall = time.perf_counter() - began
    if as_json:
        record = asdict(picture) | {"path": str(picture.path), "wall_s": round(wall, 3)}
        sys.stdout.write(json.dumps(record) + "\n")
    elif not quiet:
        frames = ", ".join(f"{code:g}" for code in picture.frames if code == code) or "the only one"
        width, height = picture.size
        typer.echo(f"{picture.path}: frame {frames}, {width} x {height}, drawn by {picture.engine} in {wall:.1f} s")


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise InputError(Mistake("size", text, "is not WIDTHxHEIGHT", "Write pixels like 1280x720."))
    return int(width), int(height)


def _frames(text: str) -> int | list[float]:
    """`4` is a number of frames, `1,30` a list of them (`30,` a list of one)."""
    if text.isdigit():
        return int(text)
    return _numbers("strip", text.rstrip(","), "Write how many (4), or which (1,30,60).")


def _point(key: str, text: str) -> tuple[float, float, float] | None:
    if not text:
        return None
    remedy = "Write x,y,z in metres."
    numbers = _numbers(key, text, remedy)
    if len(numbers) != 3:
        raise InputError(Mistake(key, text, "is not a point", remedy))
    return numbers[0], numbers[1], numbers[2]


def _numbers(key: str, text: str, remedy: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise InputError(Mistake(key, text, "is not a list of numbers", remedy)) from None
