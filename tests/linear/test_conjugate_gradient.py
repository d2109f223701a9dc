"""Operator, preconditioners and conjugate gradient against a dense matrix that the operator itself assembles."""

from typing import Any, ClassVar

import numpy as np
import pytest
import scipy.sparse.linalg
import warp as wp
from surfaces import MATERIALS, SHAPES, noise, stretched

from warpdeform.body import Body, Pin
from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.kernels import krylov as entries
from warpdeform.kernels.krylov import krylov
from warpdeform.linear import PRECONDITIONERS, ConjugateGradient, LinearOperator, Sums, choose_preconditioner
from warpdeform.material import Material
from warpdeform.model import Model
from warpdeform.shape import sheet
from warpdeform.state import State

Array = np.ndarray[Any, Any]

TAU = 0.01


class Stiffening(Force):
    """Adds `amount` times the identity to the matrix, as a term that couples nodes; negative amounts soften."""

    name = "stiffening"
    elastic: ClassVar[bool] = True

    def __init__(self, state: State, amount: float) -> None:
        self._scalars = wp.array([amount, 0.0, 0.0, 0.0], dtype=wp.float64, device=state.device)
        self._unused = state.model.zeros(3)

    def add_hessian_product(self, body: BodyArrays, direction: wp.array, product: wp.array) -> None:
        inputs = [self._scalars, direction, direction, product, self._unused]
        kernel = krylov(body.lane_width, body.real).advance
        wp.launch(kernel, dim=body.layout.lane_dim, inputs=inputs, device=body.device)


class NodeStiffness(Force):
    """A different stiffness at every node and axis, as a node-wise term."""

    name = "node stiffness"

    def __init__(self, state: State) -> None:
        random = np.random.default_rng(4)
        self._blocks = random.uniform(1.0, 1e3, (*state.layout.nodes, 6)) * [1, 1, 1, 0, 0, 0]

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        blocks.assign(blocks.numpy() + body.layout.pack(self._blocks))


class System:
    """Two bodies of different size, stretched, with pins; one of them with a node-wise term."""

    def __init__(
        self,
        preconditioner: str = "block-jacobi",
        *,
        tolerance: float = 1e-11,
        cap: int = 1000,
        precision: str = "float64",
        extra: float = 0.0,
        lane_width: int | None = None,
    ) -> None:
        device = wp.get_device("cpu")
        iteration = wp.zeros(1, dtype=wp.int32, device=device)
        self.states, terms = [], []
        for name, shape, material, pins in (
            ("shell", SHAPES["arc"]((4, 5)), MATERIALS["orthotropic"], (Pin("corner:0,0"), Pin("corner:1,1"))),
            ("cloth", sheet((3, 10), (0.6, 1.2)), MATERIALS["membrane"], (Pin("edge:u,0"),)),
        ):
            model = Model(Body(name, shape, material, pins=pins), precision, device, lane_width)
            state = State(model, iteration)
            state.x.assign(model.layout.pack(stretched(shape.positions)))
            elasticity = SurfaceElasticity(model.grid, model.layout, shape.positions, material, model.real, device)
            elasticity.linearise(state, state.x)
            own: list[Force] = [elasticity]
            if name == "cloth":
                own.append(NodeStiffness(state))
            if extra:
                own.append(Stiffening(state, extra))
            self.states.append(state)
            terms.append(own)
        self.operator = LinearOperator(self.states, terms)
        self.operator.set_tau(TAU)
        self.operator.update()
        self.sums = Sums(self.states)
        self.preconditioner = choose_preconditioner(preconditioner, self.operator)
        self.solver = ConjugateGradient(self.operator, self.preconditioner, self.sums, tolerance, cap)

    def spread(self, vector: Array, name: str) -> None:
        """Write a vector of all nodes of both bodies into an array of the states."""
        start = 0
        for state in self.states:
            count = 3 * state.model.grid.node_count
            part = vector[start : start + count].reshape(*state.layout.nodes, 3)
            getattr(state, name).assign(state.layout.pack(part))
            start += count

    def gathered(self, name: str) -> Array:
        parts = [state.model.download(getattr(state, name)).ravel() for state in self.states]
        return np.concatenate(parts).astype(np.float64)

    @property
    def free(self) -> Array:
        masks = [np.repeat(state.model.download(state.free).ravel(), 3) for state in self.states]
        return np.concatenate(masks).astype(bool)

    def matrix(self) -> Array:
        """A on the free nodes."""
        columns = []
        for k in np.flatnonzero(self.free):
            self.spread(np.eye(self.free.size)[k], "search")
            self.operator.product()
            columns.append(self.gathered("product")[self.free])
        return np.array(columns).T

    def solve(self, gradient: Array) -> Array:
        self.spread(gradient * self.free, "gradient")
        self.solver.solve()
        return self.gathered("direction")

    def read(self, entry: int) -> int:
        return int(self.solver.state.numpy()[entry])


def right_hand_side(system: System) -> Array:
    return np.concatenate([noise(s.model.initial_positions, 100.0, 3).ravel() for s in system.states])


def test_operator_is_the_mass_the_node_blocks_and_the_elastic_hessian() -> None:
    system = System()
    A = system.matrix()
    assert np.abs(A - A.T).max() < 1e-13 * np.abs(A).max()
    assert np.linalg.eigvalsh(A).min() > 0
    masses = np.concatenate([np.repeat(state.model.node_mass.ravel(), 3) for state in system.states]) / TAU**2
    blocks = system.operator.terms[1][1]._blocks[..., :3].ravel()  # type: ignore[attr-defined]
    nodewise = masses + np.concatenate([np.zeros(60), blocks])
    elastic = A - np.diag(nodewise[system.free])
    assert np.linalg.eigvalsh(elastic).min() > -1e-12 * np.abs(elastic).max()
    system.operator.set_tau(2 * TAU)
    system.operator.update()
    change = np.diag(A - system.matrix())
    np.testing.assert_allclose(change, 0.75 * masses[system.free], rtol=1e-10)


def test_product_is_zero_at_pins_and_books_its_curvature() -> None:
    system = System()
    p = right_hand_side(system) * system.free
    system.spread(p, "search")
    system.operator.product()
    q = system.gathered("product")
    assert not q[~system.free].any()
    system.sums.gather_dots()
    assert system.sums.rows.numpy()[0].sum() == pytest.approx(p @ q, rel=1e-13)


@pytest.mark.parametrize("name", PRECONDITIONERS)
@pytest.mark.parametrize("lane_width", [1, 8])
def test_every_preconditioner_finds_the_solution_of_the_dense_matrix(name: str, lane_width: int) -> None:
    system = System(name, lane_width=lane_width)
    gradient = right_hand_side(system)
    found = system.solve(gradient)
    expected = np.zeros_like(found)
    A = System().matrix()
    expected[system.free] = np.linalg.solve(A, -gradient[system.free])
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    assert not found[~system.free].any()
    assert system.read(entries.BREAKDOWN) == 0
    assert 0 < system.read(entries.ITERATIONS) < 1000
    assert system.read(entries.ACTIVE) == 0


def test_iterations_are_those_of_scipy() -> None:
    system = System(tolerance=1e-6)
    gradient = right_hand_side(system)
    system.solve(gradient)
    A, free = System().matrix(), system.free
    inverse = np.zeros_like(A)
    nodes = np.repeat(np.arange(free.size // 3), 3)[free]
    for node in np.unique(nodes):
        own = np.ix_(nodes == node, nodes == node)
        inverse[own] = np.linalg.inv(A[own])
    history: list[float] = []
    b = -gradient[free]

    def book(x: Array) -> None:
        r = b - A @ x
        history.append(float(np.sqrt(r @ inverse @ r)))

    scipy.sparse.linalg.cg(A, b, rtol=1e-12, M=inverse, callback=book)
    start = np.sqrt(b @ inverse @ b)
    expected = 1 + int(np.argmax(np.array(history) <= 1e-6 * start))
    assert abs(system.read(entries.ITERATIONS) - expected) <= 1


def test_block_jacobi_is_the_inverse_of_the_diagonal_blocks() -> None:
    system = System()
    A, free = system.matrix(), system.free
    system.preconditioner.update()
    r = right_hand_side(system)
    system.spread(r, "residual")
    system.preconditioner.apply()
    z = system.gathered("conditioned")
    assert not z[~free].any()
    nodes = np.repeat(np.arange(free.size // 3), 3)[free]
    for node in np.unique(nodes):
        own = nodes == node
        block = A[np.ix_(own, own)]
        np.testing.assert_allclose(z[free][own], np.linalg.solve(block, r[free][own]), rtol=1e-10)
    system.sums.gather_dots()
    assert system.sums.rows.numpy()[0].sum() == pytest.approx(r @ z, rel=1e-13)


def test_better_preconditioners_need_fewer_iterations() -> None:
    counts = {}
    for name in PRECONDITIONERS:
        system = System(name)
        system.solve(right_hand_side(system))
        counts[name] = system.read(entries.ITERATIONS)
    assert counts["block-jacobi"] < counts["jacobi"] < counts["none"]
    assert System("auto").preconditioner.name == "block-jacobi"


def test_nothing_to_do() -> None:
    system = System()
    system.spread(np.ones(system.free.size), "direction")
    found = system.solve(np.zeros(system.free.size))
    assert not found.any()
    assert system.read(entries.ITERATIONS) == 0
    assert system.read(entries.BREAKDOWN) == 0


def test_cap_ends_the_solve_and_is_reported() -> None:
    system = System(cap=5)
    found = system.solve(right_hand_side(system))
    assert system.read(entries.ITERATIONS) == 5
    assert system.read(entries.BREAKDOWN) == 0
    assert system.read(entries.ACTIVE) == 0
    assert np.isfinite(found).all()
    assert found.any()


def test_indefinite_matrix_is_reported_and_leaves_a_finite_direction() -> None:
    lowest, highest = (np.linalg.eigvalsh(System().matrix())[k] for k in (0, -1))
    system = System(extra=-0.5 * (lowest + highest))
    assert np.linalg.eigvalsh(system.matrix()).min() < 0
    found = system.solve(right_hand_side(system))
    assert system.read(entries.BREAKDOWN) == 1
    assert system.read(entries.ACTIVE) == 0
    assert np.isfinite(found).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_gradient_that_is_not_finite_is_reported(bad: float, precision: str) -> None:
    system = System(precision=precision)
    gradient = right_hand_side(system)
    gradient[3 * 7 + 1] = bad
    system.solve(gradient)
    assert system.read(entries.BREAKDOWN) == 1
    assert system.read(entries.ACTIVE) == 0


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_solves_repeat_to_the_bit(precision: str) -> None:
    system = System(precision=precision, tolerance=1e-4)
    gradient = right_hand_side(system)
    first, iterations = system.solve(gradient), system.read(entries.ITERATIONS)
    system.solve(0.3 * gradient[::-1])
    np.testing.assert_array_equal(system.solve(gradient), first)
    np.testing.assert_array_equal(System(precision=precision, tolerance=1e-4).solve(gradient), first)
    assert system.read(entries.ITERATIONS) == iterations


def test_solve_replays_in_a_graph() -> None:
    system = System(tolerance=1e-6)
    gradient = right_hand_side(system)
    first = system.solve(gradient)
    with wp.ScopedCapture(device="cpu") as capture:
        system.solver.solve()
    system.spread(2.0 * gradient * system.free, "gradient")
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(system.gathered("direction"), 2.0 * first)


def test_memory_is_counted() -> None:
    system = System()
    nodes = sum((s.layout.rows * s.layout.columns) for s in system.states)
    assert system.preconditioner.bytes() == 6 * 8 * nodes
    cloth = system.states[1].layout
    assert system.operator.bytes() == 6 * 8 * cloth.rows * cloth.columns
    light = Body("light", sheet((3, 3)), Material(areal_density=1.0, eta=1.0))
    model = Model(light, "float32", wp.get_device("cpu"))
    elasticity = SurfaceElasticity(
        model.grid, model.layout, light.shape.positions, light.material, model.real, model.device
    )
    assert LinearOperator([State(model, system.states[0].iteration)], [[elasticity]]).bytes() == 0
