"""Which preconditioner a solve takes, decided on the device from what earlier solves have cost.

Multigrid needs few iterations, and each costs six products or so; on a sharply folded, nearly inextensible sheet it may
need so many of them that block-Jacobi is cheaper (design 7.2). No estimate tells: so the cheaper one is taken, and now
and then the other is tried, for no longer than the cheaper one would take.
"""

import functools
from types import SimpleNamespace

import warp as wp

from warpdeform.kernels.krylov import BEFORE_SWITCH, ITERATIONS, STRICT, SWITCH_AT, SWITCHED
from warpdeform.kernels.lanes import kernel_module

# Entries of the caution with which multigrid works: whether its smoother counts with the proven bound, whether it has
# been given up, whether the smoother is the long one.
BOUNDED = wp.constant(0)
GIVEN_UP = wp.constant(1)
LONG = wp.constant(2)
CAUTION = 3

# Entries of the choice: block-Jacobi in this solve; on trial; solves since the last trial, and from one to the next.
PLAIN = wp.constant(0)
TRIAL = wp.constant(1)
SINCE = wp.constant(2)
WAIT = wp.constant(3)
CHOICE = 4

# Entries of the costs, in matrix-vector products: of a solve with multigrid and with block-Jacobi, running means.
CYCLES = wp.constant(0)
BLOCKS = wp.constant(1)
COSTS = 2
# What an iteration costs: these two, and
LONG_CYCLES = wp.constant(2)

MANY = wp.constant(30)
"""After a solve of more iterations the smoother is the long one."""
FEW = wp.constant(8)
"""After a solve of fewer with the long smoother it is the short one again."""

CHEAP = wp.constant(wp.float64(120.0))
"""A solve with multigrid that costs no more products than this is not worth a trial."""
FIRST_WAIT = wp.constant(4)
LONGEST_WAIT = wp.constant(128)
"""Solves from one trial to the next: twice as many after each that did not pay."""


@functools.cache
def choice() -> SimpleNamespace:
    """Single-thread kernels; the same for every precision."""
    module = kernel_module("choice", 1, wp.float64)

    @wp.kernel(module=module)
    def grow_cautious(caution_out: wp.array(dtype=wp.int32)):
        """The cycle was not positive definite: the rates of the proven bound; if it has those, no cycle at all."""
        if caution_out[BOUNDED] == 1:
            caution_out[GIVEN_UP] = 1
        caution_out[BOUNDED] = 1

    @wp.kernel(module=module)
    def choose_smoother(solver: wp.array(dtype=wp.int32), caution_out: wp.array(dtype=wp.int32)):
        """After a solve with cycles."""
        iterations = solver[ITERATIONS] - solver[BEFORE_SWITCH]
        if iterations > MANY:
            caution_out[LONG] = 1
        elif iterations < FEW:
            caution_out[LONG] = 0

    @wp.func
    def price(unit: wp.array(dtype=wp.float64), caution: wp.array(dtype=wp.int32), plain: int):
        """Of an iteration."""
        if plain == 1:
            return unit[BLOCKS]
        if caution[LONG] == 1:
            return unit[LONG_CYCLES]
        return unit[CYCLES]

    @wp.kernel(module=module)
    def choose_method(
        unit: wp.array(dtype=wp.float64),
        caution: wp.array(dtype=wp.int32),
        costs: wp.array(dtype=wp.float64),
        choice_out: wp.array(dtype=wp.int32),
        solver_out: wp.array(dtype=wp.int32),
    ):
        """Before a solve: the cheaper method, or a trial of the other; `unit` is what an iteration of each costs."""
        plain = wp.where(costs[BLOCKS] < costs[CYCLES], 1, 0)
        trial = 0
        choice_out[SINCE] = choice_out[SINCE] + 1
        if choice_out[SINCE] >= choice_out[WAIT] and (plain == 1 or costs[CYCLES] > CHEAP):
            trial = 1
            limit = wp.min(costs[BLOCKS], costs[CYCLES])
            plain = 1 - plain
            choice_out[SINCE] = 0
            solver_out[SWITCH_AT] = int(limit / price(unit, caution, plain)) + 1
        if caution[GIVEN_UP] == 1:
            trial = 0
            plain = 1
            solver_out[SWITCH_AT] = 0
        choice_out[TRIAL] = trial
        choice_out[PLAIN] = plain
        solver_out[STRICT] = plain

    @wp.kernel(module=module)
    def change_method(
        choice_out: wp.array(dtype=wp.int32),
        caution_out: wp.array(dtype=wp.int32),
        solver_out: wp.array(dtype=wp.int32),
    ):
        """In a solve: the trial takes too long, so the other method ends it; or the cycle was not positive definite."""
        if solver_out[SWITCHED] == 1 and choice_out[TRIAL] == 1:
            choice_out[PLAIN] = 1 - choice_out[PLAIN]
            choice_out[TRIAL] = 2
        else:
            if caution_out[BOUNDED] == 1:
                caution_out[GIVEN_UP] = 1
                choice_out[PLAIN] = 1
            caution_out[BOUNDED] = 1
        solver_out[STRICT] = choice_out[PLAIN]

    @wp.kernel(module=module)
    def learn_cost(
        unit: wp.array(dtype=wp.float64),
        caution: wp.array(dtype=wp.int32),
        solver: wp.array(dtype=wp.int32),
        choice_out: wp.array(dtype=wp.int32),
        costs_out: wp.array(dtype=wp.float64),
    ):
        """After a solve: what it has cost, and when to try again."""
        plain, trial = choice_out[PLAIN], choice_out[TRIAL]
        cost = wp.float64(solver[ITERATIONS]) * price(unit, caution, plain)
        if trial == 2:
            # The tried method did not get there for the price of the other: it costs more, how much is not known.
            tried = 1 - plain
            costs_out[tried] = wp.max(cost, wp.float64(2.0) * costs_out[plain])
        elif trial == 1:
            costs_out[plain] = cost
        else:
            known = wp.isfinite(costs_out[plain]) and costs_out[plain] > wp.float64(0.0)
            costs_out[plain] = wp.where(known, wp.float64(0.5) * (cost + costs_out[plain]), cost)
        if trial != 0:
            paid = trial == 1 and costs_out[plain] < costs_out[1 - plain]
            choice_out[WAIT] = wp.where(paid, FIRST_WAIT, wp.min(2 * choice_out[WAIT], LONGEST_WAIT))

    return SimpleNamespace(
        module=module,
        grow_cautious=grow_cautious,
        choose_smoother=choose_smoother,
        choose_method=choose_method,
        change_method=change_method,
        learn_cost=learn_cost,
    )
