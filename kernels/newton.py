"""The decisions of an implicit step: the safe start, the line search, Newton's stop test, whether the step counts."""

import functools
from types import SimpleNamespace

import warp as wp

from warpdeform.kernels.krylov import RZ
from warpdeform.kernels.lanes import kernel_module

# Entries of the float64 scalars of a step; potentials and slopes are followed by the sum of their terms' magnitudes.
PHI_STILL = wp.constant(0)
PHI = wp.constant(2)
PHI_TRIAL = wp.constant(4)
SLOPE = wp.constant(6)
LENGTH = wp.constant(8)
UPDATE = wp.constant(9)
RESIDUAL = wp.constant(10)
WORK = wp.constant(11)
TOTAL_WORK = wp.constant(13)
"""Of all stages."""
ERROR = wp.constant(14)
"""Largest error of a position in the step, by the method's own estimate [m]."""
UNSOLVED = wp.constant(15)
"""sqrt(r.z) that the last linear solve has left."""
SPEED = wp.constant(16)
"""Of the fastest node at the end of the step [m/s], where nothing but a limit keeps it from running away."""
STEP_SCALARS = 17

# Entries of the int32 state of a step.
NEWTON_ACTIVE = wp.constant(0)
SEARCH_ACTIVE = wp.constant(1)
NEWTON_ITERATIONS = wp.constant(2)
SEARCH_HALVINGS = wp.constant(3)
CG_TOTAL = wp.constant(4)
CG_BREAKDOWNS = wp.constant(5)
CG_CAPPED = wp.constant(6)
OUTCOME = wp.constant(7)
NEWTON_TOTAL = wp.constant(8)
"""Newton iterations of all stages."""
BROKE = wp.constant(9)
"""Whether the last linear solve broke down."""
ACCEPTED = wp.constant(10)
STEP_STATE = 11

# Values of the outcome entry; warpdeform.result.Outcome gives them their sentences.
RUNNING = wp.constant(0)
CONVERGED = wp.constant(1)
ROUND_OFF = wp.constant(2)
FIXED = wp.constant(3)
CAPPED = wp.constant(4)
NOT_FINITE = wp.constant(5)
STALLED = wp.constant(6)
BROKEN = wp.constant(7)
INACCURATE = wp.constant(8)
RUNAWAY = wp.constant(9)
BLOCKED = wp.constant(10)

# Entries of the float64 control parameters.
ULP = wp.constant(0)
UPDATE_TOLERANCE = wp.constant(1)
TIME_TOLERANCE = wp.constant(2)
"""Largest error of a step that counts [m]."""
MOST_SPEED = wp.constant(3)
"""Speed of a node beyond which nobody believes a step [m/s]."""
CONTROL_REALS = 4
# Entries of the int32 control parameters.
NEWTON_CAP = wp.constant(0)
TO_TOLERANCE = wp.constant(1)
IMPACT = wp.constant(2)
CONTROL_INTS = 3

ARMIJO = wp.constant(wp.float64(1.0e-4))
MOST_HALVINGS = wp.constant(20)


# What of the processor's floating-point control word makes it treat denormal numbers as zero.
_FLUSH = """
#if defined(__CUDA_ARCH__)
    return 0;
#elif defined(__x86_64__)
    const unsigned int before = __builtin_ia32_stmxcsr();
    __builtin_ia32_ldmxcsr((before & ~0x8040u) | (on ? 0x8040u : 0u));
    return (before & 0x8040u) != 0;
#elif defined(__aarch64__)
    unsigned long before;
    asm volatile("mrs %0, fpcr" : "=r"(before));
    asm volatile("msr fpcr, %0" : : "r"((before & ~(1ul << 24)) | ((unsigned long)(on != 0) << 24)));
    return (before >> 24) & 1;
#else
    return 0;
#endif
"""


@functools.cache
def decisions() -> SimpleNamespace:
    """Single-thread kernels that decide what the host must not: the same for every precision."""
    module = kernel_module("decisions", 1, wp.float64)

    @wp.func_native(_FLUSH)
    def flush_denormals(on: int) -> int: ...

    @wp.kernel(module=module)
    def enter_step(flushed_out: wp.array(dtype=wp.int32)):
        """Take denormal numbers for zero while the step runs: far from a contact a search direction fades through
        them, and arithmetic on them is slow on CPUs (products took twice as long in `carpet`).
        """
        flushed_out[0] = flush_denormals(1)

    @wp.kernel(module=module)
    def leave_step(flushed: wp.array(dtype=wp.int32)):
        """Give the processor back as it was: the thread is the caller's."""
        flush_denormals(flushed[0])

    @wp.kernel(module=module)
    def begin_step(
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
        iteration_out: wp.array(dtype=wp.int32),
        impact_out: wp.array(dtype=wp.int32),
    ):
        scalars_out[LENGTH] = wp.float64(1.0)
        scalars_out[TOTAL_WORK] = wp.float64(0.0)
        for k in range(state_out.shape[0]):
            state_out[k] = 0
        state_out[NEWTON_ACTIVE] = 1
        iteration_out[0] = 0
        impact_out[0] = 0

    @wp.func
    def is_good(outcome: int):
        return outcome == CONVERGED or outcome == ROUND_OFF or outcome == FIXED

    @wp.kernel(module=module)
    def begin_stage(
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
        iteration_out: wp.array(dtype=wp.int32),
    ):
        """A further stage of the step; if the one before it has failed there is nothing to do."""
        scalars_out[LENGTH] = wp.float64(1.0)
        state_out[NEWTON_ACTIVE] = wp.where(is_good(state_out[OUTCOME]), 1, 0)
        state_out[NEWTON_ITERATIONS] = 0
        iteration_out[0] = 0

    @wp.kernel(module=module)
    def end_stage(share: wp.float64, scalars_out: wp.array(dtype=wp.float64)):
        scalars_out[TOTAL_WORK] = scalars_out[TOTAL_WORK] + share * scalars_out[WORK]

    @wp.kernel(module=module)
    def judge_step(
        control: wp.array(dtype=wp.float64),
        scalars: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """The step counts if all of its stages ended well, and as precisely as is asked for."""
        if not wp.isfinite(scalars[RESIDUAL]) or not wp.isfinite(scalars[ERROR]):
            state_out[OUTCOME] = NOT_FINITE
        elif is_good(state_out[OUTCOME]) and scalars[ERROR] > control[TIME_TOLERANCE]:
            state_out[OUTCOME] = INACCURATE
        elif is_good(state_out[OUTCOME]) and scalars[SPEED] > control[MOST_SPEED]:
            state_out[OUTCOME] = RUNAWAY
        state_out[ACCEPTED] = wp.where(is_good(state_out[OUTCOME]), 1, 0)

    @wp.kernel(module=module)
    def judge_solve(
        cg_state: wp.array(dtype=wp.int32),
        cg_cap: wp.array(dtype=wp.int32),
        control: wp.array(dtype=wp.float64),
        scalars: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """A step that is one linear solve counts if that has not broken down, and left speeds that one can believe."""
        state_out[CG_TOTAL] = cg_state[1]
        state_out[CG_BREAKDOWNS] = cg_state[2]
        state_out[CG_CAPPED] = wp.where(cg_state[1] >= cg_cap[0], 1, 0)
        state_out[OUTCOME] = wp.where(cg_state[2] == 1, BROKEN, FIXED)
        if not wp.isfinite(scalars[SPEED]):
            state_out[OUTCOME] = NOT_FINITE
        elif is_good(state_out[OUTCOME]) and scalars[SPEED] > control[MOST_SPEED]:
            state_out[OUTCOME] = RUNAWAY
        state_out[ACCEPTED] = wp.where(is_good(state_out[OUTCOME]), 1, 0)

    @wp.kernel(module=module)
    def choose_start(limits: wp.array(dtype=wp.int32), scalars_out: wp.array(dtype=wp.float64)):
        """Length of the displacement to the predictor: all of it, or none if the potential is higher there.

        An impact starts at the predictor all the same: where it stops a part of a sheet the potential is higher, but
        from the old positions Newton does not see the obstacle, and the search would stop the whole sheet in the air.
        """
        better = limits[IMPACT] == 1 or scalars_out[PHI] <= scalars_out[PHI_STILL]
        better = better and wp.isfinite(scalars_out[PHI])
        scalars_out[LENGTH] = wp.where(better, wp.float64(1.0), wp.float64(0.0))

    @wp.kernel(module=module)
    def begin_search(
        cg_scalars: wp.array(dtype=wp.float64),
        cg_state: wp.array(dtype=wp.int32),
        cg_cap: wp.array(dtype=wp.int32),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """Book the linear solve and start the line search at full length."""
        state_out[CG_TOTAL] = state_out[CG_TOTAL] + cg_state[1]
        state_out[CG_BREAKDOWNS] = state_out[CG_BREAKDOWNS] + cg_state[2]
        state_out[BROKE] = cg_state[2]
        scalars_out[UNSOLVED] = wp.sqrt(wp.max(cg_scalars[RZ], wp.float64(0.0)))
        if cg_state[1] >= cg_cap[0]:
            state_out[CG_CAPPED] = state_out[CG_CAPPED] + 1
        scalars_out[LENGTH] = wp.float64(1.0)
        state_out[SEARCH_ACTIVE] = 1
        state_out[SEARCH_HALVINGS] = 0

    @wp.kernel(module=module)
    def judge_trial(
        control: wp.array(dtype=wp.float64),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """Armijo's test, with the round-off of the sums allowed for; after the last halving the iterate stays."""
        round_off = control[ULP] * (scalars_out[PHI + 1] + scalars_out[PHI_TRIAL + 1])
        bound = (
            scalars_out[PHI] + ARMIJO * scalars_out[LENGTH] * wp.min(scalars_out[SLOPE], wp.float64(0.0)) + round_off
        )
        if scalars_out[PHI_TRIAL] <= bound:
            state_out[SEARCH_ACTIVE] = 0
        else:
            state_out[SEARCH_HALVINGS] = state_out[SEARCH_HALVINGS] + 1
            scalars_out[LENGTH] = wp.float64(0.5) * scalars_out[LENGTH]
            if state_out[SEARCH_HALVINGS] >= MOST_HALVINGS:
                scalars_out[LENGTH] = wp.float64(0.0)
                state_out[SEARCH_ACTIVE] = 0

    @wp.kernel(module=module)
    def end_iteration(
        control: wp.array(dtype=wp.float64),
        limits: wp.array(dtype=wp.int32),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
        iteration_out: wp.array(dtype=wp.int32),
    ):
        """Newton's stop test: largest update of a node, change of the potential, or the cap.

        A linear solve that breaks down on its way has still gone downhill; one that does at once has done nothing.
        """
        state_out[NEWTON_ITERATIONS] = state_out[NEWTON_ITERATIONS] + 1
        state_out[NEWTON_TOTAL] = state_out[NEWTON_TOTAL] + 1
        iteration_out[0] = state_out[NEWTON_ITERATIONS]
        outcome = RUNNING
        update = scalars_out[UPDATE] * scalars_out[LENGTH]
        round_off = control[ULP] * (scalars_out[PHI + 1] + scalars_out[PHI_TRIAL + 1])
        if state_out[NEWTON_ITERATIONS] >= limits[NEWTON_CAP]:
            outcome = wp.where(limits[TO_TOLERANCE] == 1, CAPPED, FIXED)
        if limits[TO_TOLERANCE] == 1:
            if scalars_out[LENGTH] == wp.float64(0.0):
                # An update below the tolerance that does not lower the potential either is lost in its round-off.
                outcome = wp.where(scalars_out[UPDATE] <= control[UPDATE_TOLERANCE], ROUND_OFF, STALLED)
            # Upwards leads only what a guard has changed: that is not lost in round-off.
            if wp.abs(scalars_out[SLOPE]) <= round_off:
                outcome = ROUND_OFF
            if update <= control[UPDATE_TOLERANCE] and scalars_out[LENGTH] > wp.float64(0.0):
                outcome = CONVERGED
        if state_out[BROKE] == 1 and scalars_out[UPDATE] == wp.float64(0.0):
            outcome = BROKEN
        if not wp.isfinite(scalars_out[UPDATE]) or not wp.isfinite(scalars_out[PHI]):
            outcome = NOT_FINITE
        state_out[OUTCOME] = outcome
        state_out[NEWTON_ACTIVE] = wp.where(outcome == RUNNING, 1, 0)

    return SimpleNamespace(
        module=module,
        enter_step=enter_step,
        leave_step=leave_step,
        begin_step=begin_step,
        begin_stage=begin_stage,
        end_stage=end_stage,
        judge_step=judge_step,
        judge_solve=judge_solve,
        choose_start=choose_start,
        begin_search=begin_search,
        judge_trial=judge_trial,
        end_iteration=end_iteration,
    )
