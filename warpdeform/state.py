"""What changes while a simulation runs: the state of one body and the vectors of its step."""

from functools import cached_property
from typing import Any

import warp as wp

from warpdeform.model import Model


class State:
    """State and step vectors of one body; component arrays of shape (3, rows, columns) unless said otherwise.

    A vector of a step is allocated when a method first asks for it, so that a body has those that its method needs.

    Attributes:
        model: The body's constants.
        x: Positions [m].
        v: Velocities [m/s].
        partials: Partial sums per lane group or node, float64, shape (rows, columns).
        dots: Partial sums of inner products, float64, shape (rows, columns); in the memory of `partials`.
        iteration: Newton iteration of this step, int32, shape (1,); shared by the bodies of a simulation.
    """

    def __init__(self, model: Model, iteration: wp.array) -> None:
        self.model = model
        self.layout, self.real, self.lane_width = model.layout, model.real, model.lane_width
        self.device = model.device
        self.mass, self.free = model.mass, model.free
        self.iteration = iteration
        self.x, self.v = model.zeros(3), model.zeros(3)
        plane = (self.layout.rows, self.layout.columns)
        self.partials: wp.array = wp.zeros(plane, dtype=wp.float64, device=self.device)
        self.dots = self.partials
        self.reset()

    @cached_property
    def x_before(self) -> wp.array:
        """Positions one step before [m], or at the start of a burst of explicit steps."""
        return self.model.zeros(3)

    @cached_property
    def v_before(self) -> wp.array:
        """Velocities at the same time [m/s]."""
        return self.model.zeros(3)

    @cached_property
    def x_mid(self) -> wp.array:
        """Positions at the end of the first of two stages [m]."""
        return self.model.zeros(3)

    @cached_property
    def v_mid(self) -> wp.array:
        """Velocities there [m/s]."""
        return self.model.zeros(3)

    @cached_property
    def a(self) -> wp.array:
        """Accelerations at the end of the last step [m/s2], where a method keeps them."""
        return self.model.zeros(3)

    @cached_property
    def w(self) -> wp.array:
        """Base of the stage velocity [m]."""
        return self.model.zeros(3)

    @cached_property
    def y(self) -> wp.array:
        """Inertial target [m]."""
        return self.model.zeros(3)

    @cached_property
    def z(self) -> wp.array:
        """Newton iterate [m]; in explicit steps the positions of every other one."""
        return self.model.zeros(3)

    @cached_property
    def gradient(self) -> wp.array:
        """Gradient of the incremental potential [N]."""
        return self.model.zeros(3)

    @cached_property
    def loads(self) -> wp.array:
        """What of the gradient is not stored as energy [N], where explicit steps count its work."""
        return self.model.zeros(3)

    @cached_property
    def direction(self) -> wp.array:
        """Newton direction, or the displacement of an explicit step [m]."""
        return self.model.zeros(3)

    @cached_property
    def residual(self) -> wp.array:
        """Residual of the linear solve [N]."""
        return self.model.zeros(3)

    @cached_property
    def search(self) -> wp.array:
        """Search direction of conjugate gradient [m]."""
        return self.model.zeros(3)

    @property
    def trial(self) -> wp.array:
        """Line search's trial point [m]; in the memory of `search`, which has done its work by then."""
        return self.search

    @cached_property
    def product(self) -> wp.array:
        """Matrix times search direction [N]."""
        return self.model.zeros(3)

    @cached_property
    def conditioned(self) -> wp.array:
        """Preconditioned residual [m]."""
        return self.model.zeros(3)

    def reset(self) -> None:
        """Back to the initial state."""
        model = self.model
        self.x.assign(model.layout.pack(model.initial_positions))
        velocity = model.initial_positions * 0.0 + model.body.velocity
        self.v.assign(model.layout.pack(velocity))
        for name in ("x_before", "v_before", "a"):
            if name in vars(self):
                getattr(self, name).zero_()

    def bytes(self) -> int:
        """Device memory of state, step vectors and constants [bytes]."""
        arrays: list[Any] = [a for a in (*vars(self).values(), self.model.target) if isinstance(a, wp.array)]
        return sum({a.ptr: a.capacity for a in arrays}.values())
