"""However a run ends, a readable file with its frames is left."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from motions import shearing_block, waving_strands
from pxr import Usd, UsdGeom

from warpdeform.errors import InputError, WarpdeformError
from warpdeform.usd import chunks
from warpdeform.usd.check import check_stage
from warpdeform.usd.curves import CurveSet
from warpdeform.usd.frames import FrameWriter
from warpdeform.usd.solid import SolidBlock
from warpdeform.usd.surface import SurfaceMesh

FPS = 60.0
SHEET = SurfaceMesh("sheet", (7, 5))
CHILD = """
import sys
import numpy as np
from motions import shearing_block, waving_strands
from warpdeform.obstacle import Obstacle
from warpdeform.track import Track
from warpdeform.usd import CurveSet, FrameWriter, SolidBlock, SurfaceMesh

u, v = np.meshgrid(np.linspace(0, 1, 40), np.linspace(0, 1, 40), indexing="ij")
ball = Obstacle("sphere", {"radius": 0.1}, track=Track([0], [(0, 0, 1)], spin=(0, 0, 3)))
bodies = [SurfaceMesh("sheet", (40, 40)), CurveSet("strands", (9, 4), 0.01), SolidBlock("block", (5, 4, 3))]
with FrameWriter(sys.argv[1], bodies=bodies, obstacles=[ball], fps=60, chunk_frames=3) as w:
    for k in range(100000):
        x = np.stack([u, v, 0.1 * np.sin(4 * u + k / 10)], axis=-1)
        sheet = x, np.stack([0 * u, 0 * u, 0.6 * np.cos(4 * u + k / 10)], axis=-1)
        samples = {"sheet": sheet, "strands": waving_strands(k / 60), "block": shearing_block(k / 60)}
        w.write(k / 60, *({name: sample[part] for name, sample in samples.items()} for part in (0, 1)))
        print(k + 1, flush=True)
"""
"""A sheet, strands and a block, written without end."""
ALL_PRIMS = ["block", "block_tetrahedra", "sheet", "strands"]
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}


def child_with_frames(path: Path, frames: int) -> subprocess.Popen:
    """A process that writes without end, after its first `frames` frames."""
    command = [sys.executable, "-c", CHILD, str(path)]
    child = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT)
    assert child.stdout is not None
    for _ in range(frames):
        assert child.stdout.readline(), child.stderr.read() if child.stderr else ""
    return child


def moving_prims(path: Path) -> list[str]:
    """Names of the prims whose points have samples."""
    stage = Usd.Stage.Open(str(path))
    of_points = [UsdGeom.PointBased(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.PointBased)]
    return sorted(prim.GetPrim().GetName() for prim in of_points if prim.GetPointsAttr().GetNumTimeSamples())


def sampled_values(path: Path) -> list[tuple[tuple[str, float], np.ndarray]]:
    """Every sample of a file by attribute and time code."""
    stage = Usd.Stage.Open(str(path))
    attributes = [attribute for prim in stage.Traverse() for attribute in prim.GetAuthoredAttributes()]
    codes = np.arange(stage.GetStartTimeCode(), stage.GetEndTimeCode() + 1)
    return [
        ((str(attribute.GetPath()), code), np.array(attribute.Get(code)))
        for attribute in attributes
        if attribute.GetNumTimeSamples()
        for code in codes
    ]


def last_frame(child: subprocess.Popen, before: int) -> int:
    """The last frame that an ended child said it wrote."""
    assert child.stdout is not None
    return max([before] + [int(line) for line in child.stdout.read().splitlines() if line.strip()])


@pytest.mark.parametrize(("frames", "delay"), [(4, 0.0), (10, 0.013), (31, 0.0571)])
def test_kill_leaves_the_frames_up_to_the_last_chunk(tmp_path: Path, frames: int, delay: float) -> None:
    path = tmp_path / "wave.usdc"
    path.write_text("older")
    child = child_with_frames(path, frames)
    time.sleep(delay)
    child.kill()
    child.wait()
    said = last_frame(child, frames)
    partial = tmp_path / "wave.partial.usda"
    assert check_stage(partial) == []
    assert moving_prims(partial) == ALL_PRIMS
    stage = Usd.Stage.Open(str(partial))
    assert said - 2 <= stage.GetEndTimeCode() <= said + 1
    assert stage.GetRootLayer().customLayerData["warpdeform"]["state"] == "running"
    assert path.read_text() == "older"

    stage.Flatten().Export(str(tmp_path / "rescued.usdc"))
    assert check_stage(tmp_path / "rescued.usdc") == []
    with FrameWriter(path, bodies=[SHEET], fps=FPS):
        assert not partial.exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["rescued.usdc", "wave.usdc"]


def test_ctrl_c_leaves_the_requested_file(tmp_path: Path) -> None:
    path = tmp_path / "wave.usdc"
    child = child_with_frames(path, 5)
    child.send_signal(signal.SIGINT)
    _, errors = child.communicate(timeout=60)
    assert b"KeyboardInterrupt" in errors
    assert f"are in {path}".encode() in errors
    assert check_stage(path) == []
    assert moving_prims(path) == ALL_PRIMS
    stage = Usd.Stage.Open(str(path))
    assert stage.GetEndTimeCode() >= 5
    assert stage.GetRootLayer().customLayerData["warpdeform"]["state"] == "interrupted"
    assert os.listdir(tmp_path) == ["wave.usdc"]


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
def test_clips_and_the_stitched_file_show_the_same_of_every_kind(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"zoo{suffix}"
    bodies = [CurveSet("strands", (9, 4), 0.01), SolidBlock("block", (5, 4, 3))]
    motions = {"strands": waving_strands, "block": shearing_block}
    seen = []
    with FrameWriter(path, bodies=bodies, fps=FPS, chunk_frames=3) as writer:
        for k in range(7):
            samples = {name: motion(k / FPS) for name, motion in motions.items()}
            writer.write(k / FPS, *({name: sample[part] for name, sample in samples.items()} for part in (0, 1)))
        writer.flush()
        seen.append(sampled_values(writer.partial_path))
    seen.append(sampled_values(path))
    assert check_stage(path, tolerance=0.01) == []
    assert [key for key, _ in seen[0]] == [key for key, _ in seen[1]]
    assert len(seen[1]) == (3 + 4 + 3) * 7
    for (_, partial), (_, whole) in zip(*seen, strict=True):
        np.testing.assert_array_equal(partial, whole)


@pytest.mark.parametrize("suffix", [".usdc", ".usda", ".usdz"])
def test_an_exception_leaves_the_frames_until_then(tmp_path: Path, wave: Callable, suffix: str) -> None:
    path = tmp_path / f"wave{suffix}"

    def run() -> None:
        with FrameWriter(path, bodies=[SHEET], fps=FPS, chunk_frames=3) as writer:
            for k in range(5):
                writer.write(k / FPS, *wave(k / FPS))
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError) as caught:
        run()
    assert caught.value.__notes__ == [f"The 5 frames until then are in {path}."]
    assert check_stage(path) == []
    assert Usd.Stage.Open(str(path)).GetEndTimeCode() == 5


@pytest.mark.parametrize("frames", range(1, 8))
def test_the_partial_file_shows_whole_chunks_at_any_time(tmp_path: Path, wave: Callable, frames: int) -> None:
    with FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS, chunk_frames=3) as writer:
        for k in range(frames):
            writer.write(k / FPS, *wave(k / FPS))
        shown = frames // 3 * 3
        assert writer.partial_path.exists() == (shown > 0)
        for expected in (shown, frames):
            if expected:
                assert check_stage(writer.partial_path) == []
                stage = Usd.Stage.Open(str(writer.partial_path))
                assert stage.GetEndTimeCode() == expected
                points = UsdGeom.Mesh(stage.GetPrimAtPath("/World/sheet")).GetPointsAttr()
                assert points.Get() is None  # a default would hide the samples of the clips
                np.testing.assert_allclose(
                    points.Get(expected), wave((expected - 1) / FPS)[0]["sheet"].reshape(-1, 3), atol=1e-6
                )
                del stage, points  # the next round reads the file again
            writer.flush()


def test_old_and_large_frames_are_written_before_the_chunk_is_full(
    tmp_path: Path, wave: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, limit in (("CHUNK_SECONDS", 0.0), ("CHUNK_BYTES", 1)):
        with monkeypatch.context() as patch, FrameWriter(tmp_path / "w.usdc", bodies=[SHEET], fps=FPS) as writer:
            patch.setattr(chunks, name, limit)
            writer.write(0.0, *wave(0.0))
            assert check_stage(writer.partial_path) == []


def test_closing_can_be_repeated_after_it_failed(
    tmp_path: Path, wave: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS, chunk_frames=2)
    for k in range(3):
        writer.write(k / FPS, *wave(k / FPS))
    for failure, raised in ((OSError("disk full"), WarpdeformError), (KeyboardInterrupt(), KeyboardInterrupt)):
        with monkeypatch.context() as patch:
            patch.setattr(os, "fsync", Mock(side_effect=failure))
            with pytest.raises(raised) as caught:
                writer.close()
        if raised is WarpdeformError:
            assert "disk full" in str(caught.value)
            assert f"first 3 frames can be read from {writer.partial_path}" in str(caught.value)
        assert not writer.path.exists()
        assert check_stage(writer.partial_path) == []
    assert writer.close() == writer.path
    assert check_stage(writer.path) == []
    assert os.listdir(tmp_path) == ["wave.usdc"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX resource limits")
def test_a_file_system_that_refuses_is_explained(tmp_path: Path) -> None:
    limited = CHILD.replace("import sys", "import sys, resource, signal", 1).replace(
        "with FrameWriter",
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, resource.RLIM_INFINITY))\nwith FrameWriter",
    )
    path = tmp_path / "wave.usdc"
    child = subprocess.run(
        [sys.executable, "-c", limited.replace("100000", "12"), str(path)],
        capture_output=True,
        check=False,
        env=ENVIRONMENT,
    )
    assert b"WarpdeformError" in child.stderr
    assert b"first 12 frames can be read from" in child.stderr
    assert check_stage(tmp_path / "wave.partial.usda") == []


def test_two_runs_cannot_write_the_same_file(tmp_path: Path, wave: Callable) -> None:
    pytest.importorskip("fcntl")
    with FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS, chunk_frames=1) as writer:
        writer.write(0.0, *wave(0.0))
        with pytest.raises(InputError, match="written by another run"):
            FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS)
        writer.write(1 / FPS, *wave(1 / FPS))
    assert check_stage(tmp_path / "wave.usdc") == []


def test_files_of_others_in_the_folder_of_chunks_are_left_alone(tmp_path: Path, wave: Callable) -> None:
    other = tmp_path / "wave.partial" / "notes.txt"
    other.parent.mkdir()
    other.write_text("mine")
    with FrameWriter(tmp_path / "wave.usdc", bodies=[SHEET], fps=FPS) as writer:
        writer.write(0.0, *wave(0.0))
    assert [p.name for p in other.parent.iterdir()] == ["notes.txt"]


def test_stitching_in_several_saves_gives_the_same_samples(
    tmp_path: Path, wave: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(chunks, "_STITCH_BYTES", 1)
    path = tmp_path / "wave.usdc"
    with FrameWriter(path, bodies=[SHEET], fps=FPS, chunk_frames=2) as writer:
        for k in range(9):
            writer.write(k / FPS, *wave(k / FPS))
    assert check_stage(path, tolerance=0.01) == []
    assert Usd.Stage.Open(str(path)).GetEndTimeCode() == 9
