"""Metric and curvature of curves, closed surfaces and solids against closed forms: the paper's worked examples."""

from typing import Any

import numpy as np
import pytest
from surfaces import MATERIALS, turned

from warpdeform.body import Body
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, block, from_array, from_map, helix, line, ring, sheet, sphere, torus, tube
from warpdeform.simulation import Simulation
from warpdeform.tensors import Curvature, Metric, curvature_of_curve, metric_of

Array = np.ndarray[Any, Any]

SHELL = MATERIALS["isotropic"]
TURN = 2.0 * np.pi


def tensors(shape: RestShape) -> tuple[Metric, Curvature]:
    """G and B of a surface at rest, from a simulation."""
    settings = Settings(precision="float64", preconditioner="none", device="cpu")
    body = Simulation([Body("body", shape, SHELL)], settings=settings)["body"]
    curvature = body.curvature()
    assert isinstance(curvature, Curvature)
    return body.metric(), curvature


def orders(errors: dict[str, list[float]]) -> dict[str, float]:
    """Orders of convergence from errors at two grids, one twice as fine; exact ones count as of second order."""
    return {name: 2.0 if coarse < 1e-10 else np.log2(coarse / fine) for name, (coarse, fine) in errors.items()}


def cylinder(nodes: tuple[int, int], radius: float) -> RestShape:
    """r = (radius cos theta, radius sin theta, z), u = theta, v = z."""
    return from_map(
        lambda u, v: np.stack([radius * np.cos(u), radius * np.sin(u), v], -1),
        nodes,
        ((0, TURN), (0, 1)),
        (True, False),
    )


def globe(nodes: tuple[int, int], radius: float) -> RestShape:
    """A sphere of that radius, u = longitude and v = latitude in radians, the latitudes half a step off the poles."""
    rest = sphere(nodes, radius)
    spacing = (rest.spacing[0] / radius, rest.spacing[1] / radius)
    return from_array(rest.positions, spacing, rest.periodic, poles=rest.poles)


def test_metric_of_the_unit_cube_is_the_identity() -> None:
    shape = block((3, 4, 5))
    G = metric_of(shape.grid, shape.positions)
    for name, expected, cells in (
        ("G11", 1, (2, 4, 5)), ("G22", 1, (3, 3, 5)), ("G33", 1, (3, 4, 4)),
        ("G12", 0, (2, 3, 5)), ("G13", 0, (2, 4, 4)), ("G23", 0, (3, 3, 4)),
    ):  # fmt: skip
        found = getattr(G, name)
        assert found.shape == cells
        np.testing.assert_allclose(found, expected, atol=1e-14)


def test_metric_of_a_solid_cylinder_in_its_own_coordinates() -> None:
    # r = (rho cos theta, rho sin theta, z): G = diag(1, rho^2, 1) over (rho, theta, z).
    errors: dict[str, list[float]] = {}
    for n in (12, 24):
        shape = from_map(
            lambda u, v, w: np.stack([u * np.cos(v), u * np.sin(v), w], -1),
            (5, n, 3), ((0.5, 1.5), (0, TURN), (0, 1)), (False, True, False),
        )  # fmt: skip
        G = metric_of(shape.grid, shape.positions)
        rho = np.linspace(0.5, 1.5, 5)[:, None, None]
        for name, exact in (("G11", 1.0), ("G22", rho**2), ("G33", 1.0), ("G12", 0.0), ("G13", 0.0), ("G23", 0.0)):
            errors.setdefault(name, []).append(np.abs(getattr(G, name) - exact).max())
        assert G.G22 is not None
        assert G.G22.shape == (5, n, 3)
    assert min(orders(errors).values()) > 1.9
    assert errors["G22"][1] < 0.02


def test_metric_and_curvature_of_a_cylinder() -> None:
    rho, errors = 0.7, dict[str, list[float]]()
    for n in (16, 32):
        G, B = tensors(cylinder((n, 5), rho))
        assert G.G11.shape == (n, 5)
        assert B.B11.shape == (n, 5)
        assert B.B12.shape == (n, 4)
        for name, found, exact in (
            ("G11", G.G11, rho**2), ("G12", G.G12, 0), ("G22", G.G22, 1),
            ("B11", B.B11, -rho), ("B12", B.B12, 0), ("B22", B.B22, 0),
        ):  # fmt: skip
            errors.setdefault(name, []).append(np.abs(found - exact).max())
    assert min(orders(errors).values()) > 1.9
    assert errors["G11"][1] < 4e-3 * rho**2
    assert errors["B11"][1] < 4e-3 * rho


def test_metric_and_curvature_of_a_sphere() -> None:
    # G = diag(x^2 + y^2, rho^2), B = -diag((x^2 + y^2)/rho, rho) with the outward normal.
    rho, errors = 1.3, dict[str, list[float]]()
    for n in (12, 24):
        shape = globe((2 * n, n), rho)
        G, B = tensors(shape)
        r = shape.positions
        squared = r[..., 0] ** 2 + r[..., 1] ** 2
        assert B.B11.shape == B.B22.shape == (2 * n, n)
        for name, found, exact in (
            ("G11", G.G11, squared), ("G12", G.G12, 0 * G.G12), ("G22", G.G22, rho**2 + 0 * G.G22),
            ("B11", B.B11, -squared / rho), ("B12", B.B12, 0 * B.B12), ("B22", B.B22, -rho + 0 * B.B22),
        ):  # fmt: skip
            errors.setdefault(name, []).append(np.abs(found - exact).max())
    assert min(orders(errors).values()) > 1.9
    assert max(error for _, error in errors.values()) < 0.02 * rho**2


def test_curvatures_of_a_torus() -> None:
    a, b, errors = 0.8, 0.3, dict[str, list[float]]()
    for n in (16, 32):
        shape = torus((2 * n, n), a, b)
        G, B = tensors(shape)
        out = np.linalg.norm(shape.positions[..., :2], axis=-1)
        # In metres along the circle of the ring and around the tube; both principal curvatures are known.
        for name, found, exact in (
            ("G11", G.G11, (out / a) ** 2), ("G22", G.G22, 1 + 0 * G.G22),
            ("B11", B.B11, -out * (out - a) / b / a**2), ("B22", B.B22, -1 / b + 0 * B.B22),
            ("B12", B.B12, 0 * B.B12),
        ):  # fmt: skip
            errors.setdefault(name, []).append(np.abs(found - exact).max())
    assert min(orders(errors).values()) > 1.9


@pytest.mark.parametrize("shape", [tube((12, 5), 0.4, 0.9), torus((9, 7)), globe((12, 6), 0.5)], ids=str)
def test_same_shape_means_the_same_metric_and_curvature(shape: RestShape) -> None:
    G, B = tensors(shape)
    scale = np.abs(B.B11).max()

    def again(positions: Array) -> tuple[Metric, Curvature]:
        return tensors(from_array(positions, shape.spacing, shape.periodic, poles=shape.poles))

    moved = turned(shape.positions, (1.0, -2.0, 0.5), 1.1) + [0.3, 0.2, -0.7]
    mirrored = shape.positions * [1.0, 1.0, -1.0]
    for positions, sign in ((moved, 1.0), (mirrored, -1.0)):
        G_again, B_again = again(positions)
        for name in ("G11", "G12", "G22"):
            np.testing.assert_allclose(getattr(G_again, name), getattr(G, name), atol=1e-12)
        for name in ("B11", "B12", "B22"):
            np.testing.assert_allclose(getattr(B_again, name), sign * getattr(B, name), atol=1e-11 * scale)
    other_G, _ = again(shape.positions * [1.05, 1.0, 1.0])
    assert np.abs(other_G.G11 - G.G11).max() > 1e-3


def test_a_sheet_rolled_up_keeps_its_metric_and_not_its_curvature() -> None:
    # An isometry: lengths are chords, so the metric of the rolled sheet differs in second order only.
    flat, rolled = tensors(sheet((33, 5), (1.0, 0.3))), tensors(tube((32, 5), 0.5 / np.pi, 0.3))
    np.testing.assert_allclose(rolled[0].G11, 1.0, atol=4e-3)
    np.testing.assert_allclose(flat[0].G11, 1.0, atol=1e-12)
    assert not flat[1].B11.round(9).any()
    np.testing.assert_allclose(rolled[1].B11, -2 * np.pi, rtol=4e-3)


def test_curvature_of_curves() -> None:
    circle, radius = ring((64,), 0.4), 0.4
    kappa = curvature_of_curve(circle.grid, circle.positions).binormal
    assert kappa.shape == (64, 1, 3)
    np.testing.assert_allclose(kappa[..., 2], 1 / radius, rtol=2e-3)
    np.testing.assert_allclose(kappa[..., :2], 0.0, atol=1e-9)
    straight = line((5,), 2.0)
    assert not curvature_of_curve(straight.grid, straight.positions).binormal.any()
    np.testing.assert_allclose(metric_of(straight.grid, straight.positions).G11, 1.0, rtol=1e-14)
    errors = []
    for n in (101, 201):
        coil, r, rise = helix((n,), 0.2, 0.5, 3.0), 0.2, 0.5 / TURN
        found = np.linalg.norm(curvature_of_curve(coil.grid, coil.positions).binormal, axis=-1)
        assert found.shape == (n - 2, 1)
        errors.append(np.abs(found - r / (r**2 + rise**2)).max())
    assert np.log2(errors[0] / errors[1]) > 1.9
