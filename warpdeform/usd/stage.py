"""What a USD file holds besides its samples: units, times, prims, topology and materials (design 4.2)."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from numbers import Integral, Real

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Kind, Sdf, Tf, Usd, UsdGeom, UsdShade, Vt

from warpdeform.usd.geometry import extent

ROOT = Sdf.Path("/World")
MATERIALS = ROOT.AppendChild("Materials")
FIRST_FRAME = 1


@dataclass(frozen=True)
class StageUnits:
    """Units and rate of a stage.

    Attributes:
        fps: Frames, and time codes, per second.
        up_axis: "Y" or "Z": the axis of the given coordinates that points up. Nothing is turned.
        meters_per_unit: Length of a unit of the file, m. Lengths are given in metres and divided by it.
    """

    fps: float
    up_axis: str = "Z"
    meters_per_unit: float = 1.0

    @property
    def per_meter(self) -> float:
        """Units of the file per metre."""
        return 1.0 / self.meters_per_unit

    def author(self, layer: Sdf.Layer, frames: int, data: Mapping[str, object]) -> None:
        """Write the metadata that only a root layer can give.

        Args:
            layer: The layer.
            frames: Number of samples, the first at time code 1.
            data: What made the file; kept under `warpdeform` in the layer's customLayerData.
        """
        layer.pseudoRoot.SetInfo(UsdGeom.Tokens.upAxis, self.up_axis)
        layer.pseudoRoot.SetInfo(UsdGeom.Tokens.metersPerUnit, self.meters_per_unit)
        layer.timeCodesPerSecond = self.fps
        layer.framesPerSecond = self.fps
        layer.startTimeCode = FIRST_FRAME
        layer.endTimeCode = FIRST_FRAME + frames - 1
        layer.defaultPrim = ROOT.name
        layer.customLayerData = {"warpdeform": layer_data(data)}


@dataclass
class StaticStage:
    """The stage without its samples.

    Attributes:
        stage: A stage in memory.
        sampled: The attributes that get one sample per frame, with their types.
    """

    stage: Usd.Stage = field(default_factory=Usd.Stage.CreateInMemory)
    sampled: dict[Sdf.Path, Sdf.ValueTypeName] = field(default_factory=dict)

    def __post_init__(self) -> None:
        root = UsdGeom.Xform.Define(self.stage, ROOT).GetPrim()
        Usd.ModelAPI(root).SetKind(Kind.Tokens.component)
        self.stage.SetDefaultPrim(root)
        UsdGeom.Scope.Define(self.stage, MATERIALS)

    def new_path(self, name: str, parent: Sdf.Path = ROOT) -> Sdf.Path:
        """Return a path for a prim called `name`: the name made valid, and numbered where it is taken."""
        valid = name if Sdf.Path.IsValidIdentifier(name) else Tf.MakeValidIdentifier(name)
        path, number = parent.AppendChild(valid), 1
        while self.stage.GetPrimAtPath(path):
            number += 1
            path = parent.AppendChild(f"{valid}_{number}")
        return path

    def mark_sampled(self, attribute: Usd.Attribute) -> Sdf.Path:
        """Note that `attribute` gets samples; it must have no default, which would hide those of value clips."""
        self.sampled[attribute.GetPath()] = attribute.GetTypeName()
        return attribute.GetPath()

    def animate(self, gprim: UsdGeom.PointBased) -> PointSamples:
        """Let points, velocities and extent of a prim that is made of points have samples."""
        attributes = gprim.CreatePointsAttr(), gprim.CreateVelocitiesAttr(), gprim.CreateExtentAttr()
        return PointSamples(*(self.mark_sampled(attribute) for attribute in attributes))

    def animate_normals(self, mesh: UsdGeom.Mesh, interpolation: str) -> Sdf.Path:
        """Let the normals of a mesh, one for each `vertex` or face corner (`faceVarying`), have samples."""
        normals = mesh.CreateNormalsAttr()
        mesh.SetNormalsInterpolation(interpolation)
        return self.mark_sampled(normals)

    def paint(self, gprim: UsdGeom.Gprim, name: str, color: Iterable[float], roughness: float) -> None:
        """Give a gprim the name of what it shows, its display colour, and a preview material of its own."""
        prim = gprim.GetPrim()
        if prim.GetName() != name:
            prim.SetDisplayName(name)
        gprim.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*color)]))
        material = UsdShade.Material.Define(self.stage, self.new_path(prim.GetName(), MATERIALS))
        shader = UsdShade.Shader.Define(self.stage, material.GetPath().AppendChild("Surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(float(roughness))
        shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
        shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(prim).Bind(material)

    def texture(self, mesh: UsdGeom.Mesh, values: NDArray[np.float32], corners: NDArray[np.integer]) -> None:
        """Give a mesh texture coordinates (k, 2), and each face corner the number of its own."""
        names, where = Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", names, where)
        st.Set(Vt.Vec2fArray.FromNumpy(values))
        st.SetIndices(int_array(corners))

    def note(self, gprim: UsdGeom.Gprim, name: str, value: float) -> None:
        """Keep a number of ours with a prim, as `warpdeform:name`."""
        attribute = gprim.GetPrim().CreateAttribute(f"warpdeform:{name}", Sdf.ValueTypeNames.Float, custom=True)
        attribute.Set(value)

    def polygons(self, path: Sdf.Path, counts: NDArray[np.integer], indices: NDArray[np.integer]) -> UsdGeom.Mesh:
        """Define a mesh that is drawn as it is: constant topology, no subdivision."""
        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.CreateFaceVertexCountsAttr(int_array(counts))
        mesh.CreateFaceVertexIndicesAttr(int_array(indices))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
        return mesh

    def lines(
        self, path: Sdf.Path, counts: NDArray[np.integer], widths: NDArray[np.floating], closed: bool
    ) -> UsdGeom.BasisCurves:
        """Define curves of straight segments: points of each curve, one width or one per point, closed or open."""
        curves = UsdGeom.BasisCurves.Define(self.stage, path)
        curves.CreateTypeAttr(UsdGeom.Tokens.linear)
        curves.CreateWrapAttr(UsdGeom.Tokens.periodic if closed else UsdGeom.Tokens.nonperiodic)
        curves.CreateCurveVertexCountsAttr(int_array(counts))
        curves.CreateWidthsAttr(Vt.FloatArray.FromNumpy(np.ascontiguousarray(widths, dtype=np.float32)))
        curves.SetWidthsInterpolation(UsdGeom.Tokens.constant if len(widths) == 1 else UsdGeom.Tokens.vertex)
        return curves

    def tetrahedra(
        self, path: Sdf.Path, corners: NDArray[np.integer], surface: NDArray[np.integer], color: Iterable[float]
    ) -> UsdGeom.TetMesh:
        """Define tetrahedra (k, 4) with the triangles (m, 3) of their surface, for tools: hidden unless asked for."""
        mesh = UsdGeom.TetMesh.Define(self.stage, path)
        mesh.CreateTetVertexIndicesAttr(Vt.Vec4iArray.FromNumpy(np.ascontiguousarray(corners, dtype=np.int32)))
        mesh.CreateSurfaceFaceVertexIndicesAttr(Vt.Vec3iArray.FromNumpy(np.ascontiguousarray(surface, dtype=np.int32)))
        mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
        mesh.CreatePurposeAttr(UsdGeom.Tokens.guide)
        mesh.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*color)]))
        return mesh


@dataclass(frozen=True)
class PointSamples:
    """The sampled attributes that every prim made of points has."""

    points: Sdf.Path
    velocities: Sdf.Path
    extent: Sdf.Path

    def sample(
        self, points: NDArray[np.float32], velocities: NDArray[np.float32], margin: float = 0.0
    ) -> dict[Sdf.Path, NDArray[np.float32]]:
        """One sample: points and velocities (n, 3), and the box that reaches `margin` beyond the points."""
        low, high = extent(points)
        box = np.array([low - margin, high + margin], dtype=np.float32)
        return {self.points: points, self.velocities: velocities, self.extent: box}


def vector_array(values: NDArray[np.floating]) -> Vt.Vec3fArray:
    """USD array of vectors (..., 3)."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(values.reshape(-1, 3), dtype=np.float32))


def int_array(values: NDArray[np.integer]) -> Vt.IntArray:
    """USD array of integers."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values.reshape(-1), dtype=np.int32))


def layer_data(value: object) -> object:
    """Turn a value into one that a layer's customLayerData can hold.

    Mappings stay dictionaries (entries that are `None` are left out), text, truth values and numbers stay what they
    are, everything else becomes JSON text, or plain text where JSON has no word for it.
    """
    if isinstance(value, Mapping):
        return {str(key): layer_data(item) for key, item in value.items() if item is not None}
    if isinstance(value, Enum):
        return layer_data(value.value)
    if isinstance(value, str | bool):
        return value
    if isinstance(value, np.generic):
        return layer_data(value.item())
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        return float(value)
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return json.dumps(value, default=str)
