"""What clamps do to the material frames of curves: pinned segments hold and turn their directors (design 1.3)."""

import numpy as np
from numpy.typing import NDArray

from warpdeform.body import Body, rotate
from warpdeform.selectors import select_nodes

Array = NDArray[np.float64]


class Clamps:
    """The segments of a curve body whose nodes are both pinned by one pin: it holds them in place and direction.

    Args:
        body: A curve.

    Attributes:
        twist: Some strand is clamped in more than one place, so that its twist cannot get away.
        change: Some clamp turns, or lets go.
    """

    def __init__(self, body: Body) -> None:
        grid = body.shape.grid
        self._segments = (grid.cells[0], grid.nodes[1])
        self._pins = [
            (pin, segments)
            for pin in body.pins
            if (segments := _segments(select_nodes(pin.nodes, body.nodes, body.kind), body)).any()
        ]
        held = self.held(0.0)
        before = np.roll(held, 1, axis=0)
        before[0] &= grid.periodic[0]
        self.twist = bool(((held & ~before).sum(axis=0) > 1).any())
        pins = [pin for pin, _ in self._pins]
        self.change = any(pin.until is not None or (pin.track and not pin.track.static) for pin in pins)

    def held(self, time: float) -> NDArray[np.bool_]:
        """Which segments are held in a step that ends at `time` [s], shape (segments, strands)."""
        held = np.zeros(self._segments, dtype=bool)
        for pin, segments in self._pins:
            if not pin.is_over(time):
                held |= segments
        return held

    def directors(self, start: Array, time: float) -> Array:
        """Where pins have turned the directors by `time` [s]; both of shape (segments, strands, 3)."""
        turned = start.copy()
        for pin, segments in self._pins:
            if pin.track is not None:
                turned[segments] = rotate(pin.track.pose(time)[1].tolist(), start[segments])
        return turned


def _segments(nodes: NDArray[np.int64], body: Body) -> NDArray[np.bool_]:
    """Segments with both nodes among some nodes."""
    grid = body.shape.grid
    pinned = np.zeros(grid.nodes, dtype=bool)
    pinned[tuple(nodes.T)] = True
    return np.asarray(pinned[: grid.cells[0]] & np.roll(pinned, -1, axis=0)[: grid.cells[0]])
