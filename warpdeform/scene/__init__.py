"""Scene files: a TOML file becomes bodies, obstacles, wind and settings, or a list of everything wrong with it."""

from warpdeform.scene.build import BuiltScene
from warpdeform.scene.overrides import Override, parse_override
from warpdeform.scene.read import load_scene, scene_description, scene_names

__all__ = ["BuiltScene", "Override", "load_scene", "parse_override", "scene_description", "scene_names"]
