"""Stage vectors, potentials, works and the decisions of Newton's method against NumPy and the rules of design 2.1."""

from typing import Any

import numpy as np
import pytest
import warp as wp
from surfaces import GRIDS, REALS, WIDTHS

from warpdeform.grid import Layout
from warpdeform.kernels import newton as entries
from warpdeform.kernels.krylov import RZ, SOLVER_SCALARS
from warpdeform.kernels.newton import decisions
from warpdeform.kernels.stage import stage
from warpdeform.result import OUTCOMES, Outcome

Array = np.ndarray[Any, Any]

WEIGHTS = np.array([[0.25, -0.5, 0.125], [1.5, 0.75, -0.25], [0.0, 0.0625, 0.0]])
INERTIA, RATE, LENGTH = 40.0, 60.0, 0.375


class Run:
    """Random fields of one grid, the same numbers for every lane width, through the stage kernels."""

    def __init__(self, nodes: tuple[int, int], real: Any, width: int) -> None:
        random = np.random.default_rng(5)
        self.layout, self.real, self.width = Layout(nodes, width), real, width
        dtype = wp.dtype_to_numpy(real)
        fields = random.normal(size=(6, *nodes, 3)).astype(dtype).astype(np.float64)
        self.a, self.b, self.c, self.d, self.e, self.g = fields
        self.mass = random.uniform(0.5, 2.0, (*nodes, 1)).astype(dtype).astype(np.float64)
        self.free = (random.uniform(size=(*nodes, 1)) > 0.4).astype(np.float64)
        scalars = np.full(entries.STEP_SCALARS, np.nan)
        scalars[entries.LENGTH] = LENGTH
        self.scalars = wp.array(scalars, dtype=wp.float64, device="cpu")
        self.weights = wp.array(WEIGHTS, dtype=real, device="cpu")
        self.inertia, self.rate = (wp.array([x], dtype=real, device="cpu") for x in (INERTIA, RATE))

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device="cpu")

    def poisoned(self) -> Array:
        return np.full((*self.layout.nodes, 3), np.nan)

    def sums(self, value: float) -> wp.array:
        return wp.array(np.full((self.layout.rows, self.layout.columns), value), dtype=wp.float64, device="cpu")

    def launch(self, name: str, *inputs: Any) -> list[Array]:
        """Run a kernel; fields are NumPy arrays; results the fields, or sums per lane group, after it."""
        arrays = [self.upload(a) if isinstance(a, np.ndarray) else a for a in inputs]
        kernel = getattr(stage(self.width, self.real), name)
        wp.launch(kernel, dim=self.layout.lane_dim, inputs=arrays, device="cpu")
        results = []
        for array in arrays:
            if isinstance(array, wp.array) and array.ndim == 3:
                results.append(self.layout.unpack(array.numpy()))
            elif isinstance(array, wp.array) and array.dtype == wp.float64 and array.ndim == 2:
                results.append(array.numpy()[1:-1, self.width :: self.width][:, : self.layout.groups])
        return results

    def outputs(self) -> dict[str, Array]:
        a, b, c, d, g = self.a, self.b, self.c, self.d, self.g
        accepted = self.launch("accept", self.rate, a, b, self.poisoned(), self.poisoned())
        before = self.launch("remember", c, d, self.poisoned(), self.poisoned())
        reflected = self.launch("reflect", self.rate, self.free, a, b, c)
        return {
            **{
                f"combine {k}": self.launch("combine", self.weights, k, a, b, c, d, self.poisoned())[-1]
                for k in range(3)
            },
            "place_pins": self.launch("place_pins", self.free, a, b)[-1],
            "difference": self.launch("difference", a, b, self.poisoned())[-1],
            "displace": self.launch("displace", self.scalars, a, b, self.poisoned())[-1],
            "inertial_gradient": self.launch("inertial_gradient", self.mass, self.inertia, a, b, g)[-1],
            "place_pins_halfway": self.launch("place_pins_halfway", self.free, a, c, b)[-1],
            "accelerate": self.launch("accelerate", self.free, self.inertia, a, b, self.poisoned())[-1],
            **dict(zip(("x", "v", "x_before", "v_before"), (*accepted[2:], *before[2:]), strict=True)),
            **dict(zip(("x reflected", "v reflected"), reflected[2:], strict=True)),
        }

    def energies(self) -> dict[str, Array]:
        """Sums over the lane groups, added to 3 where the kernel adds."""
        a, b, g = self.a, self.b, self.g
        return {
            "add_inertial_energy": self.launch("add_inertial_energy", self.mass, self.inertia, a, b, self.sums(np.nan))[
                -1
            ],
            "work_of_loads": self.launch("work_of_loads", g, a, b, self.sums(3.0))[-1] - 3.0,
            "work_of_pins": self.launch("work_of_pins", self.free, g, a, b, self.sums(3.0))[-1] - 3.0,
        }


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("nodes", [(2, 2), (3, 19)], ids=str)
def test_fields_are_what_their_kernels_say(nodes: tuple[int, int], real: Any) -> None:
    run = Run(nodes, real, 1)
    a, b, c, d, g = run.a, run.b, run.c, run.d, run.g
    expected = {
        **{f"combine {k}": a + w[0] * (b - a) + w[1] * c + w[2] * d for k, w in enumerate(WEIGHTS)},
        "place_pins": np.where(run.free > 0, b, a),
        "difference": a - b,
        "place_pins_halfway": np.where(run.free > 0, b, c + 0.5 * (a - c)),
        "accelerate": INERTIA * run.free * (a - b),
        "x reflected": 2.0 * a - b,
        "v reflected": RATE * (a - b) + run.free * (RATE * (a - b) - c),
        "displace": a + LENGTH * b,
        "inertial_gradient": g + INERTIA * run.mass * (a - b),
        "x": a,
        "v": RATE * (a - b),
        "x_before": c,
        "v_before": d,
    }
    found = run.outputs()
    assert set(found) == set(expected)
    epsilon = np.finfo(wp.dtype_to_numpy(real)).eps
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, atol=8 * epsilon * np.abs(values).max(), err_msg=name)
    for name in ("place_pins", "x", "x_before", "v_before"):
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)


@pytest.mark.parametrize(("real", "width"), [(real, width) for real in REALS for width in WIDTHS[real]])
@pytest.mark.parametrize("nodes", [(2, 2), (3, 19)], ids=str)
def test_potential_and_works(nodes: tuple[int, int], real: Any, width: int) -> None:
    run = Run(nodes, real, width)
    a, b, g = run.a, run.b, run.g
    expected = {
        "add_inertial_energy": 0.5 * INERTIA * np.sum(run.mass * (a - b) ** 2, -1),
        "work_of_loads": np.sum(g * (b - a), -1),
        "work_of_pins": np.sum((1 - run.free) * g * (a - b), -1),
    }
    for name, found in run.energies().items():
        padded = np.zeros((nodes[0], run.layout.groups * width))
        padded[:, : nodes[1]] = expected[name]
        sums = padded.reshape(nodes[0], -1, width).sum(-1)
        tolerance = 40 * np.finfo(wp.dtype_to_numpy(real)).eps * np.abs(padded).max()
        np.testing.assert_allclose(found, sums, atol=tolerance, err_msg=name)


@pytest.mark.parametrize("real", REALS)
@pytest.mark.parametrize("nodes", GRIDS, ids=str)
def test_lane_widths_agree_to_the_bit(nodes: tuple[int, int], real: Any) -> None:
    narrow, wide = (Run(nodes, real, width).outputs() for width in WIDTHS[real])
    for name, values in narrow.items():
        np.testing.assert_array_equal(values, wide[name], err_msg=name)


class Decision:
    """Scalars and state of a step for the single-thread kernels."""

    def __init__(self, *, state: dict[int, int] | None = None, **scalars: float) -> None:
        reals, integers = np.zeros(entries.STEP_SCALARS), np.zeros(entries.STEP_STATE, dtype=np.int32)
        for name, value in scalars.items():
            name, magnitude = name.removesuffix("_SIZE"), name.endswith("_SIZE")
            reals[int(getattr(entries, name)) + magnitude] = value
        for entry, number in (state or {}).items():
            integers[int(entry)] = number
        self.scalars = wp.array(reals, dtype=wp.float64, device="cpu")
        self.state = wp.array(integers, dtype=wp.int32, device="cpu")

    def launch(self, name: str, *inputs: Any) -> "Decision":
        wp.launch(getattr(decisions(), name), dim=1, inputs=[*inputs], device="cpu")
        return self

    def scalar(self, entry: Any) -> float:
        return float(self.scalars.numpy()[int(entry)])

    def read(self, entry: Any) -> int:
        return int(self.state.numpy()[int(entry)])


def control(ulp: float = 1e-15, update: float = 1e-4, time: float = np.inf) -> wp.array:
    return wp.array([ulp, update, time, np.inf], dtype=wp.float64, device="cpu")


@pytest.mark.parametrize(
    ("still", "predicted", "impact", "length"),
    [
        (2.0, 1.0, 0, 1.0),
        (1.0, 1.0, 0, 1.0),
        (1.0, 2.0, 0, 0.0),
        (1.0, np.nan, 0, 0.0),
        (1.0, np.inf, 0, 0.0),
        (1.0, 2.0, 1, 1.0),
        (1.0, np.inf, 1, 0.0),
    ],
)
def test_start_is_the_better_of_predictor_and_rest_or_an_impact(
    still: float, predicted: float, impact: int, length: float
) -> None:
    decision = Decision(PHI_STILL=still, PHI=predicted)
    decision.launch("choose_start", wp.array([1, 0, impact], dtype=wp.int32, device="cpu"), decision.scalars)
    assert decision.scalar(entries.LENGTH) == length


@pytest.mark.parametrize(
    ("trial", "accepted"), [(0.5, True), (1.0 - 2e-4, True), (1.0 - 1e-5, False), (1.5, False), (np.nan, False)]
)
def test_armijo_asks_for_its_share_of_the_slope(trial: float, accepted: bool) -> None:
    decision = Decision(PHI=1.0, PHI_TRIAL=trial, SLOPE=-1.0, LENGTH=1.0, state={entries.SEARCH_ACTIVE: 1})
    decision.launch("judge_trial", control(), decision.scalars, decision.state)
    assert decision.read(entries.SEARCH_ACTIVE) == (not accepted)
    assert decision.scalar(entries.LENGTH) == (1.0 if accepted else 0.5)
    assert decision.read(entries.SEARCH_HALVINGS) == (not accepted)


def test_armijo_allows_for_the_round_off_of_large_sums() -> None:
    for size, accepted in ((1e12, True), (1.0, False)):
        decision = Decision(
            PHI=1.0, PHI_SIZE=size, PHI_TRIAL=1.0 + 1e-4, SLOPE=0.0, LENGTH=1.0, state={entries.SEARCH_ACTIVE: 1}
        )
        decision.launch("judge_trial", control(ulp=1e-15), decision.scalars, decision.state)
        assert decision.read(entries.SEARCH_ACTIVE) == (not accepted)


def test_search_does_not_follow_an_ascent() -> None:
    decision = Decision(PHI=1.0, PHI_TRIAL=1.0 + 1e-5, SLOPE=0.5, LENGTH=1.0, state={entries.SEARCH_ACTIVE: 1})
    decision.launch("judge_trial", control(), decision.scalars, decision.state)
    assert decision.read(entries.SEARCH_ACTIVE) == 1


def test_search_gives_up_where_it_began() -> None:
    decision = Decision(PHI=1.0, PHI_TRIAL=2.0, SLOPE=-1.0, LENGTH=1.0, state={entries.SEARCH_ACTIVE: 1})
    lengths = []
    while decision.read(entries.SEARCH_ACTIVE):
        decision.launch("judge_trial", control(), decision.scalars, decision.state)
        lengths.append(decision.scalar(entries.LENGTH))
    assert lengths[:3] == [0.5, 0.25, 0.125]
    assert lengths[-1] == 0.0
    assert len(lengths) == int(entries.MOST_HALVINGS)


def test_search_begins_at_full_length_and_books_the_linear_solve() -> None:
    decision = Decision(SLOPE=0.5, LENGTH=0.25, state={entries.CG_TOTAL: 10, entries.SEARCH_HALVINGS: 3})
    solve, cap = wp.array([0, 7, 1], dtype=wp.int32, device="cpu"), wp.array([7], dtype=wp.int32, device="cpu")
    left = np.zeros(SOLVER_SCALARS)
    left[int(RZ)] = 4.0
    decision.launch("begin_search", wp.array(left, device="cpu"), solve, cap, decision.scalars, decision.state)
    assert (decision.scalar(entries.UNSOLVED), decision.read(entries.BROKE)) == (2.0, 1)
    assert decision.scalar(entries.LENGTH) == 1.0
    assert [decision.read(e) for e in (entries.CG_TOTAL, entries.CG_BREAKDOWNS, entries.CG_CAPPED)] == [17, 1, 1]
    assert [decision.read(e) for e in (entries.SEARCH_ACTIVE, entries.SEARCH_HALVINGS)] == [1, 0]


@pytest.mark.parametrize(
    ("made", "cap", "to_tolerance", "scalars", "outcome"),
    [
        (1, 1, 0, {"UPDATE": 1.0}, Outcome.FIXED),
        (1, 3, 0, {"UPDATE": 0.0, "SLOPE": 0.0}, None),
        (5, 100, 1, {"UPDATE": 1.0}, None),
        (5, 100, 1, {"UPDATE": 1.1e-4}, None),
        (5, 100, 1, {"UPDATE": 0.9e-4}, Outcome.CONVERGED),
        (5, 100, 1, {"UPDATE": 1.6e-4, "LENGTH": 0.5}, Outcome.CONVERGED),
        (5, 100, 1, {"UPDATE": 1.0, "SLOPE": -1e-16}, Outcome.ROUND_OFF),
        (5, 100, 1, {"UPDATE": 1.0, "SLOPE": 0.5}, None),
        (5, 100, 1, {"UPDATE": 1e-3, "LENGTH": 0.0}, Outcome.STALLED),
        (5, 100, 1, {"UPDATE": 1e-9, "LENGTH": 0.0}, Outcome.ROUND_OFF),
        (5, 100, 1, {"UPDATE": 1e-9, "LENGTH": 0.0, "SLOPE": -1e-16}, Outcome.ROUND_OFF),
        (100, 100, 1, {"UPDATE": 1.0}, Outcome.CAPPED),
        (100, 100, 1, {"UPDATE": 1e-5}, Outcome.CONVERGED),
        (1, 100, 1, {"UPDATE": np.nan}, Outcome.NOT_FINITE),
        (1, 1, 0, {"UPDATE": np.inf}, Outcome.NOT_FINITE),
        (1, 1, 0, {"UPDATE": 1.0, "PHI": np.nan}, Outcome.NOT_FINITE),
    ],
)
def test_newton_ends_for_the_right_reason(
    made: int, cap: int, to_tolerance: int, scalars: dict[str, float], outcome: Outcome | None
) -> None:
    given = {
        "LENGTH": 1.0,
        "SLOPE": -1.0,
        "PHI": 1.0,
        "PHI_SIZE": 1.0,
        "PHI_TRIAL": 0.5,
        "PHI_TRIAL_SIZE": 1.0,
    } | scalars
    decision = Decision(state={entries.NEWTON_ITERATIONS: made - 1, entries.NEWTON_ACTIVE: 1}, **given)
    limits, iteration = (wp.array(values, dtype=wp.int32, device="cpu") for values in ([cap, to_tolerance, 0], [0]))
    decision.launch("end_iteration", control(), limits, decision.scalars, decision.state, iteration)
    assert OUTCOMES.get(decision.read(entries.OUTCOME)) is outcome
    assert decision.read(entries.NEWTON_ACTIVE) == (outcome is None)
    assert decision.read(entries.NEWTON_ITERATIONS) == int(iteration.numpy()[0]) == made


@pytest.mark.parametrize(("update", "outcome"), [(0.0, Outcome.BROKEN), (0.5, Outcome.FIXED)])
def test_a_solve_that_breaks_down_at_once_has_done_nothing(update: float, outcome: Outcome) -> None:
    decision = Decision(state={entries.BROKE: 1}, UPDATE=update, LENGTH=1.0, SLOPE=-update, PHI=1.0)
    limits, iteration = (wp.array(values, dtype=wp.int32, device="cpu") for values in ([1, 0, 0], [0]))
    decision.launch("end_iteration", control(), limits, decision.scalars, decision.state, iteration)
    assert OUTCOMES[decision.read(entries.OUTCOME)] is outcome


@pytest.mark.parametrize(
    ("ended", "scalars", "outcome", "accepted"),
    [
        (entries.CONVERGED, {}, Outcome.CONVERGED, True),
        (entries.ROUND_OFF, {}, Outcome.ROUND_OFF, True),
        (entries.FIXED, {}, Outcome.FIXED, True),
        (entries.CAPPED, {}, Outcome.CAPPED, False),
        (entries.STALLED, {}, Outcome.STALLED, False),
        (entries.BROKEN, {}, Outcome.BROKEN, False),
        (entries.CONVERGED, {"ERROR": 1e-3}, Outcome.CONVERGED, True),
        (entries.CONVERGED, {"ERROR": 1.1e-3}, Outcome.INACCURATE, False),
        (entries.CAPPED, {"ERROR": 1.1e-3}, Outcome.CAPPED, False),
        (entries.CONVERGED, {"ERROR": np.nan}, Outcome.NOT_FINITE, False),
        (entries.FIXED, {"RESIDUAL": np.inf}, Outcome.NOT_FINITE, False),
    ],
)
def test_a_step_counts_if_it_ended_well(
    ended: Any, scalars: dict[str, float], outcome: Outcome, accepted: bool
) -> None:
    decision = Decision(state={entries.OUTCOME: int(ended)}, **scalars)
    decision.launch("judge_step", control(time=1e-3), decision.scalars, decision.state)
    assert OUTCOMES[decision.read(entries.OUTCOME)] is outcome
    assert decision.read(entries.ACCEPTED) == accepted


@pytest.mark.parametrize(("ended", "active"), [(entries.CONVERGED, 1), (entries.FIXED, 1), (entries.CAPPED, 0)])
def test_a_second_stage_follows_only_a_good_one(ended: Any, active: int) -> None:
    state = {entries.OUTCOME: int(ended), entries.NEWTON_ITERATIONS: 5, entries.NEWTON_TOTAL: 5, entries.CG_TOTAL: 9}
    decision = Decision(LENGTH=0.25, state=state)
    decision.launch("begin_stage", decision.scalars, decision.state, wp.array([5], dtype=wp.int32, device="cpu"))
    assert decision.read(entries.NEWTON_ACTIVE) == active
    assert [decision.read(e) for e in (entries.NEWTON_ITERATIONS, entries.NEWTON_TOTAL, entries.CG_TOTAL)] == [0, 5, 9]
    assert decision.scalar(entries.LENGTH) == 1.0


def test_works_of_stages_add_up() -> None:
    decision = Decision(WORK=2.0, TOTAL_WORK=1.0)
    decision.launch("end_stage", wp.float64(2.0), decision.scalars)
    assert decision.scalar(entries.TOTAL_WORK) == 5.0


@pytest.mark.parametrize(("real", "width"), [(real, width) for real in REALS for width in WIDTHS[real]])
def test_estimate_is_the_largest_combination_of_velocities(real: Any, width: int) -> None:
    run = Run((3, 19), real, width)
    found = run.launch("estimate", run.weights, 1, run.rate, run.free, run.a, run.b, run.c, run.d, run.sums(np.nan))[
        -1
    ].max()
    w = WEIGHTS[1]
    length = np.linalg.norm(run.free * (w[0] * run.a + w[1] * run.b + w[2] * RATE * (run.c - run.d)), axis=-1)
    assert found == pytest.approx(length.max(), rel=400 * float(np.finfo(wp.dtype_to_numpy(real)).eps))


def test_step_begins_with_a_clean_state() -> None:
    decision = Decision(LENGTH=0.25, TOTAL_WORK=3.0, state=dict.fromkeys(range(entries.STEP_STATE), 9))
    iteration, impact = (wp.array([7], dtype=wp.int32, device="cpu") for _ in range(2))
    decision.launch("begin_step", decision.scalars, decision.state, iteration, impact)
    assert decision.scalar(entries.LENGTH) == 1.0
    assert decision.state.numpy().tolist() == [int(k == entries.NEWTON_ACTIVE) for k in range(entries.STEP_STATE)]
    assert decision.scalar(entries.TOTAL_WORK) == 0.0
    assert iteration.numpy().tolist() == impact.numpy().tolist() == [0]
