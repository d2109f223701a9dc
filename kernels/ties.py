"""Ties between nodes of bodies: a node of one and a weighted mean of nodes of another, or of the same one.

Tie t joins the node s_t to the material point sum over k of w_tk r(m_tk); its stretch is d_t = r(s_t) - that point.

    rigid     s follows: spread  r(s_t) = sum w r(m),   gather (the transpose)  g(m) += sum w g(s_t), g(s_t) = 0
    soft      energy k_t |d_t|^2 / 2, gradient k_t d_t at s_t and -w_tk k_t d_t at m_tk, blocks k_t 1 and w_tk^2 k_t 1

Every thread writes one node or one tie: what a node gets from several ties is added up in the order of a list, so that
the same scene gives the same bits. One side of all ties is a table: `places` holds row and column of each tie's nodes,
shape (ties, nodes, 2), and `weights` (ties, nodes); the other way round `starts` says which entries of the lists `ties`
and `shares` belong to each node of `nodes`.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.lanes import kernel_module, lanes


@functools.cache
def ties(real: Any) -> SimpleNamespace:
    """Kernels for one precision: of soft ties the first four, of rigid ones the rest."""
    words = lanes(1, real)
    V, S, load3, load6, store3 = words.V, words.S, words.load3, words.load6, words.store3
    add3, add6 = words.add3, words.add6
    dot3, isotropic = words.dot3, words.isotropic
    zero = real(0.0)
    module = kernel_module("ties", 1, real)

    @wp.func
    def point(places: wp.array3d(dtype=wp.int32), weights: wp.array2d(dtype=real), t: int, a: wp.array3d(dtype=real)):
        """Weighted sum of the vectors a at the nodes of a tie."""
        p = V()
        for k in range(places.shape[1]):
            p = p + weights[t, k] * load3(a, 0, places[t, k, 0], places[t, k, 1])
        return p

    @wp.kernel(module=module)
    def stretch(
        places: wp.array3d(dtype=wp.int32),
        weights: wp.array2d(dtype=real),
        other_places: wp.array3d(dtype=wp.int32),
        other_weights: wp.array2d(dtype=real),
        a: wp.array3d(dtype=real),
        b: wp.array3d(dtype=real),
        stretch_out: wp.array2d(dtype=real),
    ):
        """d of every tie, with a on the one side and b on the other."""
        t = wp.tid()
        # Differences of positions first: far from the origin a sum of weighted positions has lost its digits.
        near = load3(a, 0, places[t, 0, 0], places[t, 0, 1])
        d = V()
        for k in range(other_places.shape[1]):
            d = d + other_weights[t, k] * (near - load3(b, 0, other_places[t, k, 0], other_places[t, k, 1]))
        for c in range(3):
            stretch_out[t, c] = d[c]

    @wp.func
    def pulled(
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=real),
        stiffness: wp.array(dtype=real),
        stretches: wp.array2d(dtype=real),
        n: int,
    ):
        f = V()
        for e in range(starts[n], starts[n + 1]):
            t = tie_of[e]
            f = f + (shares[e] * stiffness[t]) * V(stretches[t, 0], stretches[t, 1], stretches[t, 2])
        return f

    @wp.func
    def own_block(
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=real),
        stiffness: wp.array(dtype=real),
        n: int,
    ):
        k = zero
        for e in range(starts[n], starts[n + 1]):
            k = k + shares[e] * shares[e] * stiffness[tie_of[e]]
        return k

    @wp.kernel(module=module)
    def pull(
        nodes: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=real),
        stiffness: wp.array(dtype=real),
        stretches: wp.array2d(dtype=real),
        sign: real,
        force_out: wp.array3d(dtype=real),
    ):
        n = wp.tid()
        f = sign * pulled(starts, tie_of, shares, stiffness, stretches, n)
        add3(force_out, 0, nodes[n, 0], nodes[n, 1], f)

    @wp.kernel(module=module)
    def pull_without_own(
        nodes: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=real),
        stiffness: wp.array(dtype=real),
        stretches: wp.array2d(dtype=real),
        sign: real,
        p: wp.array3d(dtype=real),
        q_out: wp.array3d(dtype=real),
    ):
        """`pull` of the stretches by a vector p, without what the node's own block makes of p."""
        n = wp.tid()
        f = sign * pulled(starts, tie_of, shares, stiffness, stretches, n)
        f = f - own_block(starts, tie_of, shares, stiffness, n) * load3(p, 0, nodes[n, 0], nodes[n, 1])
        add3(q_out, 0, nodes[n, 0], nodes[n, 1], f)

    @wp.kernel(module=module)
    def add_energy(
        nodes: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        stiffness: wp.array(dtype=real),
        stretches: wp.array2d(dtype=real),
        partials_out: wp.array2d(dtype=wp.float64),
    ):
        """Energy of the ties that join the node."""
        n = wp.tid()
        energy = wp.float64(0.0)
        for e in range(starts[n], starts[n + 1]):
            t = tie_of[e]
            d = V(stretches[t, 0], stretches[t, 1], stretches[t, 2])
            energy = energy + wp.float64(0.5) * wp.float64(stiffness[t] * dot3(d, d))
        i, j = nodes[n, 0], nodes[n, 1]
        partials_out[i, j] = partials_out[i, j] + energy

    @wp.kernel(module=module)
    def add_blocks(
        nodes: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=real),
        stiffness: wp.array(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        n = wp.tid()
        add6(blocks_out, 0, nodes[n, 0], nodes[n, 1], isotropic(own_block(starts, tie_of, shares, stiffness, n)))

    @wp.kernel(module=module)
    def spread(
        followers: wp.array3d(dtype=wp.int32),
        places: wp.array3d(dtype=wp.int32),
        weights: wp.array2d(dtype=real),
        a: wp.array3d(dtype=real),
        a_out: wp.array3d(dtype=real),
    ):
        """The nodes that follow take the value at their material point."""
        t = wp.tid()
        store3(a_out, 0, followers[t, 0, 0], followers[t, 0, 1], point(places, weights, t, a))

    @wp.kernel(module=module)
    def gather(
        nodes: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=real),
        followers: wp.array3d(dtype=wp.int32),
        a: wp.array3d(dtype=real),
        a_out: wp.array3d(dtype=real),
    ):
        """Nodes that are followed take what lies at their followers, by weight."""
        n = wp.tid()
        f = V()
        for e in range(starts[n], starts[n + 1]):
            t = tie_of[e]
            f = f + shares[e] * load3(a, 0, followers[t, 0, 0], followers[t, 0, 1])
        add3(a_out, 0, nodes[n, 0], nodes[n, 1], f)

    @wp.kernel(module=module)
    def hang_blocks(
        nodes: wp.array2d(dtype=wp.int32),
        starts: wp.array(dtype=wp.int32),
        tie_of: wp.array(dtype=wp.int32),
        shares: wp.array(dtype=real),
        followers: wp.array3d(dtype=wp.int32),
        blocks: wp.array3d(dtype=real),
        blocks_out: wp.array3d(dtype=real),
    ):
        """Add the blocks of the followers to those of the nodes that they follow: the diagonal blocks of T' A T."""
        n = wp.tid()
        b = S()
        for e in range(starts[n], starts[n + 1]):
            t = tie_of[e]
            b = b + (shares[e] * shares[e]) * load6(blocks, 0, followers[t, 0, 0], followers[t, 0, 1])
        add6(blocks_out, 0, nodes[n, 0], nodes[n, 1], b)

    @wp.kernel(module=module)
    def clear(followers: wp.array3d(dtype=wp.int32), a_out: wp.array3d(dtype=real)):
        t = wp.tid()
        store3(a_out, 0, followers[t, 0, 0], followers[t, 0, 1], V())

    return SimpleNamespace(
        module=module,
        stretch=stretch,
        pull=pull,
        pull_without_own=pull_without_own,
        add_energy=add_energy,
        add_blocks=add_blocks,
        spread=spread,
        gather=gather,
        hang_blocks=hang_blocks,
        clear=clear,
    )
