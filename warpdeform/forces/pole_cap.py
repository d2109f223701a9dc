"""What closes the poles of a surface: a part of its elastic energy, from strips across each pole (design 1.3)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout, ring_at
from warpdeform.kernels import pole_cap as kernels
from warpdeform.kernels.surface import TENSION_COMPONENTS
from warpdeform.launching import launch_alone

Array = NDArray[np.float64]


class PoleCap:
    """The membrane in the poles of one surface; its forces are gathered with those of the cells.

    Bending needs no part of its own: second differences go on across a pole
    (:mod:`warpdeform.forces.surface_bending`).

    Args:
        layout: Memory layout; one end of its open axis at least is a pole.
        stiffness: K of q per strip, shape (poles, n/2, 15).
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.

    Attributes:
        K: K of q per strip, shape (15, poles, n/2).
        q0: Strain numbers at rest, shape (5, poles, n/2).
        tension: Clipped geometric stiffness, shape (4, poles, n/2).
    """

    def __init__(self, layout: Layout, stiffness: Array, real: Any, device: Any) -> None:
        self._device, self._real = device, real
        self._words = kernels.pole_cap(real)
        ends = [end for end, pole in zip((0, -1), layout.poles, strict=True) if pole]
        rings = np.array([layout.places(ring_at(layout.nodes, layout.periodic, end)) for end in ends])
        slots, signs = zip(*(_slots(layout, ring, end) for ring, end in zip(rings, ends, strict=True)), strict=True)
        self._rings: wp.array = wp.array(rings, dtype=wp.int32, device=device)
        self._slots: wp.array = wp.array(np.array(slots), dtype=wp.int32, device=device)
        self._signs: wp.array = wp.array(signs, dtype=real, device=device)
        self._nodes, self._strips = rings.shape[:2], stiffness.shape[:2]
        self.K: wp.array = wp.array(np.moveaxis(stiffness, -1, 0), dtype=real, device=device)
        self.q0 = self._zeros(5)
        self.tension = self._zeros(TENSION_COMPONENTS)
        self._flux = self._zeros(kernels.STRIP_FLUX)

    def _zeros(self, components: int) -> wp.array:
        return wp.zeros((components, *self._strips), dtype=self._real, device=self._device)

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that a step launches."""
        names = ("stress_strips", "product_strips", "hand_over", "energy_strips", "block_strips")
        return tuple(f"pole_cap.{name}" for name in names)

    def bytes(self) -> int:
        """Device memory [bytes]."""
        arrays = (self._rings, self._slots, self._signs, self.K, self.q0, self.tension, self._flux)
        return int(sum(array.capacity for array in arrays))

    def measure(self, position: wp.array, q_out: wp.array) -> None:
        """Strain numbers of the strips, shape (5, poles, n/2)."""
        self._launch(self._words.measure, self._strips, self._rings, position, q_out)

    def linearise(self, position: wp.array, flux: wp.array) -> None:
        """Stresses at `position`, into the cells' flux."""
        inputs = (self._rings, position, self.K, self.q0, self.tension, self._flux)
        self._launch(self._words.stress_strips, self._strips, *inputs)
        self._hand_over(flux)

    def write_fluxes(self, position: wp.array, direction: wp.array, flux: wp.array) -> None:
        """The projected Hessian at `position` times `direction`, into the cells' flux."""
        inputs = (self._rings, position, self.K, self.tension, direction, self._flux)
        self._launch(self._words.product_strips, self._strips, *inputs)
        self._hand_over(flux)

    def add_energy(self, position: wp.array, partials: wp.array) -> None:
        """Add the energy [J]."""
        self._launch(self._words.energy_strips, self._strips, self._rings, position, self.K, self.q0, partials)

    def add_block_diagonal(self, position: wp.array, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian."""
        self._launch(self._words.block_strips, self._nodes, self._rings, position, self.K, self.tension, blocks)

    def coarsen(self, growth: float, coarse: "PoleCap") -> None:
        """Give a coarser grid, whose edges around the poles are `growth` times as long, the mean tension."""
        ratio = self._real(growth)
        self._launch(self._words.average_tension, coarse._strips, self.tension, ratio, coarse.tension)

    def _hand_over(self, flux: wp.array) -> None:
        self._launch(self._words.hand_over, self._nodes, self._slots, self._signs, self._flux, flux)

    def _launch(self, kernel: Any, dim: tuple[int, ...], *arguments: Any) -> None:
        launch_alone(kernel, dim, *arguments, device=self._device)


def _slots(layout: Layout, ring: NDArray[np.int64], end: int) -> tuple[NDArray[np.int64], float]:
    """Where the nodes of a ring find the forces of a pole: place and component in the cells' flux, and their sign.

    A node gathers -(E + x) of the cell before it along v, E - x of that before it along u and x - D of its own, where
    D, E and x stand for a cell's derivatives by them. Before the first node, and at the last one, there is no cell.

    Returns:
        Row, column and first component, shape (n, 3), and the sign.
    """
    along = layout.periodic.index(False)
    component, sign = (0, -1.0) if end else (3, 1.0 if along == 0 else -1.0)
    places = ring.copy()
    if not end:
        places[:, along] -= 1
    return np.column_stack([places, np.full(len(ring), component)]), sign
