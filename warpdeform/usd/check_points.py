"""Checks of the samples of prims that are made of points, whatever they draw: times, numbers, extents, velocities."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

_ROUNDING = 2.0**-22  # a few units in the last place of a float32


@dataclass
class Findings:
    """Mistakes by prim and kind: the first of each in words, the others counted."""

    first: dict[tuple[str, str], str] = field(default_factory=dict)
    count: dict[tuple[str, str], int] = field(default_factory=dict)

    def expect(self, good: bool | np.bool_, place: object, kind: str, detail: str = "") -> bool:
        """Note a mistake unless `good`; returns `good`."""
        if not good:
            key = (str(place), kind)
            self.first.setdefault(key, detail)
            self.count[key] = self.count.get(key, 0) + 1
        return bool(good)

    def lines(self) -> list[str]:
        """One line for each kind of mistake of each prim."""
        result = []
        for (place, kind), detail in self.first.items():
            more = self.count[place, kind] - 1
            result.append(f"{place}: {kind}{f' ({detail})' if detail else ''}{f', and {more} more' if more else ''}")
        return result


def check_times(attribute: Usd.Attribute, codes: list[float], findings: Findings) -> bool:
    """Check that an attribute has a sample at each of the time codes and at no other."""
    times = attribute.GetTimeSamples()
    span = f"{len(times)} samples from {times[0]:g} to {times[-1]:g}" if times else "no samples"
    kind = f"{attribute.GetName()} does not have one sample at each time code from the stage's first to its last"
    return findings.expect(times == codes, attribute.GetPrim().GetPath(), kind, span)


class PointsCheck(ABC):
    """The checks of one prim. Each kind of prim adds those of what joins its points, and of what it has besides.

    Args:
        prim: The prim, of the schema that the check is for.
        codes: Time codes of the stage, from its first to its last.
        findings: Where mistakes are noted.
    """

    def __init__(self, prim: UsdGeom.PointBased, codes: list[float], findings: Findings) -> None:
        self.prim, self.findings, self.path = prim, findings, prim.GetPath()
        self.animated = prim.GetPointsAttr().GetNumTimeSamples() > 0
        self.times: list[Any] = [Usd.TimeCode(c) for c in codes] if self.animated else [Usd.TimeCode.EarliestTime()]
        self.codes = codes
        self.size = len(prim.GetPointsAttr().Get(self.times[0]) or [])

    def expect(self, good: bool | np.bool_, kind: str, detail: str = "") -> bool:
        """Note a mistake of this prim unless `good`; returns `good`."""
        return self.findings.expect(good, self.path, kind, detail)

    def run(self, rate: float, tolerance: float) -> None:
        """Check all samples, one after the other.

        Args:
            rate: Time codes per second.
            tolerance: That of `check_stage`.
        """
        sampled = [self.prim.GetPointsAttr(), self.prim.GetExtentAttr()]
        optional = (self.prim.GetVelocitiesAttr(), self.prim.GetNormalsAttr())
        sampled += [attribute for attribute in optional if attribute.HasAuthoredValue()]
        if self.animated:
            complete = [check_times(attribute, self.codes, self.findings) for attribute in sampled]
            if not all(complete):
                return
        for attribute in self.constant():
            self.expect(not attribute.GetNumTimeSamples(), f"{attribute.GetName()} changes over time")
        if not self.topology():
            return
        motion = _Motion(rate)
        for time in self.times:
            where = f"time code {time.GetValue():g}" if self.animated else ""
            points = self.vectors(self.prim.GetPointsAttr(), time, where)
            if points is None or not self.expect(len(points) == self.size, "the number of points changes", where):
                continue
            self._extent(points, time, where)
            self.sample(points, time, where)
            if self.animated and self.prim.GetVelocitiesAttr().HasAuthoredValue():
                velocities = self.vectors(self.prim.GetVelocitiesAttr(), time, where)
                if velocities is not None and self.expect(
                    velocities.shape == points.shape, "there are not as many velocities as points", where
                ):
                    motion.add(points, velocities)
        worst, frame = motion.worst(tolerance)
        detail = f"{worst:.2g} of the fastest from time code {self.codes[frame]:g} on" if worst else ""
        self.expect(not worst, "velocities do not agree with the motion of the points", detail)

    @abstractmethod
    def constant(self) -> list[Usd.Attribute]:
        """The attributes that say how the points are joined, which must be the same at all times."""

    @abstractmethod
    def topology(self) -> bool:
        """Check how the points are joined against their number in the first sample; False ends the checks."""

    @abstractmethod
    def sample(self, points: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        """Check what else this kind of prim has at `time`; `where` names it."""

    def margin(self, time: Usd.TimeCode) -> float:
        """How far the extent reaches beyond the points."""
        return 0.0

    def vectors(self, attribute: Usd.Attribute, time: Usd.TimeCode, where: str) -> NDArray[np.float64] | None:
        """Vectors of an attribute (n, 3), or None and a finding where they are missing or not finite."""
        value = attribute.Get(time)
        if not self.expect(value is not None, f"{attribute.GetName()} has no value", where):
            return None
        array = np.array(value, dtype=np.float64).reshape(-1, 3)
        finite = np.isfinite(array).all(axis=1)
        detail = "" if finite.all() else f"element {int(np.argmin(finite))}, {where}".rstrip(", ")
        return array if self.expect(finite.all(), f"{attribute.GetName()} is not finite", detail) else None

    def _extent(self, points: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        if not self.expect(self.prim.GetExtentAttr().HasAuthoredValue(), "there is no extent"):
            return
        box = self.vectors(self.prim.GetExtentAttr(), time, where)
        if box is not None:
            margin = self.margin(time)
            right = np.stack([points.min(axis=0) - margin, points.max(axis=0) + margin])
            near = box.shape == (2, 3) and np.allclose(box, right, rtol=0.0, atol=_ROUNDING * np.abs(right).max())
            self.expect(near, "the extent is not that of the points", where)


@dataclass
class _Motion:
    """Velocities against finite differences of the points, kept as three numbers per pair of samples."""

    rate: float
    last: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None
    rows: list[tuple[float, float, float]] = field(default_factory=list)

    def add(self, points: NDArray[np.float64], velocities: NDArray[np.float64]) -> None:
        """Take the next sample: points in units, velocities in units per second."""
        if self.last is not None:
            before, velocity = self.last
            difference = (points - before) * self.rate
            mismatch = _rms(difference - 0.5 * (velocity + velocities))
            rounding = 2.0 * _ROUNDING * float(np.abs(points).max()) * self.rate
            excess = mismatch - 0.5 * _rms(velocities - velocity) - rounding
            self.rows.append((excess, _rms(difference), _rms(velocities)))
        self.last = (points, velocities)

    def worst(self, tolerance: float) -> tuple[float, int]:
        """The largest mismatch beyond what is allowed, as a share of the fastest speed, and its pair; 0 if none is."""
        if not self.rows:
            return 0.0, 0
        rows = np.array(self.rows)
        fastest = float(rows[:, 1].max())
        frame = int(rows[:, 0].argmax())
        excess = float(rows[frame, 0])
        return (excess / max(fastest, 1e-30), frame) if excess > tolerance * fastest else (0.0, 0)


def _rms(vectors: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(np.sum(vectors * vectors, axis=1))))
