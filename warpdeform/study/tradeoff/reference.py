"""What a scene should do: a reference, a second one that checks it, the noise floor, and how long any of it means much.

Verlet with small steps is the cheap reference (design 6.3); TR-BDF2, converged, checks it. Where Verlet cannot run the
scene, or needs too many steps, TR-BDF2 is the reference and backward differentiation (BDF2) checks it.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from warpdeform.body import Body
from warpdeform.errors import InputError, Mistake
from warpdeform.measure import node_measures
from warpdeform.study.tradeoff.course import Apart, Asked, Course, apart, observe
from warpdeform.study.tradeoff.ladder import TIGHT, Setting

FINER = 4
"""Steps of the explicit reference over those that it needs to be stable."""
MOST_STEPS = 2_000_000
"""Explicit steps of a reference at most."""
IMPLICIT_SUBSTEPS = (16, 32)
"""Steps a frame of the reference by BDF2, and by TR-BDF2."""
NOISE = 1e-6
"""Distance that two references start apart, over the size."""
MOST_NOISE = 1e-4
"""What it may grow to within the horizon, block-averaged, over the size."""
MOST_UNCERTAINTY = 1e-3
"""How far the two references may be apart within the horizon, likewise."""


@dataclass(frozen=True)
class Reference:
    """What runs are compared with.

    Attributes:
        course: Its frames.
        setting: How it was made.
        second: How the one that checks it was made.
        bodies: The bodies of both.
        size: Largest extent of a body at the start [m].
        scale: Energy to measure energies by: weight times size, or without gravity the energy at the start [J].
        fps: Frames per second.
        horizon: Frame at which positions are compared.
        uncertainty: How far the two are apart there.
        halved: How far the reference is there from itself with steps twice as long.
        floor: How far there two references are apart that started `NOISE` apart: the noise floor.
        needed: Steps a frame that explicit methods need.
    """

    course: Course
    setting: Setting
    second: Setting
    bodies: tuple[Body, ...]
    size: float
    scale: float
    fps: float
    horizon: int
    uncertainty: Apart
    halved: Apart
    floor: Apart
    needed: int

    @property
    def least_error(self) -> float:
        """The smallest block-averaged error that means anything [m]."""
        return max(self.uncertainty.block, self.floor.block)

    def error(self, course: Course) -> Apart:
        """Error of a run at the horizon."""
        return apart(course.positions[self.horizon], self.course.positions[self.horizon], self.bodies)

    def as_dict(self) -> dict[str, Any]:
        """What is said of it, as plain values."""
        return {
            "setting": dict(self.setting.values),
            "second": dict(self.second.values),
            "size_m": self.size,
            "horizon_s": self.horizon / self.fps,
            "uncertainty_m": vars(self.uncertainty),
            "with_double_steps_m": vars(self.halved),
            "noise_floor_m": vars(self.floor),
            "energy_scale_J": self.scale,
            "lowest_m": self.course.lowest,
            "max_stretch": self.course.record.max_stretch,
            "energy_change": (self.course.energies[-1] - self.course.energies[0]) / self.scale,
            "period_s": _seconds(self.course.period(), self.fps),
        }


def _seconds(frames: float | None, fps: float) -> float | None:
    return None if frames is None else frames / fps


def explicit_steps(asked: Asked) -> int | None:
    """Steps a frame that Verlet needs at first; None if it cannot run the scene."""
    try:
        course = observe(asked.under(Setting({"integrator": "verlet", "precision": "float64", "substeps": 1})), 1)
    except InputError:
        return None
    return course.record.steps if not course.trouble else None


def make_reference(asked: Asked, horizon_s: float | None = None) -> Reference:
    """Make the references of a scene.

    Args:
        asked: The scene.
        horizon_s: Time at which positions are compared [s]; None takes the last at which noise has not grown too far.

    Raises:
        InputError: The scene is too chaotic to compare positions at all, or the horizon is not within it.
    """
    scene = asked.under(Setting())
    frames, fps, bodies = scene.frames - 1, scene.settings.fps, scene.bodies
    if frames < 2:
        raise InputError(Mistake("scene.duration", scene.duration, "is too short to study [s]", "Use 1 s or so."))
    needed = explicit_steps(asked)
    coarse, fine = IMPLICIT_SUBSTEPS
    implicit = Setting({**TIGHT, "integrator": "tr-bdf2", "substeps": fine})
    if needed is not None and FINER * needed * frames <= MOST_STEPS:
        explicit: dict[str, Any] = {"integrator": "verlet", "precision": "float64", "time_step": "auto"}
        setting = Setting({**explicit, "substeps": FINER * needed})
        double = Setting({**explicit, "substeps": FINER * needed // 2})
        second = implicit
    else:
        setting, double = implicit, Setting({**implicit.values, "substeps": coarse})
        second = Setting({**TIGHT, "integrator": "bdf2", "substeps": 2 * fine})
    size = max(float(np.ptp(body.placed_positions().reshape(-1, 3), axis=0).max()) for body in bodies)
    course, other, doubled = (_ended(observe(asked.under(each), frames)) for each in (setting, second, double))
    shaken = _ended(observe(asked.under(setting), frames, NOISE * size))
    noise = [apart(a, b, bodies) for a, b in zip(shaken.positions, course.positions, strict=True)]
    checks = [apart(a, b, bodies) for a, b in zip(other.positions, course.positions, strict=True)]
    horizon = _horizon(scene.settings.fps, frames, horizon_s, noise, checks, size)
    return Reference(
        course=course,
        setting=setting,
        second=second,
        bodies=bodies,
        size=size,
        scale=_scale(scene.settings.gravity, course, bodies, size),
        fps=fps,
        horizon=horizon,
        uncertainty=checks[horizon],
        halved=apart(doubled.positions[horizon], course.positions[horizon], bodies),
        floor=noise[horizon],
        needed=needed or coarse,
    )


def _ended(course: Course) -> Course:
    if course.trouble:
        problem = f"has no reference: {course.trouble}"
        raise InputError(Mistake("scene", None, problem, "Study a scene that small steps can run."))
    return course


def _scale(gravity: tuple[float, float, float], course: Course, bodies: tuple[Body, ...], size: float) -> float:
    if not any(gravity):
        return max(abs(course.energies[0]), 1e-300)
    mass = sum(node_measures(body.shape.grid, body.shape.positions, body.density).sum() for body in bodies)
    return float(mass) * float(np.linalg.norm(gravity)) * size


def _horizon(
    fps: float, frames: int, asked_s: float | None, noise: list[Apart], checks: list[Apart], size: float
) -> int:
    if asked_s is not None:
        frame = round(asked_s * fps)
        if not 1 <= frame <= frames:
            remedy = f"Use {1.0 / fps:.3g} to {frames / fps:.3g}."
            raise InputError(Mistake("--horizon", asked_s, "is not within the scene [s]", remedy))
        return frame
    good = 0
    while (
        good < frames and noise[good + 1].block < MOST_NOISE * size and checks[good + 1].block < MOST_UNCERTAINTY * size
    ):
        good += 1
    if not good:
        raise InputError(Mistake("scene", None, "parts from its own reference at once", "Name a --horizon."))
    return good
