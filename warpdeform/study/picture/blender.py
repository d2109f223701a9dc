"""Have Blender draw: plain arrays go to a process of its own, whose Python has bpy."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from warpdeform.errors import InputError, Mistake, WarpdeformError
from warpdeform.study.picture.camera import SENSOR, View
from warpdeform.study.picture.drawing import Drawing, ground_height

PYTHON_VARIABLE = "WARPDEFORM_BLENDER_PYTHON"
"""Environment variable: the Python that has bpy, where that is not the one that runs the engine."""

DEBIAN_LIBRARIES = "libxi6 libxxf86vm1 libxfixes3 libxrender1 libgl1 libegl1 libsm6 libxkbcommon0"
_PROGRAM = Path(__file__).with_name("draw_blender.py")
_NO_BPY = 3


def blender_python() -> str | None:
    """The Python that can draw with Blender; None where bpy is not installed."""
    named = os.environ.get(PYTHON_VARIABLE)
    if named:
        return named
    return sys.executable if importlib.util.find_spec("bpy") else None


def missing_blender(cause: str = "bpy, Blender as a Python package, is not installed here") -> InputError:
    """The error that says how to get Blender."""
    remedy = (
        "Run pip install 'warpdeform[pictures]' in a Python 3.11 (the one that bpy is made for), or set "
        f"{PYTHON_VARIABLE} to a Python that has bpy, or use the engine matplotlib."
    )
    if "shared object" in cause:
        remedy = f"On Debian or Ubuntu: apt-get install {DEBIAN_LIBRARIES}. Or use the engine matplotlib."
    return InputError(Mistake("engine", "blender", cause, remedy))


def draw_with_blender(
    drawings: Sequence[Drawing],
    outputs: Sequence[Path],
    view: View,
    size: tuple[int, int],
    *,
    samples: int = 96,
    threads: int = 0,
    exposure: float = 0.0,
) -> None:
    """Draw each drawing into its PNG file, all from one camera and on one ground.

    Args:
        drawings: What to show.
        outputs: A file for each.
        view: The camera.
        size: Width and height [pixels].
        samples: Paths that Cycles follows per pixel, before it removes the remaining noise.
        threads: Processor cores to use; 0 for all.
        exposure: Brighter (+) or darker (-) [stops].

    Raises:
        InputError: There is no Blender.
        WarpdeformError: Blender failed.
    """
    python = blender_python()
    if python is None:
        raise missing_blender()
    subject = np.concatenate([drawing.subject() for drawing in drawings])
    with tempfile.TemporaryDirectory(prefix="warpdeform-picture-") as folder:
        arrays: dict[str, np.ndarray] = {}
        job = {
            "frames": [_frame(k, *pair, arrays) for k, pair in enumerate(zip(drawings, outputs, strict=True))],
            "size": list(size),
            "samples": samples,
            "denoise": True,
            "threads": threads,
            "exposure": exposure,
            "ground": ground_height(tuple(drawings)),
            "middle": ((subject.min(axis=0) + subject.max(axis=0)) / 2).tolist(),
            "extent": float(np.linalg.norm(np.ptp(subject, axis=0))),
            "azimuth": float(np.degrees(np.arctan2(view.axes[2, 1], view.axes[2, 0]))),
            "view": {
                "position": view.position.tolist(),
                "axes": view.axes.tolist(),
                "lens": view.lens,
                "sensor": SENSOR,
                "distance": view.distance,
            },
        }
        Path(folder, "job.json").write_text(json.dumps(job))
        np.savez(Path(folder, "arrays.npz"), **arrays)  # type: ignore[arg-type]
        _run(python, folder)
    for output in outputs:
        if not output.is_file():
            raise WarpdeformError(f"Blender wrote no picture to {output}")


def _frame(number: int, drawing: Drawing, output: Path, arrays: dict[str, np.ndarray]) -> dict[str, object]:
    """Describe one drawing to the program and put its arrays aside for it."""
    items = []
    for k, item in enumerate(drawing.items):
        key = f"{number}.{k}"
        arrays[f"{key}.points"], arrays[f"{key}.triangles"] = item.points, item.triangles
        arrays[f"{key}.colors"] = item.colors
        if item.normals is not None:
            arrays[f"{key}.normals"] = item.normals
        items.append({
            "key": key, "name": item.name, "thin": item.thin, "has_normals": item.normals is not None,
            "roughness": item.roughness, "metallic": item.metallic,
        })  # fmt: skip
    return {"items": items, "out": str(output.resolve())}


def _run(python: str, folder: str) -> None:
    try:
        done = subprocess.run([python, "-P", str(_PROGRAM), folder], capture_output=True, text=True)
    except OSError as error:
        raise missing_blender(f"{python} cannot be started ({error.strerror})") from None
    if done.returncode == _NO_BPY:
        raise missing_blender(done.stderr.strip().splitlines()[-1])
    if done.returncode != 0:
        tail = "\n".join((done.stderr.strip() or done.stdout.strip()).splitlines()[-8:])
        raise WarpdeformError(f"Blender failed with exit code {done.returncode}:\n{tail}")
