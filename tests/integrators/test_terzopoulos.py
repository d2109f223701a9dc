"""The paper's force and step: its formulas written in NumPy, where it is stable, and how it fails."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import warp as wp
from bodies import CLOTH, MEMBRANE, PRECISE, hanging, run
from surfaces import CLOSED, MATERIALS, REALS, SHAPES, STATES, WIDTHS, Surface, crumpled, noise, stretched

from warpdeform.errors import InputError, SimulationFailure
from warpdeform.forces.paper_elasticity import PaperElasticity
from warpdeform.grid import Layout
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, sheet
from warpdeform.simulation import Simulation
from warpdeform.track import Track

Array = np.ndarray[Any, Any]

ETA, XI = (500.0, 300.0, 200.0), (2.0, 1.0, 0.5)
PAPER = Material(areal_density=0.2, eta=ETA, xi=XI)


class Paper:
    """The term of one surface, with NumPy arrays of shape (nu, nv, ...) going in and coming out."""

    def __init__(self, rest: RestShape, material: Material, real: Any = wp.float64, lane_width: int = 1) -> None:
        self.real, self.nodes, self.rest = real, rest.nodes, rest.positions
        self.layout = Layout(rest.nodes, lane_width, rest.periodic)
        self.force = PaperElasticity(rest.grid, self.layout, rest.positions, material, real, "cpu")

    upload, download = Surface.upload, Surface.download

    def linearise(self, z: Array) -> None:
        self.force.linearise(None, self.upload(z))

    def product(self, p: Array) -> Array:
        """K times p at the last linearised state."""
        out = self.upload(np.zeros_like(p))
        self.force.add_hessian_product(None, self.upload(p), out)
        return self.download(out)

    def gradient(self, z: Array) -> Array:
        self.linearise(z)
        out = self.upload(np.zeros_like(z))
        self.force.add_gradient(None, self.upload(z), out)
        return self.download(out)


def published(rest: Array, r: Array, u: Array, h: tuple[float, float]) -> Array:
    """h1 h2 K(r) u as section 6.2 of the paper has it, border rules, trapezoid weights of eta and xi and all.

    D+ and D- are forward and backward differences, zero where they would reach beyond the sheet.
    """
    h1, h2 = h
    nu, nv = rest.shape[:2]

    def d1(a: Array) -> Array:
        return np.concatenate([np.diff(a, axis=0), np.zeros_like(a[:1])]) / h1

    def d2(a: Array) -> Array:
        return np.concatenate([np.diff(a, axis=1), np.zeros_like(a[:, :1])], axis=1) / h2

    def back1(a: Array) -> Array:
        return np.diff(a, axis=0, prepend=0.0 * a[:1]) / h1

    def back2(a: Array) -> Array:
        return np.diff(a, axis=1, prepend=0.0 * a[:, :1]) / h2

    def d11(a: Array) -> Array:
        return np.pad(np.diff(a, 2, axis=0), ((1, 1), (0, 0), (0, 0))) / h1**2

    def d22(a: Array) -> Array:
        return np.pad(np.diff(a, 2, axis=1), ((0, 0), (1, 1), (0, 0))) / h2**2

    def d12(a: Array) -> Array:
        return np.pad(np.diff(np.diff(a, axis=0), axis=1), ((0, 1), (0, 1), (0, 0))) / (h1 * h2)

    def adjoint11(a: Array) -> Array:
        wide = np.pad(a, ((1, 1), (0, 0), (0, 0)))
        return np.diff(wide, 2, axis=0) / h1**2

    def adjoint22(a: Array) -> Array:
        wide = np.pad(a, ((0, 0), (1, 1), (0, 0)))
        return np.diff(wide, 2, axis=1) / h2**2

    def dot(a: Array, b: Array) -> Array:
        return np.sum(a * b, -1, keepdims=True)

    def numbers(a: Array) -> tuple[dict[str, Array], dict[str, Array]]:
        n = np.cross(np.gradient(a, axis=0), np.gradient(a, axis=1))
        n /= np.linalg.norm(n, axis=-1, keepdims=True)
        G = {"11": dot(d1(a), d1(a)), "22": dot(d2(a), d2(a)), "12": dot(d1(a), d2(a))}
        return G, {"11": dot(n, d11(a)), "22": dot(n, d22(a)), "12": dot(n, d12(a))}

    half = [np.ones((n, 1, 1)) for n in (nu, nv)]
    for weights in half:
        weights[[0, -1]] = 0.5
    along_u, along_v = half[0], half[1].transpose(1, 0, 2)
    cells = np.zeros((nu, nv, 1))
    cells[:-1, :-1] = 1.0
    eta = {"11": ETA[0] * along_v, "22": ETA[1] * along_u, "12": ETA[2] * cells}
    xi = {"11": XI[0] * along_u * along_v, "22": XI[1] * along_u * along_v, "12": XI[2] * cells}
    (G, B), (G0, B0) = numbers(r), numbers(rest)
    alpha = {k: eta[k] * (G[k] - G0[k]) for k in G}
    beta = {k: xi[k] * (B[k] - B0[k]) for k in B}
    e = -back1(alpha["11"] * d1(u) + alpha["12"] * d2(u)) - back2(alpha["12"] * d1(u) + alpha["22"] * d2(u))
    e = e + adjoint11(beta["11"] * d11(u)) + adjoint22(beta["22"] * d22(u))
    return np.asarray(h1 * h2 * (e + 2.0 * back1(back2(beta["12"] * d12(u)))))


@pytest.mark.parametrize("state", STATES.values(), ids=STATES)
def test_force_is_the_published_one(state: Any) -> None:
    rest = SHAPES["bump"]((6, 7))
    z, p = state(rest.positions), noise(rest.positions, 1.0)
    term = Paper(rest, PAPER)
    expected = published(rest.positions, z, z, rest.spacing)
    np.testing.assert_allclose(term.gradient(z), expected, atol=1e-12 * np.abs(expected).max())
    expected = published(rest.positions, z, p, rest.spacing)
    np.testing.assert_allclose(term.product(p), expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize(("shape", "material"), [("flat", "membrane"), ("tube", "isotropic"), ("arc", "orthotropic")])
def test_matrix_is_symmetric_whatever_the_shape(shape: str, material: str) -> None:
    rest = (SHAPES | CLOSED)[shape]((5, 7))
    term = Paper(rest, MATERIALS[material])
    term.linearise(crumpled(rest.positions))
    columns = np.array([term.product(p.reshape(*rest.nodes, 3)).ravel() for p in np.eye(3 * 35)])
    np.testing.assert_allclose(columns, columns.T, atol=1e-12 * np.abs(columns).max())
    term.linearise(rest.positions)
    assert np.abs(term.product(noise(rest.positions, 1.0))).max() < 1e-9 * np.abs(columns).max()  # no stiffness at rest


@pytest.mark.parametrize("material", [Material(areal_density=0.2, eta=ETA), MEMBRANE, PAPER])
def test_metric_part_is_the_gradient_and_the_curvature_part_is_not(material: Material) -> None:
    # Both discretise the same energy where G is what edges and corners have: exactly so for the strains along edges.
    material = Material(areal_density=0.2, eta=(500.0, 300.0, 1e-9)) if material.xi is None else material
    rest = sheet((6, 7), (1.0, 0.7))
    z = stretched(rest.positions)
    exact, simple = Surface(rest, material).gradient(z), Paper(rest, material).gradient(z)
    off = np.abs(simple - exact).max() / np.abs(exact).max()
    if material.xi is None:
        assert off < 1e-9
    else:
        assert off > 1e-2


@pytest.mark.parametrize("real", REALS)
def test_lane_widths_agree_to_the_bit(real: Any) -> None:
    rest = CLOSED["tube"]((5, 19))
    z, p = crumpled(rest.positions), noise(rest.positions, 1.0, 3)
    found = []
    for width in WIDTHS[real]:
        term = Paper(rest, MATERIALS["isotropic"], real, width)
        found.append((term.gradient(z), term.product(p)))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def resting(integrator: str, dt: float) -> Simulation:
    """A free square membrane at rest with a trace of noise."""
    shape = sheet((9, 9))
    start = shape.positions + 1e-7 * np.random.default_rng(1).normal(size=shape.positions.shape)
    material = Material(areal_density=0.2, eta=(500.0, 500.0, 1e-9))
    body = hanging(shape=shape, material=material, initial_positions=start, pins=())
    settings = replace(PRECISE, integrator=integrator, fps=1 / dt, gravity=(0.0, 0.0, 0.0), cg_tolerance=1e-12)
    return Simulation([body], settings=settings)


@pytest.mark.parametrize("integrator", ["terzopoulos", "terzopoulos-exact"])
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_stable_step_at_rest_is_that_of_leap_frog(integrator: str, share: float) -> None:
    # dt = h sqrt(mu/(eta (G + G0))): where alpha is zero the matrix has no stiffness (design 1.2).
    limit = (1.0 / 8) * np.sqrt(0.2 / (500.0 * 2.0))
    simulation = resting(integrator, share * limit)
    start = sheet((9, 9)).positions
    grown = 0.0
    try:
        for _ in range(300):
            simulation.step()
            grown = max(grown, float(np.abs(simulation["sheet"].positions() - start).max()))
    except SimulationFailure:
        grown = np.inf
    assert (grown > 1e-4) == (share > 1.0)


@pytest.mark.parametrize("integrator", ["terzopoulos", "terzopoulos-exact"])
def test_compression_breaks_the_matrix_and_is_reported(integrator: str) -> None:
    body = hanging((9, 9), material=MEMBRANE, pins=(), initial_positions=0.6 * sheet((9, 9)).positions)
    simulation = Simulation([body], settings=replace(PRECISE, integrator=integrator, fps=30.0))
    with pytest.raises(SimulationFailure, match="could not be completed"):
        run(simulation, 30)
    record = simulation.record()
    assert 0 < record.outcomes["broken"] <= record.cg_breakdowns
    assert np.isfinite(simulation["sheet"].positions()).all()


def test_both_forces_swing_alike_where_the_sheet_only_stretches() -> None:
    found = []
    for integrator in ("terzopoulos", "terzopoulos-exact", "verlet"):
        settings = replace(PRECISE, integrator=integrator, substeps=200, fps=20.0)
        simulation = Simulation([hanging((7, 7), material=MEMBRANE)], settings=settings)
        for _ in range(4):
            simulation.advance_frame()
        found.append(simulation["sheet"].positions())
    simple, exact, reference = found
    assert np.abs(exact - reference).max() < 2e-3
    assert np.abs(simple - reference).max() < 5e-2
    assert np.abs(reference - sheet((7, 7)).positions).max() > 0.02


def test_every_load_runs() -> None:
    ball = Obstacle("sphere", {"radius": 0.2}, track=Track.fixed((0.5, 0.5, -0.25)), friction=0.3)
    body = hanging((9, 9), pins=(), drag=0.5)
    settings = replace(PRECISE, integrator="terzopoulos", substeps=20, precision="float32")
    simulation = Simulation([body], obstacles=[ball], settings=settings)
    for _ in range(20):
        simulation.advance_frame()
        centre = np.array([0.5, 0.5, -0.25])
        assert np.linalg.norm(simulation["sheet"].positions() - centre, axis=-1).min() > 0.2


def test_what_the_paper_has_no_force_for_is_refused() -> None:
    leaning = hanging(shape=SHAPES["parallelogram"]((5, 6)), material=CLOTH)
    with pytest.raises(InputError, match="these do not meet at right angles"):
        Simulation([leaning], settings=Settings(integrator="terzopoulos", device="cpu"))
    weighted = replace(leaning, material=PAPER)
    Simulation([weighted], settings=Settings(integrator="terzopoulos", device="cpu"))
    with pytest.raises(InputError, match="needs an estimate of the error, and terzopoulos has none"):
        Simulation([hanging()], settings=Settings(integrator="terzopoulos", device="cpu", time_step="adaptive"))
