"""Quantities that vary over a body: given per node or cell, by a function, or by an image (design 1.4).

Nothing here knows what kind of body it is, nor what the quantity means: a grid has nodes and cells, and places on it
have parameters from 0 to 1 along each axis.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.array_file import PICTURES, TABLES, read_array, read_picture
from warpdeform.errors import InputError, Mistake
from warpdeform.grid import ParameterGrid
from warpdeform.shape.numbers import numbers

Array = NDArray[np.float64]

FORMATS = f"Use a grey picture ({', '.join(PICTURES)}) or an array ({', '.join(TABLES)})."
"""What a file may be."""


@dataclass(frozen=True, eq=False)
class Varying:
    """A number for every place of a body.

    It is given in one of four ways:

    * one value per node or per cell, ``Varying(array)``: the shape of the array says which (per node, where both are
      one). Nodes have the mean of the cells around them, cells that of their corners. Strands of a curve that are all
      alike take one value per node of one of them.
    * a function of the parameters, ``Varying(lambda u, v: ...)``, of arrays from 0 to 1 along each axis.
    * an image, `Varying.image`: stretched over the whole body, whatever its nodes.
    * a file of either, `Varying.file` and `Varying.image`.

    Attributes:
        source: Array, or function of the parameters.
        stretched: The array is an image.
        name: Where it comes from, for messages.

    Raises:
        InputError: No array of finite numbers with one to three axes, and no function.
    """

    source: Array | Callable[..., ArrayLike]
    stretched: bool = False
    name: str = ""

    def __post_init__(self) -> None:
        if callable(self.source):
            return
        try:
            values = np.array(self.source, dtype=np.float64)
        except (TypeError, ValueError):
            values = np.zeros(())
        if not 1 <= values.ndim <= 3 or values.size == 0:
            remedy = "Give one number per node or cell, or a function of the parameters."
            raise InputError(Mistake("values", self._said, "is neither an array of numbers nor a function", remedy))
        if not np.isfinite(values).all():
            where = [int(k) for k in np.argwhere(~np.isfinite(values))[0]]
            raise InputError(Mistake("values", self._said, f"is not finite at {where}", "Give finite numbers."))
        values.setflags(write=False)
        object.__setattr__(self, "source", values)

    @staticmethod
    def image(image: ArrayLike | str | Path, range: Sequence[float] | None = None) -> "Varying":  # noqa: A002
        """An image that is stretched over the body, linear between the middles of its pixels.

        Where pixels are finer than the steps of the grid, a cell or node has the mean of those within its step: thin
        lines are not lost between nodes. Along periodic axes the image repeats itself.

        Args:
            image: A .pgm picture, u to the right and v upwards; or an array, or a file of one, with u along the first
                axis.
            range: Values of black and white, or of 0 and 1 in an array; None takes the numbers as they are.

        Raises:
            InputError: An unreadable file, a single pixel, or numbers outside 0 to 1 with a range.
        """
        name = ""
        if isinstance(image, str | Path):
            path, name = Path(image), str(image)
            if path.suffix in PICTURES:
                pixels = read_picture(path, "image", FORMATS)[::-1].T
            else:
                pixels = read_array(path, "image", "values", _instead_of(path.suffix))
        else:
            pixels = Varying(np.asarray(image)).values
        if pixels.size < 2:
            remedy = "Use at least two pixels, or a number in place of the image."
            raise InputError(Mistake("image", name or None, "has one pixel, which does not vary", remedy))
        if range is not None:
            ends = numbers("range", range, 2, "Use the values of black and white, for example [0.0002, 0.001].")
            if pixels.min() < 0.0 or pixels.max() > 1.0:
                problem = f"holds values from {pixels.min():.6g} to {pixels.max():.6g}, which do not lie within 0 to 1"
                remedy = "Scale it to 0 to 1, or leave out range to take the values as they are."
                raise InputError(Mistake("image", name or None, problem, remedy))
            pixels = ends[0] + (ends[1] - ends[0]) * pixels
        return Varying(pixels, stretched=True, name=name)

    @staticmethod
    def file(path: str | Path) -> "Varying":
        """One value per node or cell from a .npy, .npz ("values") or .csv file (a line for each u).

        Raises:
            InputError: A missing or unreadable file.
        """
        formats = f"Use an array of one number per node or cell: {', '.join(TABLES)}."
        return Varying(read_array(Path(path), "array", "values", formats), name=str(path))

    @property
    def values(self) -> Array:
        """The array."""
        assert isinstance(self.source, np.ndarray)
        return self.source

    @property
    def bounds(self) -> tuple[float, float] | None:
        """Smallest and largest number of an array; None of a function, which are known on a grid only."""
        return None if callable(self.source) else (float(self.values.min()), float(self.values.max()))

    def at_nodes(self, grid: ParameterGrid) -> Array:
        """Values at the nodes, shape (*nodes).

        Raises:
            InputError: An array that does not fit the grid, a function that fails to give a finite number each.
        """
        if callable(self.source):
            return self._called(grid.parameters())
        if self.stretched:
            return self._resampled(grid, grid.parameters())
        values, per_node = self._fitted(grid)
        return values if per_node else grid.cells_to_nodes(values) / grid.cells_to_nodes(np.ones(grid.cells))

    def at_cells(self, grid: ParameterGrid) -> Array:
        """Values at the middles of the cells, shape (*cells).

        Raises:
            InputError: As `at_nodes`.
        """
        if callable(self.source):
            return self._called(grid.cell_parameters())
        if self.stretched:
            return self._resampled(grid, grid.cell_parameters())
        values, per_node = self._fitted(grid)
        return grid.cell_means(values) if per_node else values

    @property
    def _said(self) -> object:
        """What messages show as the value."""
        if self.name or callable(self.source):
            return self.name or None
        return np.shape(self.source) or self.source

    def _fitted(self, grid: ParameterGrid) -> tuple[Array, bool]:
        """The array in the shape of the nodes or of the cells, and whether it is per node."""
        values = self.values
        if grid.dimension == 1 and values.ndim == 1:
            values = np.repeat(values[:, None], grid.nodes[1], axis=1)
        for shape, per_node in ((grid.nodes, True), (grid.cells, False)):
            if values.shape == shape:
                return np.array(values), per_node
        problem = f"has the shape {_times(self.values.shape)}, which is that of neither nodes nor cells"
        remedy = f"Give {_times(grid.nodes)} values, one per node, or {_times(grid.cells)}, one per cell"
        raise InputError(Mistake("values", self.name or None, problem, f"{remedy}; or an image, which is stretched."))

    def _called(self, parameters: Array) -> Array:
        assert callable(self.source)
        places = parameters.shape[:-1]
        try:
            values = np.broadcast_to(np.asarray(self.source(*np.moveaxis(parameters, -1, 0)), dtype=np.float64), places)
        except (TypeError, ValueError) as error:
            remedy = f"Take {parameters.shape[-1]} arrays of parameters and give one of the same shape."
            raise InputError(Mistake("values", None, f"is a function that fails ({error})", remedy)) from None
        if not np.isfinite(values).all():
            where = [round(float(p), 3) for p in parameters[tuple(np.argwhere(~np.isfinite(values))[0])]]
            problem = f"is a function that is not finite at the parameters {where}"
            raise InputError(Mistake("values", None, problem, "Give finite numbers from 0 to 1 along each axis."))
        return np.array(values)

    def _resampled(self, grid: ParameterGrid, parameters: Array) -> Array:
        """The image at places of the grid; strands of a curve are its second axis."""
        values = self.values
        if values.ndim != len(grid.nodes):
            problem = f"has {_times(values.shape)} pixels for a body of {len(grid.nodes)} axes"
            remedy = f"Use an image with {len(grid.nodes)} axes."
            raise InputError(Mistake("image", self.name or None, problem, remedy))
        for axis in range(values.ndim):
            at = np.moveaxis(parameters[..., axis], axis, 0).reshape(parameters.shape[axis], -1)[:, 0]
            weights = _axis_weights(at, 1.0 / max(grid.cells[axis], 1), values.shape[axis], grid.periodic[axis])
            values = np.moveaxis(np.tensordot(weights, values, axes=(1, axis)), 0, axis)
        return values


def _axis_weights(at: Array, step: float, pixels: int, periodic: bool) -> Array:
    """Weights of the pixels of one axis at some parameters, shape (places, pixels); rows add up to 1.

    The mean of the pixels over a step, but at least over one pixel: which is to be linear between their middles. Beyond
    the ends of an open axis the outer pixels go on.
    """
    width = max(step * pixels, 1.0)
    start, end = at * pixels - 0.5 * width, at * pixels + 0.5 * width
    beyond = int(np.ceil(0.5 * width)) + 1
    weights = np.zeros((len(at), pixels))
    for pixel in range(-beyond, pixels + beyond):
        covered = np.maximum(np.minimum(end, pixel + 1.0) - np.maximum(start, pixel), 0.0)
        weights[:, pixel % pixels if periodic else min(max(pixel, 0), pixels - 1)] += covered / width
    return weights


def _instead_of(suffix: str) -> str:
    """What to do about a file of another kind."""
    if suffix.lower() in (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".exr"):
        return f"{FORMATS} Image programs save grey pictures as .pgm, too."
    return FORMATS


def _times(shape: Sequence[int]) -> str:
    return " x ".join(str(n) for n in shape)
