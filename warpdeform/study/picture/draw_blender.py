"""Draw pictures with Blender's Cycles. A program of its own: `python draw_blender.py FOLDER`.

It runs in a process apart because Blender brings a USD of its own, which must not meet usd-core's, and because bpy may
live in another Python than the engine. So it imports only bpy, NumPy and the standard library, and takes plain arrays.

FOLDER holds job.json, as `warpdeform.study.picture.blender` writes it, and arrays.npz.

The studio: a seamless matt ground that fades into the backdrop, one large soft key light from the left of the camera,
a bright sky that fills the shadows, and a weak light from behind that lifts edges off the backdrop.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

try:
    import bpy
    import numpy as np
except ImportError as error:
    print(f"cannot import bpy: {error}", file=sys.stderr)
    sys.exit(3)

GROUND_COLOR = (0.44, 0.43, 0.415)
BACKDROP = (0.55, 0.55, 0.55)
"""Linear RGB that the camera sees behind everything: about that of the lit ground, which fades into it."""
SKY = (0.37, 0.41, 0.48)
"""Linear RGB of the light from the sky."""
KEY_COLOR, RIM_COLOR = (1.0, 0.93, 0.84), (0.86, 0.92, 1.0)


class Nodes:
    """A shader tree, built node by node."""

    def __init__(self, owner: Any) -> None:
        owner.use_nodes = True
        self.tree = owner.node_tree
        self.tree.nodes.clear()

    def add(self, kind: str, inputs: dict[str | int, Any] | None = None, **settings: Any) -> Any:
        """Add a node; an input is a value or the output socket of another node."""
        node = self.tree.nodes.new(f"ShaderNode{kind}")
        for setting, value in settings.items():
            setattr(node, setting, value)
        for name, value in (inputs or {}).items():
            if isinstance(value, bpy.types.NodeSocket):
                self.tree.links.new(value, node.inputs[name])
            elif isinstance(value, tuple) and len(value) == 3 and node.inputs[name].type == "RGBA":
                node.inputs[name].default_value = (*value, 1.0)
            else:
                node.inputs[name].default_value = value
        return node


def make_mesh(name: str, points: np.ndarray, triangles: np.ndarray, normals: np.ndarray | None) -> Any:
    """A smooth mesh with these vertex normals; with None, edges above 40 degrees stay sharp."""
    mesh = bpy.data.meshes.new(name)
    mesh.vertices.add(len(points))
    mesh.vertices.foreach_set("co", points.astype(np.float32).ravel())
    mesh.loops.add(3 * len(triangles))
    mesh.loops.foreach_set("vertex_index", triangles.astype(np.int32).ravel())
    mesh.polygons.add(len(triangles))
    mesh.polygons.foreach_set("loop_start", np.arange(0, 3 * len(triangles), 3, dtype=np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(triangles), dtype=bool))
    mesh.update(calc_edges=True)
    if normals is None:
        mesh.set_sharp_from_angle(angle=np.radians(40.0))
    else:
        mesh.normals_split_custom_set_from_vertices(normals.tolist())
    return mesh


def add_item(item: dict[str, Any], arrays: Any) -> Any:
    """Make one body or obstacle of the drawing."""
    key = item["key"]
    normals = arrays[f"{key}.normals"] if item["has_normals"] else None
    mesh = make_mesh(item["name"], arrays[f"{key}.points"], arrays[f"{key}.triangles"], normals)
    colors = arrays[f"{key}.colors"]
    attribute = mesh.color_attributes.new("displayColor", "FLOAT_COLOR", "POINT")
    attribute.data.foreach_set("color", np.column_stack([colors, np.ones(len(colors))]).astype(np.float32).ravel())
    mesh.materials.append(cloth(item) if item["thin"] else solid(item))
    body = bpy.data.objects.new(item["name"], mesh)
    body.cycles.shadow_terminator_geometry_offset = 0.1
    bpy.context.collection.objects.link(body)
    return body


def cloth(item: dict[str, Any]) -> Any:
    """Two-sided cloth: matt, a sheen at grazing angles, some light shining through; a metal is left a metal."""
    material = bpy.data.materials.new(item["name"])
    nodes = Nodes(material)
    color = nodes.add("Attribute", attribute_name="displayColor").outputs["Color"]
    soft = (1.0 - item["metallic"]) * min(1.0, item["roughness"] / 0.8)
    surface = nodes.add("BsdfPrincipled", {
        "Base Color": color, "Roughness": item["roughness"], "Metallic": item["metallic"],
        "Specular IOR Level": 0.5 - 0.3 * soft, "Sheen Weight": 0.12 * soft, "Sheen Roughness": 0.45,
    })  # fmt: skip
    through = nodes.add("BsdfTranslucent", {"Color": color})
    mixed = nodes.add("MixShader", {0: 0.16 * soft, 1: surface.outputs[0], 2: through.outputs[0]})
    nodes.add("OutputMaterial", {"Surface": mixed.outputs[0]})
    return material


def solid(item: dict[str, Any]) -> Any:
    """A solid: colour, roughness and metal as the file has them."""
    material = bpy.data.materials.new(item["name"])
    nodes = Nodes(material)
    color = nodes.add("Attribute", attribute_name="displayColor").outputs["Color"]
    surface = nodes.add("BsdfPrincipled", {
        "Base Color": color, "Roughness": item["roughness"], "Metallic": item["metallic"], "Specular IOR Level": 0.4,
    })  # fmt: skip
    nodes.add("OutputMaterial", {"Surface": surface.outputs[0]})
    return material


def add_ground(height: float, middle: list[float], extent: float) -> None:
    """A matt floor that fades into the backdrop between 1.5 and 9 scene diagonals from the middle."""
    far = 40.0 * extent
    corners = np.array([[-far, -far, 0], [far, -far, 0], [far, far, 0], [-far, far, 0]], dtype=np.float64)
    corners += [middle[0], middle[1], height]
    mesh = make_mesh("ground", corners, np.array([[0, 1, 2], [0, 2, 3]]), None)
    material = bpy.data.materials.new("ground")
    nodes = Nodes(material)
    offset = nodes.add("VectorMath", {0: nodes.add("NewGeometry").outputs["Position"], 1: tuple(corners.mean(axis=0))},
                       operation="SUBTRACT")  # fmt: skip
    away = nodes.add("VectorMath", {0: offset.outputs[0]}, operation="LENGTH").outputs["Value"]
    fade = nodes.add("MapRange", {"Value": away, "From Min": 1.5 * extent, "From Max": 9.0 * extent},
                     interpolation_type="SMOOTHSTEP")  # fmt: skip
    floor = nodes.add("BsdfDiffuse", {"Color": GROUND_COLOR, "Roughness": 0.6})
    backdrop = nodes.add("Emission", {"Color": BACKDROP})
    mixed = nodes.add("MixShader", {0: fade.outputs[0], 1: floor.outputs[0], 2: backdrop.outputs[0]})
    nodes.add("OutputMaterial", {"Surface": mixed.outputs[0]})
    material.cycles.emission_sampling = "NONE"
    mesh.materials.append(material)
    bpy.context.collection.objects.link(bpy.data.objects.new("ground", mesh))


def add_sky() -> None:
    """Even light from all over the sky; the camera sees the backdrop in its stead."""
    world = bpy.data.worlds.new("sky")
    bpy.context.scene.world = world
    nodes = Nodes(world)
    light, backdrop = nodes.add("Background", {"Color": SKY}), nodes.add("Background", {"Color": BACKDROP})
    camera = nodes.add("LightPath").outputs["Is Camera Ray"]
    mixed = nodes.add("MixShader", {0: camera, 1: light.outputs[0], 2: backdrop.outputs[0]})
    nodes.add("OutputWorld", {"Surface": mixed.outputs[0]})


def add_sun(name: str, azimuth: float, elevation: float, strength: float, softness: float, color: Any) -> None:
    """A light from far away: azimuth, elevation and angular diameter in degrees, strength in W/m2."""
    sun = bpy.data.lights.new(name, "SUN")
    sun.energy, sun.angle, sun.color = strength, np.radians(softness), color
    lamp = bpy.data.objects.new(name, sun)
    lamp.rotation_euler = (np.radians(90.0 - elevation), 0.0, np.radians(azimuth + 90.0))
    bpy.context.collection.objects.link(lamp)


def add_camera(view: dict[str, Any]) -> None:
    """Put the camera where the engine has computed it."""
    camera = bpy.data.cameras.new("camera")
    camera.lens, camera.sensor_width, camera.sensor_fit = view["lens"], view["sensor"], "AUTO"
    camera.clip_start, camera.clip_end = 1e-3 * view["distance"], 1e3 * view["distance"]
    eye = bpy.data.objects.new("camera", camera)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = np.array(view["axes"]).T, view["position"]
    eye.matrix_world = matrix.T.tolist()
    bpy.context.collection.objects.link(eye)
    bpy.context.scene.camera = eye


def prepare_renderer(job: dict[str, Any]) -> None:
    """Cycles on the processor, few samples and a denoiser, colours through a gentle film curve."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device, cycles.samples, cycles.seed, cycles.use_light_tree = "CPU", job["samples"], 0, False
    cycles.use_adaptive_sampling, cycles.adaptive_threshold, cycles.adaptive_min_samples = True, 0.1, 8
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 2, 2
    cycles.transmission_bounces = 2
    cycles.use_denoising = bool(bpy.app.build_options.cycles) and job["denoise"]
    if cycles.use_denoising:
        cycles.denoiser, cycles.denoising_prefilter = "OPENIMAGEDENOISE", "FAST"
    render = scene.render
    render.resolution_x, render.resolution_y = job["size"]
    render.resolution_percentage = 100
    render.threads_mode = "FIXED" if job["threads"] else "AUTO"
    if job["threads"]:
        render.threads = job["threads"]
    render.use_persistent_data = True
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    scene.view_settings.view_transform, scene.view_settings.look = "AgX", "AgX - Medium High Contrast"
    scene.view_settings.exposure = job["exposure"]


def main(folder: Path) -> None:
    """Draw all frames of a job."""
    job = json.loads((folder / "job.json").read_text())
    arrays = np.load(folder / "arrays.npz")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    prepare_renderer(job)
    add_sky()
    add_ground(job["ground"], job["middle"], job["extent"])
    azimuth = job["azimuth"]
    add_sun("key", azimuth - 70.0, 42.0, 3.7, 8.0, KEY_COLOR)
    add_sun("rim", azimuth + 150.0, 30.0, 0.9, 20.0, RIM_COLOR)
    add_camera(job["view"])
    for frame in job["frames"]:
        items = [add_item(item, arrays) for item in frame["items"]]
        bpy.context.scene.render.filepath = frame["out"]
        bpy.ops.render.render(write_still=True)
        for item in items:
            bpy.data.objects.remove(item)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
