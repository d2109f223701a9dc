"""Rest shapes of curves, surfaces and solids (design 1.3): pure NumPy, loaded without Warp.

A rest shape is a grid of points. Every shape a scene file can name is one function of `SHAPES`, in its kind's file.
"""

from collections.abc import Callable, Mapping

from warpdeform.shape.curves import helix, line, ring, root_grid, root_line, strands
from warpdeform.shape.numbers import KINDS, checked_nodes
from warpdeform.shape.rest import RestShape, from_array, from_file, from_map, read_positions
from warpdeform.shape.solids import bent_block, block, pipe
from warpdeform.shape.surfaces import arc, sheet, sphere, torus, tube

SHAPES_BY_KIND: Mapping[str, Mapping[str, Callable[..., RestShape]]] = {
    "curve": {"line": line, "helix": helix, "ring": ring},
    "surface": {"sheet": sheet, "arc": arc, "tube": tube, "torus": torus, "sphere": sphere},
    "solid": {"block": block, "bent-block": bent_block, "pipe": pipe},
}
"""Rest shapes of each kind of body by name."""

SHAPES: Mapping[str, Callable[..., RestShape]] = {
    **{name: make for shapes in SHAPES_BY_KIND.values() for name, make in shapes.items()},
    "file": from_file,
}
"""Rest shapes that a scene file names with `kind`; the other keys of the shape are keyword arguments beside `nodes`."""


def kind_of_shape(name: str) -> str:
    """The kind of body that a shape of `SHAPES` is for; empty if it is for any."""
    return next((kind for kind, shapes in SHAPES_BY_KIND.items() if name in shapes), "")


__all__ = [
    "KINDS",
    "SHAPES",
    "SHAPES_BY_KIND",
    "RestShape",
    "arc",
    "bent_block",
    "block",
    "checked_nodes",
    "from_array",
    "from_file",
    "from_map",
    "helix",
    "kind_of_shape",
    "line",
    "pipe",
    "read_positions",
    "ring",
    "root_grid",
    "root_line",
    "sheet",
    "sphere",
    "strands",
    "torus",
    "tube",
]
