"""Explicit steps: kick v by the force, drift x by v, in one pass that gathers the elastic force at once.

    v' = v - dt M^-1 grad E + dt g,    x' = x + dt v'

On pinned nodes M^-1 and g count as zero: they go on with the velocity that takes them to their target at the end of
the burst of steps. Loads that depend on the velocity take it, as implicit steps have them do, from (z - w)/tau with
tau = 1 s, at the velocity v* = v' + theta (v' - v) that is extrapolated to the next step: theta = 1/2 makes that second
order.

Where a term has a say in every step (obstacles, which clip the way), the kick ends with the displacement dt v', and
`move` makes x' and v' of what is left of it.

Largest frequency: terms give node blocks B that bound their Hessians, p'H p <= p'B p (`Force.add_majorant`), and so

    lambda_max(M^-1 H) <= max over nodes of the largest eigenvalue of B/m
"""

import functools
from types import SimpleNamespace
from typing import Any, NamedTuple

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.products import Gathering

# Entries of the pace of a burst of steps.
DT = wp.constant(0)
"""Step [s]."""
PER_DT = wp.constant(1)
DRIFT = wp.constant(2)
"""How far positions are ahead of velocities while steps are taken [s]."""
THETA = wp.constant(3)
PER_BURST = wp.constant(4)
"""One over the time from the start of the burst to its end [1/s]."""
FRESH = wp.constant(5)
"""1 where no steps went before."""
PACE = 6

# Entries of the int32 counts of a burst.
LEFT = wp.constant(0)
ODD = wp.constant(1)
COUNTS = 2


class Kick(NamedTuple):
    """What a kick is made of; only that is compiled.

    Attributes:
        gathering: How the elastic force is gathered; None where it is in the gradient.
        loaded: A gradient array holds other forces.
        pushed: One acceleration for all nodes is added: gravity, where it need not be in the gradient.
        trailing: There are loads, which depend on velocities: write w.
        displacing: End with the displacement, which `move` makes positions and velocities of.
        working: Sum up the work of loads and pins.
    """

    gathering: Gathering | None
    loaded: bool
    pushed: bool
    trailing: bool
    displacing: bool
    working: bool

    @property
    def name(self) -> str:
        """What the module is called."""
        flags = zip("lptdw", (self.loaded, self.pushed, self.trailing, self.displacing, self.working), strict=True)
        letters = "".join(letter for letter, is_set in flags if is_set)
        return f"explicit_{self.gathering.name if self.gathering else 'given'}_{letters}"


@functools.cache
def no_gathering(width: int, real: Any) -> Gathering:
    """Where there is nothing to gather."""
    V = lanes(width, real).V

    @wp.struct
    class Fluxes:
        none: wp.array3d(dtype=real)

    @wp.func
    def gathered(fluxes: Fluxes, i: int, j: int):
        return V()

    return Gathering("given", gathered, Fluxes)


@functools.cache
def kicks(width: int, real: Any, kick: Kick) -> SimpleNamespace:
    """The kernels ``advance`` and ``move`` of an explicit step for one lane width, precision and kind of kick."""
    words = lanes(width, real)
    load1, load3, store3, vector = words.load1, words.load3, words.store3, words.vector
    dot3, scale, mul, splat, sum_lanes = words.dot3, words.scale, words.mul, words.splat, words.sum_lanes
    _, gathered, Fluxes = kick.gathering or no_gathering(width, real)
    module = kernel_module(kick.name, width, real)

    @wp.kernel(module=module)
    def advance(
        fluxes: Fluxes,
        gradient: wp.array3d(dtype=real),
        loads: wp.array3d(dtype=real),
        per_mass: wp.array3d(dtype=real),
        free: wp.array3d(dtype=real),
        push: wp.array(dtype=real),
        pace: wp.array(dtype=real),
        x: wp.array3d(dtype=real),
        v_out: wp.array3d(dtype=real),
        next_out: wp.array3d(dtype=real),
        w_out: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """`per_mass` is one over mass, zero outside; `next_out` takes x', or the displacement."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        g = gathered(fluxes, i, j)
        if wp.static(kick.loaded):
            g = g + load3(gradient, 0, i, j)
        v, dt = load3(v_out, 0, i, j), pace[DT] * load1(free, 0, i, j)
        kicked = v - scale(mul(dt, load1(per_mass, 0, i, j)), g)
        if wp.static(kick.pushed):
            kicked = kicked + scale(dt, vector(splat(push[0]), splat(push[1]), splat(push[2])))
        d = scale(splat(pace[DT]), kicked)
        if wp.static(kick.working):
            # What held nodes are pushed back with, and what loads push with.
            held = splat(real(1.0)) - load1(free, 0, i, j)
            given = scale(held, g)
            if wp.static(kick.trailing):
                given = given - load3(loads, 0, i, j)
            partials_out[i, j] = partials_out[i, j] + sum_lanes(dot3(given, d))
        if wp.static(kick.displacing):
            store3(next_out, 0, i, j, d)
        else:
            store3(v_out, 0, i, j, kicked)
            moved = load3(x, 0, i, j) + d
            store3(next_out, 0, i, j, moved)
            if wp.static(kick.trailing):
                store3(w_out, 0, i, j, moved - (kicked + scale(splat(pace[THETA]), kicked - v)))

    @wp.kernel(module=module)
    def move(
        pace: wp.array(dtype=real),
        d: wp.array3d(dtype=real),
        z: wp.array3d(dtype=real),
        x_out: wp.array3d(dtype=real),
        v_out: wp.array3d(dtype=real),
        w_out: wp.array3d(dtype=real),
    ):
        """x' = z + d, where z is x, or where obstacles have carried it; v' and w of what has become of the way."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r, here, way = load3(x_out, 0, i, j), load3(z, 0, i, j), load3(d, 0, i, j)
        v = load3(v_out, 0, i, j)
        kicked = scale(splat(pace[PER_DT]), way + (here - r))
        moved = here + way
        store3(x_out, 0, i, j, moved)
        store3(v_out, 0, i, j, kicked)
        if wp.static(kick.trailing):
            store3(w_out, 0, i, j, moved - (kicked + scale(splat(pace[THETA]), kicked - v)))

    return SimpleNamespace(module=module, advance=advance, move=move)


@functools.cache
def bursts(width: int, real: Any) -> SimpleNamespace:
    """Lane kernels around explicit steps for one lane width and precision."""
    words = lanes(width, real)
    load1, load3, store3, store6 = words.load1, words.load3, words.store3, words.store6
    scale, splat, mul, div, at_least = words.scale, words.splat, words.mul, words.div, words.at_least
    dot3, root, max_lanes, S = words.dot3, words.root, words.max_lanes, words.S
    module = kernel_module("bursts", width, real)

    @wp.kernel(module=module)
    def begin(
        free: wp.array3d(dtype=real),
        target: wp.array3d(dtype=real),
        pace: wp.array(dtype=real),
        x: wp.array3d(dtype=real),
        v_out: wp.array3d(dtype=real),
        x_before_out: wp.array3d(dtype=real),
        v_before_out: wp.array3d(dtype=real),
    ):
        """Keep the state; pinned nodes get the velocity that takes them to their targets."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        r, v, f = load3(x, 0, i, j), load3(v_out, 0, i, j), load1(free, 0, i, j)
        store3(x_before_out, 0, i, j, r)
        store3(v_before_out, 0, i, j, v)
        held = splat(pace[PER_BURST]) - pace[PER_BURST] * f
        store3(v_out, 0, i, j, scale(f, v) + scale(held, load3(target, 0, i, j) - r))

    @wp.kernel(module=module)
    def drift(pace: wp.array(dtype=real), sign: real, v: wp.array3d(dtype=real), x_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(x_out, 0, i, j, load3(x_out, 0, i, j) + scale(splat(sign * pace[DRIFT]), load3(v, 0, i, j)))

    @wp.kernel(module=module)
    def drift_ahead(pace: wp.array(dtype=real), v: wp.array3d(dtype=real), d_out: wp.array3d(dtype=real)):
        """The displacement of the first drift, for obstacles to clip."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(d_out, 0, i, j, scale(splat(pace[DRIFT]), load3(v, 0, i, j)))

    @wp.kernel(module=module)
    def add(d: wp.array3d(dtype=real), x_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(x_out, 0, i, j, load3(x_out, 0, i, j) + load3(d, 0, i, j))

    @wp.kernel(module=module)
    def trail(
        pace: wp.array(dtype=real), x: wp.array3d(dtype=real), v: wp.array3d(dtype=real), w_out: wp.array3d(dtype=real)
    ):
        """w for the first step, from the velocity that the steps before have left there, or the one at hand."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        u = load3(w_out, 0, i, j)
        if pace[FRESH] > real(0.0):
            u = load3(v, 0, i, j)
        store3(w_out, 0, i, j, load3(x, 0, i, j) - u)

    @wp.kernel(module=module)
    def greatest_speed(v: wp.array3d(dtype=real), partials_out: wp.array2d(dtype=wp.float64)):
        """Of each lane group; not a number if any is."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        u = load3(v, 0, i, j)
        partials_out[i, j] = wp.float64(max_lanes(root(dot3(u, u))))

    @wp.kernel(module=module)
    def clear_blocks(blocks_out: wp.array3d(dtype=real)):
        ii, group = wp.tid()
        store6(blocks_out, 0, ii + 1, (group + 1) * width, S())

    @wp.kernel(module=module)
    def bound_rates(
        blocks: wp.array3d(dtype=real),
        per_mass: wp.array3d(dtype=real),
        free: wp.array3d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """A bound on the largest eigenvalue of free nodes' blocks over mass, 2 % above it at most, per lane group.

        With B = blocks/trace, trace (tr B^64)^(1/64): the largest of three eigenvalues is a third of them at least.
        """
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        xx, yy, zz = load1(blocks, 0, i, j), load1(blocks, 1, i, j), load1(blocks, 2, i, j)
        trace = at_least(xx + yy + zz, real(1.0e-30))
        per = div(splat(real(1.0)), trace)
        xx, yy, zz = mul(per, xx), mul(per, yy), mul(per, zz)
        xy, xz, yz = (
            mul(per, load1(blocks, 3, i, j)),
            mul(per, load1(blocks, 4, i, j)),
            mul(per, load1(blocks, 5, i, j)),
        )
        for _ in range(5):
            aa, bb, cc = mul(xy, xy), mul(xz, xz), mul(yz, yz)
            p, q, s = mul(xz, yz) + mul(xy, xx + yy), mul(xy, yz) + mul(xz, xx + zz), mul(xy, xz) + mul(yz, yy + zz)
            xx, yy, zz = mul(xx, xx) + aa + bb, mul(yy, yy) + aa + cc, mul(zz, zz) + bb + cc
            xy, xz, yz = p, q, s
        squares = mul(xx, xx) + mul(yy, yy) + mul(zz, zz)
        squares = squares + real(2.0) * (mul(xy, xy) + mul(xz, xz) + mul(yz, yz))
        rate = mul(trace, root(root(root(root(root(root(squares)))))))
        rate = mul(mul(rate, load1(per_mass, 0, i, j)), load1(free, 0, i, j))
        partials_out[i, j] = wp.float64(max_lanes(rate))

    return SimpleNamespace(
        module=module,
        begin=begin,
        drift=drift,
        drift_ahead=drift_ahead,
        add=add,
        trail=trail,
        clear_blocks=clear_blocks,
        greatest_speed=greatest_speed,
        bound_rates=bound_rates,
    )


@functools.cache
def counting() -> SimpleNamespace:
    """Single-thread kernels that count the steps of a burst."""
    module = kernel_module("counting", 1, wp.float64)

    @wp.kernel(module=module)
    def begin_burst(
        count: wp.array(dtype=wp.int32),
        together: int,
        counts_out: wp.array(dtype=wp.int32),
        iteration_out: wp.array(dtype=wp.int32),
    ):
        """Steps that are left, in groups of `together`; and whether one is left over."""
        counts_out[LEFT] = count[0] / together
        counts_out[ODD] = count[0] - together * counts_out[LEFT]
        iteration_out[0] = 0

    @wp.kernel(module=module)
    def count_down(counts_out: wp.array(dtype=wp.int32)):
        counts_out[LEFT] = counts_out[LEFT] - 1

    return SimpleNamespace(module=module, begin_burst=begin_burst, count_down=count_down)
