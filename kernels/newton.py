"""One implicit step: its stage vectors, the safe start, the line search and the decisions between Newton iterations.

The stage problem M (z - y)/tau^2 + grad E(z) - f = 0 is the same for every implicit method (design 6.1); a method is
the weights that make w, y and the start z out of the history,

    stage vector = x + weights[0] (x - x_before) + weights[1] v + weights[2] v_before
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

# Entries of the float64 scalars of a step; potentials and slopes are followed by the sum of their terms' magnitudes.
PHI_STILL = wp.constant(0)
PHI = wp.constant(2)
PHI_TRIAL = wp.constant(4)
SLOPE = wp.constant(6)
LENGTH = wp.constant(8)
UPDATE = wp.constant(9)
RESIDUAL = wp.constant(10)
WORK = wp.constant(11)
STEP_SCALARS = 13

# Entries of the int32 state of a step.
NEWTON_ACTIVE = wp.constant(0)
SEARCH_ACTIVE = wp.constant(1)
NEWTON_ITERATIONS = wp.constant(2)
SEARCH_HALVINGS = wp.constant(3)
CG_TOTAL = wp.constant(4)
CG_BREAKDOWNS = wp.constant(5)
CG_CAPPED = wp.constant(6)
OUTCOME = wp.constant(7)
STEP_STATE = 8

# Values of the outcome entry; warpdeform.result.Outcome gives them their sentences.
RUNNING = wp.constant(0)
CONVERGED = wp.constant(1)
ROUND_OFF = wp.constant(2)
FIXED = wp.constant(3)
CAPPED = wp.constant(4)
NOT_FINITE = wp.constant(5)
STALLED = wp.constant(6)

# Entries of the float64 control parameters.
ULP = wp.constant(0)
UPDATE_TOLERANCE = wp.constant(1)
CONTROL_REALS = 2
# Entries of the int32 control parameters.
NEWTON_CAP = wp.constant(0)
TO_TOLERANCE = wp.constant(1)
IMPACT = wp.constant(2)
CONTROL_INTS = 3

ARMIJO = wp.constant(wp.float64(1.0e-4))
MOST_HALVINGS = wp.constant(20)


@functools.cache
def stage(width: int, real: Any) -> SimpleNamespace:
    """Lane kernels that make and finish a stage, for one lane width and precision."""
    words = lanes(width, real)
    load1, load3, store3 = words.load1, words.load3, words.store3
    scale, dot3, splat, sum_lanes = words.scale, words.dot3, words.splat, words.sum_lanes
    module = kernel_module("stage", width, real)

    @wp.kernel(module=module)
    def combine(
        weights: wp.array2d(dtype=real),
        row: int,
        x: wp.array3d(dtype=real),
        x_before: wp.array3d(dtype=real),
        v: wp.array3d(dtype=real),
        v_before: wp.array3d(dtype=real),
        a_out: wp.array3d(dtype=real),
    ):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r = load3(x, 0, i, j)
        change = scale(splat(weights[row, 0]), r - load3(x_before, 0, i, j))
        change = change + scale(splat(weights[row, 1]), load3(v, 0, i, j))
        change = change + scale(splat(weights[row, 2]), load3(v_before, 0, i, j))
        store3(a_out, 0, i, j, r + change)

    @wp.kernel(module=module)
    def place_pins(free: wp.array3d(dtype=real), target: wp.array3d(dtype=real), a_out: wp.array3d(dtype=real)):
        """Pinned nodes to their targets, to the last bit; the others stay."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        f = load1(free, 0, i, j)
        held = splat(real(1.0)) - f
        store3(a_out, 0, i, j, scale(f, load3(a_out, 0, i, j)) + scale(held, load3(target, 0, i, j)))

    @wp.kernel(module=module)
    def difference(a: wp.array3d(dtype=real), b: wp.array3d(dtype=real), c_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(c_out, 0, i, j, load3(a, 0, i, j) - load3(b, 0, i, j))

    @wp.kernel(module=module)
    def displace(
        scalars: wp.array(dtype=wp.float64),
        a: wp.array3d(dtype=real),
        d: wp.array3d(dtype=real),
        b_out: wp.array3d(dtype=real),
    ):
        """b = a + length d."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        length = splat(real(scalars[LENGTH]))
        store3(b_out, 0, i, j, load3(a, 0, i, j) + scale(length, load3(d, 0, i, j)))

    @wp.kernel(module=module)
    def clear_partials(partials_out: wp.array2d(dtype=wp.float64)):
        ii, group = wp.tid()
        for k in range(width):
            partials_out[ii + 1, (group + 1) * width + k] = wp.float64(0.0)

    @wp.kernel(module=module)
    def add_inertial_energy(
        mass: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        z: wp.array3d(dtype=real),
        y: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """|z - y|_M^2 / (2 tau^2); overwrites the lane group's entry, so it comes first."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(z, 0, i, j) - load3(y, 0, i, j)
        energy = dot3(d, scale(inertia[0] * load1(mass, 0, i, j), d))
        partials_out[i, j] = wp.float64(0.5) * sum_lanes(energy)

    @wp.kernel(module=module)
    def inertial_gradient(
        mass: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        z: wp.array3d(dtype=real),
        y: wp.array3d(dtype=real),
        gradient_out: wp.array3d(dtype=real),
    ):
        """g = g + M (z - y) / tau^2."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(z, 0, i, j) - load3(y, 0, i, j)
        store3(gradient_out, 0, i, j, load3(gradient_out, 0, i, j) + scale(inertia[0] * load1(mass, 0, i, j), d))

    @wp.kernel(module=module)
    def work_of_loads(
        g: wp.array3d(dtype=real),
        z: wp.array3d(dtype=real),
        x: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Work that forces -g do over the step."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = load3(x, 0, i, j) - load3(z, 0, i, j)
        partials_out[i, j] = partials_out[i, j] + sum_lanes(dot3(load3(g, 0, i, j), d))

    @wp.kernel(module=module)
    def work_of_pins(
        free: wp.array3d(dtype=real),
        g: wp.array3d(dtype=real),
        z: wp.array3d(dtype=real),
        x: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Work that the pins do over the step: their reaction is the unbalanced gradient g."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        held = splat(real(1.0)) - load1(free, 0, i, j)
        d = load3(z, 0, i, j) - load3(x, 0, i, j)
        partials_out[i, j] = partials_out[i, j] + sum_lanes(dot3(scale(held, load3(g, 0, i, j)), d))

    @wp.kernel(module=module)
    def accept(
        rate: wp.array(dtype=real),
        z: wp.array3d(dtype=real),
        w: wp.array3d(dtype=real),
        x_out: wp.array3d(dtype=real),
        v_out: wp.array3d(dtype=real),
        x_before_out: wp.array3d(dtype=real),
        v_before_out: wp.array3d(dtype=real),
    ):
        """The step is done: v = (z - w)/tau, x = z, and the history moves on."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(x_before_out, 0, i, j, load3(x_out, 0, i, j))
        store3(v_before_out, 0, i, j, load3(v_out, 0, i, j))
        r = load3(z, 0, i, j)
        store3(x_out, 0, i, j, r)
        store3(v_out, 0, i, j, scale(splat(rate[0]), r - load3(w, 0, i, j)))

    return SimpleNamespace(
        module=module,
        combine=combine,
        place_pins=place_pins,
        difference=difference,
        displace=displace,
        clear_partials=clear_partials,
        add_inertial_energy=add_inertial_energy,
        inertial_gradient=inertial_gradient,
        work_of_loads=work_of_loads,
        work_of_pins=work_of_pins,
        accept=accept,
    )


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
        for k in range(state_out.shape[0]):
            state_out[k] = 0
        state_out[NEWTON_ACTIVE] = 1
        iteration_out[0] = 0
        impact_out[0] = 0

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
        cg_state: wp.array(dtype=wp.int32),
        cg_cap: wp.array(dtype=wp.int32),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """Book the linear solve and start the line search at full length."""
        state_out[CG_TOTAL] = state_out[CG_TOTAL] + cg_state[1]
        state_out[CG_BREAKDOWNS] = state_out[CG_BREAKDOWNS] + cg_state[2]
        if cg_state[1] >= cg_cap[0]:
            state_out[CG_CAPPED] = state_out[CG_CAPPED] + 1
        scalars_out[SLOPE] = wp.min(scalars_out[SLOPE], wp.float64(0.0))
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
        bound = scalars_out[PHI] + ARMIJO * scalars_out[LENGTH] * scalars_out[SLOPE] + round_off
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
        """Newton's stop test: largest update of a node, change of the potential, or the cap."""
        state_out[NEWTON_ITERATIONS] = state_out[NEWTON_ITERATIONS] + 1
        iteration_out[0] = state_out[NEWTON_ITERATIONS]
        outcome = RUNNING
        update = scalars_out[UPDATE] * scalars_out[LENGTH]
        round_off = control[ULP] * (scalars_out[PHI + 1] + scalars_out[PHI_TRIAL + 1])
        if state_out[NEWTON_ITERATIONS] >= limits[NEWTON_CAP]:
            outcome = wp.where(limits[TO_TOLERANCE] == 1, CAPPED, FIXED)
        if limits[TO_TOLERANCE] == 1:
            if scalars_out[LENGTH] == wp.float64(0.0):
                outcome = STALLED
            if -scalars_out[SLOPE] <= round_off:
                outcome = ROUND_OFF
            if update <= control[UPDATE_TOLERANCE] and scalars_out[LENGTH] > wp.float64(0.0):
                outcome = CONVERGED
        if not wp.isfinite(scalars_out[UPDATE]) or not wp.isfinite(scalars_out[PHI]):
            outcome = NOT_FINITE
        state_out[OUTCOME] = outcome
        state_out[NEWTON_ACTIVE] = wp.where(outcome == RUNNING, 1, 0)

    return SimpleNamespace(
        module=module,
        enter_step=enter_step,
        leave_step=leave_step,
        begin_step=begin_step,
        choose_start=choose_start,
        begin_search=begin_search,
        judge_trial=judge_trial,
        end_iteration=end_iteration,
    )
