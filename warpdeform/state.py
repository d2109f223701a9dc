"""What changes while a simulation runs: the state of one body and the vectors of its step."""

from typing import Any

import warp as wp

from warpdeform.model import Model


class State:
    """State and step vectors of one body; component arrays of shape (3, rows, columns) unless said otherwise.

    Attributes:
        model: The body's constants.
        x: Positions [m].
        v: Velocities [m/s].
        x_before: Positions one step before [m].
        v_before: Velocities one step before [m/s].
        w: Base of the stage velocity [m].
        y: Inertial target [m].
        z: Newton iterate [m].
        trial: Line search's trial point [m]; in the memory of `search`, which has done its work by then.
        gradient: Gradient of the incremental potential [N].
        direction: Newton direction [m].
        residual: Residual of the linear solve [N].
        search: Search direction of conjugate gradient [m].
        product: Matrix times search direction [N].
        conditioned: Preconditioned residual [m].
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
        self.x, self.v, self.x_before, self.v_before = (model.zeros(3) for _ in range(4))
        self.w, self.y, self.z = (model.zeros(3) for _ in range(3))
        self.gradient, self.direction, self.residual = (model.zeros(3) for _ in range(3))
        self.search, self.product, self.conditioned = (model.zeros(3) for _ in range(3))
        self.trial = self.search
        plane = (self.layout.rows, self.layout.columns)
        self.partials: wp.array = wp.zeros(plane, dtype=wp.float64, device=self.device)
        self.dots = self.partials
        self.reset()

    def reset(self) -> None:
        """Back to the initial state."""
        model = self.model
        self.x.assign(model.layout.pack(model.initial_positions))
        self.x_before.assign(self.x)
        velocity = model.initial_positions * 0.0 + model.body.velocity
        self.v.assign(model.layout.pack(velocity))
        self.v_before.assign(self.v)

    def bytes(self) -> int:
        """Device memory of state, step vectors and constants [bytes]."""
        arrays: list[Any] = [a for a in (*vars(self).values(), self.model.target) if isinstance(a, wp.array)]
        return sum({a.ptr: a.capacity for a in arrays}.values())
