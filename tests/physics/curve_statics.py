"""Curves at rest, and how stable they are: Newton's solver on a body of arrays, and differences of exact gradients."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import warp as wp
from curves import Curve, FakeModel
from numpy.typing import NDArray
from physics.statics import AT_REST, GRAVITY

from warpdeform.forces.force import Force
from warpdeform.forces.gravity import Gravity
from warpdeform.integrators import ImplicitEuler, Problem
from warpdeform.integrators.newton import NewtonStepper
from warpdeform.result import StepRecord
from warpdeform.settings import Settings
from warpdeform.state import State

Array = NDArray[np.float64]

STATIC = Settings(
    integrator="implicit-euler",
    newton_iterations=0,
    newton_tolerance=1e-8,
    cg_tolerance=1e-6,
    cg_iterations=100,
    precision="float64",
    device="cpu",
)


class Strands:
    """Curves with masses and pins, stepped by the engine's own solver.

    Args:
        curve: Their elastic term.
        mass: Node masses [kg], shape (n, strands).
        pinned: Which nodes are held, shape (n, strands).
        gravity: Acceleration of gravity [m/s2].
        settings: Solver settings.
        positions: Where they start [m], shape (n, strands, 3); None: at rest.
    """

    def __init__(
        self, curve: Curve, mass: Array, pinned: NDArray[np.bool_], *, gravity: Sequence[float] = (0.0, 0.0, -GRAVITY),
        settings: Settings = STATIC, positions: Array | None = None,
    ) -> None:  # fmt: skip
        iteration = wp.zeros(1, dtype=wp.int32, device="cpu")
        self.curve, self.model = curve, FakeModel(curve, mass, pinned, positions)
        self.state = State(self.model, iteration)
        terms: list[Force] = [curve.force]
        if any(gravity):
            terms.append(Gravity(self.state, gravity))
        problem = Problem([self.state], [terms], replace(settings), iteration)
        self._stepper = NewtonStepper(problem, ImplicitEuler())

    @property
    def positions(self) -> Array:
        return self.model.download(self.state.x)

    def step(self, dt: float) -> StepRecord:
        """One step of backward Euler."""
        recordings = self._stepper.recordings()
        report = self._stepper._attempt(0.0, dt, dt, lambda name: recordings[name]())
        assert report.completed, report.outcome.value
        return report

    def settle(self, dt: float = 100.0) -> Array:
        """Positions at rest: steps of `dt` [s] until no node moves by more than 1e-7 m."""
        last = self.positions
        for _ in range(100):
            report = self.step(dt)
            moved, last = float(np.abs(self.positions - last).max()), self.positions
            if moved < 1e-7:
                assert report.residual < AT_REST * GRAVITY, f"stands still out of balance: {report}"
                return last
        raise AssertionError(f"still moving by {moved:g} m a step: {report}")


def spectrum(curve: Curve, z: Array, free: NDArray[np.bool_], step: float = 1e-7) -> Array:
    """Eigenvalues of the exact Hessian at z over the free components, shape (n, 1, 3), of a single strand.

    By central differences of the exact gradient; every perturbed shape is a strand of its own.
    """
    places = np.argwhere(free[:, 0])
    bent = np.repeat(z, 2 * len(places), axis=1)
    for k, (i, c) in enumerate(places):
        bent[i, 2 * k, c] += step
        bent[i, 2 * k + 1, c] -= step
    gradient = curve.gradient(bent)
    columns = (gradient[:, ::2] - gradient[:, 1::2]) / (2 * step)
    H = columns[places[:, 0], :, places[:, 1]]
    return np.asarray(np.linalg.eigvalsh((H + H.T) / 2))


def softest(curve: Curve, z: Array, free: NDArray[np.bool_]) -> float:
    """The smallest of those eigenvalues."""
    return float(spectrum(curve, z, free)[0])


def critical(stiffness_at: Sequence[tuple[float, float]]) -> float:
    """Where a stiffness that falls with a load is zero: (load, stiffness) before and after, interpolated."""
    (before, above), (after, below) = stiffness_at
    assert above > 0 > below, f"the critical load does not lie between {before:g} and {after:g}: {above:g}, {below:g}"
    return before + (after - before) * above / (above - below)
