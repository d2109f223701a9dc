"""Distance functions and the potential against formulas in NumPy, float64."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import warp as wp
from field_nodes import LooseNodes, Points
from obstacle_shapes import box_mesh, distance_to, sheet_mesh, torus_mesh

from warpdeform.kernels.distance import CONVEX, KINDS, distances
from warpdeform.kernels.fields import fields
from warpdeform.kernels.guard import guards
from warpdeform.obstacle import Obstacle

SIZES = {
    "plane": (0.0, 0.0, 0.0),
    "sphere": (0.5, 0.0, 0.0),
    "box": (0.6, 0.3, 0.2),
    "capsule": (0.25, 0.4, 0.0),
    "cylinder": (0.4, 0.5, 0.0),
    "cone": (0.4, 0.6, 0.0),
    "torus": (0.5, 0.2, 0.0),
}
REALS = [wp.float64, wp.float32]


def grid_points() -> Points:
    axis = np.linspace(-1.0, 1.0, 23) + 1e-3 * np.sin(np.arange(23))
    return np.stack(np.meshgrid(axis, axis + 0.003, axis - 0.002, indexing="ij"), axis=-1).reshape(-1, 3)


def evaluate(
    kind: str, size: Any, points: Points, real: Any = wp.float64, mesh: wp.Mesh | None = None, half: float = 0.0
) -> tuple[Points, Points]:
    """Normals, shape (n, 3), and distances, shape (n,), of the device function; meshes are asked up to 10 m."""
    geometry = distances(real, mesh is not None)
    record, signed_distance = geometry.Obstacle, geometry.signed_distance

    @wp.kernel(module="unique", enable_backward=False)
    def measure(o: wp.array(dtype=record), points: wp.array(dtype=geometry.V), out: wp.array(dtype=geometry.F)):  # type: ignore
        i = wp.tid()
        out[i] = signed_distance(o[0], points[i], real(10.0), real(0.0))

    described = np.zeros(1, dtype=record.numpy_dtype())
    described["kind"], described["size"], described["half_thickness"] = KINDS.index(kind), size, half
    described["mesh"], described["memory"] = (0, -1) if mesh is None else (mesh.id, 0)
    out = wp.full(len(points), geometry.F(*[real(np.nan)] * 4), dtype=geometry.F, device="cpu")
    inputs: list[Any] = [
        wp.array(described, dtype=record, device="cpu"),
        wp.array(points, dtype=geometry.V, device="cpu"),
    ]
    wp.launch(measure, dim=len(points), inputs=inputs, outputs=[out], device="cpu")
    values = out.numpy().astype(np.float64)
    return values[:, :3], values[:, 3]


def upload_mesh(vertices: Points, faces: Any, winding: bool = True) -> wp.Mesh:
    points: wp.array = wp.array(vertices, dtype=wp.vec3, device="cpu")
    indices: wp.array = wp.array(faces.reshape(-1), dtype=wp.int32, device="cpu")
    return wp.Mesh(points, indices, support_winding_number=winding)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("kind", SIZES)
def test_distance_is_exact_inside_and_outside(kind: str, real: Any) -> None:
    points = grid_points()
    normals, found = evaluate(kind, SIZES[kind], points, real)
    rounding = 1e-12 if real is wp.float64 else 1e-6
    expected = distance_to(kind, SIZES[kind], points)
    assert (expected < 0).any()
    np.testing.assert_allclose(found, expected, atol=rounding)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=rounding)


@pytest.mark.parametrize("kind", SIZES)
def test_normal_is_the_gradient_of_the_distance(kind: str) -> None:
    points, h = grid_points(), 1e-6
    normals, _ = evaluate(kind, SIZES[kind], points)
    slopes = [distance_to(kind, SIZES[kind], points + s * h * e) for e in np.eye(3) for s in (-1, 1)]
    gradient = np.stack([(slopes[2 * k + 1] - slopes[2 * k]) / (2 * h) for k in range(3)], axis=1)
    smooth = np.abs(np.linalg.norm(gradient, axis=1) - 1.0) < 1e-6  # not across a medial axis
    assert smooth.mean() > 0.98
    np.testing.assert_allclose(normals[smooth], gradient[smooth], atol=2e-5)


@pytest.mark.parametrize("kind", SIZES)
def test_places_without_a_direction_still_have_a_unit_normal(kind: str) -> None:
    a, b, _ = SIZES[kind]
    special = np.array([[0, 0, 0], [0, 0, b], [0, 0, -b], [a, 0, 0], [0, a, 0], [a, 0, -b], [0, 0, 0.1]], dtype=float)
    normals, found = evaluate(kind, SIZES[kind], special)
    np.testing.assert_allclose(found, distance_to(kind, SIZES[kind], special), atol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)


@pytest.mark.parametrize("kind", sorted(CONVEX))
def test_convex_kinds_lie_behind_the_plane_through_the_nearest_point(kind: str) -> None:
    """What the guard relies on: no inside point is nearer than f against n."""
    points = grid_points()
    normals, found = evaluate(kind, SIZES[kind], points)
    outside, inside = np.flatnonzero(found > 0)[::37], points[found <= 0][::11]
    height = np.einsum("ijk,ik->ij", inside[None] - points[outside, None], normals[outside])
    assert (height <= -found[outside, None] + 1e-12).all()


@pytest.mark.parametrize("real", REALS)
def test_mesh_of_a_box_measures_like_the_box(real: Any) -> None:
    points = grid_points()
    mesh = upload_mesh(*box_mesh((1.2, 0.6, 0.4)))
    normals, found = evaluate("mesh", (0, 0, 0), points, real, mesh)
    expected_normals, expected = evaluate("box", SIZES["box"], points)
    rounding = 1e-7 if real is wp.float64 else 1e-6  # vertices are float32
    np.testing.assert_allclose(found, expected, atol=rounding)
    clear = (expected > 0) | (np.ptp(np.sort(SIZES["box"] - np.abs(points), axis=1)[:, :2], axis=1) > 1e-3)
    np.testing.assert_allclose(normals[clear], expected_normals[clear], atol=2e-5)


def test_mesh_knows_inside_from_outside_where_it_is_not_convex() -> None:
    points = grid_points()
    _, found = evaluate("mesh", (0, 0, 0), points, mesh=upload_mesh(*torus_mesh(0.5, 0.2, 80, 40)))
    expected = distance_to("torus", SIZES["torus"], points)
    np.testing.assert_allclose(found, expected, atol=2e-3)
    clear = np.abs(expected) > 2e-3
    np.testing.assert_array_equal(found[clear] > 0, expected[clear] > 0)


def test_a_shell_is_measured_from_its_two_sides() -> None:
    mesh = upload_mesh(*sheet_mesh(1.0), winding=False)
    points = np.array([[0.1, 0.2, 0.3], [0.1, 0.2, -0.3], [0.1, 0.2, 0.002], [0.9, 0.1, 0.0]])
    normals, found = evaluate("mesh", (0, 0, 0), points, mesh=mesh, half=0.005)
    np.testing.assert_allclose(found, [0.295, 0.295, -0.003, 0.395], atol=1e-7)
    np.testing.assert_allclose(normals, [[0, 0, 1], [0, 0, -1], [0, 0, 1], [1, 0, 0]], atol=1e-12)


def test_the_potential_is_continued_twice_differentiably() -> None:
    plane = Obstacle("plane", design_speed=2.0)
    constants = plane.field_constants((0, 0, -9.81))
    v2, eps, mass = constants.design_speed**2, constants.range, 0.003
    f = np.array([-3, -1, -0.3, -1e-9, 0, 1e-9, 0.4, 2, 5]) * eps
    nodes = LooseNodes(np.stack([0 * f, 0 * f, f], axis=1))
    field = nodes.field(plane)
    q = np.minimum(f, 0) / eps
    above = np.exp(-np.maximum(f, 0) / eps)
    np.testing.assert_allclose(nodes.energies(field, nodes.position), mass * v2 / 2 * above * (1 - q + q**2 / 2))
    slope = nodes.gradient(field, nodes.position)[:, 2]
    np.testing.assert_allclose(slope, mass * v2 / (2 * eps) * above * (q - 1), rtol=1e-12)
    curvature = nodes.blocks(field)[:, 2, 2]
    np.testing.assert_allclose(curvature, mass * v2 / (2 * eps**2) * above, rtol=1e-12)
    for values in (slope, curvature):
        np.testing.assert_allclose(values[3:6], values[4], rtol=1e-8)  # continuous across the surface


def test_the_wall_takes_over_inside_half_the_gap_and_grows_until_the_guard_holds() -> None:
    plane = Obstacle("plane", design_speed=2.0)
    gap, mass = plane.gap, 0.003
    f = np.array([0.05, 0.1499, 0.1501, 0.16, 0.2, 0.3, 0.45, 0.499, 0.501, 0.8]) * gap
    nodes = LooseNodes(np.stack([0 * f, 0 * f, f], axis=1))
    bare, field = nodes.field(plane), nodes.field(plane, walled=True)
    x = np.maximum((f / gap - 0.15) / 0.35, 0.01)
    rise = np.where(x < 1, -((1 - x) ** 2) * np.log(x), 0.0)
    slope = np.where(x < 1, (1 - x) * (2 * np.log(x) - (1 - x) / x), 0.0)
    below = (f / gap - 0.15) / 0.35 - x
    rise += np.where(x <= 0.01, below * slope, 0.0)
    added = nodes.energies(field, nodes.position) - nodes.energies(bare, nodes.position)
    np.testing.assert_allclose(added, mass * 2.0 * rise, rtol=1e-9, atol=1e-15)
    force = nodes.gradient(field, nodes.position)[:, 2] - nodes.gradient(bare, nodes.position)[:, 2]
    np.testing.assert_allclose(force, mass * 2.0 * slope / (0.35 * gap), rtol=1e-9, atol=1e-12)
    step = 1e-7 * gap
    ahead = nodes.gradient(field, nodes.position + [0, 0, step])[:, 2]
    behind = nodes.gradient(field, nodes.position - [0, 0, step])[:, 2]
    nodes.gradient(field, nodes.position)
    blocks, found = nodes.blocks(field)[:, 2, 2], (ahead - behind) / (2 * step)
    np.testing.assert_allclose(blocks[3:], found[3:], rtol=1e-4, atol=1e-6)
    assert (blocks[:3] > found[:3]).all()


def test_distances_are_those_of_the_skin() -> None:
    ball = Obstacle("sphere", {"radius": 0.1}, design_speed=2.0)
    height = np.array([0.1005, 0.1008, 0.102])
    places = np.stack([0 * height, 0 * height, height], axis=1)
    skin = np.array([0.003, 0.0, -1.0])
    thick, thin = LooseNodes(places + [[0, 0, 0.003], [0, 0, 0], [0, 0, 0]]), LooseNodes(places)
    field, bare = thick.field(ball, skin=skin, walled=True), thin.field(ball, walled=True)
    expected = thin.energies(bare, thin.position) * [1, 1, 0]
    np.testing.assert_allclose(thick.energies(field, thick.position), expected, rtol=1e-9)
    force = thin.gradient(bare, thin.position) * [[1], [1], [0]]
    np.testing.assert_allclose(thick.gradient(field, thick.position), force, rtol=1e-9)


@pytest.mark.parametrize("real", REALS)
def test_every_kernel_compiles_for_cuda(real: Any, tmp_path: Path) -> None:
    for kernel in (fields(real, True, True).linearise_fields, guards(real, True).carry_nodes):
        wp.compile_aot_module(kernel.module, arch=[75], use_ptx=False, module_dir=tmp_path)
    assert len(list(tmp_path.glob("*.cubin"))) == 2
