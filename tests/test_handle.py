"""What a body of a simulation shows: live and copied arrays, metric and curvature tensors, stretch, energies."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import warp as wp
from surface_energy import design_energy
from surfaces import MATERIALS, SHAPES, crumpled, stretched, turned

from warpdeform.body import Body
from warpdeform.handle import BodyHandle
from warpdeform.material import Material
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, arc, sheet
from warpdeform.simulation import Simulation

Array = np.ndarray[Any, Any]

SHELL = MATERIALS["isotropic"]


def handle(
    shape: RestShape, start: Array | None = None, material: Material = SHELL, precision: str = "float64", **body: Any
) -> BodyHandle:
    settings = Settings(precision=precision, device="cpu")
    sheet_body = Body("sheet", shape, material, initial_positions=start, **body)
    return Simulation([sheet_body], settings=settings)["sheet"]


@pytest.mark.parametrize("precision", ["float32", "float64"])
@pytest.mark.parametrize("nodes", [(2, 2), (2, 5), (17, 33)], ids=str)
def test_flat_sheet_has_the_identity_for_its_metric(nodes: tuple[int, int], precision: str) -> None:
    body = handle(sheet(nodes, (2.0, 0.5)), precision=precision)
    G, B, tolerance = body.metric(), body.curvature(), 1e-12 if precision == "float64" else 1e-4
    nu, nv = nodes
    assert G.G11.shape == (nu - 1, nv)
    assert G.G12.shape == (nu - 1, nv - 1)
    assert G.G22.shape == (nu, nv - 1)
    assert B.B11.shape == (nu - 2, nv)
    assert B.B12.shape == (nu - 1, nv - 1)
    assert B.B22.shape == (nu, nv - 2)
    for G_ab, expected in ((G.G11, 1.0), (G.G12, 0.0), (G.G22, 1.0)):
        np.testing.assert_allclose(G_ab, expected, atol=tolerance)
    for B_ab in (B.B11, B.B12, B.B22):
        np.testing.assert_allclose(B_ab, 0.0, atol=tolerance)


def test_metric_of_an_even_deformation_is_exact() -> None:
    shape = sheet((5, 8), (1.0, 0.7))
    F = np.array([[1.4, 0.25, 0.0], [0.1, 0.8, 0.0], [0.2, 0.0, 1.0]])
    G = handle(shape, shape.positions @ F.T).metric()
    expected = F.T @ F
    np.testing.assert_allclose(G.G11, expected[0, 0], rtol=1e-12)
    np.testing.assert_allclose(G.G12, expected[0, 1], rtol=1e-12)
    np.testing.assert_allclose(G.G22, expected[1, 1], rtol=1e-12)


def test_every_edge_has_its_own_metric() -> None:
    shape = sheet((5, 8), (1.0, 0.7))
    z = crumpled(shape.positions)
    G, (h1, h2) = handle(shape, z).metric(), shape.spacing
    np.testing.assert_allclose(G.G11, np.sum(np.diff(z, axis=0) ** 2, -1) / h1**2, rtol=1e-12)
    np.testing.assert_allclose(G.G22, np.sum(np.diff(z, axis=1) ** 2, -1) / h2**2, rtol=1e-12)


def test_cylinder_bends_by_its_radius_away_from_its_normal() -> None:
    radius = 0.5
    body = handle(arc((21, 6), radius=radius, angle=100.0, length=0.7))
    # The arch bulges upwards, along n = r_u x r_v / |...|; its centre of curvature lies below.
    top = body.positions()[10, 3]
    assert top[2] == body.positions()[..., 2].max()
    B, h = body.curvature(), body.model.grid.spacing[0]
    np.testing.assert_allclose(B.B11, -(4 * radius / h**2) * np.sin(h / (2 * radius)) ** 2, rtol=1e-11)
    np.testing.assert_allclose(B.B11, -1 / radius, rtol=h**2 / (12 * radius**2) * 1.01)
    np.testing.assert_allclose(B.B12, 0.0, atol=1e-10)
    np.testing.assert_allclose(B.B22, 0.0, atol=1e-10)
    np.testing.assert_allclose(body.metric().G11, (2 * radius / h * np.sin(h / (2 * radius))) ** 2, rtol=1e-12)
    inside_out = handle(arc((21, 6), radius=radius, angle=100.0, length=0.7), body.positions() * [1, 1, -1])
    np.testing.assert_allclose(inside_out.curvature().B11, -B.B11, rtol=1e-11)


def test_twisted_sheet_has_the_twist_of_its_saddle() -> None:
    shape, twist = sheet((6, 9), (1.0, 1.3)), 0.4
    u, v = shape.positions[..., 0], shape.positions[..., 1]
    B = handle(shape, np.stack([u, v, twist * u * v], -1)).curvature()
    uc, vc = (0.25 * (a[:-1, :-1] + a[1:, :-1] + a[:-1, 1:] + a[1:, 1:]) for a in (u, v))
    np.testing.assert_allclose(B.B12, twist / np.sqrt(1 + twist**2 * (uc**2 + vc**2)), rtol=1e-12)
    np.testing.assert_allclose(B.B11, 0.0, atol=1e-12)
    np.testing.assert_allclose(B.B22, 0.0, atol=1e-12)


def wavy(u: Array, v: Array) -> Array:
    return np.stack([u + 0.1 * np.sin(v), v, 0.2 * np.sin(u) * np.cos(2 * v)], -1)


def wavy_tensors(u: Array, v: Array) -> dict[str, Array]:
    """Analytic first and second fundamental form of `wavy`."""
    zero, one = 0 * u, 0 * u + 1
    r1 = np.stack([one, zero, 0.2 * np.cos(u) * np.cos(2 * v)], -1)
    r2 = np.stack([0.1 * np.cos(v), one, -0.4 * np.sin(u) * np.sin(2 * v)], -1)
    r11 = np.stack([zero, zero, -0.2 * np.sin(u) * np.cos(2 * v)], -1)
    r12 = np.stack([zero, zero, -0.4 * np.cos(u) * np.sin(2 * v)], -1)
    r22 = np.stack([-0.1 * np.sin(v), zero, -0.8 * np.sin(u) * np.cos(2 * v)], -1)
    n = np.cross(r1, r2)
    n /= np.linalg.norm(n, axis=-1, keepdims=True)
    pairs = {"G11": (r1, r1), "G12": (r1, r2), "G22": (r2, r2), "B11": (n, r11), "B12": (n, r12), "B22": (n, r22)}
    return {name: np.sum(a * b, -1) for name, (a, b) in pairs.items()}


def test_tensors_of_a_curved_surface_converge_in_second_order() -> None:
    errors: dict[str, list[float]] = {}
    for count in (17, 33):
        shape = sheet((count, count), (1.2, 0.9))
        u, v = shape.positions[..., 0], shape.positions[..., 1]
        body = handle(shape, wavy(u, v))
        G, B = body.metric(), body.curvature()
        mean = {
            "edge u": lambda a: (a[1:] + a[:-1]) / 2,
            "edge v": lambda a: (a[:, 1:] + a[:, :-1]) / 2,
            "cell": lambda a: (a[:-1, :-1] + a[1:, :-1] + a[:-1, 1:] + a[1:, 1:]) / 4,
            "inside": lambda a: a[1:-1, 1:-1],
        }
        # At border nodes the normal is one-sided, of first order; inside the scheme is of second order.
        for name, found, place in (
            ("G11", G.G11, "edge u"), ("G12", G.G12, "cell"), ("G22", G.G22, "edge v"),
            ("B11", B.B11[:, 1:-1], "inside"), ("B12", B.B12, "cell"), ("B22", B.B22[1:-1], "inside"),
        ):  # fmt: skip
            exact = wavy_tensors(mean[place](u), mean[place](v))[name]
            errors.setdefault(name, []).append(float(np.abs(found - exact).max()))
    for name, (coarse, fine) in errors.items():
        assert coarse < 2e-2, name
        assert np.log2(coarse / fine) > 1.8, name


def test_membrane_has_no_curvature_operator() -> None:
    body = handle(sheet((4, 5)), material=MATERIALS["membrane"])
    assert body.metric().G11.shape == (3, 5)
    with pytest.raises(ValueError, match=r"'sheet' is a membrane.*bending stiffness"):
        body.curvature()


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_arrays(precision: str) -> None:
    shape = SHAPES["arc"]((5, 20))
    body = handle(shape, precision=precision, position=(0.1, 0.2, 0.3), velocity=(1.0, -2.0, 3.0))
    assert body.nodes == (5, 20)
    assert body.rest_positions is shape.positions
    placed = (shape.positions + [0.1, 0.2, 0.3]).astype(precision)
    np.testing.assert_array_equal(body.positions(), placed)
    np.testing.assert_array_equal(body.velocities(), np.broadcast_to([1.0, -2.0, 3.0], (5, 20, 3)))
    copy = body.positions()
    copy[:] = 0.0
    np.testing.assert_array_equal(body.positions(), placed)
    # The live array is the state itself: what a kernel writes there is where the body is.
    live = body.position_array
    halo = body.model.layout.halo
    np.testing.assert_array_equal(live.numpy()[:, 2 + 1, 7 + halo], placed[2, 7])
    live.numpy()[:, 2 + 1, 7 + halo] += 1.0
    np.testing.assert_array_equal(body.positions()[2, 7], placed[2, 7] + np.ones(3, dtype=precision))
    assert live.dtype == (wp.float32 if precision == "float32" else wp.float64)
    assert live is body.position_array


def test_masses_are_trapezoid_shares_of_the_rest_area() -> None:
    body = handle(sheet((5, 8), (1.0, 0.7)), material=MATERIALS["membrane"])
    assert body.model.node_mass.sum() == pytest.approx(0.2 * 0.7, rel=1e-13)
    share = 0.2 * 0.25 * 0.1
    np.testing.assert_allclose(body.model.node_mass[[0, 0, 2], [0, 3, 3]], [share / 4, share / 2, share])
    bulging = handle(SHAPES["bump"]((40, 40)), material=MATERIALS["membrane"])
    u, v = np.meshgrid((np.arange(400) + 0.5) / 400, 0.7 * (np.arange(400) + 0.5) / 400)
    slope = np.stack([0.24 * np.cos(2 * u + 0.5) * np.cos(2 * v), -0.24 * np.sin(2 * u + 0.5) * np.sin(2 * v)])
    area = 0.7 * np.mean(np.sqrt(1 + np.sum(slope**2, 0)))
    assert bulging.model.node_mass.sum() == pytest.approx(0.2 * area, rel=1e-4)


def test_stretch_is_that_of_the_longest_edge() -> None:
    shape = sheet((5, 8), (1.0, 0.7))
    assert handle(shape).max_stretch() == pytest.approx(1.0, abs=1e-12)
    assert handle(shape, shape.positions * [0.9, 1.3, 1.0]).max_stretch() == pytest.approx(1.3)
    pulled = shape.positions.copy()
    pulled[0, 0, 0] -= 0.5
    assert handle(shape, pulled).max_stretch() == pytest.approx(np.hypot(0.5, 0.1) / 0.1)


@pytest.mark.parametrize("state", [stretched, crumpled], ids=lambda state: state.__name__)
def test_record_has_the_energies_of_the_present_state(state: Callable[[Array], Array]) -> None:
    shape, velocity = SHAPES["bump"]((5, 7)), np.array([1.0, -2.0, 3.0])
    start = turned(state(shape.positions), (1, 0, 0), 0.5) + [0, 0, 2.0]
    body = Body("sheet", shape, SHELL, initial_positions=start, velocity=tuple(velocity))
    simulation = Simulation([body], settings=Settings(precision="float64", device="cpu"))
    energy = simulation.record().energy
    mass = simulation["sheet"].model.node_mass
    assert energy.kinetic == pytest.approx(0.5 * mass.sum() * velocity @ velocity, rel=1e-12)
    assert energy.elastic == pytest.approx(design_energy(shape, SHELL).energy(start), rel=1e-12)
    assert energy.gravity == pytest.approx(9.81 * np.sum(mass * start[..., 2]), rel=1e-12)
    assert energy.field == 0.0
    assert energy.work_in == 0.0
