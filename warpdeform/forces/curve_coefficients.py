"""What the curve kernels weight strains with, and the frames that curves start from (design 1.3, Curve).

All lengths are undivided differences of the rest shape, so that parameter spacings enter only with the paper's weights.
Arrays of a curve have its strands along the second axis: shape (n, strands, ...) at nodes, as many rows less one at
the segments of an open curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpdeform.coefficients import CurveCoefficients, Number, PaperCurveWeights
from warpdeform.errors import InputError, Mistake
from warpdeform.grid import ParameterGrid
from warpdeform.kernels.curve_geometry import FOLD
from warpdeform.material import Material
from warpdeform.section import Section

Array = NDArray[np.float64]
Sections = Section | Sequence[Section] | None
"""One section for all strands, or one each."""

STRAIGHT = 1e-9
"""Largest curvature binormal of a curve that counts as straight: round-off of the rest shape."""
FEWEST_CLOSED = 4
"""Nodes that a closed curve needs: with three, both neighbours of a node would be next but one to each other."""


@dataclass(frozen=True)
class CurveStiffness:
    """Weights of the strains of one curve body; roots, because energies are half the sum of their squares.

    Attributes:
        axial: Weight R of |b|^2 - l0^2 at the segments, R^2 = EA / l0^3, shape (segments, strands).
        bending: At the nodes: none without bending, shape (n, strands, 0); the weight of kb, R^2 = EI / l, shape
            (n, strands, 1); or of kappa_1, kappa_2 and the twist, shape (n, strands, 3). Zero at open ends.
        floor: Smallest squared length of a segment that curvature divides by [m2]: a thousandth of the shortest.
    """

    axial: Array
    bending: Array
    floor: float

    @property
    def strains(self) -> int:
        """Strains of a node, the variant of the kernels (:func:`warpdeform.kernels.curve.curve`)."""
        return {0: 0, 1: 2, 3: 3}[self.bending.shape[-1]]


@dataclass(frozen=True)
class Frames:
    """Material frames of the segments: unit tangents and first directors, shape (segments, strands, 3)."""

    tangents: Array
    directors: Array

    def carried(self, grid: ParameterGrid, positions: Array) -> "Frames":
        """Frames of another shape: the first director by the smallest rotation from here, the others without twist."""
        tangents = unit_tangents(grid, positions)
        return material_frames(grid, positions, transported(self.directors[0], self.tangents[0], tangents[0]))


def curve_stiffness(
    grid: ParameterGrid,
    rest: Array,
    material: Material,
    sections: Sections = None,
    natural: Array | None = None,
    framed: bool = False,
) -> CurveStiffness:
    """Weights of a curve body from its rest shape, material and sections.

    Args:
        grid: Parameter grid.
        rest: Rest positions [m], shape (n, strands, 3).
        material: Material of all strands; where it varies, along and across them.
        sections: Their cross-sections.
        natural: The shape whose curvature needs no force [m], shape (n, strands, 3); None: the rest shape.
        framed: Give the curve a material frame even where nothing but held directors asks for one.

    Raises:
        InputError: The rest shape has segments without length or too few nodes, or sections that do not fit.
    """
    _check_shape(grid, rest)
    if natural is not None:
        _check_natural(natural, rest)
    count = grid.nodes[1]
    if sections is not None and not isinstance(sections, Section) and len(sections) != count:
        remedy = f"Give one section for all strands, or {count}."
        raise InputError(Mistake("section", len(sections), f"is a list for another number of strands: {count}", remedy))
    # One law for all strands, or one each.
    each = [sections] if sections is None or isinstance(sections, Section) else list(sections)
    lengths = segment_lengths(grid, rest)
    share = node_lengths(grid, lengths)
    stretching, bending = np.zeros_like(lengths), np.zeros((*grid.nodes, 3))
    for strand, section in enumerate(each):
        own = slice(strand, strand + 1) if len(each) == count else slice(None)
        axial, laws = _laws(grid, material, section)
        stretching[:, own] = np.broadcast_to(axial, lengths.shape)[:, own]
        bending[:, own] = np.broadcast_to(laws, bending.shape)[:, own]
    if material.form != "eta":
        stretching, bending = stretching / lengths**3, bending / share[..., None]
    if not grid.periodic[0]:
        bending[[0, -1]] = 0.0
    if not np.any(bending[..., :2]):
        bending = bending[..., :0]
    else:
        shape = rest if natural is None else natural
        alike = np.allclose(bending[..., 0], bending[..., 1], rtol=1e-9)
        straight = bool(np.all(np.abs(binormals(grid, shape)) <= STRAIGHT))
        if alike and straight and not framed:
            bending = bending[..., :1]
    return CurveStiffness(np.sqrt(stretching), np.sqrt(bending), 1e-6 * float(np.min(lengths)) ** 2)


def _laws(grid: ParameterGrid, material: Material, section: Section | None) -> tuple[Number, Array]:
    """EA of the segments, and EI about both directors and GJ of the nodes; of the paper's weights, R^2 themselves."""
    cells, nodes = material.curve(section, grid), material.curve(section, grid, at="nodes")
    if isinstance(cells, CurveCoefficients) and isinstance(nodes, CurveCoefficients):
        return cells.axial, np.stack(np.broadcast_arrays(*nodes.bending, nodes.torsion), axis=-1)
    assert isinstance(cells, PaperCurveWeights)
    assert isinstance(nodes, PaperCurveWeights)
    # The paper's tensors are those of the parametrisation: eta/4 (G - G0)^2, G = |b|^2 / h^2, per h.
    h = grid.spacing[0]
    return 2.0 * cells.eta / h**3, np.asarray(nodes.xi / h)[..., None]


def edges(grid: ParameterGrid, positions: Array) -> Array:
    """Vectors from node to node, shape (segments, strands, 3)."""
    closing = positions[:1] if grid.periodic[0] else positions[:0]
    return np.diff(np.concatenate([positions, closing]), axis=0)


def unit_tangents(grid: ParameterGrid, positions: Array) -> Array:
    """Directions of the segments, shape (segments, strands, 3)."""
    vectors = edges(grid, positions)
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def segment_lengths(grid: ParameterGrid, positions: Array) -> Array:
    """Lengths of the segments [m], shape (segments, strands)."""
    return np.asarray(np.linalg.norm(edges(grid, positions), axis=-1))


def node_lengths(grid: ParameterGrid, lengths: Array) -> Array:
    """Half the lengths of both segments of each node [m], shape (n, strands): of its only one at open ends."""
    return grid.cells_to_nodes(lengths)


def binormals(grid: ParameterGrid, positions: Array) -> Array:
    """Curvature binormals kb of :mod:`warpdeform.kernels.curve`, shape (n, strands, 3), zero at open ends."""
    b = edges(grid, positions)
    kb = np.zeros_like(positions)
    a = np.roll(b, 1, axis=0)
    inner = slice(None) if grid.periodic[0] else slice(1, len(b))
    size = (1.0 + FOLD) * np.linalg.norm(a, axis=-1) * np.linalg.norm(b, axis=-1) + np.sum(a * b, axis=-1)
    kb[: len(b)][inner] = (2.0 * np.cross(a, b) / size[..., None])[inner]
    return kb


def material_frames(grid: ParameterGrid, positions: Array, director: ArrayLike | None = None) -> Frames:
    """Frames along the strands of a shape.

    Args:
        grid: Parameter grid.
        positions: Node positions [m], shape (n, strands, 3).
        director: First director, the axis of the section about which its first moment bends. One vector, or one for
            each strand, shape (strands, 3), is that of the first segment and goes on along the strand by parallel
            transport, without twist; shape (segments, strands, 3) names all. Only its part normal to the segment
            counts. None takes any.

    Raises:
        InputError: The director has another shape, or lies along a segment.
    """
    tangents = unit_tangents(grid, positions)
    if director is None:
        director = np.eye(3)[np.argmin(np.abs(tangents[0]), axis=-1)]
    given = np.asarray(director, dtype=np.float64)
    wanted = tangents.shape if given.ndim == 3 else tangents.shape[1:]
    if given.shape != (3,) and given.shape != wanted:
        remedy = f"Give one vector, {wanted[-2]} vectors, or an array of shape {tangents.shape}."
        raise InputError(Mistake("director", given.shape, "is the shape of no set of directors", remedy))
    if given.ndim == 3:
        return Frames(tangents, normal_part(given, tangents))
    directors = np.empty_like(tangents)
    directors[0] = normal_part(np.broadcast_to(given, wanted), tangents[0])
    for i in range(1, len(tangents)):
        directors[i] = normal_part(transported(directors[i - 1], tangents[i - 1], tangents[i]), tangents[i])
    return Frames(tangents, directors)


def material_strains(grid: ParameterGrid, positions: Array, frames: Frames) -> Array:
    """kappa_1, kappa_2 and the twist of a shape with these frames, shape (n, strands, 3), zero at open ends.

    The formulas are those of :mod:`warpdeform.kernels.curve_frame`, in double precision: rest shapes that were rounded
    to single precision would be crooked for good.
    """
    last = len(frames.tangents)
    tb, ub = frames.tangents, frames.directors
    ta, ua = np.roll(tb, 1, axis=0), np.roll(ub, 1, axis=0)
    carried = transported(ua, ta, tb)
    twist = np.arctan2(np.sum(np.cross(carried, ub) * tb, axis=-1), np.sum(carried * ub, axis=-1))
    c, s = np.cos(0.5 * twist)[..., None], np.sin(0.5 * twist)[..., None]
    n1 = c * ua + s * np.cross(ta, ua)
    kb = binormals(grid, positions)[:last]
    strains = np.zeros_like(positions)
    strains[:last, :, 0] = np.sum(kb * n1, axis=-1)
    strains[:last, :, 1] = np.sum(kb * np.cross(ta, n1), axis=-1)
    strains[:last, :, 2] = twist
    if not grid.periodic[0]:
        strains[0] = 0.0
    return strains


def transported(d: Array, t0: Array, t1: Array) -> Array:
    """d, normal to t0, turned by the smallest rotation that takes the unit vector t0 to t1; all of shape (..., 3)."""
    cosine = np.maximum(1.0 + np.sum(t0 * t1, axis=-1, keepdims=True), 1e-12)
    return np.asarray(d - np.sum(d * t1, axis=-1, keepdims=True) / cosine * (t0 + t1))


def normal_part(d: Array, t: Array) -> Array:
    """The part of d normal to the unit vectors t, at unit length."""
    across = d - np.sum(d * t, axis=-1, keepdims=True) * t
    size = np.linalg.norm(across, axis=-1, keepdims=True)
    along = size[..., 0] <= 1e-6 * np.linalg.norm(d, axis=-1)
    if np.any(along):
        where = [int(k) for k in np.argwhere(along)[0]]
        raise InputError(
            Mistake("director", d[along][0], f"lies along the curve at {where}", "Give a vector across the curve.")
        )
    return np.asarray(across / size)


def _check_natural(natural: Array, rest: Array) -> None:
    if natural.shape != rest.shape or not np.isfinite(natural).all():
        problem = "has another shape than the rest positions, or is not finite"
        raise InputError(Mistake("natural", natural.shape, problem, f"Give finite positions of shape {rest.shape}."))


def _check_shape(grid: ParameterGrid, rest: Array) -> None:
    fewest = FEWEST_CLOSED if grid.periodic[0] else 2
    if grid.nodes[0] < fewest:
        kind = "closed curve" if grid.periodic[0] else "curve"
        raise InputError(Mistake("nodes", grid.nodes[0], f"are too few for a {kind}", f"Use at least {fewest} nodes."))
    lengths = segment_lengths(grid, rest)
    if np.any(lengths <= 1e-9 * np.max(lengths)):
        i, strand = (int(k) for k in np.argwhere(lengths <= 1e-9 * np.max(lengths))[0])
        problem, remedy = "has a segment without length", "Give a rest shape whose nodes lie apart."
        raise InputError(Mistake("shape", [i, strand], problem, remedy))
