"""From a USD file to a PNG file: read the frames, place the camera, have an engine draw, put strips together."""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from warpdeform.errors import InputError, Mistake
from warpdeform.study.picture.blender import blender_python, draw_with_blender, missing_blender
from warpdeform.study.picture.camera import Camera, View, place_camera
from warpdeform.study.picture.draw_matplotlib import draw_with_matplotlib
from warpdeform.study.picture.drawing import Drawing
from warpdeform.study.picture.stage import StageReader

ENGINES = ("auto", "blender", "matplotlib")
SAMPLES = 32
"""Paths per pixel: with the denoiser's help, four times as many look the same."""


@dataclass(frozen=True)
class Picture:
    """A picture that was made.

    Attributes:
        path: The PNG file.
        engine: "blender" or "matplotlib".
        frames: The time codes that it shows, from left to right.
        size: Width and height [pixels].
    """

    path: Path
    engine: str
    frames: tuple[float, ...]
    size: tuple[int, int]


def render_still(
    usd_path: str | Path,
    out_png: str | Path,
    *,
    frame: float | None = None,
    size: tuple[int, int] = (1280, 720),
    engine: str = "auto",
    samples: int = SAMPLES,
    camera: Camera | tuple[float, float, float] | None = None,
    threads: int = 0,
    exposure: float = 0.0,
) -> Picture:
    """Draw one frame of a USD file.

    Args:
        usd_path: The file.
        out_png: The picture, replaced only once it is complete.
        frame: Time code; None for the last.
        size: Width and height [pixels].
        engine: "blender", "matplotlib", or "auto": Blender where it is installed.
        samples: Paths per pixel that Blender follows; matplotlib knows none.
        camera: A `Camera`, or (azimuth, elevation, distance) of one; None for a three-quarter view of all there is.
        threads: Processor cores for Blender; 0 for all.
        exposure: Brighter (+) or darker (-) [stops].

    Raises:
        InputError: A wrong argument, an unreadable file, or an engine that is not installed.
        WarpdeformError: Blender failed.
    """
    out = _checked(out_png, size, engine, samples, threads, exposure)
    drawings = [StageReader(usd_path).draw(frame)]
    view = place_camera(_camera(camera), drawings[0].subject(), size)
    with tempfile.TemporaryDirectory(prefix="picture-", dir=out.parent) as folder:
        tile = Path(folder, "0.png")
        used = _draw(drawings, [tile], view, size, engine, samples, threads, exposure)
        os.replace(tile, out)
    return Picture(out, used, (drawings[0].time_code,), size)


def render_strip(
    usd_path: str | Path,
    out_png: str | Path,
    *,
    frames: int | Sequence[float] = 4,
    size: tuple[int, int] = (1920, 480),
    engine: str = "auto",
    samples: int = SAMPLES,
    camera: Camera | tuple[float, float, float] | None = None,
    threads: int = 0,
    exposure: float = 0.0,
) -> Picture:
    """Draw several frames side by side, from one camera that sees them all.

    Args:
        usd_path: The file.
        out_png: The picture, replaced only once it is complete.
        frames: How many, evenly spread from the first to the last; or the time codes themselves.
        size: Width and height of the whole strip [pixels].
        engine: As in `render_still`, and so are the other arguments.
        samples: Paths per pixel.
        camera: Where to look from.
        threads: Processor cores for Blender.
        exposure: Stops.

    Raises:
        InputError: A wrong argument, an unreadable file, or an engine that is not installed.
        WarpdeformError: Blender failed.
    """
    out = _checked(out_png, size, engine, samples, threads, exposure)
    reader = StageReader(usd_path)
    drawings = [reader.draw(frame) for frame in _spread(frames, reader.time_codes())]
    gap = max(2, size[0] // 480)
    width = (size[0] - gap * (len(drawings) - 1)) // len(drawings)
    if width < 16:
        raise InputError(
            Mistake("frames", len(drawings), f"do not fit into {size[0]} pixels", "Draw fewer, or a wider picture.")
        )
    tile_size = (width, size[1])
    view = place_camera(_camera(camera), np.concatenate([drawing.subject() for drawing in drawings]), tile_size)
    with tempfile.TemporaryDirectory(prefix="picture-", dir=out.parent) as folder:
        tiles = [Path(folder, f"{k}.png") for k in range(len(drawings))]
        used = _draw(drawings, tiles, view, tile_size, engine, samples, threads, exposure)
        strip = Path(folder, "strip.png")
        joined = _join(tiles, gap, strip)
        os.replace(strip, out)
    return Picture(out, used, tuple(drawing.time_code for drawing in drawings), joined)


def _checked(
    out_png: str | Path, size: tuple[int, int], engine: str, samples: int, threads: int, exposure: float
) -> Path:
    """The output path, once everything about the picture is known to be possible."""
    out = Path(out_png)
    mistakes = []
    if out.suffix.lower() != ".png":
        mistakes.append(Mistake("out", str(out), "is not a .png file", "Name the picture like still.png."))
    if not out.parent.is_dir() or not os.access(out.parent, os.W_OK) or out.is_dir():
        mistakes.append(Mistake("out", str(out), "cannot be written", "Name a file in a folder that is there."))
    if len(size) != 2 or not all(16 <= length <= 16384 for length in size):
        mistakes.append(Mistake("size", size, "is no picture size", "Use 16 to 16384 pixels each way: 1280x720."))
    if engine not in ENGINES:
        mistakes.append(Mistake("engine", engine, "is not known", f"Use one of {', '.join(ENGINES)}."))
    if not 1 <= samples <= 65536:
        mistakes.append(Mistake("samples", samples, "is out of range", "Use 1 to 65536; 32 is good, 128 very good."))
    if not 0 <= threads <= 1024:
        mistakes.append(Mistake("threads", threads, "is out of range", "Use 1 to 1024, or 0 for all cores."))
    if not abs(exposure) <= 20.0:
        mistakes.append(Mistake("exposure", exposure, "is out of range", "Use -20 to 20 stops; 0 is neutral."))
    if mistakes:
        raise InputError(mistakes)
    return out


def _camera(camera: Camera | tuple[float, float, float] | None) -> Camera:
    if isinstance(camera, Camera):
        return camera
    return Camera() if camera is None else Camera(*camera)


def _spread(frames: int | Sequence[float], span: tuple[float, float] | None) -> list[float]:
    """The time codes of a strip."""
    if not isinstance(frames, int):
        if len(frames) == 0:
            raise InputError(Mistake("frames", [], "names no frame", "Give time codes, or how many to spread."))
        return list(frames)
    if frames < 1:
        raise InputError(Mistake("frames", frames, "is less than one", "Use 2 or more."))
    if span is None:
        raise InputError(Mistake("frames", frames, "cannot be spread over a file without frames", "Draw a still."))
    return [float(round(code)) for code in np.linspace(span[0], span[1], frames)]


def _draw(
    drawings: Sequence[Drawing],
    outputs: Sequence[Path],
    view: View,
    size: tuple[int, int],
    engine: str,
    samples: int,
    threads: int,
    exposure: float,
) -> str:
    """Let an engine draw; return which one did."""
    if engine == "blender" and blender_python() is None:
        raise missing_blender()
    if engine == "blender" or (engine == "auto" and blender_python() is not None):
        try:
            draw_with_blender(drawings, outputs, view, size, samples=samples, threads=threads, exposure=exposure)
            return "blender"
        except InputError as error:
            if engine == "blender":
                raise
            warnings.warn(f"drawing with matplotlib instead: {error}", stacklevel=3)
    draw_with_matplotlib(drawings, outputs, view, size, exposure=exposure)
    return "matplotlib"


def _join(tiles: Sequence[Path], gap: int, out: Path) -> tuple[int, int]:
    """Put pictures of one size side by side with white between them; return the size of the whole [pixels]."""
    try:
        from PIL import Image
    except ImportError as error:
        raise InputError(
            Mistake("strip", None, f"needs Pillow ({error})", "Run pip install 'warpdeform[pictures]'.")
        ) from None
    pictures = [Image.open(tile).convert("RGB") for tile in tiles]
    width, height = pictures[0].size
    whole = Image.new("RGB", (len(pictures) * (width + gap) - gap, height), "white")
    for k, picture in enumerate(pictures):
        whole.paste(picture, (k * (width + gap), 0))
    whole.save(out)
    return whole.size
