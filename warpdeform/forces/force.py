"""The face that every energy and load shows to the solver."""

from typing import Any, ClassVar, Protocol

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpdeform.grid import Layout, ParameterGrid
from warpdeform.kernels.products import Gathering
from warpdeform.launching import RowStruct

LAGGED_ITERATIONS = 3
"""Newton iterations in which lagged quantities (contact force, wind normal) follow the iterate before they freeze."""


class GridArrays(Protocol):
    """What there is of a body on every grid, its own and multigrid's coarser ones."""

    layout: Any
    real: Any
    lane_width: int
    device: Any
    mass: wp.array
    """Node masses [kg], trapezoid weights, shape (1, rows, columns)."""
    free: wp.array
    """1 at free nodes, 0 at pinned nodes and outside the body, shape (1, rows, columns)."""


class BodyArrays(GridArrays, Protocol):
    """What a term may read of its body while a step runs; component arrays as in :class:`~warpdeform.grid.Layout`."""

    x: wp.array
    """Accepted position at the start of the step [m], shape (3, rows, columns)."""
    iteration: wp.array
    """Newton iteration of this step, int32, shape (1,)."""
    partials: wp.array
    """Partial sums per node or lane group, float64, shape (rows, columns)."""

    @property
    def w(self) -> wp.array:
        """Base of the stage velocity (z - w) / tau [m], shape (3, rows, columns)."""


class Coarsening(Protocol):
    """What a term may know of the step from a grid to the next coarser one."""

    coarse: ParameterGrid
    layout: Layout
    """Memory layout of the coarse grid."""
    growth: tuple[float, ...]
    """Coarse over fine spacing along each axis."""
    cells: Any
    """Tables that average over the fine cells of each coarse cell."""

    def sample(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at the nodes, shape (nu, nv, n), at the coarse nodes (host)."""

    def average_cells(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at the cells, shape (*cells, ...), averaged over the coarse cells (host)."""

    def average_nodes(self, values: NDArray[np.float64]) -> NDArray[np.float64]:
        """Values at the nodes, shape (*nodes, ...), averaged around the coarse nodes (host)."""


class GridTerm(Protocol):
    """What the linear solver asks of a term that couples nodes, on whatever grid; told in :class:`Force`."""

    sample_nodes: int
    gathering: Gathering | None
    fluxes: RowStruct
    angled: bool

    def bytes(self) -> int: ...

    def coarser(self, transfer: Coarsening) -> "CoarseTerm | None": ...

    def coarsen(self, transfer: Coarsening, coarse: "CoarseTerm") -> None: ...

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None: ...

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None: ...

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None: ...

    def write_band(self, body: GridArrays, band: wp.array) -> None: ...


class CoarseTerm(GridTerm, Protocol):
    """A term on a coarse grid: what a body has on its own grid only is not there to linearise it with."""

    def linearise(self, body: GridArrays, position: wp.array) -> None: ...


class Force:
    """One term of one body: an incremental potential with its gradient and a positive semi-definite Hessian.

    Every method but `prepare` and `bytes` only launches kernels, so that a step can be captured as one graph: no
    allocation, no read of a device array, no decision on the host. Terms override what they have; the rest is empty.
    """

    name: ClassVar[str] = "force"
    elastic: ClassVar[bool] = False
    """True for terms whose Hessian couples nodes; False for node-wise terms, whose Hessian is one block per node."""
    sample_nodes: int = 0
    """Most nodes that one sample of the energy couples: no eigenvalue of D^-1 H is larger (elastic terms)."""
    gathering: Gathering | None = None
    """How the Hessian product is gathered from fluxes: of the one term of a body that makes it hold together."""
    fluxes: RowStruct
    """What is gathered from."""
    force_gathering: Gathering | None = None
    """How the force that `write_force` has written is gathered; None: there are only `linearise` and `add_gradient`."""
    force_fluxes: RowStruct
    """What that is gathered from."""
    uniform: wp.array | None = None
    """The acceleration that the term gives every node [m/s2], shape (3,), if that is all it does."""
    quadratic: bool = False
    """Strains are quadratic in the positions, and `linearise_mean` takes their means (elastic terms)."""
    most_rate: float = 0.0
    """Largest eigenvalue that the node block per mass may come to between two looks at it [1/s2]; 0: as it is found."""
    most_steps: int = 1 << 30
    """Explicit steps that may share one `prepare`: few where parameters change with time."""
    angled: bool = False
    """The Hessian has the angles of segments eliminated: the direct solve along strands takes them as unknowns."""
    energy_kind: ClassVar[str] = "field"
    """Where reports book the energy: "elastic", "gravity", "field"; "" where none is stored (friction, wind)."""

    @property
    def kernels(self) -> tuple[str, ...]:
        """Names of the kernels that the term launches, for `warpdeform info`."""
        return ()

    def bytes(self) -> int:
        """Device memory that the term keeps [bytes]."""
        return 0

    def coarser(self, transfer: Coarsening) -> CoarseTerm | None:
        """The same energy on a coarser grid, rediscretised (elastic terms); None if coarse grids do without it."""
        return None

    def coarsen(self, transfer: Coarsening, coarse: CoarseTerm) -> None:
        """Carry to `coarse`, which was linearised at the coarse positions, what it must not measure itself."""

    def prepare(self, time: float, dt: float, tau: float) -> None:
        """Write the parameters of the stage that ends at `time` [s] into device arrays (host, between steps)."""

    def begin(self, body: BodyArrays) -> None:
        """Start of a step: `body.x` holds the accepted position; freeze frames that last for the step."""

    def linearise(self, body: BodyArrays, position: wp.array) -> None:
        """Store at a Newton iterate what gradient, Hessian product and blocks need."""

    def linearise_mean(self, body: BodyArrays, position: wp.array, start: wp.array) -> None:
        """As `linearise`, in the middle of a step from `start`, with the mean of the strains at its ends (`quadratic`).

        With them the work of the force over the step is exactly what the energy changes by.
        """
        raise NotImplementedError

    def add_energy(self, body: BodyArrays, position: wp.array, partials: wp.array) -> None:
        """Add the energy [J] to `partials` (float64, [rows, columns]), each thread at its own node's entry."""

    def forbid_start(self, body: BodyArrays, before: wp.array, position: wp.array, partials: wp.array) -> None:
        """Add infinity to `partials` where Newton must not start at `position`, predicted from `before`."""

    def stored_energy(self, body: BodyArrays, position: wp.array) -> float:
        """Energy [J] for reports (host): of terms whose `energy_kind` is not empty, with no constant left out."""
        body.partials.zero_()
        self.add_energy(body, position, body.partials)
        return float(body.partials.numpy().sum())

    def add_gradient(self, body: BodyArrays, position: wp.array, gradient: wp.array) -> None:
        """Add the derivative of the energy by the position [N]; valid after `linearise` at the same position."""

    def write_force(self, body: BodyArrays, position: wp.array) -> None:
        """Write what the gradient at `position` is gathered from; no need for what only a Hessian needs."""
        self.linearise(body, position)

    def write_fluxes(self, body: GridArrays, direction: wp.array) -> None:
        """Write the fluxes of the projected Hessian times `direction` (terms with a `gathering`)."""

    def add_hessian_product(self, body: GridArrays, direction: wp.array, product: wp.array) -> None:
        """Add the projected Hessian times `direction` [N] (elastic terms)."""

    def add_block_diagonal(self, body: GridArrays, blocks: wp.array) -> None:
        """Add the 3 x 3 diagonal blocks of the projected Hessian [N/m], shape (6, rows, columns) (elastic terms)."""

    def add_majorant(self, body: BodyArrays, blocks: wp.array) -> None:
        """Add node blocks B with p'H p <= p'B p, H the projected Hessian of the last `linearise` (elastic terms)."""
        for _ in range(self.sample_nodes):
            self.add_block_diagonal(body, blocks)

    def write_band(self, body: GridArrays, band: wp.array) -> None:
        """Write the projected Hessian as the band of each strand [N/m], free nodes only (elastic terms of curves).

        Float64 whatever the precision of the body; laid out as :mod:`warpdeform.kernels.strand_words` tells.
        """

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        """Add the whole Hessian of a node-wise term, one symmetric block per node [N/m], shape (6, rows, columns)."""

    def carry(self, body: BodyArrays, start: wp.array) -> None:
        """Move `start` out of the way of obstacles that would jump over it during the step."""

    def guard(self, body: BodyArrays, position: wp.array, direction: wp.array) -> None:
        """Clip the displacement `direction` from `position` so that no node crosses an obstacle."""

    def foresee(self, body: BodyArrays, predicted: wp.array, impact: wp.array) -> None:
        """Set `impact` (int32, shape (1,)) if the way from `body.x` to `predicted` ends in an impact (obstacles)."""

    def finish(self, body: BodyArrays) -> None:
        """The step is accepted: store what the next one starts from (friction anchors)."""

    def keep(self, body: BodyArrays) -> None:
        """Keep what earlier steps have stored for `restore`: explicit steps are judged many at a time."""

    def restore(self, body: BodyArrays) -> None:
        """Go back to what `keep` has kept."""

    def reset(self) -> None:
        """Forget what earlier steps have stored, as at the start of a run."""
