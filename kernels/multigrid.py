"""Geometric multigrid on component arrays: transfers, the start of the smoother, blocks, the coarsest solve.

Notation of design 7.1: A the matrix, D its diagonal blocks, C what of them stems from node-wise terms (contact,
springs, friction, air), E = D - C the elastic block with the mass. A coarse correction is filtered by F = D^-1 E before
it is added: where contact is stiff the elastic coarse grid must not move a node.
"""

import functools
from types import SimpleNamespace
from typing import Any

import warp as wp

from warpdeform.kernels.choice import BOUNDED, LONG
from warpdeform.kernels.lanes import kernel_module, lanes
from warpdeform.kernels.products import RATE
from warpdeform.kernels.transfer import transfer_tables, transfers

MOST_STIFFENING = 1.0e6
"""Largest |C| / |E| that a coarser grid is told of: beyond, float32 could not tell E in C any more."""


@functools.cache
def multigrid(width: int, real: Any) -> SimpleNamespace:
    """Lane kernels of the V-cycle for one lane width and precision."""
    words, moves, Tables = lanes(width, real), transfers(width, real), transfer_tables(real)
    carried3, add3 = moves.carried3, words.add3
    load1, load3, load6 = words.load1, words.load3, words.load6
    store3, store6, isotropic = words.store3, words.store6, words.isotropic
    scale, scale6, apply6, inverse6, splat = words.scale, words.scale6, words.apply6, words.inverse6, words.splat
    div, at_least, symmetric, vector = words.div, words.at_least, words.symmetric, words.vector
    one, tiny, most = real(1.0), real(1.0e-30), real(MOST_STIFFENING)
    module = kernel_module("multigrid", width, real)

    @wp.kernel(module=module)
    def carry(
        a: wp.array3d(dtype=real),
        tables: Tables,
        b_out: wp.array3d(dtype=real),
    ):
        """b = the linear map of the vectors a."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store3(b_out, 0, i, j, carried3(a, 0, tables, i, j))

    @wp.kernel(module=module)
    def correct(
        z: wp.array3d(dtype=real),
        tables: Tables,
        free: wp.array3d(dtype=real),
        d_out: wp.array3d(dtype=real),
        z_out: wp.array3d(dtype=real),
    ):
        """Coarse correction d = P z on the free nodes, added to the fine z."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        d = scale(load1(free, 0, i, j), carried3(z, 0, tables, i, j))
        store3(d_out, 0, i, j, d)
        store3(z_out, 0, i, j, load3(z_out, 0, i, j) + d)

    @wp.kernel(module=module)
    def correct_filtered(
        z: wp.array3d(dtype=real),
        tables: Tables,
        free: wp.array3d(dtype=real),
        elastic: wp.array3d(dtype=real),
        inverse: wp.array3d(dtype=real),
        d_out: wp.array3d(dtype=real),
        z_out: wp.array3d(dtype=real),
    ):
        """Coarse correction d = F P z on the free nodes, F = D^-1 E, added to the fine z."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        e = apply6(load6(elastic, 0, i, j), carried3(z, 0, tables, i, j))
        d = scale(load1(free, 0, i, j), apply6(load6(inverse, 0, i, j), e))
        store3(d_out, 0, i, j, d)
        store3(z_out, 0, i, j, load3(z_out, 0, i, j) + d)

    @wp.kernel(module=module)
    def start_smoother(
        free: wp.array3d(dtype=real),
        inverse: wp.array3d(dtype=real),
        r: wp.array3d(dtype=real),
        rates: wp.array3d(dtype=real),
        caution: wp.array(dtype=wp.int32),
        r_out: wp.array3d(dtype=real),
        d_out: wp.array3d(dtype=real),
        z_out: wp.array3d(dtype=real),
    ):
        """First step from zero: z = d = rate D^-1 r; r is copied, the smoother uses it up."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        residual = load3(r, 0, i, j)
        d = scale(
            rates[caution[BOUNDED] + 2 * caution[LONG], 0, RATE] * load1(free, 0, i, j),
            apply6(load6(inverse, 0, i, j), residual),
        )
        store3(r_out, 0, i, j, residual)
        store3(d_out, 0, i, j, d)
        store3(z_out, 0, i, j, d)

    @wp.kernel(module=module)
    def split_blocks(
        mass: wp.array3d(dtype=real),
        inertia: wp.array(dtype=real),
        free: wp.array3d(dtype=real),
        blocks: wp.array3d(dtype=real),
        elastic: wp.array3d(dtype=real),
        inverse_out: wp.array3d(dtype=real),
        stiffening_out: wp.array3d(dtype=real),
    ):
        """D^-1 = (E + C)^-1, where C = B - M / tau^2, and what a coarser grid feels of C: E D^-1 C, and E at pins."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        E, C = load6(elastic, 0, i, j), load6(blocks, 0, i, j)
        C = C - isotropic(inertia[0] * load1(mass, 0, i, j))
        store6(inverse_out, 0, i, j, inverse6(E + C))
        excess = div(C[0] + C[1] + C[2], at_least(most * (E[0] + E[1] + E[2]), tiny))
        C = scale6(div(splat(one), at_least(excess, one)), C)
        D = inverse6(E + C)
        felt = symmetric(
            apply6(E, apply6(D, vector(C[0], C[3], C[4]))),
            apply6(E, apply6(D, vector(C[3], C[1], C[5]))),
            apply6(E, apply6(D, vector(C[4], C[5], C[2]))),
        )
        f = load1(free, 0, i, j)
        store6(stiffening_out, 0, i, j, scale6(f, felt) + scale6(splat(one) - f, E))

    @wp.kernel(module=module)
    def hold_pins(
        free: wp.array3d(dtype=real), elastic: wp.array3d(dtype=real), stiffening_out: wp.array3d(dtype=real)
    ):
        """What a coarser grid feels of pins where there are no node-wise terms: E at pins."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        store6(stiffening_out, 0, i, j, scale6(splat(one) - load1(free, 0, i, j), load6(elastic, 0, i, j)))

    @wp.kernel(module=module)
    def add_carried_blocks(a: wp.array3d(dtype=real), tables: Tables, b_out: wp.array3d(dtype=real)):
        """b = b + the linear map of the blocks a."""
        ii, group = wp.tid()
        i, j = ii + 1, (group + 1) * width
        add3(b_out, 0, i, j, carried3(a, 0, tables, i, j))
        add3(b_out, 3, i, j, carried3(a, 3, tables, i, j))

    return SimpleNamespace(
        module=module,
        carry=carry,
        add_carried_blocks=add_carried_blocks,
        correct=correct,
        correct_filtered=correct_filtered,
        start_smoother=start_smoother,
        split_blocks=split_blocks,
        hold_pins=hold_pins,
    )


@functools.cache
def dense(real: Any) -> SimpleNamespace:
    """The coarsest grid's matrix: assembled column by column, inverted in place of being factorised, multiplied.

    Unknown 3 n + c is component c of node n; `places` holds row and column of each node. The inverse takes a few dozen
    nodes no longer than a factorisation would, and a product with it runs in parallel.
    """
    module = kernel_module("dense", 1, real)

    @wp.kernel(module=module)
    def set_unit(places: wp.array2d(dtype=wp.int32), column: int, d_out: wp.array3d(dtype=real)):
        """d = the unit vector of a column."""
        k = wp.tid()
        n = k // 3
        d_out[k % 3, places[n, 0], places[n, 1]] = wp.where(k == column, real(1.0), real(0.0))

    @wp.kernel(module=module)
    def store_column(
        places: wp.array2d(dtype=wp.int32),
        column: int,
        free: wp.array3d(dtype=real),
        q: wp.array3d(dtype=real),
        matrix_out: wp.array2d(dtype=wp.float64),
    ):
        """A column of the matrix; that of the identity at pins."""
        k = wp.tid()
        n, m = k // 3, column // 3
        free_k = wp.float64(free[0, places[n, 0], places[n, 1]])
        free_m = wp.float64(free[0, places[m, 0], places[m, 1]])
        entry = free_k * free_m * wp.float64(q[k % 3, places[n, 0], places[n, 1]])
        matrix_out[k, column] = entry + wp.where(k == column, wp.float64(1.0) - free_k, wp.float64(0.0))

    @wp.kernel(module=module)
    def sweep(pivot: int, matrix: wp.array2d(dtype=wp.float64), matrix_out: wp.array2d(dtype=wp.float64)):
        """Exchange one unknown with its right-hand side (Gauss-Jordan); after all of them the matrix is the inverse."""
        i = wp.tid()
        p = wp.float64(1.0) / matrix[pivot, pivot]
        f = p * matrix[i, pivot]
        if i == pivot:
            for k in range(matrix.shape[1]):
                matrix_out[i, k] = p * matrix[i, k]
            matrix_out[i, i] = p
        else:
            for k in range(matrix.shape[1]):
                matrix_out[i, k] = matrix[i, k] - f * matrix[pivot, k]
            matrix_out[i, pivot] = -f

    @wp.kernel(module=module)
    def gather_unknowns(
        places: wp.array2d(dtype=wp.int32),
        free: wp.array3d(dtype=real),
        r: wp.array3d(dtype=real),
        vector_out: wp.array(dtype=wp.float64),
    ):
        """The component array r as a vector, zero at pins."""
        k = wp.tid()
        i, j = places[k // 3, 0], places[k // 3, 1]
        vector_out[k] = wp.float64(free[0, i, j] * r[k % 3, i, j])

    @wp.kernel(module=module)
    def multiply(
        places: wp.array2d(dtype=wp.int32),
        free: wp.array3d(dtype=real),
        inverse: wp.array2d(dtype=wp.float64),
        vector: wp.array(dtype=wp.float64),
        z_out: wp.array3d(dtype=real),
    ):
        """z = inverse vector on the free nodes, with the mean of both triangles: round-off must stay symmetric."""
        k = wp.tid()
        total = wp.float64(0.0)
        for m in range(inverse.shape[0]):
            total += (inverse[k, m] + inverse[m, k]) * vector[m]
        i, j = places[k // 3, 0], places[k // 3, 1]
        z_out[k % 3, i, j] = free[0, i, j] * real(wp.float64(0.5) * total)

    return SimpleNamespace(
        module=module,
        set_unit=set_unit,
        store_column=store_column,
        sweep=sweep,
        gather_unknowns=gather_unknowns,
        multiply=multiply,
    )
