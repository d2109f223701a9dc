"""Samples: something recorded as a graph, as a step is, and timed again and again."""

from collections.abc import Callable
from typing import Any

import warp as wp

from warpdeform.study.bench.machine import clock_of

NODES_PER_SAMPLE = 1 << 17
"""Work of one sample: small grids repeat a launch this many nodes long, so that no sample is shorter than the clock."""


class Sample:
    """Something that launches kernels, recorded as a graph; it keeps `launch` alive, and so the arrays behind it.

    Attributes:
        nodes: Nodes that one launch works on.
        seconds: Times per node of the rounds so far [s].
    """

    def __init__(self, launch: Callable[[], None], nodes: int, device: Any) -> None:
        """Record.

        Args:
            launch: Launches once.
            nodes: Nodes that one launch works on.
            device: Warp device.
        """
        self.nodes = nodes
        self.seconds: list[float] = []
        self._launch, self._device, self._clock = launch, device, clock_of(device)
        copies = max(1, NODES_PER_SAMPLE // nodes)
        self._node_passes = copies * nodes
        launch()  # loads the kernels, which a capture may not
        with wp.ScopedCapture(device=device) as capture:
            for _ in range(copies):
                launch()
        self._graph = capture.graph

    def time(self) -> None:
        """Take one more time."""
        wp.capture_launch(self._graph)  # brings the arrays into the cache, as far as they fit
        wp.synchronize_device(self._device)
        start = self._clock()
        wp.capture_launch(self._graph)
        wp.synchronize_device(self._device)
        self.seconds.append((self._clock() - start) / self._node_passes)
