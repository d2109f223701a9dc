"""warpdeform: elastically deformable curves, surfaces and solids on NVIDIA Warp.

The public names are loaded when they are first used, so that `import warpdeform` needs neither Warp nor USD.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from warpdeform.attachment import Attachment
    from warpdeform.body import Body, Pin, Spring
    from warpdeform.contact import Contact
    from warpdeform.errors import InputError, Mistake, SimulationFailure, WarpdeformError
    from warpdeform.growth import Growth
    from warpdeform.material import Material
    from warpdeform.obstacle import Obstacle
    from warpdeform.scene import load_scene
    from warpdeform.section import Section
    from warpdeform.settings import Settings
    from warpdeform.shape import (
        RestShape,
        arc,
        bent_block,
        block,
        from_array,
        from_file,
        from_map,
        helix,
        line,
        pipe,
        ring,
        root_grid,
        root_line,
        sheet,
        sphere,
        strands,
        torus,
        tube,
    )
    from warpdeform.simulation import Simulation
    from warpdeform.track import Track
    from warpdeform.usd.frames import FrameWriter
    from warpdeform.usd.recorder import Recorder
    from warpdeform.varying import Varying
    from warpdeform.wind import Wind

__version__ = "0.1.0"

__all__ = [
    "Attachment",
    "Body",
    "Contact",
    "FrameWriter",
    "Growth",
    "InputError",
    "Material",
    "Mistake",
    "Obstacle",
    "Pin",
    "Recorder",
    "RestShape",
    "Section",
    "Settings",
    "Simulation",
    "SimulationFailure",
    "Spring",
    "Track",
    "Varying",
    "WarpdeformError",
    "Wind",
    "__version__",
    "arc",
    "bent_block",
    "block",
    "from_array",
    "from_file",
    "from_map",
    "helix",
    "line",
    "load_scene",
    "pipe",
    "ring",
    "root_grid",
    "root_line",
    "sheet",
    "sphere",
    "strands",
    "torus",
    "tube",
]

_HOMES = {
    "attachment": ("Attachment",),
    "body": ("Body", "Pin", "Spring"),
    "contact": ("Contact",),
    "errors": ("InputError", "Mistake", "SimulationFailure", "WarpdeformError"),
    "growth": ("Growth",),
    "material": ("Material",),
    "obstacle": ("Obstacle",),
    "scene": ("load_scene",),
    "section": ("Section",),
    "settings": ("Settings",),
    "shape": (
        "RestShape",
        "arc",
        "bent_block",
        "block",
        "from_array",
        "from_file",
        "from_map",
        "helix",
        "line",
        "pipe",
        "ring",
        "root_grid",
        "root_line",
        "sheet",
        "sphere",
        "strands",
        "torus",
        "tube",
    ),
    "simulation": ("Simulation",),
    "track": ("Track",),
    "usd.frames": ("FrameWriter",),
    "usd.recorder": ("Recorder",),
    "varying": ("Varying",),
    "wind": ("Wind",),
}
"""The module that each public name lives in."""


def __getattr__(name: str) -> object:
    for home, names in _HOMES.items():
        if name in names:
            value = getattr(import_module(f"{__name__}.{home}"), name)
            globals()[name] = value
            return value
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
