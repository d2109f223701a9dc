"""Pressure inside closed surfaces: volume, force, conservation, and a pressure vessel."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from bodies import CLOTH, PRECISE
from surfaces import CLOSED, REALS, STATES, WIDTHS, crumpled, noise, turned

from warpdeform.body import Body
from warpdeform.errors import InputError
from warpdeform.forces.pressure import Pressure
from warpdeform.material import Material
from warpdeform.measure import enclosed_volume, exposed_shares
from warpdeform.model import Model
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, from_array, line, sheet, sphere, torus, tube
from warpdeform.simulation import Simulation
from warpdeform.state import State

Array = np.ndarray[Any, Any]
CPU = wp.get_device("cpu")
KINDS = ["tube", "tube along u", "torus", "screw", "knot", "sphere"]
P = 700.0


def shape_of(kind: str, nodes: tuple[int, int] = (8, 11)) -> RestShape:
    return sphere(nodes, 0.4) if kind == "sphere" else CLOSED[kind](nodes)


class Balloon:
    """The term alone, with arrays of shape (nu, nv, 3) going in and coming out."""

    def __init__(self, shape: RestShape, real: Any = wp.float64, lane_width: int = 1) -> None:
        precision = "float32" if real is wp.float32 else "float64"
        self.model = Model(Body("balloon", shape, CLOTH), precision, CPU, lane_width)
        self.state = State(self.model, wp.zeros(1, dtype=wp.int32, device=CPU))
        self.force = Pressure(self.state, P, shape.positions)
        self.force.prepare(0.0, 0.01, 0.01)

    def energy(self, z: Array, start: Array) -> float:
        self.state.x.assign(self.model.layout.pack(start))
        self.state.partials.zero_()
        self.force.add_energy(self.state, self.model.upload(z), self.state.partials)
        return float(self.state.partials.numpy().sum())

    def gradient(self, z: Array) -> Array:
        out = self.model.zeros(3)
        self.force.add_gradient(self.state, self.model.upload(z), out)
        inside = self.model.download(out)
        assert np.count_nonzero(out.numpy()) <= inside.size, "written outside the body"
        return inside

    def volume(self, z: Array) -> float:
        return self.force.volume(self.state, self.model.upload(z))


@pytest.mark.parametrize("lane_width", [1, 8])
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("kind", KINDS)
def test_force_is_the_derivative_of_the_enclosed_volume(kind: str, state: str, lane_width: int) -> None:
    shape = shape_of(kind)
    balloon = Balloon(shape, lane_width=lane_width)
    start, z = shape.positions + [0.3, -0.2, 0.5], STATES[state](shape.positions)
    assert balloon.energy(start, start) == 0.0
    grown = balloon.volume(z) - balloon.volume(start)
    assert balloon.energy(z, start) == pytest.approx(-P * grown, rel=1e-11)
    gradient = balloon.gradient(z)
    for seed in range(3):
        p, step = noise(shape.positions, 1.0, seed), 1e-4
        slope = (balloon.energy(z + step * p, z) - balloon.energy(z - step * p, z)) / (2 * step)
        # V is a cubic: a central difference is off by a third derivative times the step squared.
        assert np.sum(gradient * p) == pytest.approx(slope, rel=1e-6, abs=1e-8 * P)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("kind", KINDS)
def test_no_net_force_and_torque(kind: str, real: Any) -> None:
    shape = shape_of(kind)
    z = turned(crumpled(shape.positions), (1, 2, 3), 0.7) + [20.0, -10.0, 5.0]
    force = Balloon(shape, real, WIDTHS[real][1]).gradient(z)
    tolerance = (1e-12 if real is wp.float64 else 2e-5) * np.abs(force).sum()
    np.testing.assert_allclose(force.sum((0, 1)), 0.0, atol=tolerance)
    np.testing.assert_allclose(np.cross(z - z.mean((0, 1)), force).sum((0, 1)), 0.0, atol=tolerance)


@pytest.mark.parametrize("kind", KINDS)
def test_precisions_and_lane_widths_agree_far_from_the_origin_too(kind: str) -> None:
    shape = shape_of(kind)
    here, there = crumpled(shape.positions), crumpled(shape.positions) + np.array([64.0, -32.0, 16.0])
    exact = Balloon(shape).gradient(here)
    np.testing.assert_array_equal(Balloon(shape, lane_width=8).gradient(here), exact)
    single = [Balloon(shape, wp.float32, width).gradient(there) for width in WIDTHS[wp.float32]]
    np.testing.assert_array_equal(*single)
    np.testing.assert_allclose(single[0], exact, atol=2e-4 * np.abs(exact).max())
    start, z = shape.positions + [64.0, -32.0, 16.0], there
    grown = Balloon(shape).energy(z, start)
    # Single precision knows where a node is to 4e-6 m there.
    area = exposed_shares(shape.grid, shape.positions).sum()
    assert Balloon(shape, wp.float32, 16).energy(z, start) == pytest.approx(grown, abs=4e-6 * P * area)


@pytest.mark.parametrize("kind", ["torus", "sphere", "tube", "tube along u"])
def test_pressure_pushes_outwards_by_its_area_wherever_the_normals_point(kind: str) -> None:
    shape = shape_of(kind, (40, 32))
    balloon = Balloon(shape)
    force = -balloon.gradient(shape.positions)
    r = shape.positions - shape.positions.mean((0, 1))
    outwards = r * [1, 1, 0]
    if kind == "torus":
        outwards = r - 0.5 * outwards / np.linalg.norm(outwards, axis=-1, keepdims=True)
    if kind == "sphere":
        outwards = r
    outwards = outwards / np.linalg.norm(outwards, axis=-1, keepdims=True)
    inner = np.s_[:, 3:-3] if kind != "tube along u" else np.s_[3:-3]
    area = exposed_shares(balloon.model.grid, balloon.model.body.shape.positions)[..., 0]
    np.testing.assert_allclose(force[inner], P * (area[..., None] * outwards)[inner], atol=0.02 * P * area.max())
    assert balloon.volume(shape.positions) > 0


@pytest.mark.parametrize(
    ("make", "volume"),
    [
        (lambda n: tube((2 * n, 3), 0.3, 0.8), 0.8 * np.pi * 0.09),
        (lambda n: torus((2 * n, n), 0.5, 0.2), 2 * np.pi**2 * 0.5 * 0.04),
        (lambda n: sphere((2 * n, n), 0.7), 4 / 3 * np.pi * 0.343),
    ],
    ids=["tube", "torus", "sphere"],
)
def test_volumes_converge_in_second_order(make: Any, volume: float) -> None:
    errors = []
    for n in (16, 32):
        shape = make(n)
        errors.append(abs(enclosed_volume(shape.periodic, shape.positions, shape.grid.poles) - volume) / volume)
    assert errors[0] < 0.04
    assert np.log2(errors[0] / errors[1]) > 1.9


def test_a_cube_of_cells_is_measured_exactly() -> None:
    # A square tube with caps, twisted by a rigid motion: V = side^2 height.
    square = np.array([[0, 0], [0.5, 0], [1, 0], [1, 0.5], [1, 1], [0.5, 1], [0, 1], [0, 0.5]])
    z = np.linspace(0, 2, 4)
    r = np.concatenate([np.repeat(square[:, None], 4, 1), np.broadcast_to(z[None, :, None], (8, 4, 1))], -1)
    shape = from_array(turned(r, (1, 1, 0), 0.4) + [3, 4, 5], periodic=(True, False))
    assert enclosed_volume(shape.periodic, shape.positions, shape.grid.poles) == pytest.approx(2.0, rel=1e-13)
    assert enclosed_volume(shape.periodic, shape.positions[::-1], shape.grid.poles) == pytest.approx(-2.0, rel=1e-13)


def test_stored_energy_counts_from_rest_and_pressure_may_change() -> None:
    shape = torus((12, 9), 0.5, 0.2)
    balloon = Balloon(shape)
    rest, larger = balloon.model.upload(shape.positions), balloon.model.upload(1.1 * shape.positions)
    assert balloon.force.stored_energy(balloon.state, rest) == pytest.approx(0.0, abs=1e-12)
    volume = enclosed_volume(shape.periodic, shape.positions, shape.grid.poles)
    assert balloon.force.stored_energy(balloon.state, larger) == pytest.approx(-P * volume * (1.1**3 - 1))
    before = balloon.gradient(shape.positions)
    balloon.force.pressure = -0.5 * P
    balloon.force.prepare(0.0, 0.01, 0.01)
    np.testing.assert_allclose(balloon.gradient(shape.positions), -0.5 * before, rtol=1e-12)


def test_a_pressure_vessel_widens_and_lengthens_as_thin_shells_do() -> None:
    # A closed cylinder: hoop strain p r (2 - nu) / (2 E h), axial strain p r (1 - 2 nu) / (2 E h).
    radius, length, stiffness, nu = 0.2, 1.0, 2000.0, 0.3
    pressure = 2e-3 * stiffness / radius
    material = Material(areal_density=0.2, membrane_stiffness=stiffness, poisson_ratio=nu, bending_stiffness=1e-3)
    body = Body("vessel", tube((24, 17), radius, length), material, pressure=pressure)
    settings = Settings(
        integrator="implicit-euler", fps=0.1, newton_iterations=0, newton_tolerance=1e-7, cg_tolerance=1e-6,
        cg_iterations=3000, precision="float64", gravity=(0.0, 0.0, 0.0), device="cpu",
    )  # fmt: skip
    simulation = Simulation([body], settings=settings)
    for _ in range(3):
        simulation.step()
    r = simulation["vessel"].positions()
    middle = r[:, 8] - r[:, 8].mean(axis=0)
    hoop = np.linalg.norm(middle, axis=-1).mean() / radius - 1
    axial = np.ptp(r[..., 2].mean(axis=0)) / length - 1
    unit = pressure * radius / stiffness
    assert hoop == pytest.approx(unit * (1 - nu / 2), rel=0.02)
    assert axial == pytest.approx(unit * (0.5 - nu), rel=0.04)


def test_a_balloon_in_flight_keeps_its_momentum() -> None:
    settings = Settings(**{**vars(PRECISE), "gravity": (0.0, 0.0, 0.0), "newton_tolerance": 1e-8})
    body = Body("balloon", sphere((12, 9), 0.4), CLOTH, pressure=20.0, velocity=(1.0, 2.0, 3.0))
    simulation = Simulation([body], settings=settings)
    for _ in range(5):
        simulation.step()
    handle = simulation["balloon"]
    momentum = np.einsum("ij,ijk->k", handle.model.node_mass, handle.velocities())
    np.testing.assert_allclose(momentum, handle.model.node_mass.sum() * np.array([1.0, 2.0, 3.0]), rtol=1e-7)
    assert handle.max_stretch() > 1.001
    assert "pressure" in {term.name for term in handle.terms}


@pytest.mark.parametrize("shape", [sheet((4, 5)), line((4,))], ids=["sheet", "line"])
def test_what_encloses_nothing_has_no_pressure(shape: RestShape) -> None:
    with pytest.raises(InputError, match=r"pressure = 5.*needs a surface that encloses something"):
        Body("sheet", shape, CLOTH, pressure=5.0)
    with pytest.raises(InputError, match=r"pressure = nan: must be finite \[Pa\]"):
        Body("tube", tube((5, 4)), CLOTH, pressure=np.nan)
