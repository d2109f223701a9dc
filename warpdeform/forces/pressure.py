"""Pressure inside a closed surface or tube: the force p n A of a constant pressure (design 1.1)."""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.parameters import Parameters
from warpdeform.halo import Halo
from warpdeform.kernels.pressure import caps, pressure
from warpdeform.launching import launch_alone, launch_lanes
from warpdeform.measure import enclosed_volume, rims_of


class Pressure(Force):
    """The potential -p V of the enclosed volume V; ends that are open are closed by caps without mass.

    A constant pressure is that of a large reservoir; what escapes or is compressed is not counted. It has no Hessian
    here: that of -p V is not positive semi-definite, so Newton sees the pressure through the gradient only.

    Attributes:
        pressure: p inside over outside [Pa]; may be changed between steps; negative sucks the body flat.
    """

    name = "pressure"
    energy_kind = "field"

    def __init__(
        self,
        body: BodyArrays,
        pressure_inside: float,
        rest: NDArray[np.float64],
    ) -> None:
        """Make the term.

        Args:
            body: The body's arrays.
            pressure_inside: p [Pa].
            rest: Rest positions [m], shape (nu, nv, 3), which tell inside from outside; one axis at least is periodic.
        """
        layout, real, device = body.layout, body.real, body.device
        self.pressure = pressure_inside
        self._periodic = layout.periodic
        volume = enclosed_volume(layout.periodic, rest)
        self._rest_volume, self._outwards = abs(volume), float(np.sign(volume))
        self._push = Parameters([self._outwards * pressure_inside], real, device)
        self._halo = Halo(layout, real, device)
        cells_u, cells_v = np.zeros((1, layout.rows, 1)), np.zeros((1, 1, layout.columns))
        ends = [count if wraps else count - 1 for count, wraps in zip(layout.nodes, layout.periodic, strict=True)]
        first = [0 if wraps else 1 for wraps in layout.periodic]
        cells_u[0, first[0] : ends[0] + 1, 0] = 1.0
        cells_v[0, 0, layout.halo - 1 + first[1] : layout.halo + ends[1]] = 1.0
        self._cells_u: wp.array = wp.array(cells_u, dtype=real, device=device)
        self._cells_v: wp.array = wp.array(cells_v, dtype=real, device=device)
        rims, turns = rims_of(layout.nodes, layout.periodic)
        self._count = rims.shape[:2]
        places = layout.places(rims.reshape(-1, 2)).reshape(*self._count, 2)
        self._rims: wp.array = wp.array(places, dtype=wp.int32, device=device)
        self._turns: wp.array = wp.array(turns, dtype=real, device=device)
        self._measured: wp.array = wp.zeros((self._count[0], 6), dtype=real, device=device)
        self._kernels = pressure(body.lane_width, real)
        self._caps = caps(real) if self._count[0] else None

    @property
    def kernels(self) -> tuple[str, ...]:
        names = ("pressure.add_energy", "pressure.add_gradient")
        return names if self._caps is None else (*names, "caps.measure", "caps.add_energy", "caps.add_gradient")

    def bytes(self) -> int:
        arrays = (self._cells_u, self._cells_v, self._rims, self._turns, self._measured)
        return sum(int(array.capacity) for array in arrays) + self._push.bytes() + self._halo.bytes()

    def prepare(self, time: float, dt: float, tau: float) -> None:
        self._push.write([self._outwards * self.pressure])

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add -p (V - V at the start of the step) [J]."""
        self._halo.refresh(body.x, position)
        halo, push = body.layout.halo, self._push.array
        inputs = [body.x, position, self._cells_u, self._cells_v, halo, push]
        launch_lanes(self._kernels.add_energy, body.layout, *inputs, partials, device=body.device)
        if self._caps is not None:
            inputs = [self._rims, self._turns, body.x, position, halo, push]
            launch_alone(self._caps.add_energy, self._count[0], *inputs, partials, device=body.device)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        self._halo.refresh(position)
        push = self._push.array
        inputs = [position, self._cells_u, self._cells_v, push]
        launch_lanes(self._kernels.add_gradient, body.layout, *inputs, gradient, device=body.device)
        self._halo.clear(gradient)
        if self._caps is not None:
            measured = self._measured
            launch_alone(self._caps.measure, self._count[0], self._rims, position, measured, device=body.device)
            inputs = [self._rims, self._turns, self._measured, position, push]
            launch_alone(self._caps.add_gradient, self._count, *inputs, gradient, device=body.device)

    def volume(self, body: BodyArrays, position: wp.array) -> float:
        """Enclosed volume [m3], in float64 on the host: for reports, between steps."""
        return self._outwards * enclosed_volume(self._periodic, body.layout.unpack(position.numpy()))

    def stored_energy(self, body: BodyArrays, position: wp.array) -> float:
        """Energy -p (V - V at rest) [J], in float64 on the host: for reports, between steps."""
        return -self.pressure * (self.volume(body, position) - self._rest_volume)
