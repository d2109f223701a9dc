"""Sheets and obstacles: the acceptance scenes 1 and 2 of design 5.3, the gap of 1.5 and 5.1, moving obstacles."""

import math
from typing import Any

import numpy as np
import pytest
from physics.paths import WatchedNodes
from physics.statics import GRAVITY, Array

from warpdeform.body import Body
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation
from warpdeform.track import Track, rotation_to

CLOTH = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-5)
PRECISE: dict[str, Any] = {"integrator": "implicit-euler", "newton_iterations": 0, "cg_iterations": 2000}
UNDER_TEST = {
    "plane": Obstacle("plane"),
    "sphere": Obstacle("sphere", {"radius": 0.3}, track=Track.fixed((0.0, 0.0, -0.3))),
    "plate": Obstacle("box", {"size": (0.6, 0.6, 0.002)}, track=Track.fixed((0.0, 0.0, -0.001))),
    "cone": Obstacle("cone", {"radius": 0.3, "height": 0.6}, track=Track.fixed((0.0, 0.0, -0.3))),
}
"""The tops of all of them lie in z = 0."""


def on(obstacle: Obstacle, body: Body, *, captured: bool = True, **settings: Any) -> Simulation:
    return Simulation([body], obstacles=[obstacle], settings=Settings(device="cpu", **settings), captured=captured)


def dropped(nodes: int) -> Body:
    """A sheet of 1 m over the origin, 0.2 m up, falling flat at 10 m/s."""
    return Body("sheet", sheet((nodes, nodes)), CLOTH, position=(-0.5, -0.5, 0.2), velocity=(0.0, 0.0, -10.0))


def drop(kind: str, nodes: int, rate: int, duration: float, **settings: Any) -> None:
    obstacle = UNDER_TEST[kind]
    watched = WatchedNodes(on(obstacle, dropped(nodes), captured=False, fps=rate, **settings), obstacle)
    for _ in range(round(duration * rate)):
        watched.step()
    iterations = settings.get("newton_iterations", 1) or "converged"
    print(f"\ndrop at 10 m/s on {kind}, {nodes} x {nodes}, dt 1/{rate}, Newton {iterations}:", end=" ")
    print(f"{watched.touches} crossings, nearest {watched.nearest / obstacle.gap:.3f} gaps", end="")
    assert watched.touches == 0
    assert watched.nearest > 0.1 * obstacle.gap


@pytest.mark.parametrize("rate", [60, 240])
@pytest.mark.parametrize("kind", UNDER_TEST)
def test_a_dropped_sheet_does_not_cross(kind: str, rate: int) -> None:
    drop(kind, 33, rate, 0.3)


@pytest.mark.parametrize("kind", ["plate", "cone"])
def test_a_dropped_sheet_does_not_cross_when_newton_converges(kind: str) -> None:
    drop(kind, 17, 60, 0.2, **PRECISE)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [60, 240])
@pytest.mark.parametrize("kind", UNDER_TEST)
def test_the_acceptance_drop_does_not_cross(kind: str, rate: int) -> None:
    drop(kind, 65, rate, 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("rate", [60, 240])
@pytest.mark.parametrize("kind", UNDER_TEST)
def test_the_acceptance_drop_does_not_cross_when_newton_converges(kind: str, rate: int) -> None:
    drop(kind, 65, rate, 0.1, **PRECISE)


@pytest.mark.parametrize("integrator", ["bdf2", "implicit-euler"])
@pytest.mark.parametrize(
    ("nodes", "rate"),
    [(33, 60), (33, 240), pytest.param(65, 60, marks=pytest.mark.slow), pytest.param(65, 240, marks=pytest.mark.slow)],
)
def test_a_dropped_sheet_comes_to_rest_at_the_gap(nodes: int, rate: int, integrator: str) -> None:
    simulation = on(UNDER_TEST["plane"], dropped(nodes), fps=rate, integrator=integrator)
    for _ in range(2 * rate):
        simulation.step()
    heights, gap = simulation["sheet"].positions()[..., 2], UNDER_TEST["plane"].gap
    speed = float(np.sqrt(np.mean(simulation["sheet"].velocities()[..., 2].astype(np.float64) ** 2)))
    error = float(np.abs(heights / gap - 1).max())
    print(f"\nrest after 2 s, {nodes} x {nodes}, dt 1/{rate}, {integrator}: gap off by {error:.2e}", end="")
    print(f", normal speed {speed:.1e} m/s rms", end="")
    assert error < 0.01
    assert speed < 1e-4


@pytest.mark.parametrize(("gap", "speed"), [(0.002, 1.0), (0.002, 10.0), (0.01, 3.0)])
def test_a_sheet_rests_at_the_gap_and_oscillates_about_it(gap: float, speed: float) -> None:
    """The gap eps ln(V^2 / (2 eps g)), and small oscillations of frequency sqrt(g / eps), which backward Euler turns
    into the amplitudes Re (1 + i omega dt)^-n.
    """
    obstacle = Obstacle("plane", gap=gap, design_speed=speed)
    eps = obstacle.field_constants((0.0, 0.0, -GRAVITY)).range
    lift = 1e-3 * eps
    body = Body("sheet", sheet((5, 5), (0.1, 0.1)), CLOTH, position=(0.0, 0.0, gap + lift))
    omega = math.sqrt(GRAVITY / eps)
    rate = 10.0 * omega
    tight = {"newton_tolerance": 1e-13, "cg_tolerance": 1e-10, "precision": "float64"}
    simulation = on(obstacle, body, fps=rate, **PRECISE | tight)
    assert abs(eps * math.log(speed**2 / (2.0 * eps * GRAVITY)) / gap - 1) < 1e-5
    worst = 0.0
    for step in range(1, 61):
        simulation.step()
        exact = ((1.0 + 1j * omega / rate) ** -step).real
        worst = max(worst, float(np.abs((simulation["sheet"].positions()[..., 2] - gap) / lift - exact).max()))
    print(f"\noscillation on the field, gap {gap:g} m, V {speed:g} m/s: error over amplitude {worst:.1e}", end="")
    assert worst < 2e-3


def on_an_incline(steepness: float, nodes: int = 9, **settings: Any) -> tuple[Array, float]:
    """Mean slide [m] of a sheet put down at the gap on an incline of tan a = steepness times mu = 0.5, after each step,
    and the exact one after ten seconds.
    """
    mu, seconds = 0.5, 10.0
    angle = math.atan(steepness * mu)
    normal = np.array([math.sin(angle), 0.0, math.cos(angle)])
    down = np.array([math.cos(angle), 0.0, -math.sin(angle)])
    turn = rotation_to(normal)
    obstacle = Obstacle("plane", friction=mu, track=Track.fixed((0.0, 0.0, 0.0), turn))
    x, y, z = obstacle.gap * normal
    body = Body("sheet", sheet((nodes, nodes), (0.3, 0.3)), CLOTH, position=(x, y, z), rotation=tuple(turn))
    simulation = on(obstacle, body, **settings)
    start = simulation["sheet"].positions().astype(np.float64)
    slides = []
    for _ in range(round(seconds * simulation.settings.fps)):
        simulation.step()
        slides.append(float(np.mean((simulation["sheet"].positions() - start) @ down)))
    return np.array(slides), 0.5 * GRAVITY * (math.sin(angle) - mu * math.cos(angle)) * seconds**2


def named(method: dict[str, Any]) -> str:
    return f"{method['integrator']} {method['newton_iterations'] or 'converged'}"


METHODS = [{"integrator": name, "newton_iterations": count} for name in ("bdf2", "implicit-euler") for count in (1, 0)]


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_an_incline_below_the_friction_angle_holds(method: dict[str, Any]) -> None:
    slides, _ = on_an_incline(0.95, **method)
    creep = float(np.abs(slides[-1] - slides[len(slides) // 2]))
    print(f"\nincline 0.95, {named(method)}: {1e3 * slides[-1]:.3f} mm in 10 s", end="")
    print(f", {1e3 * creep:.1e} mm of them in the last 5", end="")
    assert np.abs(slides).max() < 0.5e-3
    assert creep < 1e-6


@pytest.mark.parametrize("method", METHODS, ids=named)
def test_an_incline_above_the_friction_angle_slides_as_it_must(method: dict[str, Any]) -> None:
    slides, exact = on_an_incline(1.05, **method)
    error = slides[-1] / exact - 1
    print(f"\nincline 1.05, {named(method)}: {slides[-1]:.3f} m in 10 s, exact {exact:.3f}: {error:+.2%}", end="")
    assert abs(error) < 0.03


def on_a_sphere(friction: float, nodes: int, seconds: float) -> tuple[Simulation, Obstacle]:
    """A sheet of 0.5 m laid on a sphere, 5 cm beside its top."""
    obstacle = Obstacle("sphere", {"radius": 0.3}, friction=friction, track=Track.fixed((0.0, 0.0, -0.3)))
    body = Body("sheet", sheet((nodes, nodes), (0.5, 0.5)), CLOTH, position=(-0.2, -0.25, 0.01))
    simulation = on(obstacle, body)
    for _ in range(round(60 * seconds)):
        simulation.step()
    return simulation, obstacle


@pytest.mark.parametrize("nodes", [17, pytest.param(65, marks=pytest.mark.slow)])
def test_a_sheet_stays_on_a_rough_sphere(nodes: int) -> None:
    simulation, obstacle = on_a_sphere(0.5, nodes, 4.0)
    settled = simulation["sheet"].positions().astype(np.float64)
    for _ in range(60):
        simulation.step()
    drift = np.linalg.norm(simulation["sheet"].positions() - settled, axis=-1)
    print(f"\nsphere, mu 0.5, {nodes} x {nodes}: drift {1e3 * drift.max():.1e} mm/s from 4 s to 5 s", end="")
    assert drift.max() < 1e-3
    assert np.linalg.norm(settled - [0.0, 0.0, -0.3], axis=-1).min() > obstacle.sizes["radius"]


def test_a_sheet_slides_off_a_smooth_sphere() -> None:
    simulation, _ = on_a_sphere(0.0, 17, 2.0)
    assert simulation["sheet"].positions()[..., 2].max() < -0.6


@pytest.mark.parametrize("speed", [2.0, 10.0, 20.0])
@pytest.mark.parametrize("kind", ["sphere", "plate"])
def test_a_moving_obstacle_pushes_a_sheet_without_crossing(kind: str, speed: float) -> None:
    """Driven half a metre through a weightless sheet, at 20 m/s a third of a metre a step."""
    sizes: dict[str, Any] = {"radius": 0.1} if kind == "sphere" else {"size": (0.6, 0.6, 0.002)}
    top = 0.1 if kind == "sphere" else 0.001
    start, end = (0.013, 0.007, -top - 0.05), (0.013, 0.007, -top + 0.5)
    steps = max(round(60 * 0.55 / speed), 1) + 6
    track = Track.line(start, end, 1 / 60, 1 / 60 + 0.55 / speed)
    obstacle = Obstacle("sphere" if kind == "sphere" else "box", sizes, track=track)
    body = Body("sheet", sheet((25, 25), (0.5, 0.5)), CLOTH, position=(-0.25, -0.25, 0.0))
    watched = WatchedNodes(on(obstacle, body, captured=False, gravity=(0.0, 0.0, 0.0)), obstacle)
    for _ in range(steps):
        watched.step()
    heights = watched.handle.positions()[..., 2]
    print(
        f"\n{kind} at {speed:g} m/s: {watched.touches} crossings, nearest {watched.nearest / obstacle.gap:.3f} gaps",
        end="",
    )
    assert watched.touches == 0
    assert watched.nearest > 0.0
    if kind == "plate":
        assert heights.min() > end[2]
    else:
        assert heights[12, 12] > end[2]
