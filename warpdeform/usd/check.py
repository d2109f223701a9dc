"""Checks of a USD file: what usd-core's validators say, and what none of them looks at, the samples themselves."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, Usd, UsdGeom, UsdValidation

from warpdeform.errors import WarpdeformError
from warpdeform.usd.opening import open_stage

_ROUNDING = 2.0**-22  # a few units in the last place of a float32


def schema_errors(path: str | Path) -> list[str]:
    """Everything that usd-core's validators find in a file, one line each.

    Raises:
        InputError: The file cannot be opened.
        WarpdeformError: This release of usd-core cannot load its own validators (25.11 and older).
    """
    stage = open_stage(path, "file")
    try:
        validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
        found = UsdValidation.ValidationContext(validators).Validate(stage)
    except Tf.ErrorException as error:
        version = ".".join(str(part) for part in Usd.GetVersion()[1:])
        raise WarpdeformError(f"the validators of usd-core {version} cannot be loaded: update usd-core") from error
    return [f"{error.GetName()}: {error.GetMessage()}" for error in found]


def check_stage(path: str | Path, tolerance: float = 0.1) -> list[str]:
    """Check the units, times and samples of a file.

    Units, the default prim and, where something moves, the rates are authored; topology is constant and sound; every
    sampled attribute has one sample at each time code from the stage's first to its last; all numbers are finite;
    extents are those of the points; normals have length 1 and lie on the side of the winding; closed meshes enclose a
    positive volume; velocities agree with the motion of the points. Frames are read one after the other, so memory
    does not grow with their number.

    Args:
        path: A USD file.
        tolerance: How far the mean velocity of two samples may lie from the finite difference of their points, root
            mean square over the nodes, as a share of the fastest such speed of the mesh. Half the change of the
            velocity is allowed besides: some integrators give the velocity at the end of a step, not in its middle.

    Returns:
        One line for each kind of mistake of each prim; empty if there is none.

    Raises:
        InputError: The file cannot be opened.
    """
    stage = open_stage(path, "file")
    findings = _Findings()
    prims = list(stage.Traverse())
    _check_units(stage, findings)
    if any(attribute.GetNumTimeSamples() for prim in prims for attribute in prim.GetAuthoredAttributes()):
        _check_rates(stage, findings)
    codes = [float(c) for c in np.arange(stage.GetStartTimeCode(), stage.GetEndTimeCode() + 0.5)]
    for prim in prims:
        if prim.IsA(UsdGeom.Xformable):
            for operation in UsdGeom.Xformable(prim).GetOrderedXformOps():
                _check_pose(operation.GetAttr(), codes, findings)
        if prim.IsA(UsdGeom.Mesh):
            _MeshCheck(UsdGeom.Mesh(prim), codes, findings).run(stage.GetTimeCodesPerSecond(), tolerance)
    return findings.lines()


@dataclass
class _Findings:
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
        result = []
        for (place, kind), detail in self.first.items():
            more = self.count[place, kind] - 1
            result.append(f"{place}: {kind}{f' ({detail})' if detail else ''}{f', and {more} more' if more else ''}")
        return result


def _check_units(stage: Usd.Stage, findings: _Findings) -> None:
    root = stage.GetDefaultPrim()
    if findings.expect(bool(root), "stage", "there is no default prim"):
        findings.expect(bool(Usd.ModelAPI(root).GetKind()), root.GetPath(), "the default prim has no kind")
    for key in ("upAxis", "metersPerUnit"):
        findings.expect(stage.HasAuthoredMetadata(key), "stage", f"{key} is not authored")


def _check_rates(stage: Usd.Stage, findings: _Findings) -> None:
    for key in ("timeCodesPerSecond", "startTimeCode", "endTimeCode"):
        findings.expect(stage.HasAuthoredMetadata(key), "stage", f"{key} is not authored")
    rates = (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond())
    same = rates[0] == rates[1] and stage.HasAuthoredMetadata("framesPerSecond")
    findings.expect(same, "stage", "framesPerSecond is not authored as timeCodesPerSecond is", f"{rates[1]:g}")
    forward = stage.GetStartTimeCode() <= stage.GetEndTimeCode()
    findings.expect(forward, "stage", "the last time code precedes the first")


def _check_times(attribute: Usd.Attribute, codes: list[float], findings: _Findings) -> bool:
    times = attribute.GetTimeSamples()
    span = f"{len(times)} samples from {times[0]:g} to {times[-1]:g}" if times else "no samples"
    kind = f"{attribute.GetName()} does not have one sample at each time code from the stage's first to its last"
    return findings.expect(times == codes, attribute.GetPrim().GetPath(), kind, span)


def _check_pose(attribute: Usd.Attribute, codes: list[float], findings: _Findings) -> None:
    if not attribute.GetNumTimeSamples() or not _check_times(attribute, codes, findings):
        return
    place, name = attribute.GetPrim().GetPath(), attribute.GetName()
    for code in codes:
        value = attribute.Get(code)
        quaternion = hasattr(value, "GetImaginary")
        parts = [*value.GetImaginary(), value.GetReal()] if quaternion else value
        numbers = np.array(parts, dtype=np.float64)
        findings.expect(np.isfinite(numbers).all(), place, f"{name} is not finite", f"time code {code:g}")
        if quaternion:
            unit = abs(float(np.linalg.norm(numbers)) - 1.0) < 1e-4
            findings.expect(unit, place, f"{name} is not a unit quaternion", f"time code {code:g}")


class _MeshCheck:
    """The checks of one mesh."""

    def __init__(self, mesh: UsdGeom.Mesh, codes: list[float], findings: _Findings) -> None:
        self.mesh, self.findings, self.path = mesh, findings, mesh.GetPath()
        self.animated = mesh.GetPointsAttr().GetNumTimeSamples() > 0
        self.times: list[Any] = [Usd.TimeCode(c) for c in codes] if self.animated else [Usd.TimeCode.EarliestTime()]
        self.codes = codes
        self.counts = np.array(mesh.GetFaceVertexCountsAttr().Get() or [], dtype=np.int64)
        self.indices = np.array(mesh.GetFaceVertexIndicesAttr().Get() or [], dtype=np.int64)
        self.reversed = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded

    def expect(self, good: bool | np.bool_, kind: str, detail: str = "") -> bool:
        return self.findings.expect(good, self.path, kind, detail)

    def run(self, rate: float, tolerance: float) -> None:
        sampled = [self.mesh.GetPointsAttr(), self.mesh.GetExtentAttr()]
        optional = (self.mesh.GetVelocitiesAttr(), self.mesh.GetNormalsAttr())
        sampled += [attribute for attribute in optional if attribute.HasAuthoredValue()]
        if self.animated:
            complete = [_check_times(attribute, self.codes, self.findings) for attribute in sampled]
            if not all(complete):
                return
        if not self._topology():
            return
        motion = _Motion(rate)
        for time in self.times:
            where = f"time code {time.GetValue():g}" if self.animated else ""
            points = self._vectors(self.mesh.GetPointsAttr(), time, where)
            if points is None or not self.expect(len(points) == self.size, "the number of points changes", where):
                continue
            self._extent(points, time, where)
            self._sides(points, time, where)
            if self.animated and self.mesh.GetVelocitiesAttr().HasAuthoredValue():
                velocities = self._vectors(self.mesh.GetVelocitiesAttr(), time, where)
                if velocities is not None and self.expect(
                    velocities.shape == points.shape, "there are not as many velocities as points", where
                ):
                    motion.add(points, velocities)
        worst, frame = motion.worst(tolerance)
        detail = f"{worst:.2g} of the fastest from time code {self.codes[frame]:g} on" if worst else ""
        self.expect(not worst, "velocities do not agree with the motion of the points", detail)

    def _topology(self) -> bool:
        """Check the faces, which must be the same at all times, against the number of points of the first sample."""
        for attribute in (self.mesh.GetFaceVertexCountsAttr(), self.mesh.GetFaceVertexIndicesAttr()):
            self.expect(not attribute.GetNumTimeSamples(), f"{attribute.GetName()} changes over time")
        self.size = len(self.mesh.GetPointsAttr().Get(self.times[0]) or [])
        sound = len(self.counts) > 0 and self.counts.min() >= 3 and self.counts.sum() == len(self.indices)
        sound = sound and self.indices.min() >= 0 and self.indices.max() < self.size
        return self.expect(sound, "the faces do not fit the points")

    def _vectors(self, attribute: Usd.Attribute, time: Usd.TimeCode, where: str) -> NDArray[np.float64] | None:
        """Vectors of an attribute (n, 3), or None and a finding where they are missing or not finite."""
        value = attribute.Get(time)
        if not self.expect(value is not None, f"{attribute.GetName()} has no value", where):
            return None
        array = np.array(value, dtype=np.float64).reshape(-1, 3)
        finite = np.isfinite(array).all(axis=1)
        detail = "" if finite.all() else f"element {int(np.argmin(finite))}, {where}".rstrip(", ")
        return array if self.expect(finite.all(), f"{attribute.GetName()} is not finite", detail) else None

    def _extent(self, points: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        if not self.expect(self.mesh.GetExtentAttr().HasAuthoredValue(), "there is no extent"):
            return
        box = self._vectors(self.mesh.GetExtentAttr(), time, where)
        if box is not None:
            right = np.stack([points.min(axis=0), points.max(axis=0)])
            near = box.shape == (2, 3) and np.allclose(box, right, rtol=0.0, atol=_ROUNDING * np.abs(right).max())
            self.expect(near, "the extent is not that of the points", where)

    def _sides(self, points: NDArray[np.float64], time: Usd.TimeCode, where: str) -> None:
        """Check normals against the winding, and the volume of a closed mesh."""
        corners = points[self.indices]
        starts = np.cumsum(self.counts) - self.counts
        following = np.arange(1, len(corners) + 1)
        following[starts + self.counts - 1] = starts
        centres = np.add.reduceat(corners, starts) / self.counts[:, None]
        arms = corners - np.repeat(centres, self.counts, axis=0)
        areas = 0.5 * np.add.reduceat(np.cross(arms, arms[following]), starts) * (-1.0 if self.reversed else 1.0)
        if self._closed(following):
            volume = float(np.sum(areas * (centres - points.mean(axis=0)))) / 3.0
            self.expect(volume > 0.0, "the mesh is closed, but its faces look inwards", where)
        if not self.mesh.GetNormalsAttr().HasAuthoredValue():
            return
        normals = self._vectors(self.mesh.GetNormalsAttr(), time, where)
        if normals is None:
            return
        if self.mesh.GetNormalsInterpolation() in (UsdGeom.Tokens.vertex, UsdGeom.Tokens.varying):
            if not self.expect(len(normals) == len(points), "there are not as many normals as points", where):
                return
            at_corners = normals[self.indices]
        else:
            at_corners = normals
            if not self.expect(len(normals) == len(corners), "there are not as many normals as face corners", where):
                return
        unit = np.abs(np.linalg.norm(normals, axis=1) - 1.0) < 1e-3
        self.expect(unit.all(), "normals do not have length 1", where)
        against = np.einsum("ij,ij->i", at_corners, np.repeat(areas, self.counts, axis=0)) < 0.0
        self.expect(against.mean() < 0.1, "normals lie on the other side than the winding", where)

    def _closed(self, following: NDArray[np.int64]) -> bool:
        """Whether every edge belongs to exactly two faces."""
        if not hasattr(self, "_is_closed"):
            edges = np.sort(np.stack([self.indices, self.indices[following]], axis=1), axis=1)
            self._is_closed = bool((np.unique(edges, axis=0, return_counts=True)[1] == 2).all())
        return self._is_closed


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
