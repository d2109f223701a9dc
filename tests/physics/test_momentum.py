"""Bodies of every kind in free flight, spinning and wobbling: momentum and angular momentum.

The scheme keeps both. In time, momentum is kept by every method; angular momentum is lost by backward Euler, in
proportion to the step (design 1.6).
"""

from dataclasses import replace

import numpy as np
import pytest
from bodies import PRECISE
from physics.statics import Array, listed, orders

from warpdeform.body import Body
from warpdeform.material import Material
from warpdeform.section import Section
from warpdeform.shape import RestShape, block, helix, sheet, sphere
from warpdeform.simulation import Simulation

RUBBER = {"density": 1000.0, "youngs_modulus": 4e3, "poisson_ratio": 0.3}
SHAPES: dict[str, tuple[RestShape, dict[str, object]]] = {
    "curve": (helix((25,), radius=0.1, pitch=0.1, turns=2.0), {"section": Section.circular(0.01)}),
    "surface": (sheet((7, 9), (0.4, 0.5)), {}),
    "closed surface": (sphere((12, 7), 0.2), {"pressure": 4.0}),
    "solid": (block((4, 5, 6), (0.15, 0.2, 0.25)), {}),
}


def body(kind: str) -> Body:
    """A body of that kind, stretched out of shape by a fifth."""
    shape, options = SHAPES[kind]
    law = RUBBER | ({"thickness": 0.01} if "surface" in kind else {})
    start = shape.positions * [1.2, 0.9, 1.1]
    return Body(kind, shape, Material(**law), initial_positions=start, **options)  # type: ignore[arg-type]


def flown(kind: str, integrator: str, fps: float, duration: float = 0.1) -> tuple[float, float, float]:
    """How much momentum and angular momentum change in free flight, over what they are, and how far the body deforms.

    It starts out of shape, and turns about an axis that is none of its own.
    """
    settings = replace(PRECISE, integrator=integrator, gravity=(0.0, 0.0, 0.0), fps=fps)
    simulation = Simulation([body(kind)], settings=settings)
    handle = simulation[kind]
    mass = handle.model.node_mass.reshape(-1, 1)

    def momenta() -> Array:
        at, v = handle.positions().reshape(-1, 3), handle.velocities().reshape(-1, 3)
        return np.array([np.sum(mass * v, axis=0), np.sum(mass * np.cross(at, v), axis=0)])

    start = handle.positions()
    turning = np.cross([4.0, 8.0, -6.0], start - start.mean(axis=tuple(range(start.ndim - 1)))) + [0.5, -1.0, 0.2]
    handle.state.v.assign(handle.model.layout.pack(turning))
    simulation.restart()
    before, first = momenta(), np.linalg.norm(np.diff(start, axis=0), axis=-1)
    for _ in range(round(duration * fps)):
        simulation.step()
    now = np.linalg.norm(np.diff(handle.positions(), axis=0), axis=-1)
    change = np.linalg.norm(momenta() - before, axis=1) / np.linalg.norm(before, axis=1)
    return float(change[0]), float(change[1]), float(np.abs(now / first - 1).max())


@pytest.mark.parametrize("kind", SHAPES)
def test_backward_euler_keeps_momentum_and_loses_spin_with_the_step(kind: str) -> None:
    lost = []
    for fps in (500.0, 1000.0, 2000.0):
        momentum, spin, deformed = flown(kind, "implicit-euler", fps)
        assert momentum < 1e-9
        assert deformed > 0.05
        lost.append(spin)
    print(f"\n{kind} in free flight: lost spin {listed(100 * np.array(lost))} %, order {listed(orders(lost))}", end="")
    assert orders(lost)[-1] == pytest.approx(1.0, abs=0.2)


def test_a_midpoint_rule_loses_none_of_either() -> None:
    momentum, spin, deformed = flown("solid", "energy-momentum", 500.0)
    print(f"\nsolid in free flight, energy-momentum: momentum {momentum:.0e}, spin {spin:.0e}", end="")
    assert max(momentum, spin) < 1e-8
    assert deformed > 0.05
