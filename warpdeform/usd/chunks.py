"""Samples on disk while a run lasts, so that nothing is lost however it ends (design 4.2).

Frames are collected and written in chunks, each a .usdc file of its own under a temporary name that is then renamed. A
small text root shows them through value clips and is replaced, as atomically, after every chunk. A process that is
killed at any moment leaves a root that opens and shows all frames up to the last chunk. At the end the chunks are
stitched into the requested file, one after the other, with memory that does not grow with the number of frames.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from pxr import Sdf, UsdUtils, Vt

from warpdeform.usd.output import OutputFiles
from warpdeform.usd.stage import FIRST_FRAME, ROOT, StageUnits, StaticStage

CHUNK_FRAMES = 24
CHUNK_BYTES = 32_000_000
CHUNK_SECONDS = 10.0
_STITCH_BYTES = 64_000_000


@dataclass(frozen=True)
class Frame:
    """One sample of everything that moves: its time code, a USD value per attribute, and about how many bytes."""

    code: int
    values: Mapping[Sdf.Path, object]
    size: int


@dataclass(frozen=True)
class Chunk:
    """A chunk on disk: its file, the time codes of its first and last frame, and about how many bytes."""

    path: Path
    first: int
    last: int
    size: int


class ChunkStore:
    """Writes frames in chunks beside the requested file and stitches them at the end.

    Every method can be called again after it was interrupted: a chunk counts once its file has its final name, and
    frames are dropped from memory only after that.
    """

    def __init__(
        self,
        files: OutputFiles,
        static: StaticStage,
        units: StageUnits,
        data: Mapping[str, object],
        chunk_frames: int = CHUNK_FRAMES,
    ) -> None:
        """Write what does not change into the folder of chunks, which must exist.

        Args:
            files: Where everything goes.
            static: The stage without its samples.
            units: Units and rate.
            data: What makes the file, for the partial root.
            chunk_frames: A chunk is written at the latest after that many frames.
        """
        self._files, self._units, self._data = files, units, dict(data)
        self._sampled = dict(static.sampled)
        self._chunk_frames = chunk_frames
        self._pending: list[Frame] = []
        self._chunks: list[Chunk] = []
        self._shown = 0
        self._chunk_started = time.monotonic()
        base = static.stage.GetRootLayer()
        units.author(base, 1, {})
        self._replace(files.static, lambda path: _export(base, path))
        manifest = Sdf.Layer.CreateAnonymous(".usda")
        self._declare(manifest)
        self._replace(files.manifest, lambda path: _export(manifest, path))

    @property
    def frames(self) -> int:
        """Frames on disk and in memory."""
        return self._on_disk + len(self._waiting())

    @property
    def readable_frames(self) -> int:
        """Frames that the partial root shows."""
        return self._shown

    @property
    def _on_disk(self) -> int:
        return self._chunks[-1].last - FIRST_FRAME + 1 if self._chunks else 0

    def _waiting(self) -> list[Frame]:
        last = self._chunks[-1].last if self._chunks else FIRST_FRAME - 1
        return [frame for frame in self._pending if frame.code > last]

    def add(self, values: Mapping[Sdf.Path, object], size: int) -> None:
        """Append a frame; write a chunk when it is full, or old.

        Args:
            values: A value for every sampled attribute.
            size: About how many bytes they hold.
        """
        self._pending.append(Frame(FIRST_FRAME + self.frames, values, size))
        full = len(self._pending) >= self._chunk_frames or sum(frame.size for frame in self._pending) >= CHUNK_BYTES
        if full or time.monotonic() - self._chunk_started >= CHUNK_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write the frames in memory as a chunk, then the root that shows it."""
        frames = self._waiting()
        if frames:
            path = self._files.chunk(len(self._chunks) + 1)
            self._replace(path, lambda temporary: self._write_chunk(temporary, frames))
            self._chunks.append(Chunk(path, frames[0].code, frames[-1].code, sum(frame.size for frame in frames)))
        self._pending = []
        self._replace(self._files.root, self._write_root)
        self._shown = self._on_disk
        self._chunk_started = time.monotonic()

    def stitch(self, data: Mapping[str, object]) -> None:
        """Make the requested file of all chunks, under a temporary name, and rename it.

        Args:
            data: What made the file, for its customLayerData.
        """
        target = self._files.target
        if target.suffix == ".usdc":
            self._replace(target, lambda path: self._write_stitched(path, data), sync=True)
            return
        write = self._write_text if target.suffix == ".usda" else self._write_package
        binary = self._files.temporary(".usdc")
        try:
            self._write_stitched(binary, data)
            self._replace(target, lambda path: write(binary, path), sync=True)
        finally:
            binary.unlink(missing_ok=True)

    def _replace(self, path: Path, write: Callable[[Path], None], sync: bool = False) -> None:
        """Write under a temporary name, then rename: readers see the old file or the new one, never a part."""
        temporary = self._files.temporary(path.suffix)
        try:
            write(temporary)
            if sync:
                _sync(temporary)
            os.replace(temporary, path)
        finally:
            temporary.unlink(missing_ok=True)

    def _declare(self, layer: Sdf.Layer) -> None:
        """Give a layer specs of the sampled attributes."""
        for path, type_name in self._sampled.items():
            Sdf.AttributeSpec(Sdf.CreatePrimInLayer(layer, path.GetPrimPath()), path.name, type_name)

    def _write_chunk(self, path: Path, frames: Sequence[Frame]) -> None:
        layer = Sdf.Layer.CreateAnonymous(".usdc")
        self._declare(layer)
        for frame in frames:
            for attribute, value in frame.values.items():
                layer.SetTimeSample(attribute, float(frame.code), value)
        _export(layer, path)

    def _write_root(self, path: Path) -> None:
        layer = Sdf.Layer.CreateAnonymous(".usda")
        layer.subLayerPaths.append(self._beside(self._files.static))
        self._units.author(layer, self._on_disk, {**self._data, "state": "running"})
        prim = Sdf.CreatePrimInLayer(layer, ROOT)
        active = [(float(chunk.first), float(number)) for number, chunk in enumerate(self._chunks)]
        ends = sorted({FIRST_FRAME, self._on_disk})
        clips = {
            "primPath": str(ROOT),
            "assetPaths": Sdf.AssetPathArray([Sdf.AssetPath(self._beside(chunk.path)) for chunk in self._chunks]),
            "active": Vt.Vec2dArray(active),
            "times": Vt.Vec2dArray([(float(code), float(code)) for code in ends]),
            "manifestAssetPath": Sdf.AssetPath(self._beside(self._files.manifest)),
        }
        prim.SetInfo("clips", {"default": clips})
        _export(layer, path)

    def _beside(self, path: Path) -> str:
        """The path of a file of the folder, as the partial root names it."""
        return f"./{path.parent.name}/{path.name}"

    def _write_stitched(self, path: Path, data: Mapping[str, object]) -> None:
        """Write the static stage and the samples of all chunks into one binary file, saving as memory fills."""
        layer = Sdf.Layer.CreateNew(str(path))
        layer.TransferContent(Sdf.Layer.OpenAsAnonymous(str(self._files.static)))
        self._units.author(layer, self._on_disk, data)
        held = 0
        for chunk in self._chunks:
            source = Sdf.Layer.OpenAsAnonymous(str(chunk.path))
            for attribute in self._sampled:
                for code in source.ListTimeSamplesForPath(attribute):
                    layer.SetTimeSample(attribute, code, source.QueryTimeSample(attribute, code))
            held += chunk.size
            if held >= _STITCH_BYTES:
                _save(layer)
                held = 0
        _save(layer)

    def _write_text(self, binary: Path, path: Path) -> None:
        _export(Sdf.Layer.FindOrOpen(str(binary)), path)

    def _write_package(self, binary: Path, path: Path) -> None:
        inside = f"{self._files.target.stem}.usdc"
        if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(binary)), str(path), inside):
            raise OSError(f"could not write {path}")


def _save(layer: Sdf.Layer) -> None:
    if not layer.Save():
        raise OSError(f"could not write {layer.realPath}")


def _export(layer: Sdf.Layer, path: Path) -> None:
    if not layer.Export(str(path)):
        raise OSError(f"could not write {path}")


def _sync(path: Path) -> None:
    """Wait until a file is on the disk: what it replaces is removed next."""
    with path.open("rb+") as file:
        os.fsync(file.fileno())
