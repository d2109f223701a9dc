"""How far two states of a body are apart (design 6.3)."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLOCKS = 5
"""Blocks along each axis of the averages."""


def rms(positions: Array, reference: Array) -> float:
    """Root mean square of the node distances [m].

    Args:
        positions: Positions [m], shape (*nodes, 3).
        reference: What they should be [m], of the same shape.
    """
    return float(np.sqrt(np.mean(np.sum((positions - reference) ** 2, axis=-1))))


def block_averaged(positions: Array, reference: Array, connected: int = 3) -> float:
    """Root mean square of the distances after averaging them over blocks [m]: c4, blind to finer folds.

    The averages are those of `block_averages`, so that the measure means the same at every resolution.

    Args:
        positions: Positions [m], shape (*nodes, 3).
        reference: What they should be [m], of the same shape.
        connected: Axes to average over, as in `block_averages`.
    """
    apart = block_averages(positions, connected) - block_averages(reference, connected)
    return float(np.sqrt(np.mean(np.sum(apart**2, axis=-1))))


def block_averages(positions: Array, connected: int = 3) -> Array:
    """Positions averaged with the hat functions of a grid of 5 (x 5 (x 5)) nodes over the body [m].

    Args:
        positions: Positions [m], shape (*nodes, 3).
        connected: Axes to average over; the second axis of curves counts strands, which are not averaged.
    """
    averages = np.asarray(positions, dtype=np.float64)
    for axis in range(min(connected, averages.ndim - 1)):
        averages = np.moveaxis(np.tensordot(_hats(averages.shape[axis]), averages, axes=(1, axis)), 0, axis)
    return averages


def _hats(nodes: int) -> Any:
    """Weights of so many nodes in each block, shape (blocks, nodes); a node on the rim stands for half a cell."""
    blocks = min(BLOCKS, nodes)
    along = np.linspace(0.0, blocks - 1.0, nodes)
    hats = np.maximum(0.0, 1.0 - np.abs(along - np.arange(blocks)[:, None]))
    hats[:, [0, -1]] *= 0.5
    return hats / hats.sum(axis=1, keepdims=True)
