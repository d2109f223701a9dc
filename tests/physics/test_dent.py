"""The dent of the ball on the solid, at the load that the ball weighs, against the dents of finer cells."""

import numpy as np
import pytest
from physics.statics import percent

from warpdeform.scene import load_scene
from warpdeform.scene.checks.solids import DENT
from warpdeform.scene.measure import load_on_sphere
from warpdeform.scene.play import play
from warpdeform.simulation import Simulation

WEIGHT = 7.26 * 9.81


def dent(cells: int) -> float:
    """Depth of the dent of a block `cells` thick and twice as wide where it bears the weight of the ball [m].

    The ball is lowered so slowly that the block follows it at rest, past the depth of the scene.
    """
    dents, loads = [], []

    def observe(simulation: Simulation) -> None:
        handle = simulation["block"]
        points, masses = handle.positions(), np.asarray(handle.model.node_mass)
        force = load_on_sphere(
            simulation.obstacles[0], points.reshape(-1, 3), masses.reshape(-1), simulation.time, simulation.gravity
        )
        dents.append(0.152 - points[cells, cells, -1, 2])
        loads.append(force[2])

    way = {"times": [0.0, 1.0], "displacements": [[0, 0, -0.019], [0, 0, -0.074]]}
    own = {"body.0.nodes": [2 * cells + 1, 2 * cells + 1, cells + 1], "obstacle.0.path": way}
    rest = {"scene.duration": 0.45, "solver.device": "cpu"}
    played = play(load_scene("ball_on_solid", own | rest), on_frame=observe)
    assert played.failure is None
    assert loads[-1] > WEIGHT
    last = int(np.flatnonzero(np.array(loads) < WEIGHT)[-1])
    return float(np.interp(WEIGHT, loads[last : last + 2], dents[last : last + 2]))


@pytest.mark.parametrize("refined", [16, pytest.param(32, marks=pytest.mark.slow)])
def test_dent_is_that_of_a_finer_block(refined: int) -> None:
    coarse, fine = dent(8), dent(refined)
    print(f"\ndent of the ball, 8 and {refined} cells: {1e3 * coarse:.2f}, {1e3 * fine:.2f} mm", end="")
    print(f", apart {percent(coarse / fine - 1, 2)}", end="")
    assert abs(coarse / fine - 1) < 0.05
    assert abs(fine / DENT - 1) < 0.02
