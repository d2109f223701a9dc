"""One grid of a multigrid hierarchy: its operator, its smoother, and the way to the next coarser grid (design 7.1)."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels.choice import LONG as LONG_ENTRY
from warpdeform.kernels.multigrid import multigrid
from warpdeform.launching import Whole, choose, launch_lanes
from warpdeform.linear.coarsest import DenseInverse
from warpdeform.linear.operator import GridOperator
from warpdeform.linear.smoother import LONG, SHORT, Smoother, rates_of
from warpdeform.linear.strands import StrandInverse
from warpdeform.linear.transfer import Transfer

COARSEST_NODES = 12
"""A grid of so many nodes or fewer is solved directly."""


@dataclass
class GridBody:
    """What there is of a body on a grid; attributes as in :class:`~warpdeform.forces.force.GridArrays`."""

    layout: Layout
    real: Any
    lane_width: int
    device: Any
    mass: wp.array
    free: wp.array


@dataclass(frozen=True)
class Vectors:
    """Arrays of a level that the cycle writes, shape (3, rows, columns).

    Attributes:
        position: Where the terms are linearised [m].
        solution: What the cycle finds [m].
        change: Scratch [m].
    """

    position: wp.array
    solution: wp.array
    change: wp.array


class Level:
    """One grid of the hierarchy of one body, with all coarser ones behind it.

    Args:
        grid: Its grid.
        lengths: Mean distance of neighbours along each axis [m].
        mass: Node masses [kg], shape (*nodes).
        operator: A on this grid.
        vectors: The arrays that the cycle writes.
        stiff: Node-wise terms or pins leave the coarse grid something to feel.
        caution: Which rates the smoother takes (:mod:`warpdeform.kernels.multigrid`), int32, shape (3,).

    Attributes:
        coarse: The next coarser grid; None where there is none.
        strands: The direct solve that curves have in place of all this; None for surfaces and solids.
    """

    def __init__(
        self,
        grid: ParameterGrid,
        lengths: tuple[float, ...],
        mass: NDArray[np.float64],
        operator: GridOperator,
        vectors: Vectors,
        stiff: bool,
        caution: wp.array,
    ) -> None:
        body = operator.body
        self._caution = caution
        self._body, self._operator, self._stiff = body, operator, stiff
        self.position, self.solution = vectors.position, vectors.solution
        self._kernels = multigrid(body.lane_width, body.real)
        self.coarse: Level | None = None
        self.strands = StrandInverse(operator) if grid.dimension == 1 else None
        if self.strands is not None:
            return

        def zeros(components: int) -> wp.array:
            shape = (components, body.layout.rows, body.layout.columns)
            return wp.zeros(shape, dtype=body.real, device=body.device)

        # What a coarser grid feels of contact and pins is gone before the cycle begins.
        self._stiffening = zeros(6)
        self.residual, self._change = self._stiffening[:3], self._stiffening[3:]
        self._changes = (self._change, vectors.change)
        self.inverse = zeros(6)
        self._elastic = zeros(6) if operator.blocks is not None else self.inverse
        self._coarsest: DenseInverse | None = None
        coarser = grid.coarser(lengths) if grid.node_count > COARSEST_NODES else None
        if coarser is None:
            self._coarsest = DenseInverse(operator)
            return
        self._transfer = Transfer(grid, body.layout, coarser, body.real, body.device)
        self._pairs = [(term, coarse) for term in operator.terms if (coarse := term.coarser(self._transfer))]
        self.coarse = self._make_coarse(lengths, mass, caution)
        bound = float(max((term.sample_nodes for term in operator.terms), default=1))
        self._rates: wp.array = wp.array(rates_of(bound), dtype=body.real, device=body.device)
        self._long = caution[LONG_ENTRY : LONG_ENTRY + 1]

    def _make_coarse(self, lengths: tuple[float, ...], mass: NDArray[np.float64], caution: wp.array) -> "Level":
        body, transfer = self._body, self._transfer
        layout, growth = transfer.layout, transfer.growth

        def upload(values: NDArray[np.float64]) -> wp.array:
            return wp.array(layout.pack(values), dtype=body.real, device=body.device)

        def zeros(components: int) -> wp.array:
            return wp.zeros((components, layout.rows, layout.columns), dtype=body.real, device=body.device)

        coarse_mass = transfer.gather(mass)
        free = upload(np.ones(layout.nodes))
        arrays = GridBody(layout, body.real, body.lane_width, body.device, upload(coarse_mass), free)
        terms = [coarse for _, coarse in self._pairs]
        operator = GridOperator(arrays, self._operator.inertia, zeros(6) if self._stiff else None, terms)
        coarse_lengths = tuple(length * grown for length, grown in zip(lengths, growth, strict=True))
        vectors = Vectors(zeros(3), zeros(3), zeros(3))
        return Level(transfer.coarse, coarse_lengths, coarse_mass, operator, vectors, self._stiff, caution)

    def bytes(self) -> int:
        """Device memory of this level and the coarser ones that nothing else counts [bytes]."""
        if self.strands is not None:
            return self.strands.bytes()
        own = self._stiffening.capacity + self.inverse.capacity
        if self._elastic is not self.inverse:
            own += self._elastic.capacity
        if self.coarse is None:
            return own + (self._coarsest.bytes() if self._coarsest else 0)
        coarse, operator = self.coarse, self.coarse._operator
        arrays = (*coarse._changes[1:], coarse.position, coarse.solution, operator.body.mass, operator.body.free)
        own += sum(array.capacity for array in arrays) + self._transfer.bytes()
        own += operator.blocks.capacity if operator.blocks is not None else 0
        return own + sum(term.bytes() for term in operator.terms) + coarse.bytes()

    def update_blocks(self) -> None:
        """Rebuild D^-1, and what a coarser grid feels of contact and pins, from terms linearised at `position`."""
        if self.strands is not None:
            self.strands.update()
            return
        body, operator = self._body, self._operator
        operator.start_blocks(self._elastic)
        operator.add_elastic_diagonal(self._elastic)
        if operator.blocks is not None:
            self._launch(
                "split_blocks", body.mass, operator.inertia, body.free, operator.blocks, self._elastic,
                self.inverse, self._stiffening,
            )  # fmt: skip
        else:
            if self._stiff:
                self._launch("hold_pins", body.free, self._elastic, self._stiffening)
            operator.launch("invert_blocks", self._elastic, self.inverse)

    def update_coarse(self) -> None:
        """Rebuild the coarser grids, or the inverse where there are none; follows `update_blocks`."""
        if self.strands is not None:
            return
        if self._coarsest is not None:
            self._coarsest.update(self._change)
            return
        coarse = self.coarse
        assert coarse is not None
        coarse._launch("carry", Whole(self.position), self._transfer.positions, coarse.position)
        for fine_term, coarse_term in self._pairs:
            coarse_term.linearise(coarse._body, coarse.position)
            fine_term.coarsen(self._transfer, coarse_term)
        if coarse._operator.blocks is not None:
            coarse._operator.start_blocks(coarse._operator.blocks)
            coarse._launch(
                "add_carried_blocks", Whole(self._stiffening), self._transfer.restrict, coarse._operator.blocks
            )
        if coarse.coarse is not None:
            coarse.update_blocks()
        coarse.update_coarse()

    def cycle_cost(self, smoother: Smoother) -> float:
        """Matrix-vector products on this grid that the cycle costs, coarser grids counted by their lane groups."""
        if self.coarse is None:
            return 1.0
        rows, groups = self._body.layout.lane_dim
        coarse_rows, coarse_groups = self.coarse._body.layout.lane_dim
        share = coarse_rows * coarse_groups / (rows * groups)
        return 2.0 * smoother.degree + share * self.coarse.cycle_cost(smoother)

    def cycle(self, residual: wp.array) -> None:
        """One V-cycle from zero: `solution` becomes an approximation of A^-1 residual, shape (3, rows, columns)."""
        if self.strands is not None:
            self.strands.apply(residual, self.solution)
            return
        if self._coarsest is not None:
            self._coarsest.apply(residual, self.solution)
            return
        assert self.coarse is not None
        free, inverse = self._body.free, self.inverse
        vectors = (self.residual, self._change, self.solution)
        self._launch("start_smoother", free, inverse, residual, self._rates, self._caution, *vectors)
        self._smooth(1)
        coarse, tables = self.coarse, self._transfer
        blocks = (free, self._elastic, inverse)
        last = self._changes[1]  # the short smoother and the long one end in the same place
        self._operator.launch_product("retire", last, *blocks, last, self.residual, self._change)
        filtered = self._elastic is not inverse
        coarse._launch("carry", Whole(self._change if filtered else self.residual), tables.restrict, coarse.residual)
        coarse.cycle(coarse.residual)
        correction = (self._change, self.solution)
        if filtered:
            self._launch("correct_filtered", Whole(coarse.solution), tables.prolong, *blocks, *correction)
        else:
            self._launch("correct", Whole(coarse.solution), tables.prolong, free, *correction)
        self._smooth(0)

    def _smooth(self, first: int) -> None:
        """Steps of the smoother from `first` on, each from the change that the one before has made."""
        self._smooth_steps(first, range(first, SHORT.degree))
        choose(self._long, lambda: self._smooth_steps(first, range(SHORT.degree, LONG.degree)), None)

    def _smooth_steps(self, first: int, steps: range) -> None:
        for step in steps:
            given, found = self._changes[(step - first) % 2], self._changes[(step - first + 1) % 2]
            inputs = (self._body.free, self.inverse, self._rates, self._caution, step)
            self._operator.launch_product("smooth", given, *inputs, given, self.residual, found, self.solution)

    def _launch(self, name: str, *inputs: Any) -> None:
        kernel = getattr(self._kernels, name)
        launch_lanes(kernel, self._body.layout, *inputs, device=self._body.device)
