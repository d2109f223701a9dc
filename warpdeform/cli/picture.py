"""`warpdeform picture RESULT --out still.png`: a still of a result."""

from __future__ import annotations

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from warpdeform.cli.ending import ending_well, print_json, stdout_for_json
from warpdeform.cli.options import Json, Quiet


@ending_well
def picture(
    result: Annotated[Path, typer.Argument(help="A USD file, as `warpdeform run` writes it.", show_default=False)],
    out: Annotated[Path, typer.Option("--out", "-o", help="The PNG file to write.")] = Path("still.png"),
    frame: Annotated[float | None, typer.Option(help="Frame (time code); the last by default.")] = None,
    strip: Annotated[
        str, typer.Option(help="Frames side by side: how many (4), or which (1,30,60).", show_default=False)
    ] = "",
    size: Annotated[str, typer.Option(help="Pixels; 1280x720 by default, 1920x480 for a strip.")] = "",
    engine: Annotated[Literal["auto", "blender", "matplotlib"], typer.Option(help="What draws it.")] = "auto",
    samples: Annotated[int | None, typer.Option(help="Light paths per pixel (Blender).")] = None,
    azimuth: Annotated[float | None, typer.Option(help="Camera's direction about z, degrees.")] = None,
    elevation: Annotated[float | None, typer.Option(help="Camera's height above the horizon, degrees.")] = None,
    distance: Annotated[float | None, typer.Option(help="Camera's distance; 1 fills the picture.")] = None,
    lens: Annotated[float | None, typer.Option(help="Focal length, mm of a 36 mm film.")] = None,
    position: Annotated[str, typer.Option(help="Explicit camera position x,y,z, m.", show_default=False)] = "",
    target: Annotated[str, typer.Option(help="Explicit point looked at x,y,z, m.", show_default=False)] = "",
    exposure: Annotated[float, typer.Option(help="Brighter (+) or darker (-), stops.")] = 0.0,
    threads: Annotated[int, typer.Option(help="Cores for Blender; 0 for all.")] = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Draw a still of a result, or a strip of several frames, as a PNG file; no screen is needed."""
    from warpdeform.study.picture import Camera, render_still, render_strip

    placed = {"azimuth": azimuth, "elevation": elevation, "distance": distance, "lens": lens}
    given = {key: value for key, value in placed.items() if value is not None}
    camera = Camera(**given, position=_point("position", position), target=_point("target", target))
    if strip and frame is not None:
        raise _mistake("frame", str(frame), "goes with a still, not with --strip", "Leave out one of the two.")
    pixels = _size(size or ("1920x480" if strip else "1280x720"))
    began = time.perf_counter()
    common: dict[str, Any] = {"size": pixels, "engine": engine, "camera": camera, "threads": threads}
    common |= {} if samples is None else {"samples": samples}
    with stdout_for_json(as_json):
        if strip:
            drawn = render_strip(result, out, frames=_frames(strip), exposure=exposure, **common)
        else:
            drawn = render_still(result, out, frame=frame, exposure=exposure, **common)
    wall = time.perf_counter() - began
    if as_json:
        print_json(asdict(drawn) | {"path": str(drawn.path), "wall_s": round(wall, 3)})
    elif not quiet:
        frames = ", ".join(f"{code:g}" for code in drawn.frames if code == code) or "the only one"
        width, height = drawn.size
        typer.echo(f"{drawn.path}: frame {frames}, {width} x {height}, drawn by {drawn.engine} in {wall:.1f} s")


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    if not (width.isdigit() and height.isdigit()):
        raise _mistake("size", text, "is not WIDTHxHEIGHT", "Write pixels like 1280x720.")
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
        raise _mistake(key, text, "is not a point", remedy)
    return numbers[0], numbers[1], numbers[2]


def _numbers(key: str, text: str, remedy: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise _mistake(key, text, "is not a list of numbers", remedy) from None


def _mistake(key: str, value: str, problem: str, remedy: str) -> Exception:
    from warpdeform.errors import InputError, Mistake

    return InputError(Mistake(key, value, problem, remedy))
