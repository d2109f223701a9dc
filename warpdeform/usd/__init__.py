"""USD: writing frames, reading meshes, checking files.

Names are looked up at their first use, so that importing this package does not import pxr.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from warpdeform.usd.check import check_stage, schema_errors
    from warpdeform.usd.curves import CurveSet
    from warpdeform.usd.frames import FrameWriter
    from warpdeform.usd.mesh import read_mesh, warp_asset
    from warpdeform.usd.output import check_output
    from warpdeform.usd.solid import SolidBlock
    from warpdeform.usd.surface import SurfaceMesh

_PLACES = {
    "CurveSet": "curves",
    "FrameWriter": "frames",
    "SolidBlock": "solid",
    "SurfaceMesh": "surface",
    "check_output": "output",
    "check_stage": "check",
    "schema_errors": "check",
    "read_mesh": "mesh",
    "warp_asset": "mesh",
}

__all__ = [
    "CurveSet",
    "FrameWriter",
    "SolidBlock",
    "SurfaceMesh",
    "check_output",
    "check_stage",
    "read_mesh",
    "schema_errors",
    "warp_asset",
]


def __getattr__(name: str) -> object:
    """Import a public name from the module that holds it."""
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
