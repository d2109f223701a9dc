"""A sheet folded up in many layers, which fall on each other: what self-contact costs where all of it touches."""

from dataclasses import replace
from typing import Any

import numpy as np

from warpdeform.body import Body
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, sheet
from warpdeform.simulation import Simulation

CLOTH = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-4, damping=2.0)


SUBSTEPS = 2
"""Steps a frame."""


def folded(nodes: int, layers: int) -> tuple[RestShape, np.ndarray[Any, Any]]:
    """A flat sheet of 1 m, and its positions [m] folded up: layers one node spacing apart, every fold one cell high.

    Args:
        nodes: Nodes along each side, at least two for each layer.
        layers: Layers.
    """
    shape = sheet((nodes, nodes), (1.0, 1.0))
    h, panel = 1.0 / (nodes - 1), (nodes - layers) // layers
    x, z, along = [0.0], [0.0], 1.0
    for cell in range(nodes - 1):
        within = cell % (panel + 1)
        if within == panel and cell // (panel + 1) < layers - 1:
            x.append(x[-1])
            z.append(z[-1] + h)
            along = -along
        else:
            x.append(x[-1] + along * h)
            z.append(z[-1])
    positions = shape.positions.copy()
    positions[..., 0], positions[..., 2] = np.array(x)[:, None], np.array(z)[:, None]
    return shape, positions


def accordion(nodes: int, layers: int, self_contact: bool = True, **settings: Any) -> Simulation:
    """The folded sheet above the ground.

    Args:
        nodes: Nodes along each side.
        layers: Layers.
        self_contact: Whether the sheet feels itself.
        settings: Further settings.
    """
    shape, positions = folded(nodes, layers)
    body = Body("sheet", shape, CLOTH, initial_positions=positions + [0.0, 0.0, 0.003], self_contact=self_contact)
    ground = Obstacle("plane", friction=0.4)
    return Simulation([body], obstacles=[ground], settings=replace(Settings(substeps=SUBSTEPS), **settings))
