"""`study estimate`: what runs say of their own error, beside the error that they have."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from warpdeform.errors import InputError
from warpdeform.scene import Override
from warpdeform.study.bench.machine import describe
from warpdeform.study.bench.table import table
from warpdeform.study.files import StudyFiles
from warpdeform.study.tradeoff.course import Asked, Course, observe
from warpdeform.study.tradeoff.ladder import TIGHT, Setting

FINER = 8
"""Steps of the reference, TR-BDF2 converged in float64, over those of the scene."""


@dataclass(frozen=True)
class Estimate:
    """A scene's estimate of its error, and the error.

    Attributes:
        scene: Its name.
        integrator: Its integrator.
        time_s: When both were taken [s].
        estimate_m: `error_estimate.time_step` of the run until then [m].
        largest_m: Largest distance of a node from the reference [m].
        rms_m: Root mean square distance [m].
        doubt_m: Largest distance of the reference from one with half its steps [m].
        trouble: Why there is none.
    """

    scene: str
    integrator: str = ""
    time_s: float = float("nan")
    estimate_m: float = float("nan")
    largest_m: float = float("nan")
    rms_m: float = float("nan")
    doubt_m: float = float("nan")
    trouble: str = ""


@dataclass
class Estimates:
    """The result of `study estimate`."""

    machine: dict[str, Any]
    found: list[Estimate] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The table as people read it."""
        header = ("scene", "method", "at [s]", "estimate [m]", "largest error [m]", "RMS [m]", "reference to", "ratio")
        rows = [
            [
                e.scene, e.integrator, f"{e.time_s:.2f}", f"{e.estimate_m:.1e}", f"{e.largest_m:.1e}",
                f"{e.rms_m:.1e}", f"{e.doubt_m:.0e}", f"{e.estimate_m / e.largest_m:.2g}",
            ]
            for e in self.found if not e.trouble
        ]  # fmt: skip
        return [*table(header, rows), *(f"{e.scene}: {e.trouble}" for e in self.found if e.trouble)]


def study_estimates(
    scenes: Sequence[str],
    files: StudyFiles,
    *,
    time_s: float = 0.1,
    overrides: Sequence[Override] = (),
    device: str = "cpu",
    said: Callable[[str], None] = lambda line: None,
) -> Estimates:
    """Run scenes and their references for a short time.

    Args:
        scenes: Names or paths.
        files: Where the table is written, row by row.
        time_s: How long [s]; estimates are added up over time and bound nothing later on.
        overrides: What is changed of all of them.
        device: Warp device.
        said: Told about progress.
    """
    found = Estimates(describe())
    files.start_rows(list(asdict(Estimate(""))))
    for name in scenes:
        said(name)
        asked = Asked(name, tuple(overrides), device)
        try:
            found.found.append(_estimate(asked, time_s))
        except InputError as error:
            found.found.append(Estimate(name, trouble=str(error)))
        files.add_row(asdict(found.found[-1]))
    files.write_json(found.as_dict())
    return found


def _estimate(asked: Asked, time_s: float) -> Estimate:
    scene = asked.under(Setting())
    frames = max(1, round(time_s * scene.settings.fps))
    steps = scene.settings.substeps
    tight = {**TIGHT, "integrator": "tr-bdf2"}
    courses = [observe(scene, frames)]
    for finer in (FINER, FINER // 2):
        courses.append(observe(asked.under(Setting({**tight, "substeps": finer * steps})), frames))
    method, at = scene.settings.integrator, frames / scene.settings.fps
    for course in courses:
        if course.trouble:
            return Estimate(scene.name, method, at, trouble=course.trouble)
    run, exact, half = courses
    distances = _distances(run, exact)
    return Estimate(
        scene.name,
        method,
        at,
        run.record.error_estimate["time_step"],
        float(distances.max()),
        float(np.sqrt(np.mean(distances**2))),
        float(_distances(half, exact).max()),
    )


def _distances(a: Course, b: Course) -> Any:
    """Distances of all nodes at the last frame [m]."""
    pairs = zip(a.positions[-1], b.positions[-1], strict=True)
    return np.concatenate([np.linalg.norm(x - y, axis=-1).ravel() for x, y in pairs])
