"""The energy budget under backward Euler: what is stored, less the work done on the sheet, falls in every step."""

from typing import Any

import numpy as np
import pytest

from warpdeform.body import Body, Pin, Spring
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import sheet
from warpdeform.simulation import Simulation
from warpdeform.track import Track
from warpdeform.wind import Wind

CLOTH = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-5)
WEIGHT = 0.2 * 9.81
"""Weight times side of the sheet [J]."""
CORNERS = (Pin("corner:0,0"), Pin("corner:1,0"))
LED = Track([0.0, 0.5, 1.0], [[0.0, 0.0, 0.0], [0.3, 0.2, 0.4], [0.0, 0.0, 0.0]])
FLOOR = Track.fixed((0.0, 0.0, -0.3))

SCENES: dict[str, dict[str, Any]] = {
    "swing": {"pins": CORNERS},
    "swing from an edge": {"pins": (Pin("edge:u,0"),)},
    "drag": {"pins": CORNERS, "drag": 1.0},
    "wind": {"pins": CORNERS, "wind": Wind((3.0, 4.0, 0.0))},
    "led pin": {"pins": (Pin("corner:0,0", track=LED), CORNERS[1])},
    "springs": {"springs": (Spring("corner:0,0", 50.0), Spring("corner:1,0", 50.0))},
    "floor": {"pins": CORNERS, "obstacles": (Obstacle("plane", track=FLOOR),)},
    "slide": {
        "position": (0.0, 0.0, -0.29),
        "velocity": (2.0, 0.0, 0.0),
        "obstacles": (Obstacle("plane", track=FLOOR, friction=0.4),),
    },
}


def budget(simulation: Simulation) -> tuple[float, float]:
    """Stored energy and work done on the sheet so far, over weight times side."""
    energy = simulation.record().energy
    stored = energy.kinetic + energy.elastic + energy.gravity + energy.field
    return stored / WEIGHT, energy.work_in / WEIGHT


@pytest.mark.parametrize("name", SCENES)
def test_energy_never_grows_but_by_work(name: str) -> None:
    scene = dict(SCENES[name])
    obstacles, wind = scene.pop("obstacles", ()), scene.pop("wind", None)
    settings = Settings(
        integrator="implicit-euler",
        newton_iterations=0,
        newton_tolerance=1e-7,
        cg_tolerance=1e-6,
        cg_iterations=5000,
        precision="float64",
        device="cpu",
    )
    body = Body("sheet", sheet((11, 11)), CLOTH, **scene)
    simulation = Simulation([body], obstacles=obstacles, wind=wind, settings=settings)
    history = [budget(simulation)]
    for _ in range(60):
        simulation.step()
        history.append(budget(simulation))
    stored, work = np.array(history).T
    growth = float(np.diff(stored - work).max())
    print(f"\nenergy, {name}: stored {stored[0]:+.3f} to {stored[-1]:+.3f}, work {work[-1]:+.3f}", end="")
    print(f", largest growth in a step {growth:+.1e} of weight times side", end="")
    assert growth < 1e-6
    if name in ("wind", "led pin"):
        assert np.diff(stored).max() > 1e-3  # the work is what makes up for it
