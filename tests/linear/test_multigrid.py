"""Multigrid: symmetric, positive definite, and as many iterations however fine the grid."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
import warp as wp
from bodies import CORNERS, REAL_TIME, assert_same_bits, busy, hanging, run
from surfaces import CLOSED, MATERIALS, POLAR, SHAPES, noise, stretched

from warpdeform.body import Body, Pin
from warpdeform.forces.force import BodyArrays, Force
from warpdeform.forces.surface_elasticity import SurfaceElasticity
from warpdeform.kernels import krylov as entries
from warpdeform.kernels.choice import BOUNDED, GIVEN_UP, PLAIN
from warpdeform.linear import ConjugateGradient, LinearOperator, Sums, choose_preconditioner
from warpdeform.linear.cheapest import Cheapest
from warpdeform.linear.level import COARSEST_NODES, Level
from warpdeform.linear.multigrid import Multigrid
from warpdeform.linear.smoother import SHORT, chebyshev
from warpdeform.material import Material
from warpdeform.model import Model
from warpdeform.settings import Settings
from warpdeform.shape import RestShape, sheet
from warpdeform.simulation import Simulation
from warpdeform.state import State

Array = np.ndarray[Any, Any]
CPU = wp.get_device("cpu")


def cloth(stretching: float = 1e3, bending: float = 1e-5) -> Material:
    return Material(
        areal_density=0.2, membrane_stiffness=stretching, poisson_ratio=0.3, bending_stiffness=bending or None
    )


class Contact(Force):
    """A wall that presses on every second node, as many times stiffer than the sheet as `ratio` says."""

    name = "contact"

    def __init__(self, state: State, elasticity: SurfaceElasticity, ratio: float) -> None:
        diagonal = state.model.zeros(6)
        elasticity.add_block_diagonal(state, diagonal)
        blocks = np.zeros((*state.layout.nodes, 6))
        normal = np.array([0.6, 0.0, 0.8])
        outer = [normal[a] * normal[b] for a, b in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))]
        stiffness = ratio * float(np.max(diagonal.numpy()))
        blocks[::2, : state.layout.nodes[1] // 2] = stiffness * np.array(outer)
        self._blocks = blocks

    def add_node_blocks(self, body: BodyArrays, blocks: wp.array) -> None:
        blocks.assign(blocks.numpy() + body.layout.pack(self._blocks))


class System:
    """A * d = -g of one deformed sheet."""

    def __init__(
        self,
        shape: RestShape,
        material: Material,
        *,
        pins: Sequence[Pin] = CORNERS,
        positions: Array | None = None,
        contact: float = 0.0,
        precision: str = "float64",
        lane_width: int | None = None,
        preconditioner: str = "multigrid",
        tolerance: float = 1e-4,
        tau: float = 1.0 / 60.0,
    ) -> None:
        model = Model(Body("sheet", shape, material, pins=tuple(pins)), precision, CPU, lane_width)
        self.state = State(model, wp.zeros(1, dtype=wp.int32, device=CPU))
        self.state.z.assign(model.layout.pack(shape.positions if positions is None else positions))
        elasticity = SurfaceElasticity(model.grid, model.layout, shape.positions, material, model.real, CPU)
        elasticity.linearise(self.state, self.state.z)
        terms: list[Force] = [elasticity]
        if contact:
            terms.append(Contact(self.state, elasticity, contact))
        self.operator = LinearOperator([self.state], [terms])
        self.operator.set_tau(tau)
        self.operator.update()
        self.preconditioner = choose_preconditioner(preconditioner, self.operator)
        self.solver = ConjugateGradient(self.operator, self.preconditioner, Sums([self.state]), tolerance, 2000)

    def fill(self, name: str, values: Array) -> None:
        getattr(self.state, name).assign(self.state.layout.pack(values))

    def read(self, name: str) -> Array:
        return self.state.model.download(getattr(self.state, name))

    @property
    def free(self) -> Array:
        return self.read("free").astype(bool)[..., 0]

    def random(self, seed: int) -> Array:
        return np.random.default_rng(seed).normal(size=(*self.state.layout.nodes, 3)) * self.free[..., None]

    def precondition(self, residual: Array) -> Array:
        self.fill("residual", residual)
        self.preconditioner.apply()
        return self.read("conditioned")

    def product(self, p: Array) -> Array:
        self.fill("search", p)
        self.operator.product()
        return self.read("product")

    def iterations(self, gradient: Array | None = None) -> int:
        """Iterations for a load that bends and stretches the sheet everywhere, smoothly and roughly."""
        if gradient is None:
            gradient = self.state.model.node_mass[..., None] * np.array([0.0, 0.0, 9.81]) + 1e-4 * self.random(7)
        self.fill("gradient", gradient * self.free[..., None])
        self.solver.solve()
        found = self.solver.state.numpy()
        assert found[entries.BREAKDOWN] == 0
        return int(found[entries.ITERATIONS])


def bent(shape: RestShape, amplitude: float = 0.1) -> Array:
    """The shape with waves in it, stretched a little: what cloth looks like that is not folded."""
    r = shape.positions
    u, v = (np.linspace(0, 1, n) for n in r.shape[:2])
    wave = amplitude * np.sin(4 * u)[:, None] * np.cos(3 * v)[None, :]
    return r * [1.02, 0.99, 1.0] + np.stack([0 * wave, 0.2 * wave, wave], axis=-1)


def folds(positions: Array) -> float:
    """Largest angle between the normals of neighbouring cells [degrees]."""
    normals = np.cross(positions[1:, 1:] - positions[:-1, :-1], positions[:-1, 1:] - positions[1:, :-1])
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    cosines = [np.sum(normals[1:] * normals[:-1], axis=-1), np.sum(normals[:, 1:] * normals[:, :-1], axis=-1)]
    return float(np.degrees(np.arccos(np.clip(min(c.min() for c in cosines), -1, 1))))


CASES = {
    "square": ((17, 17), "membrane", "sheet"),
    "bending": ((13, 21), "shell", "sheet"),
    "strip": ((60, 5), "shell", "sheet"),
    "curved": ((16, 9), "orthotropic", "arc"),
    "skewed": ((12, 19), "isotropic", "bump"),
    "general": ((11, 16), "membrane", "bump"),
    "tube": ((13, 9), "orthotropic", "tube"),
    "tube along u": ((9, 13), "membrane", "tube along u"),
    "torus": ((12, 11), "isotropic", "torus"),
    "screw": ((12, 10), "isotropic", "screw"),
    "ball": ((12, 9), "isotropic", "ball"),
    "twisted ball": ((10, 11), "shell", "twisted ball along u"),
}


@pytest.mark.parametrize("contact", [0.0, 1e-2, 1.0, 1e6])
@pytest.mark.parametrize("lane_width", [1, 8])
@pytest.mark.parametrize("case", CASES)
def test_cycle_is_symmetric_and_positive_definite(case: str, lane_width: int, contact: float) -> None:
    nodes, material, kind = CASES[case]
    shape = sheet(nodes) if kind == "sheet" else (SHAPES | CLOSED | POLAR)[kind](nodes)
    system = System(
        shape, MATERIALS[material], positions=stretched(shape.positions), contact=contact, lane_width=lane_width
    )
    system.preconditioner.update()
    vectors = [system.random(seed) for seed in range(4)]
    images = [system.precondition(v) for v in vectors]
    for a, za in zip(vectors, images, strict=True):
        assert not za[~system.free].any()
        assert np.vdot(a, za) > 0
        for b, zb in zip(vectors, images, strict=True):
            scale = np.sqrt(np.vdot(a, za) * np.vdot(b, zb))
            assert abs(np.vdot(a, zb) - np.vdot(b, za)) < 1e-15 * max(1e5, 1e2 * contact) * scale


def test_cycle_comes_close_to_the_inverse() -> None:
    system = System(sheet((17, 17)), cloth(), positions=bent(sheet((17, 17))))
    system.preconditioner.update()
    ratios = []
    for seed in range(6):
        error = system.random(seed)
        found = system.precondition(system.product(error))
        left = error - found
        ratios.append(np.vdot(left, system.product(left)) / np.vdot(error, system.product(error)))
    assert max(ratios) < 0.1


SIZES = [(17, 17), (33, 33), (50, 37), (64, 64), (96, 64), (200, 6)]
LARGE = [(65, 65), (129, 129), (257, 257), (513, 513)]


def counted(nodes: tuple[int, int], size: tuple[float, float], precision: str) -> dict[str, int]:
    """Iterations on the waved sheet, over stretching and bending."""
    found = {}
    shape = sheet(nodes, size)
    for stretching in (1e2, 1e3, 1e5):
        for bending in (0.0, 1e-5, 1e-2):
            tolerance = 1e-4 if precision == "float64" else 1e-3
            positions = bent(shape)
            assert folds(positions) < 60
            system = System(
                shape, cloth(stretching, bending), positions=positions, precision=precision, tolerance=tolerance
            )
            found[f"{stretching:g} N/m, {bending:g} N m"] = system.iterations()
    print(f"\n{nodes} nodes over {size} m, {precision}: {found}")
    return found


@pytest.mark.parametrize("precision", ["float64", "float32"])
@pytest.mark.parametrize("nodes", SIZES + [pytest.param(n, marks=pytest.mark.slow) for n in LARGE], ids=str)
def test_iterations_do_not_grow_with_the_number_of_nodes(nodes: tuple[int, int], precision: str) -> None:
    assert max(counted(nodes, (1.0, 1.0), precision).values()) <= 40


@pytest.mark.parametrize("nodes", [(33, 33), pytest.param((129, 129), marks=pytest.mark.slow)], ids=str)
def test_stretched_grids_are_coarsened_along_their_close_axis(nodes: tuple[int, int]) -> None:
    assert max(counted(nodes, (10.0, 1.0), "float64").values()) <= 40


def dented(shape: RestShape) -> Array:
    """A closed shape with waves in it, stretched a little."""
    r = shape.positions
    waves = np.stack([np.sin(3 * r[..., 1] + 1), np.cos(4 * r[..., 2]), np.sin(5 * r[..., 0])], axis=-1)
    return r * [1.02, 0.95, 1.0] + 0.02 * waves


CYLINDERS = [("tube", (64, 33)), ("tube", (63, 33)), ("tube", (50, 37)), ("tube along u", (30, 37))]
TORI = [("torus", (64, 32)), ("torus", (63, 37)), ("knot", (33, 50))]
FINE = [
    pytest.param("tube", (256, 129), marks=pytest.mark.slow),
    pytest.param("torus", (256, 100), marks=pytest.mark.slow),
]


@pytest.mark.parametrize(("kind", "nodes"), [*CYLINDERS, *TORI, *FINE])
def test_closed_surfaces_take_no_more_iterations(kind: str, nodes: tuple[int, int]) -> None:
    shape, found = CLOSED[kind](nodes), []
    pins = (Pin([[0, 0], [nodes[0] // 2, 0]]),)
    for stretching in (1e3, 1e5):
        for bending in (0.0, 1e-5, 1e-2):
            system = System(shape, cloth(stretching, bending), pins=pins, positions=dented(shape))
            found.append(system.iterations())
    print(f"\n{kind} {nodes}: {found}")
    assert max(found) <= 30


@pytest.mark.parametrize(
    "nodes", [(32, 16), (32, 32), (50, 24), (64, 32), pytest.param((128, 64), marks=pytest.mark.slow)], ids=str
)
def test_poles_take_few_more_iterations(nodes: tuple[int, int]) -> None:
    # Beside a pole cells are 2 pi / n as wide as they are long, n nodes around it.
    shape, found = POLAR["ball"](nodes), []
    pins = (Pin([[0, 0], [nodes[0] // 2, 0]]),)
    for stretching in (1e3, 1e5):
        for bending in (0.0, 1e-5, 1e-2):
            system = System(shape, cloth(stretching, bending), pins=pins, positions=dented(shape))
            found.append(system.iterations())
    print(f"\nball {nodes}: {found}")
    assert max(found) <= 30


def crease(u: Array, v: Array) -> Array:
    return np.where(np.abs(u - 0.5) < 0.01, 1.0, 0.0)


def hem(u: Array, v: Array) -> Array:
    return np.where(np.minimum.reduce([u, 1 - u, v, 1 - v]) < 0.03, 1.0, 0.0)


def checks(u: Array, v: Array) -> Array:
    return (np.floor(7 * u) + np.floor(7 * v)) % 2


@pytest.mark.parametrize("contrast", [1e2, 1e4])
@pytest.mark.parametrize(
    ("pattern", "factor"), [(crease, -1), (crease, 1), (hem, 1), (checks, -1)], ids=["weak", "stiff", "hem", "checks"]
)
def test_stiffness_that_varies_is_felt_on_every_grid(pattern: Any, factor: int, contrast: float) -> None:
    # With the harmonic mean in place of the arithmetic one: up to 253.
    shape, found = sheet((65, 65)), []
    for key, even in (("membrane_stiffness", 1e4), ("bending_stiffness", 1e-3)):
        local = {key: lambda u, v, even=even: even * contrast ** (factor * pattern(u, v))}
        constants = {"membrane_stiffness": 1e4, "bending_stiffness": 1e-5} | local
        system = System(shape, Material(areal_density=0.2, poisson_ratio=0.3, **constants), positions=bent(shape))
        found.append(system.iterations())
    print(f"\n{pattern.__name__}, contrast {contrast**factor:g}: {found}")
    assert max(found) <= 40


@pytest.mark.parametrize("stretching", [1e2, 1e3, 1e5])
@pytest.mark.parametrize("nodes", [33, 65, pytest.param(129, marks=pytest.mark.slow)])
def test_iterations_of_a_hanging_sheet_are_bounded_until_it_folds(nodes: int, stretching: float) -> None:
    settings = Settings(precision="float64", preconditioner="multigrid", cg_tolerance=1e-4, device="cpu")
    simulation = Simulation([hanging((nodes, nodes), material=cloth(stretching))], settings=settings)
    counts = []
    for _ in range(36):
        count = simulation.step().cg_iterations
        if folds(simulation.bodies[0].positions()) > 60:
            break
        counts.append(count)
    print(f"\nhanging {nodes} x {nodes}, {stretching:g} N/m: {counts}")
    assert len(counts) > 12
    assert max(counts) <= 40


@pytest.mark.parametrize("ratio", [1e-2, 1.0, 1e2, 1e4, 1e6])
def test_contact_is_felt_on_every_grid(ratio: float) -> None:
    shape = sheet((65, 65))
    count = System(shape, cloth(), positions=bent(shape), contact=ratio).iterations()
    print(f"\ncontact {ratio:g} times as stiff as the sheet: {count}")
    assert count <= 25


def test_pins_are_felt_on_every_grid() -> None:
    shape = sheet((65, 65))
    pins = (Pin([[i, j] for i in range(3, 62, 7) for j in range(2, 62, 9)]),)
    count = System(shape, cloth(1e4), pins=pins, positions=bent(shape)).iterations()
    print(f"\npins all over: {count}")
    assert count <= 30


def test_a_few_nodes_are_solved_directly() -> None:
    shape = sheet((3, 4))
    assert shape.positions[..., 0].size <= COARSEST_NODES
    system = System(shape, cloth(), positions=bent(shape), tolerance=1e-12)
    assert system.iterations() <= 2


@pytest.mark.parametrize("shape", ["sheet", "bump"])
@pytest.mark.parametrize("material", ["membrane", "shell"])
@pytest.mark.parametrize("seed", range(3))
def test_no_eigenvalue_exceeds_the_nodes_of_a_sample(shape: str, material: str, seed: int) -> None:
    rest = sheet((5, 6)) if shape == "sheet" else SHAPES["bump"]((5, 6))
    rough = rest.positions + noise(rest.positions, (0.02, 0.1, 0.3)[seed], seed)
    system = System(rest, MATERIALS[material], pins=(), positions=rough, preconditioner="block-jacobi", tau=10.0)
    bound = system.operator.terms[0][0].sample_nodes
    assert bound == {"membrane": 4, "shell": {"sheet": 5, "bump": 6}[shape]}[material]
    system.preconditioner.update()
    unit = np.eye(rest.positions.size).reshape(-1, *rest.positions.shape)
    matrix = np.array([system.precondition(system.product(e)).ravel() for e in unit])
    assert np.abs(np.linalg.eigvals(matrix)).max() <= bound * (1 + 1e-9)


def test_chebyshev_damps_its_interval_evenly() -> None:
    steps = chebyshev(0.5, 2.0, 3)
    left = []
    for eigenvalue in np.linspace(0.5, 2.0, 101):
        d, z = 0.0, 0.0
        for keep, rate in steps:
            d = keep * d + rate * (1.0 - eigenvalue * z)
            z += d
        left.append(1.0 - eigenvalue * z)
    assert max(left) == pytest.approx(-min(left), rel=1e-3)
    assert max(left) == pytest.approx(1.0 / np.cosh(3 * np.arccosh(2.5 / 1.5)), rel=1e-3)


def overconfident(level: Level | None) -> None:
    """Makes a hierarchy count with a third of its largest eigenvalues."""
    while level is not None and level.coarse is not None:
        rates = level._rates.numpy().copy()
        rates[[0, 2], :, 1] *= 3.0
        level._rates.assign(rates)
        level = level.coarse


@pytest.mark.parametrize("name", ["multigrid", "cheapest"])
def test_cycle_that_is_not_positive_definite_becomes_careful(name: str) -> None:
    shape = sheet((33, 33))
    system = System(shape, cloth(), positions=bent(shape), preconditioner=name)
    expected = system.iterations()
    preconditioner: Any = system.preconditioner
    inner: Multigrid = preconditioner.multigrid if isinstance(preconditioner, Cheapest) else preconditioner
    overconfident(inner.levels[0])
    solution = system.read("direction")
    count = system.iterations()
    assert inner.caution.numpy()[BOUNDED] == 1
    assert inner.caution.numpy()[GIVEN_UP] == 0
    assert count <= 2 * expected + 8
    np.testing.assert_allclose(system.read("direction"), solution, atol=1e-2 * np.abs(solution).max())
    preconditioner.reset()
    assert not inner.caution.numpy().any()


def test_cycle_that_stays_indefinite_is_given_up_for_block_jacobi() -> None:
    shape = sheet((17, 17))
    system = System(shape, cloth(), positions=bent(shape))
    plain = System(shape, cloth(), positions=bent(shape), preconditioner="block-jacobi").iterations()
    levels: Level = system.preconditioner.levels[0]  # type: ignore[attr-defined]
    overconfident(levels)
    while levels.coarse is not None:
        rates = levels._rates.numpy().copy()
        rates[[1, 3]] = rates[[0, 2]]
        levels._rates.assign(rates)
        levels = levels.coarse
    count = system.iterations()
    assert system.preconditioner.caution.numpy()[GIVEN_UP] == 1  # type: ignore[attr-defined]
    assert count <= plain + 10
    assert system.iterations() == plain


def test_cheapest_takes_block_jacobi_where_cycles_cost_more() -> None:
    shape = sheet((33, 33))
    system = System(shape, cloth(), positions=bent(shape), preconditioner="cheapest")
    cheapest = system.preconditioner
    assert isinstance(cheapest, Cheapest)
    assert cheapest.multigrid.levels[0].cycle_cost(SHORT) > 4.0
    cycles = system.iterations()
    assert not cheapest._choice.numpy()[PLAIN]
    cheapest._unit.assign([1e4, 1e-3, 1e4])
    for _ in range(6):
        count = system.iterations()
    assert cheapest._choice.numpy()[PLAIN]
    assert count > 3 * cycles
    cheapest._unit.assign([1e-3, 1e4, 1e-3])
    for _ in range(40):
        count = system.iterations()
    assert not cheapest._choice.numpy()[PLAIN]
    assert count == cycles


def test_trial_that_takes_too_long_is_ended_by_the_other_method() -> None:
    shape = sheet((33, 33))
    system = System(shape, cloth(1e5), positions=bent(shape), preconditioner="cheapest")
    expected, cycles = system.iterations(), 0
    solution = system.read("direction")
    cheapest = system.preconditioner
    assert isinstance(cheapest, Cheapest)
    cheapest._unit.assign([30.0, 1.3, 90.0])
    cheapest.reset()
    plain = System(shape, cloth(1e5), positions=bent(shape), preconditioner="block-jacobi", tolerance=2.5e-5)
    price = int(30.0 * expected / 1.3)
    assert price < plain.iterations()
    counts = []
    for _ in range(8):
        counts.append(system.iterations())
        np.testing.assert_allclose(system.read("direction"), solution, atol=1e-3 * np.abs(solution).max())
        cycles += counts[-1] == expected
    assert max(counts) > price
    assert cycles >= 6


def test_equal_answers_at_both_lane_widths() -> None:
    shape = sheet((20, 31))
    found = []
    for width in (1, 8):
        system = System(shape, cloth(), positions=bent(shape), lane_width=width)
        found.append((system.iterations(), system.read("direction")))
    assert found[0][0] == found[1][0]
    np.testing.assert_allclose(found[0][1], found[1][1], atol=1e-9 * np.abs(found[0][1]).max())


@pytest.mark.parametrize("name", ["multigrid", "cheapest"])
def test_captured_and_repeated_runs_give_the_same_bits(name: str) -> None:
    runs = [run(busy(preconditioner=name, captured=captured), 12) for captured in (True, False, True)]
    assert_same_bits(runs[1], runs[0])
    assert_same_bits(runs[2], runs[0])


@pytest.mark.parametrize("name", ["multigrid", "cheapest"])
def test_reset_starts_over_to_the_bit(name: str) -> None:
    simulation = busy(preconditioner=name)
    first = run(simulation, 12)
    simulation.reset()
    assert_same_bits(run(simulation, 12), first)


def test_memory_per_node_is_bounded() -> None:
    for nodes, limit in ((64, 1000), (129, 850)):
        simulation = Simulation([hanging((nodes, nodes))], settings=REAL_TIME)
        assert simulation.info().preconditioner == "cheapest"
        assert simulation.info().bytes_total < limit * nodes**2


@pytest.mark.parametrize("name", ["block-jacobi", "multigrid", "cheapest"])
def test_a_step_allocates_nothing_on_the_device(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    simulation = busy(preconditioner=name)
    simulation.step()
    allocator = CPU.default_allocator
    made: list[int] = []
    allocate = type(allocator).allocate
    monkeypatch.setattr(
        type(allocator), "allocate", lambda self, size, *rest: (made.append(size), allocate(self, size, *rest))[1]
    )
    wp.zeros(3, dtype=wp.float32, device=CPU)
    assert made, "the count does not work"
    made.clear()
    for _ in range(3):
        simulation._stepper._prepare(0, 0.1, 0.1 + simulation.dt, simulation.dt)
        simulation._replay("stage 0")
    assert not made
