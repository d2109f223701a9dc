"""The lane type: the words that kernels are written in, and every memory access they make.

A kernel body works on *lane groups*: ``width`` neighbouring nodes of a row, one after another along the last grid axis.
On CUDA the width is 1 and a lane group is a plain scalar or vec3; on the CPU it is 16 (float32) or 8 (float64) and a
group is a small matrix, on which LLVM vectorises every word below. The same kernel source serves both.

Names: ``L`` one real per lane, ``V`` a 3-vector per lane, ``S`` a symmetric 3 x 3 block per lane, stored as
(xx, yy, zz, xy, xz, yz). Arrays are component arrays ``[component, row, column]`` with a halo of one row and
``halo`` columns on every side, so that no kernel has a border test (2-solver design, kernels over lanes).
"""

import functools
import re
from types import SimpleNamespace
from typing import Any

import warp as wp

WORDS = frozenset(
    "L V S load1 load3 load6 store1 store3 store6 splat mul div root at_least sum_lanes max_lanes "
    "dot3 cross3 scale scale6 outer symmetric isotropic apply6 inverse6".split()
)
NATIVE = {wp.float32: "float", wp.float64: "double"}


def kernel_module(name: str, width: int, real: Any) -> Any:
    """The Warp module that holds the kernels `name` for one lane width and precision.

    Modules are separate so that only what a scene requires is compiled, and none keeps adjoint code.
    """
    module = wp.get_module(f"warpdeform_{name}_{real.__name__}_{width}")
    # Contraction to fused multiply-adds depends on the surrounding code; without it all lane widths agree to the bit.
    module.options.update({"enable_backward": False})
    return module


@functools.cache
def lanes(width: int, real: Any) -> SimpleNamespace:
    """The words of the lane type for one lane width and precision.

    Args:
        width: Nodes per lane group: 1 (CUDA, and node-by-node kernels), 8 or 16 (CPU).
        real: ``wp.float32`` or ``wp.float64``.

    Returns:
        A namespace of types (``L``, ``V``, ``S``, ``real``) and device functions.
    """
    words = _scalar_words(real) if width == 1 else _wide_words(width, real)
    L, V, S = words.L, words.V, words.S
    load1, load3, load6 = words.load1, words.load3, words.load6
    store1, store3, store6 = words.store1, words.store3, words.store6

    @wp.func
    def add1(a: wp.array3d(dtype=real), c: int, i: int, j: int, x: L):
        store1(a, c, i, j, load1(a, c, i, j) + x)

    @wp.func
    def add3(a: wp.array3d(dtype=real), c: int, i: int, j: int, v: V):
        store3(a, c, i, j, load3(a, c, i, j) + v)

    @wp.func
    def add6(a: wp.array3d(dtype=real), c: int, i: int, j: int, s: S):
        store6(a, c, i, j, load6(a, c, i, j) + s)

    @wp.func
    def along_u(a: wp.array3d(dtype=real), c: int, i: int):
        """A number per grid row, from an array (c, rows, 1)."""
        return words.splat(a[c, i, 0])

    words.add1, words.add3, words.add6, words.along_u = add1, add3, add6, along_u
    words.width, words.real = width, real
    return words


def _scalar_words(real: Any) -> SimpleNamespace:
    L = real
    V = wp.types.vector(3, real)
    S = wp.types.vector(6, real)

    @wp.func
    def load1(a: wp.array3d(dtype=real), c: int, i: int, j: int):
        return a[c, i, j]

    @wp.func
    def load3(a: wp.array3d(dtype=real), c: int, i: int, j: int):
        return V(a[c, i, j], a[c + 1, i, j], a[c + 2, i, j])

    @wp.func
    def load6(a: wp.array3d(dtype=real), c: int, i: int, j: int):
        return S(a[c, i, j], a[c + 1, i, j], a[c + 2, i, j], a[c + 3, i, j], a[c + 4, i, j], a[c + 5, i, j])

    @wp.func
    def store1(a: wp.array3d(dtype=real), c: int, i: int, j: int, x: real):
        a[c, i, j] = x

    @wp.func
    def store3(a: wp.array3d(dtype=real), c: int, i: int, j: int, v: V):
        a[c, i, j] = v[0]
        a[c + 1, i, j] = v[1]
        a[c + 2, i, j] = v[2]

    @wp.func
    def store6(a: wp.array3d(dtype=real), c: int, i: int, j: int, s: S):
        for k in range(6):
            a[c + k, i, j] = s[k]

    @wp.func
    def splat(x: real):
        return x

    @wp.func
    def mul(a: real, b: real):
        return a * b

    @wp.func
    def div(a: real, b: real):
        return a / b

    @wp.func
    def root(a: real):
        return wp.sqrt(a)

    @wp.func
    def at_least(a: real, floor: real):
        return wp.max(a, floor)

    @wp.func
    def sum_lanes(a: real):
        return wp.float64(a)

    @wp.func
    def max_lanes(a: real):
        return a

    @wp.func
    def dot3(a: V, b: V):
        return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]

    @wp.func
    def cross3(a: V, b: V):
        return V(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])

    @wp.func
    def scale(s: real, a: V):
        return V(s * a[0], s * a[1], s * a[2])

    @wp.func
    def scale6(s: real, a: S):
        return s * a

    @wp.func
    def outer(a: V, b: V):
        h = real(0.5)
        return S(
            a[0] * b[0], a[1] * b[1], a[2] * b[2],
            h * (a[0] * b[1] + a[1] * b[0]), h * (a[0] * b[2] + a[2] * b[0]), h * (a[1] * b[2] + a[2] * b[1]),
        )  # fmt: skip

    @wp.func
    def symmetric(a: V, b: V, c: V):
        return S(a[0], b[1], c[2], a[1], a[2], b[2])

    @wp.func
    def isotropic(s: real):
        z = real(0.0)
        return S(s, s, s, z, z, z)

    @wp.func
    def apply6(s: S, a: V):
        return V(
            s[0] * a[0] + s[3] * a[1] + s[4] * a[2],
            s[3] * a[0] + s[1] * a[1] + s[5] * a[2],
            s[4] * a[0] + s[5] * a[1] + s[2] * a[2],
        )

    @wp.func
    def inverse6(s: S):
        xx = s[1] * s[2] - s[5] * s[5]
        xy = s[4] * s[5] - s[3] * s[2]
        xz = s[3] * s[5] - s[4] * s[1]
        det = s[0] * xx + s[3] * xy + s[4] * xz
        r = real(0.0)
        if det > real(0.0):
            r = real(1.0) / det
        return S(
            r * xx, r * (s[0] * s[2] - s[4] * s[4]), r * (s[0] * s[1] - s[3] * s[3]),
            r * xy, r * xz, r * (s[3] * s[4] - s[0] * s[5]),
        )  # fmt: skip

    names = dict(locals())
    return SimpleNamespace(**{name: word for name, word in names.items() if name in WORDS})


def _wide_words(width: int, real: Any) -> SimpleNamespace:
    """The words over `width` lanes, in Clang's vector types: left to itself LLVM vectorises only some of the loops."""
    W, rn = width, NATIVE[real]
    L = wp.types.vector(W, real)
    V = wp.types.matrix((3, W), real)
    S = wp.types.matrix((6, W), real)
    vec, mat3, mat6 = f"wp::vec_t<{W}, {rn}>", f"wp::mat_t<3, {W}, {rn}>", f"wp::mat_t<6, {W}, {rn}>"
    size = 4 if real == wp.float32 else 8
    lanes_type = f"typedef {rn} lv __attribute__((vector_size({W * size}), aligned({size}), may_alias));"

    def native(code: str) -> str:
        return f"{lanes_type} {code}"

    def row(name: str, k: int) -> str:
        return f"(*(lv*)&{name}.data[{k}][0])"

    def rows(result: str, n: int, expression: str) -> str:
        """Code of a matrix-valued word: `expression` gives row k, with rows of an argument x written x[k]."""
        body = "".join(
            f"{row('r', k)} = {re.sub(chr(92) + 'b' + '([a-z])' + chr(92) + '[k' + chr(92) + ']', lambda m: row(m[1], k), expression)};"
            for k in range(n)
        )
        return f"{result} r; {body} return r;"

    def lane(expression: str) -> str:
        return f"{vec} r; *(lv*)&r.c[0] = {expression}; return r;"

    def load(result: str, n: int) -> str:
        body = "".join(f"{row('r', k)} = *(const lv*)&wp::index(a, c0 + {k}, i, j);" for k in range(n))
        return f"{result} r; {body} return r;"

    def store(n: int) -> str:
        return "".join(f"*(lv*)&wp::index(a, c0 + {k}, i, j) = {row('v', k)};" for k in range(n))

    x, y = "(*(lv*)&a.c[0])", "(*(lv*)&b.c[0])"
    each = f"for (int k = 0; k < {W}; ++k)"

    @wp.func_native(native(lane("*(const lv*)&wp::index(a, c0, i, j)")))
    def load1(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> L: ...

    @wp.func_native(native(load(mat3, 3)))
    def load3(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> V: ...

    @wp.func_native(native(load(mat6, 6)))
    def load6(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> S: ...

    @wp.func_native(native("*(lv*)&wp::index(a, c0, i, j) = *(lv*)&v.c[0];"))
    def store1(a: wp.array3d(dtype=real), c0: int, i: int, j: int, v: L): ...

    @wp.func_native(native(store(3)))
    def store3(a: wp.array3d(dtype=real), c0: int, i: int, j: int, v: V): ...

    @wp.func_native(native(store(6)))
    def store6(a: wp.array3d(dtype=real), c0: int, i: int, j: int, v: S): ...

    @wp.func_native(native(f"{vec} r; {each} r.c[k] = x; return r;"))
    def splat(x: real) -> L: ...

    @wp.func_native(native(lane(f"{x} * {y}")))
    def mul(a: L, b: L) -> L: ...

    @wp.func_native(native(lane(f"{x} / {y}")))
    def div(a: L, b: L) -> L: ...

    @wp.func_native(native(f"{vec} r; {each} r.c[k] = wp::sqrt(a.c[k]); return r;"))
    def root(a: L) -> L: ...

    @wp.func_native(native(f"{vec} r; {each} r.c[k] = a.c[k] > floor ? a.c[k] : floor; return r;"))
    def at_least(a: L, floor: real) -> L: ...

    @wp.func_native(native(f"double s = 0.0; {each} s += (double)a.c[k]; return s;"))
    def sum_lanes(a: L) -> wp.float64: ...

    # A lane that is not a number wins and stays: no comparison with it holds.
    @wp.func_native(native(f"{rn} m = a.c[0]; {each} m = a.c[k] > m || a.c[k] != a.c[k] ? a.c[k] : m; return m;"))
    def max_lanes(a: L) -> real: ...

    def at(name: str, k: int) -> str:
        return row(name, k)

    @wp.func_native(
        native(lane(f"{at('a', 0)} * {at('b', 0)} + {at('a', 1)} * {at('b', 1)} + {at('a', 2)} * {at('b', 2)}"))
    )
    def dot3(a: V, b: V) -> L: ...

    @wp.func_native(
        native(
            f"{mat3} r; {at('r', 0)} = {at('a', 1)} * {at('b', 2)} - {at('a', 2)} * {at('b', 1)};"
            f"{at('r', 1)} = {at('a', 2)} * {at('b', 0)} - {at('a', 0)} * {at('b', 2)};"
            f"{at('r', 2)} = {at('a', 0)} * {at('b', 1)} - {at('a', 1)} * {at('b', 0)}; return r;"
        )
    )
    def cross3(a: V, b: V) -> V: ...

    @wp.func_native(native("const lv t = *(lv*)&s.c[0]; " + rows(mat3, 3, "t * a[k]")))
    def scale(s: L, a: V) -> V: ...

    @wp.func_native(native("const lv t = *(lv*)&s.c[0]; " + rows(mat6, 6, "t * a[k]")))
    def scale6(s: L, a: S) -> S: ...

    @wp.func_native(
        native(
            f"{mat6} r; const {rn} h = ({rn})0.5;"
            + "".join(f"{at('r', k)} = {at('a', k)} * {at('b', k)};" for k in range(3))
            + "".join(
                f"{at('r', n)} = h * ({at('a', k)} * {at('b', m)} + {at('a', m)} * {at('b', k)});"
                for n, k, m in ((3, 0, 1), (4, 0, 2), (5, 1, 2))
            )
            + "return r;"
        )
    )
    def outer(a: V, b: V) -> S: ...

    @wp.func_native(
        native(
            f"{mat6} r; "
            + "".join(
                f"{at('r', n)} = {at(name, k)};"
                for n, name, k in ((0, "a", 0), (1, "b", 1), (2, "c", 2), (3, "a", 1), (4, "a", 2), (5, "b", 2))
            )
            + "return r;"
        )
    )
    def symmetric(a: V, b: V, c: V) -> S: ...

    @wp.func_native(
        native(
            f"{mat6} r; const lv t = *(lv*)&s.c[0]; "
            + "".join(f"{at('r', k)} = t; {at('r', k + 3)} = t - t;" for k in range(3))
            + "return r;"
        )
    )
    def isotropic(s: L) -> S: ...

    @wp.func_native(
        native(
            f"{mat3} r; "
            + "".join(
                f"{at('r', n)} = {at('s', k)} * {at('a', 0)} + {at('s', m)} * {at('a', 1)} + {at('s', q)} * {at('a', 2)};"
                for n, k, m, q in ((0, 0, 3, 4), (1, 3, 1, 5), (2, 4, 5, 2))
            )
            + "return r;"
        )
    )
    def apply6(s: S, a: V) -> V: ...

    @wp.func_native(
        native(
            f"{mat6} o; {each} {{ const {rn} a = s.data[0][k], b = s.data[1][k], c = s.data[2][k], d = s.data[3][k],"
            " e = s.data[4][k], f = s.data[5][k];"
            f" const {rn} xx = b * c - f * f, xy = e * f - d * c, xz = d * f - e * b;"
            f" const {rn} det = a * xx + d * xy + e * xz; const {rn} r = det > ({rn})0 ? ({rn})1 / det : ({rn})0;"
            " o.data[0][k] = r * xx; o.data[1][k] = r * (a * c - e * e); o.data[2][k] = r * (a * b - d * d);"
            " o.data[3][k] = r * xy; o.data[4][k] = r * xz; o.data[5][k] = r * (d * e - a * f); } return o;"
        )
    )
    def inverse6(s: S) -> S: ...

    names = dict(locals())
    return SimpleNamespace(**{name: word for name, word in names.items() if name in WORDS})
