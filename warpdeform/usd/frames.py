"""Frames of a simulation as a USD file that is readable however the run ends (design 4.2)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import IO

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf

from warpdeform.errors import InputError, Mistake, SimulationFailure, WarpdeformError
from warpdeform.obstacle import Obstacle
from warpdeform.usd.chunks import CHUNK_FRAMES, ChunkStore
from warpdeform.usd.description import BodyDescription, BodySamples, Vectors
from warpdeform.usd.obstacles import ObstacleSamples
from warpdeform.usd.output import OutputFiles, check_output, refusal
from warpdeform.usd.stage import StageUnits, StaticStage, vector_array

try:
    import fcntl
except ImportError:  # Windows: two runs that write the same file are not noticed there
    fcntl = None  # type: ignore[assignment]


class FrameWriter:
    """Writes one sample of every body per frame: points, velocities, normals, extent, and the poses of obstacles.

    Bodies are described by kind: `SurfaceMesh`, `CurveSet`, `SolidBlock`, or another `BodyDescription`.

    While it is open the frames so far can be read through `partial_path`, whatever happens to the process. `close`
    makes the requested file of them and replaces in one step what was there before; leaving the `with` body through
    an exception, Ctrl-C included, does the same with the frames until then.

        with FrameWriter("flag.usdc", bodies=[SurfaceMesh("flag", (64, 64))], fps=60) as writer:
            writer.write(simulation.time, {"flag": positions}, {"flag": velocities})
    """

    def __init__(
        self,
        path: str | Path,
        *,
        bodies: Sequence[BodyDescription],
        obstacles: Sequence[Obstacle] = (),
        fps: float,
        up_axis: str = "Z",
        meters_per_unit: float = 1.0,
        metadata: Mapping[str, object] | None = None,
        chunk_frames: int = CHUNK_FRAMES,
    ) -> None:
        """Check everything that can be checked before a simulation runs, and open the files.

        What a killed run to the same file left beside it is removed.

        Args:
            path: The requested file: .usdc, .usda or .usdz.
            bodies: The bodies; their names key the samples.
            obstacles: Obstacles, drawn beside the bodies.
            fps: Frames per second of simulated time.
            up_axis: "Y" or "Z", the axis of the given coordinates that points up; nothing is turned.
            meters_per_unit: Length of a unit of the file, m; positions and velocities are given in metres.
            metadata: What makes the file (scene, versions, device): kept in the layer's customLayerData.
            chunk_frames: Frames that a kill may cost at most; long frames and large ones are written earlier.

        Raises:
            InputError: The path cannot be written, another run writes to it, or an argument is wrong.
        """
        _check(bodies, fps, up_axis, meters_per_unit, chunk_frames)
        self._files = check_output(path)
        self._units = StageUnits(float(fps), up_axis, float(meters_per_unit))
        self._metadata = dict(metadata or {})
        self._obstacles = tuple(obstacles)
        self._bodies = tuple(bodies)
        self._samples: dict[str, BodySamples] = {}
        self._moving: list[ObstacleSamples] = []
        self._start = 0.0
        self._stitched = self._closed = False
        try:
            self._lock = _take_folder(self._files)
        except (OSError, ValueError) as error:
            raise refusal(self._files, error) from error
        try:
            self._files.remove_partial()
            static = StaticStage()
            for body in self._bodies:
                self._samples[body.name] = body.define(static, self._units)
            self._moving = [ObstacleSamples(static, obstacle, self._units) for obstacle in self._obstacles]
            self._store = ChunkStore(self._files, static, self._units, self._metadata, chunk_frames)
        except BaseException as error:
            self._clean_up()
            if isinstance(error, OSError | Tf.ErrorException):
                raise refusal(self._files, error) from error
            raise

    @property
    def path(self) -> Path:
        """The requested file; it appears when the writer closes."""
        return self._files.target

    @property
    def partial_path(self) -> Path:
        """The file that shows the frames so far until the writer closes."""
        return self._files.root

    @property
    def frames(self) -> int:
        """Number of samples taken so far."""
        return self._store.frames

    def write(
        self,
        time: float,
        points: Mapping[str, NDArray[np.floating]],
        velocities: Mapping[str, NDArray[np.floating]],
    ) -> None:
        """Take the next sample; sample k, counted from 0, stands at time code k + 1.

        Args:
            time: Simulated time, s: that of the first sample plus k / fps.
            points: Node positions of every body, m, shape (*nodes, 3): (nu, nv, 3) of a surface, (n, strands, 3) of
                curves, (nu, nv, nw, 3) of a solid.
            velocities: Node velocities, m/s, same shape.

        Raises:
            SimulationFailure: A position or velocity is not finite; the sample is not written.
            InputError: A body is missing or unknown, a shape or the time does not fit.
            WarpdeformError: The file system refused; the message says what is readable.
        """
        if self._closed:
            raise WarpdeformError(f"{self.path} is closed: no more frames can be written to it")
        self._check_time(time)
        self._check_names(points, velocities)
        values: dict[Sdf.Path, object] = {}
        size = 0
        for body in self._bodies:
            r = self._sample(body, "position", points[body.name], time)
            v = self._sample(body, "velocity", velocities[body.name], time)
            for path, vectors in self._samples[body.name].sample(r, v).items():
                values[path] = vector_array(vectors)
                size += vectors.nbytes
        for obstacle in self._moving:
            values.update(obstacle.sample(time))
        if not self.frames:
            self._start = time
        with self._explained():
            self._store.add(values, size)

    def flush(self) -> None:
        """Make all frames so far readable through `partial_path` now."""
        with self._explained():
            self._store.flush()

    def close(self, statistics: Mapping[str, object] | None = None, *, interrupted: bool = False) -> Path | None:
        """Make the requested file of all frames so far and remove what lay beside it. Does nothing when closed.

        If it fails or is interrupted, everything stays readable through `partial_path`, and it can be called again.

        Args:
            statistics: Solver statistics, kept with the metadata.
            interrupted: Whether the run ended before its time.

        Returns:
            The requested file, or `None` where no frame was written (a file that was there before is left alone).

        Raises:
            WarpdeformError: The file system refused; the message says what is readable.
        """
        if not self._closed:
            if self.frames and not self._stitched:
                state = "interrupted" if interrupted else "complete"
                with self._explained():
                    self._store.flush()
                    self._store.stitch({**self._metadata, "statistics": statistics, "state": state})
                self._stitched = True
            self._clean_up()
            self._closed = True
        return self.path if self.frames else None

    def __enter__(self) -> FrameWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        written = self.close(interrupted=error is not None)
        if error is not None and written:
            error.add_note(f"The {self.frames} frames until then are in {written}.")

    def _clean_up(self) -> None:
        """Remove what lies beside the requested file."""
        self._files.remove_partial()
        self._files.lock.unlink(missing_ok=True)
        self._lock.close()
        if self._files.folder.is_dir() and not any(self._files.folder.iterdir()):
            self._files.folder.rmdir()

    def _sample(self, body: BodyDescription, what: str, values: NDArray[np.floating], time: float) -> Vectors:
        """One checked sample in the units of the file, shape (*nodes, 3)."""
        array = np.asarray(values)
        if array.shape != (*body.nodes, 3):
            problem, remedy = "is not the shape of its grid", f"Give an array of shape {[*body.nodes, 3]}."
            raise InputError(Mistake(f"{what} of {body.name}", list(array.shape), problem, remedy))
        if self._units.meters_per_unit != 1.0:
            array = array * self._units.per_meter
        with np.errstate(over="ignore"):
            array = np.ascontiguousarray(array, dtype=np.float32)
        if not np.isfinite(array).all():
            node = tuple(int(i) for i in np.argwhere(~np.isfinite(array).all(axis=-1))[0])
            cause = f"the {what} is not finite, so the frame was not written"
            raise SimulationFailure(body.name, time, node, cause, "Use smaller steps or more Newton iterations.")
        return array

    def _check_time(self, time: float) -> None:
        expected = self._start + self.frames / self._units.fps if self.frames else time
        if not math.isfinite(time) or abs(time - expected) * self._units.fps > 0.01:
            problem = f"is not the time of sample {self.frames}, {expected:.9g} s"
            raise InputError(Mistake("time", time, problem, f"Write one sample every {1 / self._units.fps:.6g} s."))

    def _check_names(self, *samples: Mapping[str, object]) -> None:
        names = {body.name for body in self._bodies}
        for sample in samples:
            if wrong := names ^ sample.keys():
                problem = "must have one sample for each body and no other"
                raise InputError(Mistake("samples", sorted(wrong), problem, f"The bodies are {sorted(names)}."))

    @contextmanager
    def _explained(self) -> Iterator[None]:
        """Say what is readable when the file system refuses."""
        try:
            yield
        except (OSError, Tf.ErrorException) as error:
            readable = self._store.readable_frames
            rest = f"; its first {readable} frames can be read from {self.partial_path}" if readable else ""
            raise WarpdeformError(f"{self.path} could not be written ({' '.join(str(error).split())}){rest}") from error


def _check(
    bodies: Sequence[BodyDescription], fps: float, up_axis: str, meters_per_unit: float, chunk_frames: int
) -> None:
    mistakes = []
    names = [body.name for body in bodies]
    if not names:
        mistakes.append(Mistake("bodies", None, "there is no body to write", "Give at least one."))
    for name in sorted({name for name in names if names.count(name) > 1}):
        mistakes.append(Mistake("bodies", name, "is the name of several bodies", "Give each a name of its own."))
    if not (math.isfinite(fps) and fps > 0.0):
        mistakes.append(Mistake("fps", fps, "must be finite and above 0", "Use for example 60."))
    if up_axis not in ("Y", "Z"):
        mistakes.append(Mistake("up_axis", up_axis, "is no up axis", 'Use "Y" or "Z".'))
    if not (math.isfinite(meters_per_unit) and meters_per_unit > 0.0):
        remedy = "Use 1.0 for metres, 0.01 for centimetres."
        mistakes.append(Mistake("meters_per_unit", meters_per_unit, "must be finite and above 0", remedy))
    if chunk_frames < 1:
        mistakes.append(Mistake("chunk_frames", chunk_frames, "must be at least 1", "Use for example 24."))
    if mistakes:
        raise InputError(mistakes)


def _take_folder(files: OutputFiles) -> IO[str]:
    """Make the folder of chunks and lock it for this process; the lock ends with the process, however it ends."""
    files.folder.mkdir(parents=True, exist_ok=True)
    lock = files.lock.open("w")
    if fcntl is not None:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            lock.close()
            problem = "is being written by another run"
            remedy = "Wait until that run has ended, or choose another name."
            raise InputError(Mistake("output", str(files.target), problem, remedy)) from error
        except OSError:  # a file system without locks
            return lock
    return lock
