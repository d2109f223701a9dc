"""Methods: stage weights, exactness on polynomials, closed forms of an oscillator, and the measured order of all."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import REAL_TIME, assert_same_bits, busy, hanging, material_for, run
from surfaces import MATERIALS

from warpdeform import launching
from warpdeform.body import Body, Pin, Spring
from warpdeform.integrators import BDF2, INTEGRATORS, SDIRK2, TRBDF2, ImplicitEuler, Stage
from warpdeform.integrators.sdirk2 import embedded
from warpdeform.material import Material
from warpdeform.result import Outcome
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation
from warpdeform.wind import Wind

Array = np.ndarray[Any, Any]

RATIOS = [0.5, 1.0, 2.0]
PRECISE: dict[str, Any] = {
    "precision": "float64", "newton_iterations": 0, "newton_tolerance": 1e-11, "cg_tolerance": 1e-10,
    "cg_iterations": 2000, "gravity": (0.0, 0.0, 0.0), "device": "cpu",
}  # fmt: skip


def combined(weights: tuple[float, float, float], x: Any, x_before: Any, v: Any, v_before: Any) -> Any:
    """A stage vector, as the kernels make it."""
    return x + weights[0] * (x_before - x) + weights[1] * v + weights[2] * v_before


def test_methods_are_found_by_name_and_say_their_order() -> None:
    assert {name: method.order for name, method in INTEGRATORS.items()} == {
        "symplectic-euler": 1, "verlet": 2, "terzopoulos": 1, "terzopoulos-exact": 1, "linear-implicit": 1,
        "implicit-euler": 1, "bdf2": 2, "tr-bdf2": 2, "sdirk2": 2, "energy-momentum": 2,
    }  # fmt: skip


def test_implicit_euler_is_the_row_of_the_table() -> None:
    for before in (None, 0.3):
        (stage,) = ImplicitEuler().stages(0.1, before)
        assert stage == Stage(tau=0.1, w=(0.0, 0.0, 0.0), y=(0.0, 0.1, 0.0), start=(0.0, 0.1, 0.0))


@pytest.mark.parametrize("ratio", RATIOS)
def test_bdf2_is_the_row_of_the_table(ratio: float) -> None:
    # tau = dt (1 + r)/(1 + 2r), w = ((1 + r)^2 x - r^2 x-)/(1 + 2r), likewise w_v, y = w + tau w_v (design 6.1).
    dt, r, (x, x_before, v, v_before) = 0.1, ratio, np.random.default_rng(0).normal(size=4)
    (stage,) = BDF2().stages(dt, dt / r)
    assert stage.tau == pytest.approx(dt * (1 + r) / (1 + 2 * r), rel=1e-15)
    w, w_v = (((1 + r) ** 2 * a - r**2 * b) / (1 + 2 * r) for a, b in ((x, x_before), (v, v_before)))
    assert combined(stage.w, x, x_before, v, v_before) == pytest.approx(w, rel=1e-13)
    assert combined(stage.y, x, x_before, v, v_before) == pytest.approx(w + stage.tau * w_v, rel=1e-13)
    assert combined(stage.start, x, x_before, v, v_before) == pytest.approx(x + dt * v, rel=1e-15)


def test_bdf2_with_equal_steps_is_the_textbook_formula() -> None:
    (stage,), (x, x_before) = BDF2().stages(0.3, 0.3), (1.7, 1.1)
    assert stage.tau == pytest.approx(0.2)
    assert combined(stage.w, x, x_before, 0, 0) == pytest.approx((4 * x - x_before) / 3)


def test_bdf2_starts_as_implicit_euler() -> None:
    assert BDF2().stages(0.1, None) == ImplicitEuler().stages(0.1, None)
    assert BDF2().stages(0.25, 0.1) == ImplicitEuler().stages(0.25, None)  # too long after the step before


def test_sdirk2_is_the_rows_of_the_table() -> None:
    # tau = g dt; w2 = x + (1 - g) dt v1, y2 = w2 + tau (v + (1 - g) dt a1), start x + dt v1 (design 6.1).
    dt, g, (x, v, z1) = 0.1, 1 - 1 / np.sqrt(2), np.random.default_rng(0).normal(size=3)
    first, second = SDIRK2().stages(dt, None)
    assert first.tau == second.tau == pytest.approx(g * dt)
    assert (first.end, second.end) == (pytest.approx(g), 1.0)
    assert combined(first.y, x, x, v, v) == combined(first.start, x, x, v, v) == pytest.approx(x + first.tau * v)
    assert combined(first.w, x, x, v, v) == x
    v1 = (z1 - x) / first.tau
    a1 = (v1 - v) / first.tau
    w2 = x + (1 - g) * dt * v1
    assert combined(second.w, x, x, v, v1) == pytest.approx(w2, rel=1e-13)
    assert combined(second.y, x, x, v, v1) == pytest.approx(w2 + second.tau * (v + (1 - g) * dt * a1), rel=1e-13)
    assert combined(second.start, x, x, v, v1) == pytest.approx(x + dt * v1, rel=1e-13)


def test_tr_bdf2_is_the_rows_of_the_table() -> None:
    dt, g, (x, v, a, zg) = 0.1, 2 - np.sqrt(2), np.random.default_rng(1).normal(size=4)
    first, second = TRBDF2().stages(dt, dt)
    tau = g * dt / 2
    assert first.tau == second.tau == pytest.approx(tau)
    assert (first.end, second.end) == (pytest.approx(g), 1.0)
    assert combined(first.w, x, x, v, a) == pytest.approx(x + tau * v)
    assert combined(first.y, x, x, v, a) == pytest.approx(x + g * dt * v + tau**2 * a)
    assert combined(first.start, x, x, v, a) == pytest.approx(x + g * dt * v)
    vg = (zg - combined(first.w, x, x, v, a)) / tau
    c1, c2 = 1 / (g * (2 - g)), (1 - g) ** 2 / (g * (2 - g))
    w2 = c1 * zg - c2 * x
    assert combined(second.w, x, zg, v, vg) == pytest.approx(w2, rel=1e-13)
    assert combined(second.y, x, zg, v, vg) == pytest.approx(w2 + tau * (c1 * vg - c2 * v), rel=1e-13)
    assert combined(second.start, x, zg, v, vg) == pytest.approx(zg + (1 - g) * dt * vg, rel=1e-13)
    assert TRBDF2().stages(dt, None) == SDIRK2().stages(dt, None)


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("method", [ImplicitEuler(), BDF2()], ids=lambda method: method.name)
def test_error_estimate_is_that_of_the_first_monomial_the_method_gets_wrong(method: Any, ratio: float) -> None:
    # Of x = t^(order + 1)/(order + 1)!, with the velocity of the past exact.
    dt, p = 0.1, method.order
    before = dt / ratio
    (stage,) = method.stages(dt, before)
    x = np.polynomial.Polynomial([0.0] * (p + 1) + [1.0])
    v = x.deriv()
    estimate = method.error(dt, before)
    assert estimate.order == p
    found = sum(w * value for w, value in zip(estimate.weights, (v(0), v(-before), v(dt)), strict=True))
    # The step with the exact velocity at its end: x' = w + tau v'.
    wrong = combined(stage.w, x(0), x(-before), v(0), v(-before)) + stage.tau * v(dt) - x(dt)
    assert found == pytest.approx(wrong, rel=1e-9)


@pytest.mark.parametrize(
    ("middle", "weights"), [(1 - 1 / np.sqrt(2), (0.0, 1 / np.sqrt(2), 1 - 1 / np.sqrt(2)))], ids=["sdirk2"]
)
def test_embedded_quadrature_is_exact_for_parabolas(middle: float, weights: tuple[float, float, float]) -> None:
    change = np.array(embedded(1.0, middle, weights)) + weights
    for power in range(3):
        assert change @ np.array([0.0, middle, 1.0]) ** power == pytest.approx(1 / (power + 1))


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("method", [ImplicitEuler(), BDF2()], ids=lambda method: method.name)
def test_stage_velocity_and_acceleration_are_exact_for_polynomials_of_the_order(method: Any, ratio: float) -> None:
    dt = 0.1
    before = dt / ratio
    (stage,) = method.stages(dt, before)
    x = np.polynomial.Polynomial([0.3, -1.2, 2.0][: method.order + 1])
    v = x.deriv()
    z = x(dt)
    velocity = (z - combined(stage.w, x(0), x(-before), v(0), v(-before))) / stage.tau
    assert velocity == pytest.approx(v(dt), rel=1e-12)
    # The same formula for the velocity: x may be of one degree more there only if it is exact for x too.
    acceleration = (z - combined(stage.y, x(0), x(-before), v(0), v(-before))) / stage.tau**2
    assert acceleration == pytest.approx(v.deriv()(dt), rel=1e-10, abs=1e-10)


def bobbing(integrator: str, dt: float, steps: int) -> tuple[Array, float]:
    """Heights of a rigidly moving 2 x 2 sheet on springs, started at its rest with unit speed, and its frequency."""
    stiffness, shape = 3.0, sheet((2, 2))
    body = Body("sheet", shape, MATERIALS["membrane"], velocity=(0.0, 0.0, 1.0), springs=(Spring("all", stiffness),))
    simulation = Simulation([body], settings=Settings(integrator=integrator, fps=1 / dt, **PRECISE))
    heights = [0.0]
    for _ in range(steps):
        record = simulation.step()
        assert record.outcome in (Outcome.CONVERGED, Outcome.ROUND_OFF)
        heights.append(float(simulation.bodies[0].positions()[0, 0, 2]))
    return np.array(heights), float(np.sqrt(stiffness / (0.25 * 0.2)))


def test_implicit_euler_damps_and_slows_an_oscillation_as_it_must() -> None:
    # Amplitude (1 + w^2 dt^2)^(-1/2) a step, frequency atan(w dt)/dt (design 1.6).
    dt, steps = 0.05, 60
    heights, omega = bobbing("implicit-euler", dt, steps)
    n = np.arange(steps + 1)
    decay, phase = (1 + (omega * dt) ** 2) ** -0.5, np.arctan(omega * dt)
    np.testing.assert_allclose(heights, decay**n * np.sin(phase * n) / omega, atol=1e-6 / omega)
    assert np.abs(heights).max() > 0.3 / omega


def test_bdf2_follows_its_recurrence() -> None:
    dt, steps = 0.05, 60
    heights, omega = bobbing("bdf2", dt, steps)
    x, v = [0.0], [1.0]
    for k in range(steps):
        (stage,) = BDF2().stages(dt, dt if k else None)
        history = (x[-1], x[-2] if k else 0.0, v[-1], v[-2] if k else 1.0)
        w, y = combined(stage.w, *history), combined(stage.y, *history)
        z = y / (1 + (omega * stage.tau) ** 2)
        x.append(z)
        v.append((z - w) / stage.tau)
    np.testing.assert_allclose(heights, x, atol=1e-10)
    swing = slice(0, 9)
    exact = np.sin(omega * dt * np.arange(steps + 1)) / omega
    euler = bobbing("implicit-euler", dt, 8)[0]
    assert np.abs(heights - exact)[swing].max() < 0.5 * np.abs(euler - exact[swing]).max()


def swinging_string(integrator: str, steps: int) -> Array:
    """Positions of a prestretched strip between two held ends after 0.08 s, a sixth of its period."""
    length, stretch, count = 1.0, 1.2, 13
    shape = sheet((count, 2), (length, length / (count - 1)))
    start = shape.positions * [stretch, 1.0, 1.0]
    start[..., 2] = 0.05 * np.sin(np.pi * shape.positions[..., 0] / length)
    strip = Body(
        "strip", shape, Material(areal_density=0.2, membrane_stiffness=15.0, poisson_ratio=0.0),
        initial_positions=start, pins=(Pin("edge:u,0"), Pin("edge:u,1")),
    )  # fmt: skip
    simulation = Simulation([strip], settings=Settings(integrator=integrator, fps=steps / 0.08, **PRECISE))
    for _ in range(steps):
        good = (Outcome.CONVERGED, Outcome.ROUND_OFF, Outcome.FIXED, Outcome.EXPLICIT)
        assert simulation.step().outcome in good
    assert simulation.record().steps == steps
    return simulation.bodies[0].positions()


@pytest.mark.parametrize("name", INTEGRATORS)
def test_measured_order_is_the_declared_one(name: str) -> None:
    fewest = 48 if INTEGRATORS[name].explicit else 12
    ends = [swinging_string(name, fewest * factor) for factor in (1, 2, 4, 8)]
    changes = [np.sqrt(np.mean(np.sum((a - b) ** 2, -1))) for a, b in zip(ends[1:], ends, strict=False)]
    orders = np.log2(np.array(changes[:-1]) / changes[1:])
    assert orders[-1] == pytest.approx(INTEGRATORS[name].order, abs=0.15)
    assert np.abs(ends[0] - ends[-1]).max() > 1e-6
    # It did swing, from 0.05 m.
    assert ends[-1][6, 0, 2] < 0.03


@pytest.mark.parametrize("name", ["tr-bdf2", "energy-momentum", "terzopoulos", "terzopoulos-exact", "linear-implicit"])
def test_threads_do_not_change_a_bit(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launching, "SHARED_FROM", 0)
    found = []
    for threads in (1, 2):
        if name == "tr-bdf2":
            simulation = busy(integrator=name, threads=threads)
        else:
            body = hanging((13, 18), material=material_for(name), springs=(Spring("corner:1,1", 3.0),), drag=0.1)
            settings = replace(REAL_TIME, integrator=name, threads=threads, fps=1200.0)
            simulation = Simulation([body], settings=settings, wind=Wind((2.0, 1.0, 0.0), gust=0.4))
        assert simulation.threads == threads
        found.append(run(simulation, 6))
    assert_same_bits(*found)
