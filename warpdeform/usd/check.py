"""Checks of a USD file: what usd-core's validators say, and what none of them looks at, the samples themselves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from pxr import Tf, Usd, UsdGeom, UsdValidation

from warpdeform.errors import WarpdeformError
from warpdeform.usd.check_curves import CurvesCheck
from warpdeform.usd.check_mesh import MeshCheck
from warpdeform.usd.check_points import Findings, PointsCheck, check_times
from warpdeform.usd.check_tetrahedra import TetrahedraCheck
from warpdeform.usd.opening import open_stage

_CHECKS: dict[type[UsdGeom.PointBased], type[PointsCheck]] = {
    UsdGeom.Mesh: MeshCheck,
    UsdGeom.BasisCurves: CurvesCheck,
    UsdGeom.TetMesh: TetrahedraCheck,
}
"""The checks of samples by the schema of the prim."""


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
    extents are those of the points (and of the widths of curves); normals have length 1 and lie on the side of the
    winding; closed meshes enclose a positive volume, and so does every tetrahedron; velocities agree with the motion of
    the points. Frames are read one after the other, so memory does not grow with their number.

    Args:
        path: A USD file.
        tolerance: How far the mean velocity of two samples may lie from the finite difference of their points, root
            mean square over the nodes, as a share of the fastest such speed of the prim. Half the change of the
            velocity is allowed besides: some integrators give the velocity at the end of a step, not in its middle.

    Returns:
        One line for each kind of mistake of each prim; empty if there is none.

    Raises:
        InputError: The file cannot be opened.
    """
    stage = open_stage(path, "file")
    findings = Findings()
    prims = list(stage.Traverse())
    _check_units(stage, findings)
    if any(attribute.GetNumTimeSamples() for prim in prims for attribute in prim.GetAuthoredAttributes()):
        _check_rates(stage, findings)
    codes = [float(c) for c in np.arange(stage.GetStartTimeCode(), stage.GetEndTimeCode() + 0.5)]
    for prim in prims:
        if prim.IsA(UsdGeom.Xformable):
            for operation in UsdGeom.Xformable(prim).GetOrderedXformOps():
                _check_pose(operation.GetAttr(), codes, findings)
        for schema, check in _CHECKS.items():
            if prim.IsA(schema):
                check(schema(prim), codes, findings).run(stage.GetTimeCodesPerSecond(), tolerance)
    return findings.lines()


def _check_units(stage: Usd.Stage, findings: Findings) -> None:
    root = stage.GetDefaultPrim()
    if findings.expect(bool(root), "stage", "there is no default prim"):
        findings.expect(bool(Usd.ModelAPI(root).GetKind()), root.GetPath(), "the default prim has no kind")
    for key in ("upAxis", "metersPerUnit"):
        findings.expect(stage.HasAuthoredMetadata(key), "stage", f"{key} is not authored")


def _check_rates(stage: Usd.Stage, findings: Findings) -> None:
    for key in ("timeCodesPerSecond", "startTimeCode", "endTimeCode"):
        findings.expect(stage.HasAuthoredMetadata(key), "stage", f"{key} is not authored")
    rates = (stage.GetTimeCodesPerSecond(), stage.GetFramesPerSecond())
    same = rates[0] == rates[1] and stage.HasAuthoredMetadata("framesPerSecond")
    findings.expect(same, "stage", "framesPerSecond is not authored as timeCodesPerSecond is", f"{rates[1]:g}")
    forward = stage.GetStartTimeCode() <= stage.GetEndTimeCode()
    findings.expect(forward, "stage", "the last time code precedes the first")


def _check_pose(attribute: Usd.Attribute, codes: list[float], findings: Findings) -> None:
    if not attribute.GetNumTimeSamples() or not check_times(attribute, codes, findings):
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
