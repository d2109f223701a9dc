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

from warpdeform.usd.topology import SurfaceMesh, quad_indices, texture_coordinates

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

    def paint(self, gprim: UsdGeom.Gprim, name: str, color: Iterable[float], roughness: float) -> None:
        """Give a gprim its display colour and bind a preview material of its own, called `name`."""
        gprim.CreateDisplayColorAttr(Vt.Vec3fArray([Gf.Vec3f(*color)]))
        material = UsdShade.Material.Define(self.stage, self.new_path(name, MATERIALS))
        shader = UsdShade.Shader.Define(self.stage, material.GetPath().AppendChild("Surface"))
        shader.CreateIdAttr("UsdPreviewSurface")
        shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set(Gf.Vec3f(*color))
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(float(roughness))
        shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(0.0)
        shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        material.CreateSurfaceOutput().ConnectToSource(shader.ConnectableAPI(), "surface")
        UsdShade.MaterialBindingAPI.Apply(gprim.GetPrim()).Bind(material)

    def polygons(self, path: Sdf.Path, counts: NDArray[np.integer], indices: NDArray[np.integer]) -> UsdGeom.Mesh:
        """Define a mesh that is drawn as it is: constant topology, no subdivision."""
        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.CreateFaceVertexCountsAttr(int_array(counts))
        mesh.CreateFaceVertexIndicesAttr(int_array(indices))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
        return mesh


@dataclass(frozen=True)
class SurfacePaths:
    """The sampled attributes of one surface."""

    mesh: SurfaceMesh
    points: Sdf.Path
    velocities: Sdf.Path
    normals: Sdf.Path
    extent: Sdf.Path


def define_surface(static: StaticStage, surface: SurfaceMesh, units: StageUnits) -> SurfacePaths:
    """Define the mesh of a surface: topology, texture coordinates and material now, samples later."""
    quads = quad_indices(surface)
    path = static.new_path(surface.name)
    mesh = static.polygons(path, np.full(len(quads), 4, np.int32), quads.reshape(-1))
    mesh.CreateDoubleSidedAttr(not surface.closed)
    values, corners = texture_coordinates(surface)
    st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.faceVarying)
    st.Set(Vt.Vec2fArray.FromNumpy(values))
    st.SetIndices(int_array(corners))
    if path.name != surface.name:
        mesh.GetPrim().SetDisplayName(surface.name)
    if surface.thickness:
        thickness = mesh.GetPrim().CreateAttribute("warpdeform:thickness", Sdf.ValueTypeNames.Float, custom=True)
        thickness.Set(surface.thickness * units.per_meter)
    static.paint(mesh, path.name, surface.color, surface.roughness)
    normals = mesh.CreateNormalsAttr()
    mesh.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    return SurfacePaths(
        surface,
        points=static.mark_sampled(mesh.CreatePointsAttr()),
        velocities=static.mark_sampled(mesh.CreateVelocitiesAttr()),
        normals=static.mark_sampled(normals),
        extent=static.mark_sampled(mesh.CreateExtentAttr()),
    )


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
