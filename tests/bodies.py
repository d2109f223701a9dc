"""Simulations in code for tests: a hanging sheet, and a busy scene with every kind of load."""

from dataclasses import replace
from typing import Any

import numpy as np

from warpdeform.body import Body, Pin, Spring
from warpdeform.integrators import INTEGRATORS
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation
from warpdeform.track import Track
from warpdeform.wind import Wind

Array = np.ndarray[Any, Any]

SEARCHING = [name for name, method in INTEGRATORS.items() if getattr(method, "searches", False)]
"""Methods whose Newton iteration has a line search."""
EVERYWHERE = [name for name in INTEGRATORS if name != "energy-momentum"]
"""Methods that run every body and term."""

PAPER_FPS = {name: 6000.0 for name in INTEGRATORS if "terzopoulos" in name}
"""Steps a second that are stable for the paper's method."""

CLOTH = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-5)
REAL_TIME = Settings(device="cpu")
PRECISE = replace(
    REAL_TIME, precision="float64", newton_iterations=0, newton_tolerance=1e-9, cg_tolerance=1e-9, cg_iterations=2000
)
MEMBRANE = replace(CLOTH, bending_stiffness=None)
CORNERS = (Pin("corner:0,0"), Pin("corner:0,1"))
LIFT = Track.line((0.0, 0.0, 0.0), (0.3, -0.1, 0.7), 0.0, 0.5)


def hanging(nodes: tuple[int, int] = (6, 19), **body: Any) -> Body:
    return Body(**{"name": "sheet", "shape": sheet(nodes), "material": CLOTH, "pins": CORNERS} | body)


def material_for(integrator: str) -> Material:
    """Cloth, or a membrane where the method asks for it."""
    return CLOTH if integrator in EVERYWHERE else MEMBRANE


def busy(**settings: Any) -> Simulation:
    """Two bodies with every kind of load: a moving pin, a spring, gusts, drag, a moving obstacle with friction."""
    banner = hanging(pins=(Pin("corner:0,0"), Pin("corner:0,1", LIFT)), drag=0.5)
    loose: dict[str, Any] = {"pins": (), "springs": (Spring("corner:1,1", 5.0),), "velocity": (0, 0, -1)}
    scarf = hanging((4, 7), name="scarf", position=(0.0, 0.0, 0.4), **loose)
    ball = Obstacle(
        "sphere", {"radius": 0.2}, track=Track.line((0.5, 0.5, -0.1735), (0.5, 0.4, -0.07), 0.0, 0.5), friction=0.4
    )
    options = {key: settings.pop(key) for key in ("captured", "lane_width") if key in settings}
    wind, solver = Wind((3.0, 1.0, 0.0), gust=0.4), replace(REAL_TIME, **settings)
    return Simulation([banner, scarf], obstacles=[ball], wind=wind, settings=solver, **options)


def run(simulation: Simulation, steps: int) -> list[Array]:
    """Positions and velocities of all bodies after so many steps."""
    for _ in range(steps):
        simulation.step()
    return [array for body in simulation.bodies for array in (body.positions(), body.velocities())]


def assert_same_bits(found: list[Array], expected: list[Array]) -> None:
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a, b)
