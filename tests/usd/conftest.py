"""A waving sheet with exact velocities, a file of it, and files of other motions."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from warpdeform.usd.description import BodyDescription
from warpdeform.usd.frames import FrameWriter
from warpdeform.usd.surface import SurfaceMesh

FPS = 60.0
NODES = (7, 5)
Sample = dict[str, NDArray[np.float64]]
Wave = Callable[..., tuple[Sample, Sample]]


@pytest.fixture
def wave() -> Wave:
    """Positions and velocities of "sheet" at a time: a wave that runs along u over a sheet of 1.2 m by 0.8 m."""

    def sample(time: float, nodes: tuple[int, int] = NODES, name: str = "sheet") -> tuple[Sample, Sample]:
        u, v = np.meshgrid(np.linspace(0.0, 1.2, nodes[0]), np.linspace(0.0, 0.8, nodes[1]), indexing="ij")
        phase = 4.0 * u + 6.0 * time
        zero = np.zeros_like(u)
        positions = np.stack([u, v, 0.1 * np.sin(phase)], axis=-1)
        return {name: positions}, {name: np.stack([zero, zero, 0.6 * np.cos(phase)], axis=-1)}

    return sample


@pytest.fixture
def written(wave: Wave) -> Callable[..., Path]:
    """Write a file of the waving sheet and return its path."""

    def write(path: Path, frames: int = 8, **settings: object) -> Path:
        settings = {"bodies": [SurfaceMesh("sheet", NODES)], "fps": FPS, "chunk_frames": 3} | settings
        with FrameWriter(path, **settings) as writer:  # type: ignore[arg-type]
            for k in range(frames):
                writer.write(k / FPS, *wave(k / FPS))
        return path

    return write


@pytest.fixture
def recorded() -> Callable[..., Path]:
    """Write a file of described bodies, each with its motion (:mod:`motions`), and return its path."""

    def record(path: Path, moving: list[tuple[BodyDescription, Callable]], frames: int = 6, **settings: object) -> Path:
        with FrameWriter(path, bodies=[body for body, _ in moving], fps=FPS, chunk_frames=4, **settings) as writer:  # type: ignore[arg-type]
            for k in range(frames):
                samples = {body.name: motion(k / FPS, body.nodes) for body, motion in moving}
                writer.write(k / FPS, *({name: pair[part] for name, pair in samples.items()} for part in (0, 1)))
        return path

    return record
