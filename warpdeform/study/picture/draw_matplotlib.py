"""Draw pictures with matplotlib alone: shaded triangles, painted from the farthest to the nearest.

The studio is that of the Blender engine, in short: one key light with a shadow map, a bright sky, matt surfaces.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpdeform.errors import InputError, Mistake
from warpdeform.study.picture.camera import SENSOR, View
from warpdeform.study.picture.drawing import Drawing, Floats, Item, ground_height

GROUND_COLOR = np.array([0.44, 0.43, 0.415])
KEY_COLOR, SKY_COLOR = 0.95 * np.array([1.0, 0.95, 0.88]), 0.55 * np.array([0.92, 0.96, 1.05])
PIECES = 60
"""Triangles are cut until none is longer than the scene's diagonal divided by this: painting by distance needs it."""
SHADOW_CELLS = 320
OVERSAMPLING = 2
"""Pixels are averaged over this many in each direction: smooth outlines."""


def draw_with_matplotlib(
    drawings: Sequence[Drawing], outputs: Sequence[Path], view: View, size: tuple[int, int], *, exposure: float = 0.0
) -> None:
    """Draw each drawing into its PNG file, all from one camera and on one ground.

    Args:
        drawings: What to show.
        outputs: A file for each.
        view: The camera.
        size: Width and height [pixels].
        exposure: Brighter (+) or darker (-) [stops].

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.collections import TriMesh
        from matplotlib.figure import Figure
        from matplotlib.image import imsave
        from matplotlib.tri import Triangulation
    except ImportError as error:
        raise InputError(
            Mistake("engine", "matplotlib", f"cannot be used ({error})", "Run pip install 'warpdeform[pictures]'.")
        ) from None
    large = (OVERSAMPLING * size[0], OVERSAMPLING * size[1])
    ground = ground_height(tuple(drawings))
    extent = max(float(np.linalg.norm(np.ptp(drawing.subject(), axis=0))) for drawing in drawings)
    light = _key_direction(view)
    for drawing, output in zip(drawings, outputs, strict=True):
        pieces = [_cut(item, extent / PIECES) for item in drawing.items]
        corners = np.concatenate([piece[0] for piece in pieces])
        shadow = ShadowMap(corners, light)
        shades = np.concatenate([_shade(*piece, view, shadow) for piece in pieces])
        pixels, depth = _project(corners.reshape(-1, 3), view, large)
        depth = depth.reshape(-1, 3)
        sizes = [len(piece[0]) for piece in pieces]
        is_body = np.repeat([item.role == "body" for item in drawing.items], sizes)
        one_sided = np.repeat([item.role == "body" and not item.thin for item in drawing.items], sizes)
        # Cloth lies on things: where both are about as far, its nearest corner counts against their farthest.
        order = np.argsort(-np.where(is_body, depth.min(axis=1), depth.max(axis=1)), kind="stable")
        order = order[depth.min(axis=1)[order] > 1e-3 * view.distance]
        order = order[~(one_sided & _away(corners, view))[order]]
        figure = Figure(figsize=(large[0] / 100, large[1] / 100), dpi=100)
        canvas = FigureCanvasAgg(figure)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        background = _to_display(_ground_picture(view, size, ground, shadow), exposure)
        axes.imshow(background, extent=(0, large[0], large[1], 0), aspect="auto", interpolation="bilinear")
        mesh = Triangulation(pixels[:, 0], pixels[:, 1], np.arange(len(pixels)).reshape(-1, 3)[order])
        axes.add_collection(TriMesh(mesh, facecolors=_to_display(shades.reshape(-1, 3), exposure)), autolim=False)
        axes.set_xlim(0, large[0])
        axes.set_ylim(large[1], 0)
        canvas.draw()
        image = np.asarray(canvas.buffer_rgba())[: large[1], : large[0], :3].astype(np.float64)
        blocks = image.reshape(size[1], OVERSAMPLING, size[0], OVERSAMPLING, 3)
        imsave(str(output), np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8))


class ShadowMap:
    """What the key light reaches: the surface nearest to it in each cell of a grid across its rays.

    Args:
        corners: Corners of the triangles that cast shadows [m], shape (m, 3, 3).
        light: Unit vector towards the light, shape (3,).
    """

    def __init__(self, corners: Floats, light: Floats) -> None:
        side = np.cross(light, [0.0, 0.0, 1.0])
        side /= np.linalg.norm(side)
        self.axes = np.stack([side, np.cross(light, side), light])
        weights = np.array([[i, j, 6 - i - j] for i in range(7) for j in range(7 - i)]) / 6.0
        samples = np.einsum("sc,mcx->msx", weights, corners).reshape(-1, 3) @ self.axes.T
        self.low = samples[:, :2].min(axis=0)
        self.cell = float(np.ptp(samples[:, :2], axis=0).max()) / (SHADOW_CELLS - 1) or 1.0
        self.nearest = np.full((SHADOW_CELLS + 8, SHADOW_CELLS + 8), -np.inf)
        np.maximum.at(self.nearest, self._cells(samples), samples[:, 2])

    def _cells(self, across: Floats) -> tuple[np.ndarray, np.ndarray]:
        index = np.rint((across[:, :2] - self.low) / self.cell).astype(np.int64) + 4
        index = np.clip(index, 0, SHADOW_CELLS + 7)
        return index[:, 0], index[:, 1]

    def lit(self, points: Floats) -> Floats:
        """Part of the key light that reaches points [m] of shape (n, 3): 0 to 1, soft over a few cells, shape (n,)."""
        local = points @ self.axes.T
        total = np.zeros(len(points))
        steps = (-2.0, -1.0, 0.0, 1.0, 2.0)
        for du in steps:
            for dv in steps:
                moved = local[:, :2] + np.array([du, dv]) * self.cell
                total += self.nearest[self._cells(moved)] <= local[:, 2] + 4.0 * self.cell
        return total / len(steps) ** 2


def _key_direction(view: View) -> Floats:
    """Towards the key light: 70 degrees to the left of the camera, 42 above the ground."""
    azimuth = np.arctan2(view.axes[2, 1], view.axes[2, 0]) - np.radians(70.0)
    elevation = np.radians(42.0)
    return np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


def _cut(item: Item, longest: float) -> tuple[Floats, Floats, Floats]:
    """Positions, unit normals and colours at the corners of an item's triangles, cut until no edge is above `longest`.

    Each has shape (m, 3, 3): triangle, corner, value.
    """
    corners, colors = item.points[item.triangles], item.colors[item.triangles]
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.repeat(flat[:, None, :], 3, axis=1) if item.normals is None else item.normals[item.triangles]
    normals = normals / np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-30)
    values = np.concatenate([corners, normals, colors], axis=2)
    done = []
    while len(values):
        edges = np.linalg.norm(values[:, :, :3] - np.roll(values[:, :, :3], -1, axis=1), axis=2)
        large = edges.max(axis=1) > longest
        done.append(values[~large])
        turn = (edges[large].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(values[large], turn[:, :, None], axis=1).swapaxes(0, 1)
        values = np.concatenate([np.stack([a, (a + b) / 2, c], axis=1), np.stack([(a + b) / 2, b, c], axis=1)])
    values = np.concatenate(done)
    return values[:, :, :3], values[:, :, 3:6], values[:, :, 6:]


def _shade(corners: Floats, normals: Floats, colors: Floats, view: View, shadow: ShadowMap) -> Floats:
    """Linear RGB at the corners, shape (m, 3, 3): Lambert's law for the key light, a hemisphere for the sky."""
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat *= np.where(np.einsum("mx,mx->m", flat, normals.sum(axis=1)) < 0.0, -1.0, 1.0)[:, None]
    away = np.einsum("mx,mx->m", flat, view.position - corners.mean(axis=1)) < 0.0
    normals = np.where(away[:, None, None], -normals, normals)
    key = np.maximum(normals @ shadow.axes[2], 0.0) * shadow.lit(corners.reshape(-1, 3)).reshape(-1, 3)
    sky = 0.62 + 0.38 * normals[:, :, 2]
    return colors * (key[:, :, None] * KEY_COLOR + sky[:, :, None] * SKY_COLOR)


def _away(corners: Floats, view: View) -> NDArray[np.bool_]:
    """Which triangles show their back: the far side of a solid body, which would peep over its edges."""
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("mx,mx->m", flat, view.position - corners[:, 0]) < 0.0


def _ground_picture(view: View, size: tuple[int, int], height: float, shadow: ShadowMap) -> Floats:
    """The ground with the shadows on it, linear RGB of shape (height, width, 3); beyond the horizon the same tone."""
    x, y = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    scale = SENSOR / (view.lens * max(size))
    rays = np.stack([(x - size[0] / 2) * scale, (size[1] / 2 - y) * scale, np.full_like(x, -1.0)], axis=-1) @ view.axes
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (height - view.position[2]) / rays[..., 2]
    hit = np.isfinite(reach) & (reach > 0.0) & (reach < 20.0 * view.distance)
    lit = np.ones(hit.shape)
    lit[hit] = shadow.lit(view.position + reach[hit][:, None] * rays[hit])
    key = shadow.axes[2, 2]
    return GROUND_COLOR * (lit[..., None] * key * KEY_COLOR + SKY_COLOR)


def _project(points: Floats, view: View, size: tuple[int, int]) -> tuple[Floats, Floats]:
    """Pixels from the upper left corner, shape (n, 2), and distance along the view [m], shape (n,)."""
    local = (points - view.position) @ view.axes.T
    depth = -local[:, 2]
    scale = view.lens * max(size) / SENSOR / np.maximum(depth, 1e-9)
    return np.stack([size[0] / 2 + scale * local[:, 0], size[1] / 2 - scale * local[:, 1]], axis=-1), depth


def _to_display(linear: Floats, exposure: float) -> Floats:
    """Linear RGB to sRGB, with highlights rolled off instead of cut."""
    value = np.maximum(linear, 0.0) * 2.0**exposure
    value = np.where(value > 0.7, 0.7 + 0.3 * (1.0 - np.exp(-(value - 0.7) / 0.3)), value)
    return np.where(value <= 0.0031308, 12.92 * value, 1.055 * value ** (1 / 2.4) - 0.055)
