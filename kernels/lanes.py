"""The lane type: the words that kernels are written in, and every memory access they make.

A kernel body works on *lane groups*: ``width`` neighbouring nodes of a row, one after another along the last grid axis.
On CUDA the width is 1 and a lane group is a plain scalar or vec3; on the CPU it is 16 (float32) or 8 (float64) and a
group is a small matrix, on which LLVM vectorises every word below. The same kernel source serves both.

Names: ``read`` loads into float64 whatever the precision of the array is, ``write`` stores what was computed so; ``L``
is one real per lane, ``V`` a 3-vector per lane, ``S`` a symmetric 3 x 3 block per lane, stored as
(xx, yy, zz, xy, xz, yz). Arrays are component arrays ``[component, row, column]`` with a halo of one row and
``halo`` columns on every side, so that no kernel has a border test (2-solver design, kernels over lanes).
"""

import functools
import platform
from types import SimpleNamespace
from typing import Any

import warp as wp

WORDS = frozenset(
    "L V S load1 load3 load6 pick1 pick3 store1 store3 store6 read1 read3 read6 write3 splat mul div root at_least "
    "larger exceeds above sum_lanes max_lanes dot3 cross3 normal3 scale scale6 vector outer symmetric isotropic apply6 "
    "inverse6".split()
)
NATIVE = {wp.float32: "float", wp.float64: "double"}


def kernel_module(name: str, width: int, real: Any) -> Any:
    """The Warp module that holds the kernels `name` for one lane width and precision.

    Modules are separate so that only what a scene requires is compiled, and none keeps adjoint code. Warp's compiler
    aligns the CPU's stack to 16 bytes; aligned anew, 32-byte spills do not straddle cache lines (products 1.1 to 1.3
    times as fast). Left to itself it also splits a vector of 512 bits in two where the CPU has such registers (products
    1.4 to 1.5 times as fast with them).
    """
    module = wp.get_module(f"warpdeform_{name}_{real.__name__}_{width}")
    options: dict[str, Any] = {"enable_backward": False}
    if platform.machine() in ("x86_64", "AMD64"):
        options["cpu_compiler_flags"] = f"{wp.config.cpu_compiler_flags} -mstackrealign -mprefer-vector-width=512"
    module.options.update(options)
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

    @wp.func
    def spread3(a: wp.array3d(dtype=real), c: int, i: int, j: int):
        """The vector at one place, in every lane."""
        return words.vector(words.splat(a[c, i, j]), words.splat(a[c + 1, i, j]), words.splat(a[c + 2, i, j]))

    words.add1, words.add3, words.add6, words.along_u, words.spread3 = add1, add3, add6, along_u, spread3
    words.width, words.real = width, real
    vars(words).update(vars(_scalar_comparisons(real) if width == 1 else _wide_comparisons(width, real)))
    return words


def _scalar_words(real: Any) -> SimpleNamespace:
    L = real
    V = wp.types.vector(3, real)
    S = wp.types.vector(6, real)
    D, D6 = wp.types.vector(3, wp.float64), wp.types.vector(6, wp.float64)

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
    def pick1(a: wp.array3d(dtype=real), c: int, i: int, columns: wp.array2d(dtype=wp.int32), t: int, j: int):
        """Component c of row i at the columns that row t of a table names for the lane group."""
        return a[c, i, columns[t, j]]

    @wp.func
    def pick3(a: wp.array3d(dtype=real), c: int, i: int, columns: wp.array2d(dtype=wp.int32), t: int, j: int):
        k = columns[t, j]
        return V(a[c, i, k], a[c + 1, i, k], a[c + 2, i, k])

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
    def read1(a: wp.array3d(dtype=real), c: int, i: int, j: int):
        return wp.float64(a[c, i, j])

    @wp.func
    def read3(a: wp.array3d(dtype=real), c: int, i: int, j: int):
        return D(wp.float64(a[c, i, j]), wp.float64(a[c + 1, i, j]), wp.float64(a[c + 2, i, j]))

    @wp.func
    def read6(a: wp.array3d(dtype=real), c: int, i: int, j: int):
        return D6(
            wp.float64(a[c, i, j]), wp.float64(a[c + 1, i, j]), wp.float64(a[c + 2, i, j]),
            wp.float64(a[c + 3, i, j]), wp.float64(a[c + 4, i, j]), wp.float64(a[c + 5, i, j]),
        )  # fmt: skip

    @wp.func
    def write3(a: wp.array3d(dtype=real), c: int, i: int, j: int, v: D):
        a[c, i, j] = real(v[0])
        a[c + 1, i, j] = real(v[1])
        a[c + 2, i, j] = real(v[2])

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
    def larger(a: real, b: real):
        return wp.max(a, b)

    @wp.func
    def exceeds(a: real, limit: real):
        """1 where a is greater than the limit, 0 elsewhere."""
        return wp.where(a > limit, real(1.0), real(0.0))

    @wp.func
    def above(a: real, floor: real, x: real, y: real):
        """x where a is above the floor, else y, also where a is not a number."""
        return wp.where(a > floor, x, y)

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
    def normal3(t: V):
        """A unit vector normal to the unit vector t (Duff et al., Building an Orthonormal Basis, Revisited, 2017)."""
        sign = wp.where(t[2] < real(0.0), real(-1.0), real(1.0))
        f = real(-1.0) / (sign + t[2])
        return V(real(1.0) + sign * t[0] * t[0] * f, sign * t[0] * t[1] * f, -sign * t[0])

    @wp.func
    def scale(s: real, a: V):
        return V(s * a[0], s * a[1], s * a[2])

    @wp.func
    def vector(x: real, y: real, z: real):
        return V(x, y, z)

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

    return _chosen(locals())


def _wide_words(width: int, real: Any) -> SimpleNamespace:
    """The words over `width` lanes, in Clang's vector types: left to itself LLVM vectorises only some of the loops.

    In the snippets ``lv`` is a vector of lanes in memory, ``row(x, k)`` component k of a V or S, ``one(x)`` an L.
    """
    rn, size = NATIVE[real], width * (4 if real == wp.float32 else 8)
    L = wp.types.vector(width, real)
    V = wp.types.matrix((3, width), real)
    S = wp.types.matrix((6, width), real)
    vec, mat3, mat6 = f"wp::vec_t<{width}, {rn}>", f"wp::mat_t<3, {width}, {rn}>", f"wp::mat_t<6, {width}, {rn}>"
    lane_vector = f"typedef {rn} lv __attribute__((vector_size({size}), aligned({size // width}), may_alias)); "
    each = f"for (int k = 0; k < {width}; ++k)"

    def row(name: str, k: int) -> str:
        return f"(*(lv*)&{name}.data[{k}][0])"

    def one(name: str) -> str:
        return f"(*(lv*)&{name}.c[0])"

    def place(k: int) -> str:
        return f"(*(lv*)&wp::index(a, c0 + {k}, i, j))"

    def lane(expression: str) -> str:
        """Code of a word that gives an L."""
        return f"{lane_vector}{vec} r; {one('r')} = {expression}; return r;"

    def lane_by_lane(expression: str) -> str:
        """The same, lane k by lane k."""
        return f"{vec} r; {each} r.c[k] = {expression}; return r;"

    def rows(result: str, *expressions: str) -> str:
        """Code of a word that gives a V or S, one expression for each of its rows."""
        body = "".join(f"{row('r', k)} = {expression}; " for k, expression in enumerate(expressions))
        return f"{lane_vector}{result} r; {body}return r;"

    def store(n: int) -> str:
        return lane_vector + "".join(f"{place(k)} = {row('v', k)}; " for k in range(n))

    def pick_row(member: str, k: int) -> str:
        """Code that picks the lanes of a row of the result out of component c0 + k."""
        start = f"const {rn}* row = &wp::index(a, c0 + {k}, i, 0); const int* column = &wp::index(columns, t, j);"
        return f"{{ {start} {each} r.{member}[k] = row[column[k]]; }} "

    dv = f"double __attribute__((vector_size({8 * width}), aligned(8), may_alias))"

    def as_double(target: str, lanes_of: str) -> str:
        """Code that converts a vector of lanes into double precision, in memory."""
        return f"{{ typedef {dv} dv; *(dv*)&{target} = __builtin_convertvector({lanes_of}, dv); }} "

    def read_rows(n: int) -> str:
        """Code that loads n components as doubles."""
        rows = "".join(as_double(f"r.data[{k}][0]", place(k)) for k in range(n))
        return f"{lane_vector}wp::mat_t<{n}, {width}, double> r; {rows}return r;"

    def as_real(source: str) -> str:
        """The lanes of a vector of doubles in memory as an expression."""
        return f"__builtin_convertvector(*(dv*)&{source}, lv)"

    def products(k: int, m: int) -> str:
        return f"{row('a', k)} * {row('b', m)}"

    def mixed(k: int, m: int) -> str:
        """An off-diagonal entry of the symmetric part of a b'."""
        return f"({rn})0.5 * ({products(k, m)} + {products(m, k)})"

    @wp.func_native(lane(place(0)))
    def load1(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> L: ...

    @wp.func_native(rows(mat3, *(place(k) for k in range(3))))
    def load3(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> V: ...

    @wp.func_native(rows(mat6, *(place(k) for k in range(6))))
    def load6(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> S: ...

    @wp.func_native(f"{vec} r; {pick_row('c', 0)}return r;")
    def pick1(a: wp.array3d(dtype=real), c0: int, i: int, columns: wp.array2d(dtype=wp.int32), t: int, j: int) -> L: ...

    @wp.func_native(f"{mat3} r; {''.join(pick_row(f'data[{k}]', k) for k in range(3))}return r;")
    def pick3(a: wp.array3d(dtype=real), c0: int, i: int, columns: wp.array2d(dtype=wp.int32), t: int, j: int) -> V: ...

    @wp.func_native(f"{lane_vector}{place(0)} = {one('v')};")
    def store1(a: wp.array3d(dtype=real), c0: int, i: int, j: int, v: L): ...

    @wp.func_native(store(3))
    def store3(a: wp.array3d(dtype=real), c0: int, i: int, j: int, v: V): ...

    @wp.func_native(store(6))
    def store6(a: wp.array3d(dtype=real), c0: int, i: int, j: int, v: S): ...

    @wp.func_native(f"{lane_vector}wp::vec_t<{width}, double> r; {as_double('r.c[0]', place(0))}return r;")
    def read1(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> wp.types.vector(width, wp.float64): ...

    @wp.func_native(read_rows(3))
    def read3(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> wp.types.matrix((3, width), wp.float64): ...

    @wp.func_native(read_rows(6))
    def read6(a: wp.array3d(dtype=real), c0: int, i: int, j: int) -> wp.types.matrix((6, width), wp.float64): ...

    @wp.func_native(
        f"{lane_vector}typedef {dv} dv; " + "".join(f"{place(k)} = {as_real(f'v.data[{k}][0]')}; " for k in range(3))
    )
    def write3(a: wp.array3d(dtype=real), c0: int, i: int, j: int, v: wp.types.matrix((3, width), wp.float64)): ...

    @wp.func_native(lane_by_lane("x"))
    def splat(x: real) -> L: ...

    @wp.func_native(lane(f"{one('a')} * {one('b')}"))
    def mul(a: L, b: L) -> L: ...

    @wp.func_native(lane(f"{one('a')} / {one('b')}"))
    def div(a: L, b: L) -> L: ...

    @wp.func_native(lane(f"__builtin_elementwise_sqrt({one('a')})"))
    def root(a: L) -> L: ...

    @wp.func_native(lane_by_lane("a.c[k] > floor ? a.c[k] : floor"))
    def at_least(a: L, floor: real) -> L: ...

    @wp.func_native(lane_by_lane("a.c[k] > b.c[k] ? a.c[k] : b.c[k]"))
    def larger(a: L, b: L) -> L: ...

    @wp.func_native(lane_by_lane(f"a.c[k] > limit ? ({rn})1 : ({rn})0"))
    def exceeds(a: L, limit: real) -> L: ...

    @wp.func_native(lane_by_lane("a.c[k] > floor ? x.c[k] : y.c[k]"))
    def above(a: L, floor: real, x: L, y: L) -> L: ...

    # Pair by pair, always the same pairs: one after another the additions would wait for each other.
    @wp.func_native(
        f"double s[{width}]; {each} s[k] = (double)a.c[k]; "
        + "".join(f"for (int k = 0; k < {half}; ++k) s[k] += s[k + {half}]; " for half in _halves(width))
        + "return s[0];"
    )
    def sum_lanes(a: L) -> wp.float64: ...

    # A lane that is not a number wins and stays: no comparison with it holds.
    @wp.func_native(f"{rn} m = a.c[0]; {each} m = a.c[k] > m || a.c[k] != a.c[k] ? a.c[k] : m; return m;")
    def max_lanes(a: L) -> real: ...

    @wp.func_native(lane(f"{products(0, 0)} + {products(1, 1)} + {products(2, 2)}"))
    def dot3(a: V, b: V) -> L: ...

    @wp.func_native(rows(mat3, *(f"{products(k, m)} - {products(m, k)}" for k, m in ((1, 2), (2, 0), (0, 1)))))
    def cross3(a: V, b: V) -> V: ...

    @wp.func_native(
        f"{mat3} n; {each} {{ const {rn} x = t.data[0][k], y = t.data[1][k], z = t.data[2][k];"
        f" const {rn} sign = z < ({rn})0 ? ({rn})-1 : ({rn})1; const {rn} f = ({rn})-1 / (sign + z);"
        f" n.data[0][k] = ({rn})1 + sign * x * x * f; n.data[1][k] = sign * x * y * f; n.data[2][k] = -sign * x; }}"
        " return n;"
    )
    def normal3(t: V) -> V: ...

    @wp.func_native(rows(mat3, *(f"{one('s')} * {row('a', k)}" for k in range(3))))
    def scale(s: L, a: V) -> V: ...

    @wp.func_native(rows(mat3, one("x"), one("y"), one("z")))
    def vector(x: L, y: L, z: L) -> V: ...

    @wp.func_native(rows(mat6, *(f"{one('s')} * {row('a', k)}" for k in range(6))))
    def scale6(s: L, a: S) -> S: ...

    @wp.func_native(rows(mat6, *(products(k, k) for k in range(3)), mixed(0, 1), mixed(0, 2), mixed(1, 2)))
    def outer(a: V, b: V) -> S: ...

    @wp.func_native(
        rows(mat6, row("a", 0), row("b", 1), row("c", 2), row("a", 1), row("a", 2), row("b", 2)),
    )
    def symmetric(a: V, b: V, c: V) -> S: ...

    @wp.func_native(rows(mat6, *[one("s")] * 3, *["lv{}"] * 3))
    def isotropic(s: L) -> S: ...

    @wp.func_native(
        rows(
            mat3,
            *(
                f"{row('s', k)} * {row('a', 0)} + {row('s', m)} * {row('a', 1)} + {row('s', n)} * {row('a', 2)}"
                for k, m, n in ((0, 3, 4), (3, 1, 5), (4, 5, 2))
            ),
        )
    )
    def apply6(s: S, a: V) -> V: ...

    @wp.func_native(
        f"{mat6} o; {each} {{ const {rn} a = s.data[0][k], b = s.data[1][k], c = s.data[2][k], d = s.data[3][k],"
        " e = s.data[4][k], f = s.data[5][k];"
        f" const {rn} xx = b * c - f * f, xy = e * f - d * c, xz = d * f - e * b;"
        f" const {rn} det = a * xx + d * xy + e * xz; const {rn} r = det > ({rn})0 ? ({rn})1 / det : ({rn})0;"
        " o.data[0][k] = r * xx; o.data[1][k] = r * (a * c - e * e); o.data[2][k] = r * (a * b - d * d);"
        " o.data[3][k] = r * xy; o.data[4][k] = r * xz; o.data[5][k] = r * (d * e - a * f); } return o;"
    )
    def inverse6(s: S) -> S: ...

    return _chosen(locals())


def _halves(width: int) -> list[int]:
    """8, 4, 2, 1 for a width of 16."""
    return [width >> k for k in range(1, width.bit_length())]


def _chosen(names: dict[str, Any]) -> SimpleNamespace:
    """The words among the names of a function."""
    return SimpleNamespace(**{name: word for name, word in names.items() if name in WORDS})


COMPARISONS = frozenset("least most where1 where3 lane3 spread min_lanes below first_lane".split())
"""Words that search for contacts: which of two is smaller, which lanes are meant."""


def _scalar_comparisons(real: Any) -> SimpleNamespace:
    V = wp.types.vector(3, real)

    @wp.func
    def least(a: real, b: real):
        return wp.min(a, b)

    @wp.func
    def most(a: real, b: real):
        return wp.max(a, b)

    @wp.func
    def where1(c: real, a: real, b: real):
        """a where c > 0, else b."""
        return wp.where(c > real(0.0), a, b)

    @wp.func
    def where3(c: real, a: V, b: V):
        """a where c > 0, else b."""
        return wp.where(c > real(0.0), a, b)

    @wp.func
    def below(a: real, limit: real):
        """Which lanes are below a limit: bit k for lane k."""
        return wp.where(a < limit, 1, 0)

    @wp.func
    def first_lane(lanes_set: int):
        """The first of the lanes that a number of `below` has set; there must be one."""
        return 0

    @wp.func
    def lane3(a: V, k: int):
        """The vector in lane k."""
        return a

    @wp.func
    def spread(a: V):
        """One vector in every lane."""
        return a

    @wp.func
    def min_lanes(a: real):
        return a

    return SimpleNamespace(**{name: word for name, word in locals().items() if name in COMPARISONS})


def _wide_comparisons(width: int, real: Any) -> SimpleNamespace:
    rn, size = NATIVE[real], width * (4 if real == wp.float32 else 8)
    L, V, P = wp.types.vector(width, real), wp.types.matrix((3, width), real), wp.types.vector(3, real)
    vec, mat, each = f"wp::vec_t<{width}, {rn}>", f"wp::mat_t<3, {width}, {rn}>", f"for (int k = 0; k < {width}; ++k)"
    lv = f"typedef {rn} lv __attribute__((vector_size({size}), aligned({size // width}), may_alias)); "

    def one(name: str) -> str:
        return f"(*(lv*)&{name}.c[0])"

    def row(name: str, k: int) -> str:
        return f"(*(lv*)&{name}.data[{k}][0])"

    @wp.func_native(f"{lv}{vec} r; {one('r')} = __builtin_elementwise_min({one('a')}, {one('b')}); return r;")
    def least(a: L, b: L) -> L: ...

    @wp.func_native(f"{lv}{vec} r; {one('r')} = __builtin_elementwise_max({one('a')}, {one('b')}); return r;")
    def most(a: L, b: L) -> L: ...

    @wp.func_native(f"{lv}{vec} r; {one('r')} = {one('c')} > ({rn})0 ? {one('a')} : {one('b')}; return r;")
    def where1(c: L, a: L, b: L) -> L: ...

    @wp.func_native(
        f"{lv}{mat} r; "
        + "".join(f"{row('r', k)} = {one('c')} > ({rn})0 ? {row('a', k)} : {row('b', k)}; " for k in range(3))
        + "return r;"
    )
    def where3(c: L, a: V, b: V) -> V: ...

    bits = {8: "unsigned char", 16: "unsigned short"}[width]

    @wp.func_native(
        f"{lv}typedef bool bv __attribute__((ext_vector_type({width}))); {bits} set;"
        f" const bv b = __builtin_convertvector({one('a')} < limit, bv); __builtin_memcpy(&set, &b, sizeof(set));"
        " return (int)set;"
    )
    def below(a: L, limit: real) -> int: ...

    @wp.func_native("return __builtin_ctz((unsigned)lanes_set);")
    def first_lane(lanes_set: int) -> int: ...

    @wp.func_native(f"return wp::vec_t<3, {rn}>(a.data[0][k], a.data[1][k], a.data[2][k]);")
    def lane3(a: V, k: int) -> P: ...

    @wp.func_native(f"{mat} r; for (int c = 0; c < 3; ++c) {each} r.data[c][k] = a.c[c]; return r;")
    def spread(a: P) -> V: ...

    @wp.func_native(f"{rn} m = a.c[0]; {each} m = a.c[k] < m ? a.c[k] : m; return m;")
    def min_lanes(a: L) -> real: ...

    return SimpleNamespace(**{name: word for name, word in locals().items() if name in COMPARISONS})
