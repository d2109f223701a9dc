"""The paper's simplified elastic force of a surface, and its matrix K(r) (Terzopoulos et al. 1987)."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.coefficients import PaperWeights
from warpdeform.errors import InputError, Mistake
from warpdeform.forces.force import BodyArrays, Force, GridArrays
from warpdeform.forces.surface_bending import difference_weights
from warpdeform.forces.surface_coefficients import RIGHT_ANGLE
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.halo import Halo
from warpdeform.kernels.paper import FLUX_COMPONENTS, MEASURED, paper
from warpdeform.launching import Buffer, RowStruct, launch_lanes
from warpdeform.material import Material

Array = NDArray[np.float64]


class PaperElasticity(Force):
    """e = K(r) r with alpha and beta frozen by `linearise`; K is symmetric, and indefinite where they are negative.

    Materials in physical units or shell constants are given the weights eta and xi that their energy has for strains
    along the axes and shear. What Poisson's ratio couples has no weight in the paper and is left out.

    Args:
        grid: Parameter grid.
        layout: Memory layout.
        rest: Rest positions [m], shape (nu, nv, 3).
        material: Material.
        real: ``wp.float32`` or ``wp.float64``.
        device: Warp device.

    Raises:
        InputError: The axes of the chart do not meet at right angles, and the material is not given by the paper's
            weights, which mean those axes.
    """

    name = "paper"
    elastic = True
    energy_kind = "elastic"

    def __init__(
        self, grid: ParameterGrid, layout: Layout, rest: Array, material: Material, real: Any, device: Any
    ) -> None:
        weights, self.bending = paper_weights(grid, rest, material)
        self._layout, self._device, self._real = layout, device, real
        self._words = paper(layout.lane_width, real, self.bending)

        def upload(values: Array) -> wp.array:
            return wp.array(layout.pack(values), dtype=real, device=device)

        def scratch(components: int) -> wp.array:
            return wp.zeros((components, layout.rows, layout.columns), dtype=real, device=device)

        count = MEASURED if self.bending else MEASURED // 2
        self._weights = upload(weights[..., :count])
        self._rest, self._measured, self.frozen = scratch(count), scratch(count), scratch(count)
        self.flux = scratch(FLUX_COMPONENTS if self.bending else 6)
        self.gathering = self._words.gathering
        self.fluxes = RowStruct(self.gathering.Fluxes, {"flux": self.flux}, frozenset({"flux"}))
        slopes_u, slopes_v = difference_weights(layout)
        self._slopes_u: wp.array = wp.array(slopes_u, dtype=real, device=device)
        self._slopes_v: wp.array = wp.array(slopes_v, dtype=real, device=device)
        self._halo = Halo(layout, real, device)
        # |r_u x r_v|^2 of a cell at a thousandth of its rest area.
        areas = np.linalg.norm(np.cross(*_edges(grid, rest)), axis=-1)
        self._floor = real(1e-6 * float(areas.min()) ** 2)
        self._measure(upload(rest), self._rest)

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        arrays = (self._weights, self._rest, self._measured, self.frozen, self.flux, self._slopes_u, self._slopes_v)
        return sum(int(array.capacity) for array in arrays) + self._halo.bytes()

    def linearise(self, body: GridArrays, position: wp.array) -> None:
        """Freeze alpha and beta at `position`."""
        self._measure(position, self._measured)
        self._launch(self._words.freeze, self._measured, self._rest, self._weights, self.frozen)

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add K times `position` [N]: the force with its sign reversed."""
        self.add_hessian_product(body, position, gradient)

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None:
        """Write the fluxes of K times `direction`."""
        self._halo.refresh(direction)
        self._launch(self._words.product, self.frozen, direction, Buffer(self.flux))
        self._halo.refresh(self.flux)

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add K times `direction` [N]."""
        self.write_fluxes(body, direction)
        self._launch(self._words.gather, self.fluxes, product)
        self._halo.clear(product)

    def _measure(self, position: wp.array, measured: wp.array) -> None:
        self._halo.refresh(position)
        self._launch(self._words.measure, position, self._slopes_u, self._slopes_v, self._floor, measured)

    def _launch(self, kernel: Any, *arguments: Any) -> None:
        launch_lanes(kernel, self._layout, *arguments, device=self._device)


def paper_weights(grid: ParameterGrid, rest: Array, material: Material) -> tuple[Array, bool]:
    """eta and xi of undivided differences, each times the area of its sample; zero beyond borders.

    Differences enter four times with eta: twice in G, once in u, once in what is made of both; with xi second
    differences enter three times. Trapezoid weights go with the masses of border nodes, which are halved too.

    Returns:
        Weights of G11, G22, G12, B11, B22, B12, shape (nu, nv, 6), and whether any of the last three is not zero.

    Raises:
        InputError: Told in the class.
    """
    d1, d2 = _edges(grid, rest)
    l1, l2 = np.sum(d1 * d1, axis=-1), np.sum(d2 * d2, axis=-1)
    coefficients = material.surface(grid)
    if isinstance(coefficients, PaperWeights):
        h1, h2 = grid.spacing
        l1, l2 = np.full(grid.nodes, h1**2), np.full(grid.nodes, h2**2)
        area = np.full(grid.cells, h1 * h2)
        eta, xi = coefficients.eta, coefficients.xi
    else:
        leaning = np.abs(np.sum(d1 * d2, axis=-1) / np.sqrt(l1 * l2))[: grid.cells[0], : grid.cells[1]]
        if float(leaning.max()) > RIGHT_ANGLE:
            problem = "writes its forces along the axes of the chart, and these do not meet at right angles"
            remedy = "Use another shape or integrator, or give the material as eta and xi."
            raise InputError(Mistake("integrator", "terzopoulos", problem, remedy))
        closed = grid.closed(rest)
        m1 = 0.5 * (closed[1:, 1:] + closed[1:, :-1] - closed[:-1, 1:] - closed[:-1, :-1])
        m2 = 0.5 * (closed[1:, 1:] + closed[:-1, 1:] - closed[1:, :-1] - closed[:-1, :-1])
        area = np.linalg.norm(np.cross(m1, m2), axis=-1)
        C, D = coefficients.membrane, coefficients.bending
        eta = 0.5 * C[..., 0, 0], 0.5 * C[..., 1, 1], C[..., 2, 2]
        xi = D[..., 0, 0], D[..., 1, 1], 2.0 * D[..., 2, 2]
    edge_u, edge_v = (_edge_areas(grid, eta[axis] * area, axis) for axis in (0, 1))
    node_u, node_v = (grid.cells_to_nodes(xi[axis] * area) * _inside(grid, axis) for axis in (0, 1))
    cells = np.zeros((*grid.nodes, 2))
    cells[: grid.cells[0], : grid.cells[1]] = np.stack([eta[2] * area, xi[2] * area], axis=-1)
    weights = np.stack(
        [
            edge_u / l1**2, edge_v / l2**2, cells[..., 0] / (l1 * l2),
            node_u / l1**3, node_v / l2**3, cells[..., 1] / (l1 * l2) ** 1.5,
        ],
        axis=-1,
    )  # fmt: skip
    return weights, any(np.any(weight) for weight in xi)


def _edges(grid: ParameterGrid, rest: Array) -> tuple[Array, Array]:
    """Forward differences at the nodes, at an end those of the node before, shape (nu, nv, 3)."""
    found = []
    for axis in (0, 1):
        edges = grid.differences(rest, axis)
        last = np.take(edges, [-1], axis=axis)
        found.append(edges if grid.periodic[axis] else np.concatenate([edges, last], axis=axis))
    return found[0], found[1]


def _edge_areas(grid: ParameterGrid, area: Array, axis: int) -> Array:
    """Half of the cells beside each edge along an axis, at the node where it begins; zero beyond a border."""
    across = 1 - axis
    shares = np.zeros(grid.nodes)
    for step in (0, 1):
        index = [np.arange(count) for count in area.shape]
        index[across] = (index[across] + step) % grid.nodes[across]
        shares[np.ix_(*index)] += 0.5 * area
    return shares


def _inside(grid: ParameterGrid, axis: int) -> Array:
    """1 at nodes that have neighbours on both sides along an axis."""
    inside = np.ones(grid.nodes)
    if not grid.periodic[axis]:
        inside[(slice(None),) * axis + ([0, -1],)] = 0.0
    return inside
