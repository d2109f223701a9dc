"""Pressure inside a closed surface or tube: the force p n A of a constant pressure (design 1.1)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.parameters import Parameters
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.halo import Halo
from warpdeform.kernels.pressure import caps, centres, pressure
from warpdeform.launching import Whole, launch_alone, launch_lanes
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
        layout = body.layout
        self.pressure = pressure_inside
        self._periodic, self._poles = layout.periodic, layout.poles
        volume = self._enclosed(rest)
        self._rest_volume, self._outwards = abs(volume), float(np.sign(volume))
        self._halo = Halo(layout, body.real, body.device)
        within_centres = all(layout.poles)
        self._nodes = _Enclosure(body, layout.nodes, 4.0 / 3.0 if within_centres else 1.0)
        self._centres: _Centres | None = _Centres(body, self._halo) if within_centres else None
        self._push()

    def _enclosed(self, positions: NDArray[np.float64]) -> float:
        return enclosed_volume(self._periodic, positions, self._poles)

    def _push(self) -> None:
        for enclosure in (self._nodes, self._centres.enclosure if self._centres else None):
            if enclosure is not None:
                enclosure.push.write([enclosure.weight * self._outwards * self.pressure])

    @property
    def kernels(self) -> tuple[str, ...]:
        return (*self._nodes.kernels, *(self._centres.kernels if self._centres is not None else ()))

    def bytes(self) -> int:
        own = self._nodes.bytes() + self._halo.bytes()
        return own + (self._centres.bytes() if self._centres is not None else 0)

    def prepare(self, time: float, dt: float, tau: float) -> None:
        self._push()

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add -p (V - V at the start of the step) [J]."""
        self._halo.refresh(body.x, position)
        self._nodes.add_energy(body.x, position, body.x, position, partials)
        if self._centres is not None:
            self._centres.add_energy(body.x, position, partials)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        self._halo.refresh(position)
        self._nodes.add_gradient(position, position, gradient, gradient)
        if self._centres is not None:
            self._centres.add_gradient(position, gradient)
        self._halo.clear(gradient)

    def volume(self, body: BodyArrays, position: wp.array) -> float:
        """Enclosed volume [m3], in float64 on the host: for reports, between steps."""
        return self._outwards * self._enclosed(body.layout.unpack(position.numpy()))

    def stored_energy(self, body: BodyArrays, position: wp.array) -> float:
        """Energy -p (V - V at rest) [J], in float64 on the host: for reports, between steps."""
        return -self.pressure * (self.volume(body, position) - self._rest_volume)


class _Enclosure:
    """The volume within a grid of points, the nodes of a body or the centres of its cells, and its caps.

    Args:
        body: The body's arrays.
        points: Points along u and v.
        weight: What the volume counts in V.
    """

    def __init__(self, body: BodyArrays, points: tuple[int, ...], weight: float) -> None:
        layout, real, device = body.layout, body.real, body.device
        self.weight, self._layout, self._device = weight, layout, device
        self.push = Parameters([0.0], real, device)
        cells_u, cells_v = _cells(layout, points)
        self._cells_u: wp.array = wp.array(cells_u, dtype=real, device=device)
        self._cells_v: wp.array = wp.array(cells_v, dtype=real, device=device)
        rims, turns = rims_of(points, layout.periodic)
        apexes, _ = rims_of(layout.nodes, layout.periodic)
        places = [layout.places(ends.reshape(-1, 2)).reshape(ends.shape) for ends in (rims, apexes)]
        self._rims: wp.array = wp.array(places[0], dtype=wp.int32, device=device)
        self._apexes: wp.array = wp.array(places[1], dtype=wp.int32, device=device)
        self._count = rims.shape[:2]
        self._turns: wp.array = wp.array(turns, dtype=real, device=device)
        self._measured: wp.array = wp.zeros((self._count[0], 6), dtype=real, device=device)
        self._kernels = pressure(body.lane_width, real)
        self._caps: Any = caps(real) if self._count[0] else None

    @property
    def kernels(self) -> tuple[str, ...]:
        names = ("pressure.add_energy", "pressure.add_gradient")
        if self._caps is None:
            return names
        return (*names, *(f"caps.{name}" for name in ("measure", "add_energy", "add_gradient", "add_apex_gradient")))

    def bytes(self) -> int:
        arrays = (self._cells_u, self._cells_v, self._rims, self._apexes, self._turns, self._measured)
        return sum(int(array.capacity) for array in arrays) + self.push.bytes()

    def add_energy(
        self, start: wp.array, now: wp.array, nodes_start: wp.array, nodes: wp.array, partials: wp.array
    ) -> None:
        """Add -p (V - V at the start), of points and nodes at the start of the step and now."""
        column, push = self._layout.halo, self.push.array
        inputs = [start, now, self._cells_u, self._cells_v, Whole(start), column, push]
        launch_lanes(self._kernels.add_energy, self._layout, *inputs, partials, device=self._device)
        if self._caps is not None:
            inputs = [self._rims, self._turns, start, now, self._apexes, nodes_start, nodes, column, push]
            launch_alone(self._caps.add_energy, self._count[0], *inputs, partials, device=self._device)

    def add_gradient(self, now: wp.array, nodes: wp.array, gradient: wp.array, nodes_gradient: wp.array) -> None:
        """Add the derivative by the points to `gradient`, and that by the nodes in the caps to `nodes_gradient`."""
        push, device = self.push.array, self._device
        inputs = [now, self._cells_u, self._cells_v, push]
        launch_lanes(self._kernels.add_gradient, self._layout, *inputs, gradient, device=device)
        if self._caps is not None:
            k, rims, apexes, turns, measured = self._caps, self._rims, self._apexes, self._turns, self._measured
            launch_alone(k.measure, self._count[0], rims, now, apexes, nodes, measured, device=device)
            launch_alone(k.add_gradient, self._count, rims, turns, measured, now, push, gradient, device=device)
            launch_alone(k.add_apex_gradient, self._count, apexes, turns, measured, push, nodes_gradient, device=device)


class _Centres:
    """The volume within the centres of the cells, of a body that closes at poles.

    Args:
        body: The body's arrays.
        halo: Its halo.
    """

    def __init__(self, body: BodyArrays, halo: Halo) -> None:
        layout, real, device = body.layout, body.real, body.device
        cells = ParameterGrid(layout.nodes, (1.0, 1.0), layout.periodic).cells
        self.enclosure = _Enclosure(body, cells, -1.0 / 3.0)
        self._layout, self._halo, self._device = layout, halo, device
        self._kernels = centres(body.lane_width, real)
        shape = (3, layout.rows, layout.columns)
        self._start, self._now, self._gradient = (wp.zeros(shape, dtype=real, device=device) for _ in range(3))

    @property
    def kernels(self) -> tuple[str, ...]:
        return ("pressure_centres.find_centres", "pressure_centres.add_shares")

    def bytes(self) -> int:
        arrays = (self._start, self._now, self._gradient)
        return sum(int(array.capacity) for array in arrays) + self.enclosure.bytes()

    def add_energy(self, start: wp.array, position: wp.array, partials: wp.array) -> None:
        """Add to `partials`, from nodes whose halo is in step."""
        self._find(start, self._start)
        self._find(position, self._now)
        self.enclosure.add_energy(self._start, self._now, start, position, partials)

    def add_gradient(self, position: wp.array, gradient: wp.array) -> None:
        """Add to the gradient by the nodes, whose halo is in step."""
        self._find(position, self._now)
        self.enclosure.add_gradient(self._now, position, self._gradient, gradient)
        self._halo.refresh_cells(self._gradient)
        launch_lanes(self._kernels.add_shares, self._layout, self._gradient, gradient, device=self._device)

    def _find(self, position: wp.array, centres_out: wp.array) -> None:
        kernel = self._kernels.find_centres
        launch_lanes(kernel, self._layout, position, centres_out, self._gradient, device=self._device)
        self._halo.refresh_cells(centres_out)


def _cells(layout: Layout, points: tuple[int, ...]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where there is a cell from a row or a column of points to the next, shapes (1, rows, 1) and (1, 1, columns)."""
    cells_u, cells_v = np.zeros((1, layout.rows, 1)), np.zeros((1, 1, layout.columns))
    ends = [count if wraps else count - 1 for count, wraps in zip(points, layout.periodic, strict=True)]
    first = [0 if wraps else 1 for wraps in layout.periodic]
    cells_u[0, first[0] : ends[0] + 1, 0] = 1.0
    cells_v[0, 0, layout.halo - 1 + first[1] : layout.halo + ends[1]] = 1.0
    return cells_u, cells_v
