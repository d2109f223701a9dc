"""Multigrid on solids: symmetric, positive definite, and as many iterations however fine the grid (design 7.2)."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from solids import MATERIALS, SHAPES, Block, box, crumpled, noise, squashed, stretched
from surfaces import REALS, WIDTHS

from warpdeform import launching
from warpdeform.forces.solid_coefficients import solid_stiffness
from warpdeform.forces.solid_elasticity import SolidElasticity
from warpdeform.grid import Layout
from warpdeform.kernels import krylov as entries
from warpdeform.linear import ConjugateGradient, LinearOperator, Sums, choose_preconditioner
from warpdeform.linear.transfer import Transfer
from warpdeform.material import Material
from warpdeform.state import State

Array = np.ndarray[Any, Any]
CPU = wp.get_device("cpu")


class BlockModel:
    """What a state asks of the constants of a solid whose nodes at u = 0 are pinned."""

    has_pins = True
    device = CPU

    def __init__(self, rest: Block, material: Material, real: Any, lane_width: int) -> None:
        self.grid, self.real, self.lane_width = rest.grid, real, lane_width
        self.layout = Layout(rest.nodes, lane_width)
        self.body, self.velocity, self.initial_positions = self, 0.0, rest.positions
        solid = material.solid()
        self.node_mass = solid.density * solid_stiffness(rest.grid, rest.positions, solid).node_volume
        edges = (np.diff(rest.positions, axis=axis) for axis in range(3))
        self.lengths = tuple(float(np.linalg.norm(e, axis=-1).mean()) for e in edges)
        free = np.ones(rest.nodes)
        free[0] = 0.0
        self.mass, self.free = self.upload(self.node_mass), self.upload(free)
        self.target = self.zeros(3)

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device=CPU)

    def zeros(self, components: int) -> wp.array:
        return wp.zeros((components, self.layout.rows, self.layout.columns), dtype=self.real, device=CPU)


class System:
    """A direction = -gradient of one deformed block."""

    def __init__(
        self,
        rest: Block,
        material: Material,
        positions: Array | None = None,
        *,
        preconditioner: str = "multigrid",
        real: Any = wp.float64,
        lane_width: int = 8,
        tolerance: float = 1e-4,
        tau: float = 1 / 60,
    ) -> None:
        self.model = BlockModel(rest, material, real, lane_width)
        model: Any = self.model
        self.state = State(model, wp.zeros(1, dtype=wp.int32, device=CPU))
        self.state.z.assign(model.layout.pack(rest.positions if positions is None else positions))
        given = (model.grid, model.layout, rest.positions, material, real, CPU)
        self.term = SolidElasticity(*given)
        self.term.linearise(self.state, self.state.z)
        self.operator = LinearOperator([self.state], [[self.term]])
        self.operator.set_tau(tau)
        self.operator.update()
        self.preconditioner = choose_preconditioner(preconditioner, self.operator)
        self.solver = ConjugateGradient(self.operator, self.preconditioner, Sums([self.state]), tolerance, 2000)

    def fill(self, name: str, values: Array) -> None:
        getattr(self.state, name).assign(self.model.layout.pack(values))

    def read(self, name: str) -> Array:
        return self.model.layout.unpack(getattr(self.state, name).numpy())

    def random(self, seed: int) -> Array:
        return np.random.default_rng(seed).normal(size=(*self.model.layout.nodes, 3)) * self.read("free")

    def precondition(self, residual: Array) -> Array:
        self.fill("residual", residual)
        self.preconditioner.apply()
        return self.read("conditioned")

    def product(self, p: Array) -> Array:
        self.fill("search", p)
        self.operator.product()
        return self.read("product")

    def iterations(self) -> int:
        """Iterations for its own weight across and some noise."""
        weight = self.model.node_mass[..., None] * np.array([0.0, 0.0, 9.81])
        self.fill("gradient", (weight + 1e-4 * weight.max() * self.random(7)) * self.read("free"))
        self.solver.solve()
        found = self.solver.state.numpy()
        assert found[entries.BREAKDOWN] == 0
        return int(found[entries.ITERATIONS])


def rubber(nu: float, barrier: float | None = None) -> Material:
    return Material(density=1000.0, youngs_modulus=1e6, poisson_ratio=nu, inversion_barrier=barrier)


def beam(nodes: tuple[int, int, int]) -> Block:
    """Four times as long as it is thick, a tenth of a metre."""
    return box(nodes, (0.4, 0.1, 0.1))


@pytest.mark.parametrize("lane_width", [1, 8])
@pytest.mark.parametrize(
    ("shape", "nodes", "material"),
    [("box", (9, 5, 6), "soft"), ("bent", (6, 7, 5), "rubber"), ("box", (7, 6, 9), "barrier")],
)
def test_cycle_is_symmetric_and_positive_definite(
    shape: str, nodes: tuple[int, int, int], material: str, lane_width: int
) -> None:
    rest = SHAPES[shape](nodes)
    system = System(rest, MATERIALS[material], squashed(rest.positions), lane_width=lane_width)
    system.preconditioner.update()
    vectors = [system.random(seed) for seed in range(3)]
    images = [system.precondition(v) for v in vectors]
    for a, za in zip(vectors, images, strict=True):
        assert not za[0].any()
        assert np.vdot(a, za) > 0
        for b, zb in zip(vectors, images, strict=True):
            scale = np.sqrt(np.vdot(a, za) * np.vdot(b, zb))
            assert abs(np.vdot(a, zb) - np.vdot(b, za)) < 1e-10 * scale


@pytest.mark.parametrize(("nu", "most"), [(0.3, 10), (0.45, 13), (0.49, 28)])
@pytest.mark.parametrize("nodes", [(33, 9, 9), pytest.param((65, 17, 17), marks=pytest.mark.slow)], ids=str)
def test_iterations_do_not_grow_with_the_number_of_nodes(nodes: tuple[int, int, int], nu: float, most: int) -> None:
    count = System(beam(nodes), rubber(nu)).iterations()
    plain = System(beam(nodes), rubber(nu), preconditioner="block-jacobi").iterations()
    print(f"\nbeam {nodes}, nu {nu:g}: multigrid {count}, block-Jacobi {plain}", end="")
    assert count <= most
    assert plain > 8 * count


@pytest.mark.parametrize(
    ("name", "material", "deformed", "most"),
    [
        ("stretched", rubber(0.3), stretched, 10),
        ("crumpled", rubber(0.49), crumpled, 14),
        ("squashed", rubber(0.3), squashed, 12),
        ("squashed, with a barrier", rubber(0.3, 2e5), squashed, 20),
    ],
)
def test_iterations_of_deformed_blocks_are_bounded(name: str, material: Material, deformed: Any, most: int) -> None:
    rest = box((17, 12, 14), (0.1, 0.08, 0.09))
    count = System(rest, material, deformed(rest.positions)).iterations()
    print(f"\nblock {name}: {count}", end="")
    assert count <= most


@pytest.mark.parametrize("shape", ["leaning", "cylinder", "bent"])
def test_iterations_on_curved_charts_are_bounded(shape: str) -> None:
    rest = SHAPES[shape]((17, 9, 12))
    count = System(rest, rubber(0.3)).iterations()
    print(f"\nblock {shape}: {count}", end="")
    assert count <= 16


def test_single_precision_needs_as_many_iterations() -> None:
    counts = [
        System(beam((33, 9, 9)), rubber(0.45), real=real, lane_width=width, tolerance=1e-3).iterations()
        for real, width in ((wp.float64, 8), (wp.float32, 16))
    ]
    assert abs(counts[0] - counts[1]) <= 1


@pytest.mark.parametrize("real", REALS)
def test_products_in_bands_are_the_same_to_the_bit(real: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    rest = box((12, 5, 40), (0.5, 0.2, 1.6))
    found = []
    for band_bytes in (1, 10**9):
        monkeypatch.setattr(launching, "BAND_BYTES", band_bytes)
        system = System(rest, rubber(0.4, 2e5), squashed(rest.positions), real=real, lane_width=WIDTHS[real][1])
        system.product(system.random(2))  # leaves something in the buffers
        found.append(system.product(system.random(1)))
    np.testing.assert_array_equal(found[0], found[1])


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("nu", "barrier"), [(0.0, None), (0.499, None), (0.3, 1e7)])
def test_no_eigenvalue_exceeds_the_nodes_of_a_cell(nu: float, barrier: float | None, seed: int) -> None:
    rest = box((4, 3, 3), (0.1, 0.1, 0.3))
    rough = rest.positions * [0.7, 1.0, 1.0] + noise(rest.positions, (0.02, 0.1, 0.2)[seed], seed)
    system = System(rest, rubber(nu, barrier), rough, preconditioner="block-jacobi", tau=10.0)
    system.preconditioner.update()
    unit = np.eye(rest.positions.size).reshape(-1, *rest.positions.shape)
    matrix = np.array([system.precondition(system.product(e)).ravel() for e in unit])
    assert np.abs(np.linalg.eigvals(matrix)).max() <= 8 * (1 + 1e-9)
    assert system.term.sample_nodes == 8


def test_stress_of_a_coarse_grid_has_the_work_of_the_fine_one() -> None:
    """An even motion of an evenly stressed block feels the same on both grids, one half as fine along all axes."""
    rest = box((9, 7, 11), (0.4, 0.3, 0.5))
    material = MATERIALS["soft"]
    layout = Layout(rest.nodes, 1)
    coarse_grid = rest.grid.coarser((0.05, 0.05, 0.05))
    assert coarse_grid is not None
    transfer = Transfer(rest.grid, layout, coarse_grid, wp.float64, CPU)
    fine = SolidElasticity(rest.grid, layout, rest.positions, material, wp.float64, CPU)
    coarse = fine.coarser(transfer)
    lean = np.array([[1.2, 0.1, 0.0], [0.2, 1.1, 0.3], [0.0, 0.1, 1.3]])
    motion = np.array([[0.0, 1.0, 0.3], [0.2, 0.0, 0.5], [-0.4, 0.6, 0.0]])
    work = []
    for term, at, nodes in ((fine, layout, rest.positions), (coarse, transfer.layout, transfer.sample(rest.positions))):
        position, p = (wp.array(at.pack(nodes @ F), dtype=wp.float64, device=CPU) for F in (lean, motion))
        term.linearise(None, position)  # type: ignore[arg-type]
        if term is coarse:
            fine.coarsen(transfer, coarse)
        product = wp.zeros_like(position)
        term.add_hessian_product(None, p, product)  # type: ignore[arg-type]
        work.append(float(np.sum(at.unpack(product.numpy()) * (nodes @ motion))))
    assert work[1] == pytest.approx(work[0], rel=1e-12)
    assert coarse.stiffness.orthogonal
