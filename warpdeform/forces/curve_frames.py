"""The material frames of a curve body: their arrays, how they follow the curve, and what holds them (design 1.3)."""

from collections.abc import Sequence
from functools import cached_property, partial
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpdeform.body import rotate
from warpdeform.forces.curve_coefficients import (
    Frames,
    material_frames,
    material_strains,
    normal_part,
    transported,
    unit_tangents,
)
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels.curve import SPIN_COMPONENTS
from warpdeform.kernels.curve_angles import CHAIN_COMPONENTS, JOINT_COMPONENTS
from warpdeform.kernels.curve_frame import LEVER_COMPONENTS, curve_frame
from warpdeform.kernels.curve_settle import curve_settle
from warpdeform.launching import do_alone, launch_alone, launch_lanes

Array = NDArray[np.float64]

UNTURNED = (0.0, 0.0, 0.0, 1.0)


class MaterialFrames:
    """Frames and angles of the segments of all strands (:mod:`warpdeform.kernels.curve_frame`).

    At the start of a step the frames are tangents and directors, and all angles are zero. Positions are measured with
    one of two sets of angles: those of the iterate, from which the next Newton iteration goes on, or trial ones.

    For the body that has them: `place` once the initial positions are known, `hold` for clamps (segments with both
    nodes pinned), `aim` before each step in which a clamp turns.

    Args:
        grid: Parameter grid.
        layout: Memory layout.
        weights: Weights of kappa_1, kappa_2 and the twist at the nodes, shape (3, rows, columns).
        floor: Smallest squared length of a segment that curvature divides by [m2].
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.
        shape: The shape whose curvature and twist need no force [m], shape (n, strands, 3).
        rest: Rest positions [m], shape (n, strands, 3); None: the same.
        director: Where director 1 points on `shape` (:func:`~warpdeform.forces.curve_coefficients.material_frames`).

    Attributes:
        start: Tangents and directors of the segments at the start of a run.
        held: 1 at segments whose director is held, and where there is no segment; shape (1, rows, columns).
        natural: kappa_1, kappa_2 and the twist that need no force, shape (3, rows, columns).
        spins: Derivatives of the weighted strains by the angles at the iterate.
        turn: How the angles follow the displacement of the last Hessian product [rad], shape (1, rows, columns).
    """

    def __init__(
        self,
        grid: ParameterGrid,
        layout: Layout,
        weights: wp.array,
        floor: Any,
        real: Any,
        device: Any,
        shape: Array,
        rest: Array | None,
        director: ArrayLike | None,
    ) -> None:
        self._grid, self._layout, self._real, self._device = grid, layout, real, device
        self._weights, self._floor = weights, floor
        self._words = curve_frame(layout.lane_width, real)
        self._walks = curve_settle(layout.lane_width, real)
        self._loop = grid.nodes[0] if grid.periodic[0] else 0
        self._last = grid.cells[0]

        def zeros(components: int) -> wp.array:
            return wp.zeros((components, layout.rows, layout.columns), dtype=real, device=device)

        # The frames at the start of the step, the twist that they had, and the directors that are held.
        self._tangent, self._director, self._twist_before = zeros(3), zeros(3), zeros(1)
        self.held, self._aim = zeros(1), zeros(3)
        # At the position that was measured last: directors by transport, what angles do to strains, their equations.
        self._u, self.lever, self._joint = zeros(3), zeros(LEVER_COMPONENTS), zeros(JOINT_COMPONENTS)
        self._newton = zeros(CHAIN_COMPONENTS), zeros(1), zeros(1)
        self._angle, self._trial_angle = zeros(1), zeros(1)
        # At the iterate.
        self.spins, self._chain, self.turn = zeros(SPIN_COMPONENTS), zeros(CHAIN_COMPONENTS), zeros(1)
        self.start = material_frames(grid, shape, director)
        # That natural curvature and twist may grow is nothing to the twist that the frames start with.
        self._unstrained = layout.pack(material_strains(grid, shape, self.start))
        self.natural: wp.array = wp.array(self._unstrained, dtype=real, device=device)
        kept = [*vars(self).values(), *self._newton]
        self._arrays = [array for array in kept if isinstance(array, wp.array) and array is not weights]
        self.hold(np.zeros(self.start.tangents.shape[:2], dtype=bool))
        self._rest = self.start if rest is None else self.start.carried(grid, rest)
        self.place(shape if rest is None else rest)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        frame = ("carry_frames", "measure_levers", "stress", "energy", "accept_frames")
        walks = ("settle_angles", "factorise_angles", "relax_angles")
        return (*(f"curve_frame.{name}" for name in frame), *(f"curve_settle.{name}" for name in walks))

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return sum(int(array.capacity) for array in self._arrays)

    def place(self, positions: Array, rotation: Sequence[float] = UNTURNED) -> None:
        """Set where the frames start from (host): at the rest shape, turned and then bent to the initial positions.

        Directors that are held are held there.

        Args:
            positions: Initial positions [m], shape (n, strands, 3).
            rotation: Rotation of the initial from the rest positions, quaternion (x, y, z, w): what positions alone do
                not tell of a straight strand.
        """
        tangents = unit_tangents(self._grid, positions)
        directors, before = rotate(rotation, self._rest.directors), rotate(rotation, self._rest.tangents)
        self.start = Frames(tangents, normal_part(transported(directors, before, tangents), tangents))
        self.aim(self.start.directors)
        self.reset()

    def hold(self, segments: NDArray[np.bool_], directors: Array | None = None) -> None:
        """Hold the directors of some segments, whose nodes are pinned: what a clamp does (host).

        Args:
            segments: Which segments, shape (segments, strands).
            directors: Where they point; None holds them as they are at the start.
        """
        held = np.ones(self._layout.nodes)
        held[: len(segments)] = segments
        self.held.assign(self._layout.pack(held))
        self.aim(self.start.directors if directors is None else directors)

    def aim(self, directors: Array) -> None:
        """Lead the held directors, shape (segments, strands, 3), of any length; between steps (host)."""
        self._aim.assign(self._layout.pack(np.asarray(directors, dtype=np.float64)))

    def reset(self) -> None:
        """Back to where the frames start from (host)."""
        self._tangent.assign(self._layout.pack(self.start.tangents))
        self._director.assign(self._layout.pack(self.start.directors))
        self._twist_before.assign(self._unstrained[2:3])
        self._angle.zero_()

    def settle(self, position: wp.array, trial: bool = False) -> wp.array:
        """Find the angles of least energy at a position, from those of the iterate; returns them."""
        angle = self._angle
        if trial:
            angle = self._trial_angle
            do_alone(lambda: wp.copy(angle, self._angle))
        self._measure(position, angle)
        arrays = (self.lever, self._weights, self.natural, self.held, self._joint, *self._newton)
        self._walk("settle_angles", *arrays, angle)
        return angle

    def linearise(self, position: wp.array, *, stretching: Sequence[wp.array], outputs: Sequence[wp.array]) -> None:
        """Stresses and slopes at a position, and how the angles follow from there.

        Args:
            position: Positions.
            stretching: Weights and rest lengths of the segments.
            outputs: Linearised stretch, slopes of the strains, flux.
        """
        angle = self.settle(position)
        stretch, slopes, flux = outputs
        self._launch(
            "stress", position, self._loop, *stretching, self._weights, self.natural, self._floor, self._u, self.lever,
            angle, stretch, slopes, self.spins, flux,
        )  # fmt: skip
        self._walk("factorise_angles", self.spins, self.held, self._joint, self._chain)

    def relax(self, slopes: wp.array, p: wp.array) -> None:
        """Write how the angles follow the displacement p into `turn`."""
        self._walk("relax_angles", slopes, self.spins, self.held, self._chain, p, self._joint, self.turn)

    def add_energy(self, position: wp.array, stretching: Sequence[wp.array], partials: wp.array) -> None:
        """Add the energy of stretch, bending and twist [J]."""
        angle = self.settle(position, trial=True)
        self._launch(
            "energy", position, self._loop, *stretching, self._weights, self.natural, self.lever, angle, partials
        )

    def accept(self, position: wp.array) -> None:
        """The step is done: its frames are what the next one starts from."""
        self._measure(position, self._angle)
        measured = (self._u, self.lever, self._angle)
        self._launch(
            "accept_frames", position, self._loop, self._floor, *measured, self._tangent, self._director,
            self._twist_before,
        )  # fmt: skip
        do_alone(self._angle.zero_)

    def keep(self) -> None:
        """Keep the frames that the next step starts from."""
        for kept, array in zip(self._kept, self._history, strict=True):
            do_alone(partial(kept.assign, array))

    def restore(self) -> None:
        """Go back to the frames that were kept."""
        for kept, array in zip(self._kept, self._history, strict=True):
            do_alone(partial(array.assign, kept))
        do_alone(self._angle.zero_)

    @property
    def _history(self) -> tuple[wp.array, ...]:
        return (self._tangent, self._director, self._twist_before)

    @cached_property
    def _kept(self) -> tuple[wp.array, ...]:
        return tuple(wp.zeros_like(array) for array in self._history)

    def strains(self, position: wp.array) -> Array:
        """kappa_1, kappa_2 and the twist [rad] of the nodes at a position, shape (n, strands, 3); zero at open ends."""
        strains = wp.zeros_like(self.natural)
        self._launch("measure_strains", self._loop, self.lever, self.settle(position, trial=True), strains)
        values = self._layout.unpack(strains.numpy())
        if not self._loop:
            values[[0, -1]] = 0.0
        return values

    def _measure(self, position: wp.array, angle: wp.array) -> None:
        """Directors by parallel transport, and what turning them does to the strains."""
        held = (self.held, self._aim)
        frames = (self._tangent, self._director)
        self._launch("carry_frames", position, self._loop, self._floor, *frames, *held, self._u, angle)
        self._launch("measure_levers", position, self._loop, self._floor, self._u, self._twist_before, self.lever)

    def _launch(self, name: str, *inputs: Any) -> None:
        kernel = getattr(self._words, name)
        if self._loop:  # neighbours at the other end: nobody can have but some rows
            launch_alone(kernel, self._layout.lane_dim, *inputs, device=self._device)
        else:
            launch_lanes(kernel, self._layout, *inputs, device=self._device)

    def _walk(self, name: str, *inputs: Any) -> None:
        """Launch a kernel with one thread for each lane group, that walks along its strands."""
        dim = self._layout.lane_dim[1]
        launch_alone(getattr(self._walks, name), dim, self._last, self._loop, *inputs, device=self._device)
