"""Pictures of results, without a screen: a still of one frame, or a strip of several side by side.

`render_still` and `render_strip` draw any USD file that the engine has written (and most others) with Blender where its
Python package bpy is installed, else with matplotlib.
"""

from warpdeform.study.picture.camera import Camera
from warpdeform.study.picture.render import Picture, render_still, render_strip

__all__ = ["Camera", "Picture", "render_still", "render_strip"]
