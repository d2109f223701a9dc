"""How far two states of a sheet are apart (design 6.3)."""

import numpy as np

from warpdeform.study.peers.sheet import Array

BLOCKS = 5
"""Blocks along each side of the averages."""


def rms(positions: Array, reference: Array) -> float:
    """Root mean square of the node distances [m].

    Args:
        positions: Positions [m], shape (n, n, 3).
        reference: What they should be [m], of the same shape.
    """
    return float(np.sqrt(np.mean(np.sum((positions - reference) ** 2, axis=-1))))


def block_averaged(positions: Array, reference: Array) -> float:
    """Root mean square of the distances after averaging them over blocks [m]: c4, blind to finer folds.

    The blocks are the hat functions of a 5 x 5 grid over the sheet (four coarse cells along each side), so that the
    measure means the same at every resolution.

    Args:
        positions: Positions [m], shape (n, n, 3).
        reference: What they should be [m], of the same shape.
    """
    along = np.linspace(0.0, BLOCKS - 1.0, positions.shape[0])
    hats = np.maximum(0.0, 1.0 - np.abs(along - np.arange(BLOCKS)[:, None]))
    hats[:, [0, -1]] *= 0.5  # a node on the rim stands for half the area
    hats /= hats.sum(axis=1, keepdims=True)
    averages = np.einsum("ai,bj,ijk->abk", hats, hats, positions - reference)
    return float(np.sqrt(np.mean(np.sum(averages**2, axis=-1))))
