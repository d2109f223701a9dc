"""Frenet's curvature and torsion of a polygon: what geometry sees of a curve, measured on the host.

Torsion is not an energy here. The paper's term in it is undefined wherever a curve is straight, and a rod can be
twisted without being bent: material twist is what resists (:mod:`warpdeform.kernels.curve_frame`, design 1.3).
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def frenet(positions: Array, closed: bool = False) -> tuple[Array, Array]:
    """Curvature at the nodes and torsion at the segments of curves.

    Args:
        positions: Node positions [m], shape (n, ...., 3), nodes along the first axis.
        closed: The last node is followed by the first.

    Returns:
        Curvature [1/m], 2 tan(phi/2) over the mean of the two edges, at the nodes that have two neighbours, shape
        (n - 2, ...), of closed curves (n, ...); torsion [1/m], the angle between the binormals at the ends of a segment
        over its length, positive for right-handed helices, at the segments between such nodes, shape (n - 3, ...) or
        (n, ...). Torsion is not a number where an end of the segment is straight.
    """
    if closed:
        positions = np.concatenate([positions, positions[:2]])
    b = np.diff(positions, axis=0)
    lengths = np.linalg.norm(b, axis=-1)
    kb = 2.0 * np.cross(b[:-1], b[1:])
    kb /= (lengths[:-1] * lengths[1:] + np.sum(b[:-1] * b[1:], axis=-1))[..., None]
    curvature = np.linalg.norm(kb, axis=-1) / (0.5 * (lengths[:-1] + lengths[1:]))
    if closed:
        # Nodes 1 .. n - 1 and 0; then segments 1 .. n - 1 and 0.
        kb, curvature = (np.roll(values, 1, axis=0) for values in (kb, curvature))
        kb = np.concatenate([kb, kb[:1]])
        middle, along = b[: len(curvature)], lengths[: len(curvature)]
    else:
        middle, along = b[1:-1], lengths[1:-1]
    sine = np.sum(np.cross(kb[:-1], kb[1:]) * middle, axis=-1) / along
    cosine = np.sum(kb[:-1] * kb[1:], axis=-1)
    straight = np.linalg.norm(kb, axis=-1) == 0.0
    torsion = np.where(straight[:-1] | straight[1:], np.nan, np.arctan2(sine, cosine) / along)
    return curvature, torsion
