"""What elastic terms of all kinds have in common when their rest shapes change over time."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import Coarsening
from warpdeform.forces.parameters import Parameters
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.growth import Growth
from warpdeform.halo import Halo
from warpdeform.launching import launch_alone
from warpdeform.team import Team

Array = NDArray[np.float64]

GROWING_STEPS = 8
"""Explicit steps from one look at a rest shape that grows to the next."""


@dataclass(frozen=True)
class GrowthOnGrid:
    """A growth on a grid.

    Attributes:
        growth: Keyframes.
        grid: The grid.
        cells: Shares of the cells in it, shape (*cells).
        nodes: Shares of the nodes, shape (*nodes).
        rest: What holds for the body now, the same on all its grids: the numbers that kernels read, scales first.
    """

    growth: Growth
    grid: ParameterGrid
    cells: Array
    nodes: Array
    rest: Parameters

    def coarser(self, transfer: Coarsening) -> "GrowthOnGrid":
        """The same growth on a coarser grid, with the mean of the shares."""
        cells, nodes = transfer.average_cells(self.cells), transfer.average_nodes(self.nodes)
        return replace(self, grid=transfer.coarse, cells=cells, nodes=nodes)

    @property
    def varies(self) -> bool:
        """Places take different shares in it."""
        return self.growth.varies

    def edge_shares(self, axis: int) -> Array:
        """Shares of the edges along an axis: a curve's are its cells, others lie between two nodes."""
        return self.cells if self.grid.dimension == 1 else self.grid.means(self.nodes, axis)


@dataclass(frozen=True)
class Regrowing:
    """One array that changes: what computes it, and from what.

    Attributes:
        name: Name of the kernel.
        kernel: Its arguments are the numbers of the moment, the shares and constants, the array as it was at the start
            and as it is now.
        dim: Launch dimensions.
        arguments: All of them.
    """

    name: str
    kernel: Any
    dim: tuple[int, int]
    arguments: tuple[wp.array, ...]


class RestGrowth:
    """Computes the coefficients and rest numbers of one elastic term from those of the shape that it starts with.

    That happens on the device and between steps, when a growth has moved on. So everything that reads them, on every
    grid, sees the rest shape of the moment, and what does not grow has no part in it. A factor for the kernels to
    multiply by, which even growth could do with, would be a variant of each of them; this costs surfaces 1 to 4 % of a
    step.

    Each kind of body has its own, which says what changes (`_keep`).

    Args:
        words: Kernels of the kind.
        growth: Growth of the body; on a coarser grid that of the finer one (`coarser`).
        grid: Parameter grid.
        layout: Memory layout.
        halo: Halo of the body's arrays.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.

    Raises:
        InputError: Shares that do not fit the grid or are none.
    """

    module: ClassVar[str] = ""
    """What the kernels of the kind are called."""
    curvatures: ClassVar[int] = 3
    """Natural curvatures and twists of the kind."""

    def __init__(
        self,
        words: Any,
        growth: Growth | GrowthOnGrid,
        grid: ParameterGrid,
        layout: Layout,
        halo: Halo,
        real: Any,
        device: Any,
    ) -> None:
        self._words, self._layout, self._halo = words, layout, halo
        self._real, self._device = real, device
        if isinstance(growth, Growth):
            start = self._entries(np.ones(grid.dimension), np.zeros(self.curvatures))
            growth = GrowthOnGrid(growth, grid, *growth.shares(grid), Parameters(start, real, device))
        self.on_grid: GrowthOnGrid = growth
        self._constants: list[wp.array] = []
        self._tasks: list[Regrowing] = []
        self._coarse: RestGrowth | None = None
        self._recorded: Team | None = None

    @staticmethod
    def _entries(scale: Array, curvature: Array) -> Array:
        """The numbers that kernels read, from scales along the axes and natural curvatures."""
        return np.concatenate([scale, curvature])

    def _upload(self, values: Array, cells: bool = False) -> wp.array:
        """Constants of the nodes or cells, with their halo."""
        array: wp.array = wp.array(self._layout.pack(values), dtype=self._real, device=self._device)
        self._constants.append(self._halo.surrounded(array, cells=cells))
        return self._constants[-1]

    def _keep(
        self,
        name: str,
        constants: Sequence[wp.array],
        arrays: Sequence[wp.array],
        *,
        less: int = 0,
        words: Any = None,
        rest: wp.array | None = None,
    ) -> None:
        """Have arrays changed by a kernel, from what they are now.

        Args:
            name: Name of the kernel.
            constants: Shares, and whatever else it reads.
            arrays: What changes, shape (n, rows, columns); the halo grows with the rest.
            less: Rows and lane groups at the end that the kernel leaves out.
            words: Other kernels, of lane width one; None takes those of the kind.
            rest: Other numbers; None takes those of the body.
        """
        width = self._layout.lane_width if words is None else 1
        kernel = getattr(words or self._words, name)
        for array in arrays:
            dim = (array.shape[1] - less, array.shape[2] // width - less)
            arguments = (self._numbers if rest is None else rest, *constants, wp.clone(array), array)
            self._tasks.append(Regrowing(name, kernel, dim, arguments))

    @property
    def _numbers(self) -> wp.array:
        return self.on_grid.rest.array

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that are launched before a step."""
        return tuple(dict.fromkeys(f"{self.module}.{task.name}" for task in self._tasks))

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = [*self._constants, *(task.arguments[-2] for task in self._tasks)]
        return sum({a.ptr: a.capacity for a in arrays}.values()) + self.on_grid.rest.bytes()

    def edge_scales(self) -> list[Array]:
        """Factors by which the rest lengths of the edges along each axis have grown by now."""
        on, scales = self.on_grid, self.on_grid.rest.values
        return [1.0 + on.edge_shares(axis) * (scales[axis] - 1.0) for axis in range(on.grid.dimension)]

    def coarser(self, transfer: Coarsening) -> GrowthOnGrid:
        """The growth of the next coarser grid, whose term names itself by `above`."""
        return self.on_grid.coarser(transfer)

    def above(self, coarse: "RestGrowth | None") -> None:
        """Lead the growth of the next coarser grid."""
        self._coarse, self._recorded = coarse, None

    def follow(self, time: float) -> None:
        """Let the rest shape be that of a time [s], here and on the coarser grids (host, between steps)."""
        on = self.on_grid
        if not on.rest.write(self._entries(*on.growth.at(time, on.grid.dimension, self.curvatures))):
            return
        if self._recorded is None:
            self.launch()
            self._recorded = Team(1, self._device)
            self._recorded.record(self.launch)
        else:
            self._recorded.replay()

    def launch(self) -> None:
        """Make the rest shape that of now."""
        for task in self._tasks:
            launch_alone(task.kernel, task.dim, *task.arguments, device=self._device)
        if self._coarse is not None:
            self._coarse.launch()
