"""Sums over a body and the vector updates of conjugate gradient.

Every sum is made in a fixed order: each lane group adds its lanes in float64, each row its groups, one thread the rows
of all bodies. So the same scene gives the same bits in every run, and no atomic decides.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes

# Entries of the solver's float64 scalars.
ALPHA = wp.constant(0)
BETA = wp.constant(1)
RZ = wp.constant(2)
RZ_START = wp.constant(3)
RZ_SWITCHED = wp.constant(4)
SOLVER_SCALARS = 5

# Entries of the solver's int32 state.
ACTIVE = wp.constant(0)
ITERATIONS = wp.constant(1)
BREAKDOWN = wp.constant(2)
RETREAT = wp.constant(3)
RETREATS = wp.constant(4)
RESTART = wp.constant(5)
SWITCH_AT = wp.constant(6)
SWITCHED = wp.constant(7)
STRICT = wp.constant(8)
BEFORE_SWITCH = wp.constant(9)
SOLVER_STATE = 10

MOST_RETREATS = wp.constant(2)
STRICTNESS = wp.constant(wp.float64(0.25))
"""What a tolerance on sqrt(r.z) is multiplied with where z = D^-1 r is to end with the energy error that z = V(r) does.

Of a hanging sheet: sqrt(r.D^-1 r) ends 1 to 8 times below the energy error, sqrt(r.V r) 1.2 times.
"""


@functools.cache
def krylov(width: int, real: Any) -> SimpleNamespace:
    """Lane kernels of conjugate gradient for one lane width and precision."""
    words = lanes(width, real)
    load1, load3, load6, store3 = words.load1, words.load3, words.load6, words.store3
    dot3, scale, splat, store6 = words.dot3, words.scale, words.splat, words.store6
    sum_lanes, apply6, inverse6, isotropic = words.sum_lanes, words.apply6, words.inverse6, words.isotropic
    root, max_lanes, div, at_least = words.root, words.max_lanes, words.div, words.at_least
    V = words.V
    module = kernel_module("krylov", width, real)

    @wp.kernel(module=module)
    def start_solve(gradient: wp.array3d(dtype=real), x_out: wp.array3d(dtype=real), r_out: wp.array3d(dtype=real)):
        """x = 0, r = -gradient."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(x_out, 0, i, j, V())
        store3(r_out, 0, i, j, V() - load3(gradient, 0, i, j))

    @wp.kernel(module=module)
    def clear(a_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(a_out, 0, i, j, V())

    @wp.kernel(module=module)
    def copy(a: wp.array3d(dtype=real), b_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(b_out, 0, i, j, load3(a, 0, i, j))

    @wp.kernel(module=module)
    def copy_blocks(a: wp.array3d(dtype=real), b_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store6(b_out, 0, i, j, load6(a, 0, i, j))

    @wp.kernel(module=module)
    def dot(a: wp.array3d(dtype=real), b: wp.array3d(dtype=real), partials_out: wp.array2d(dtype=wp.float64)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        partials_out[i, j] = sum_lanes(dot3(load3(a, 0, i, j), load3(b, 0, i, j)))

    @wp.kernel(module=module)
    def mask(free: wp.array3d(dtype=real), a_out: wp.array3d(dtype=real)):
        """Zero at pinned nodes and outside the body."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(a_out, 0, i, j, scale(load1(free, 0, i, j), load3(a_out, 0, i, j)))

    @wp.kernel(module=module)
    def mask_dot(
        free: wp.array3d(dtype=real),
        p: wp.array3d(dtype=real),
        q_out: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """q = free q, and the sums of p.q."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        q = scale(load1(free, 0, i, j), load3(q_out, 0, i, j))
        store3(q_out, 0, i, j, q)
        partials_out[i, j] = sum_lanes(dot3(load3(p, 0, i, j), q))

    @wp.kernel(module=module)
    def start_blocks(mass: wp.array3d(dtype=real), inertia: wp.array(dtype=real), blocks_out: wp.array3d(dtype=real)):
        """B = M / tau^2."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store6(blocks_out, 0, i, j, isotropic(inertia[0] * load1(mass, 0, i, j)))

    @wp.kernel(module=module)
    def invert_blocks(blocks: wp.array3d(dtype=real), inverse_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store6(inverse_out, 0, i, j, inverse6(load6(blocks, 0, i, j)))

    @wp.kernel(module=module)
    def invert_traces(blocks: wp.array3d(dtype=real), inverse_out: wp.array3d(dtype=real)):
        """The point-Jacobi form: 3 / trace of each block."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        trace = load1(blocks, 0, i, j) + load1(blocks, 1, i, j) + load1(blocks, 2, i, j)
        store6(inverse_out, 0, i, j, isotropic(div(splat(real(3.0)), at_least(trace, real(1.0e-30)))))

    @wp.kernel(module=module)
    def advance(
        scalars: wp.array(dtype=wp.float64),
        p: wp.array3d(dtype=real),
        q: wp.array3d(dtype=real),
        x_out: wp.array3d(dtype=real),
        r_out: wp.array3d(dtype=real),
    ):
        """x = x + alpha p, r = r - alpha q."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        alpha = splat(real(scalars[ALPHA]))
        store3(x_out, 0, i, j, load3(x_out, 0, i, j) + scale(alpha, load3(p, 0, i, j)))
        store3(r_out, 0, i, j, load3(r_out, 0, i, j) - scale(alpha, load3(q, 0, i, j)))

    @wp.kernel(module=module)
    def apply_blocks(
        free: wp.array3d(dtype=real),
        inverse: wp.array3d(dtype=real),
        r: wp.array3d(dtype=real),
        z_out: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """z = D^-1 r on the free nodes, and the sums of r.z."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        residual = load3(r, 0, i, j)
        z = scale(load1(free, 0, i, j), apply6(load6(inverse, 0, i, j), residual))
        store3(z_out, 0, i, j, z)
        partials_out[i, j] = sum_lanes(dot3(residual, z))

    @wp.kernel(module=module)
    def turn(scalars: wp.array(dtype=wp.float64), z: wp.array3d(dtype=real), p_out: wp.array3d(dtype=real)):
        """p = z + beta p."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(p_out, 0, i, j, load3(z, 0, i, j) + scale(splat(real(scalars[BETA])), load3(p_out, 0, i, j)))

    @wp.kernel(module=module)
    def largest(
        a: wp.array3d(dtype=real),
        weight: wp.array3d(dtype=real),
        free: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Largest |a| / weight of each lane group's free nodes."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        v = scale(load1(free, 0, i, j), load3(a, 0, i, j))
        length = div(root(dot3(v, v)), at_least(load1(weight, 0, i, j), real(1.0e-30)))
        partials_out[i, j] = wp.float64(max_lanes(length))

    return SimpleNamespace(
        module=module,
        start_solve=start_solve,
        clear=clear,
        copy=copy,
        copy_blocks=copy_blocks,
        dot=dot,
        mask=mask,
        mask_dot=mask_dot,
        start_blocks=start_blocks,
        invert_blocks=invert_blocks,
        invert_traces=invert_traces,
        advance=advance,
        apply_blocks=apply_blocks,
        turn=turn,
        largest=largest,
    )


@functools.cache
def reductions() -> SimpleNamespace:
    """Sums of float64 partial results and the scalar steps of conjugate gradient; the same for every precision."""
    module = kernel_module("reductions", 1, wp.float64)

    @wp.kernel(module=module)
    def sum_rows(partials: wp.array2d(dtype=wp.float64), stride: int, rows_out: wp.array2d(dtype=wp.float64)):
        """Sum and sum of magnitudes of every `stride`-th entry of a row."""
        i = wp.tid()
        total, size = wp.float64(0.0), wp.float64(0.0)
        for k in range(partials.shape[1] // stride):
            x = partials[i + 1, k * stride]
            total += x
            size += wp.abs(x)
        rows_out[0, i] = total
        rows_out[1, i] = size

    @wp.kernel(module=module)
    def max_rows(partials: wp.array2d(dtype=wp.float64), stride: int, rows_out: wp.array2d(dtype=wp.float64)):
        """Largest of every `stride`-th entry of a row; not a number if any is."""
        i = wp.tid()
        worst = wp.float64(0.0)
        for k in range(1, partials.shape[1] // stride - 1):
            x = partials[i + 1, k * stride]
            if x > worst or wp.isnan(x):
                worst = x
        rows_out[0, i] = worst

    @wp.kernel(module=module)
    def total(rows: wp.array2d(dtype=wp.float64), entry: int, scalars_out: wp.array(dtype=wp.float64)):
        """Sum of all rows, and of their magnitudes in the next entry."""
        s, m = wp.float64(0.0), wp.float64(0.0)
        for i in range(rows.shape[1]):
            s += rows[0, i]
            m += rows[1, i]
        scalars_out[entry] = s
        scalars_out[entry + 1] = m

    @wp.kernel(module=module)
    def greatest(rows: wp.array2d(dtype=wp.float64), entry: int, scalars_out: wp.array(dtype=wp.float64)):
        worst = wp.float64(0.0)
        for i in range(rows.shape[1]):
            if rows[0, i] > worst or wp.isnan(rows[0, i]):
                worst = rows[0, i]
        scalars_out[entry] = worst

    @wp.func
    def row_sum(rows: wp.array2d(dtype=wp.float64)):
        s = wp.float64(0.0)
        for i in range(rows.shape[1]):
            s += rows[0, i]
        return s

    @wp.kernel(module=module)
    def judge_preconditioner(
        rows: wp.array2d(dtype=wp.float64),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """r.z < 0, or so many iterations that it should be another one: it is to change, the next direction is new."""
        rz = row_sum(rows)
        state_out[RETREAT] = 0
        if rz < wp.float64(0.0) and state_out[RETREATS] < MOST_RETREATS:
            state_out[RETREAT] = 1
            state_out[RETREATS] = state_out[RETREATS] + 1
        elif state_out[SWITCH_AT] > 0 and state_out[ITERATIONS] >= state_out[SWITCH_AT]:
            state_out[RETREAT] = 1
            state_out[SWITCH_AT] = 0
            state_out[SWITCHED] = 1
            state_out[BEFORE_SWITCH] = state_out[ITERATIONS]
            scalars_out[RZ_SWITCHED] = rz
        if state_out[RETREAT] == 1:
            state_out[RESTART] = 1

    @wp.kernel(module=module)
    def cg_start(
        rows: wp.array2d(dtype=wp.float64),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """First r.z; nothing to do when it is zero."""
        rz = row_sum(rows)
        scalars_out[RZ] = rz
        scalars_out[RZ_START] = rz
        state_out[ITERATIONS] = 0
        state_out[RESTART] = 0
        state_out[ACTIVE] = wp.where(rz > wp.float64(0.0), 1, 0)
        state_out[BREAKDOWN] = wp.where(wp.isfinite(rz), 0, 1)

    @wp.kernel(module=module)
    def cg_step(
        rows: wp.array2d(dtype=wp.float64),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """alpha = r.z / p.Ap; a direction without curvature ends the solve with alpha = 0."""
        curvature = row_sum(rows)
        if curvature > wp.float64(0.0) and wp.isfinite(curvature):
            scalars_out[ALPHA] = scalars_out[RZ] / curvature
        else:
            scalars_out[ALPHA] = wp.float64(0.0)
            state_out[BREAKDOWN] = 1

    @wp.kernel(module=module)
    def cg_turn(
        rows: wp.array2d(dtype=wp.float64),
        tolerance: wp.array(dtype=wp.float64),
        cap: wp.array(dtype=wp.int32),
        scalars_out: wp.array(dtype=wp.float64),
        state_out: wp.array(dtype=wp.int32),
    ):
        """beta = new r.z / old r.z (0 after a retreat), and the stop test sqrt(r.z) <= tolerance * first sqrt(r.z)."""
        rz = row_sum(rows)
        scalars_out[BETA] = rz / scalars_out[RZ]
        if state_out[RESTART] == 1:
            scalars_out[BETA] = wp.float64(0.0)
        if state_out[SWITCHED] == 1:
            # What has been reached so far counts, in the measure of the new preconditioner.
            scalars_out[RZ_START] = scalars_out[RZ_START] * rz / scalars_out[RZ_SWITCHED]
            state_out[SWITCHED] = 0
        state_out[RESTART] = 0
        scalars_out[RZ] = rz
        state_out[ITERATIONS] = state_out[ITERATIONS] + 1
        if not (rz >= wp.float64(0.0)) or not wp.isfinite(rz):
            state_out[BREAKDOWN] = 1
        drop = tolerance[0]
        if state_out[STRICT] == 1:
            drop = STRICTNESS * drop
        done = rz <= drop * drop * scalars_out[RZ_START]
        if done or state_out[BREAKDOWN] == 1 or state_out[ITERATIONS] >= cap[0]:
            state_out[ACTIVE] = 0

    return SimpleNamespace(
        module=module,
        sum_rows=sum_rows,
        max_rows=max_rows,
        total=total,
        greatest=greatest,
        judge_preconditioner=judge_preconditioner,
        cg_start=cg_start,
        cg_step=cg_step,
        cg_turn=cg_turn,
    )
