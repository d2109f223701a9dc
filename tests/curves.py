"""Curves for tests: shapes, materials, deformed states, and the discrete energy of design 1.3 written in NumPy.

The oracle knows nothing of the kernels: no slopes, no levers, no elimination of angles. Its energy is the formula of
the design with the angles as arguments, so that derivatives can be taken by complex steps, exact to round-off; the
angles of least energy are found by SciPy.
"""

from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.optimize import minimize
from surfaces import turned

from warpdeform.forces.curve_elasticity import CurveElasticity
from warpdeform.grid import Layout, ParameterGrid
from warpdeform.material import Material
from warpdeform.section import Section

Array = NDArray[Any]

RUBBER = Material(density=1000.0, youngs_modulus=1e6, poisson_ratio=0.3)
STRING = Material(linear_density=0.1, axial_stiffness=50.0)
ROD = Material(linear_density=0.1, axial_stiffness=50.0, bending_stiffness=0.4)
PAPER = Material(linear_density=0.1, eta=20.0, xi=0.3)
ROUND, FLAT = Section.circular(0.1), Section.rectangular(0.3, 0.1)


def line(nodes: int, strands: int) -> Array:
    """Straight strands of unequal lengths, their segments of one length, each in its own direction."""
    ends = np.random.default_rng(4).normal(0.0, 0.4, (strands, 3)) + [1.0, 0.0, 0.0]
    return np.linspace(0, 1, nodes)[:, None, None] * ends + np.arange(strands)[:, None] * [0.0, 0.3, 0.0]


def uneven(nodes: int, strands: int) -> Array:
    """Straight strands whose segments differ in length."""
    along = np.cumsum(np.random.default_rng(5).uniform(0.5, 1.5, (nodes, strands)), axis=0) / nodes
    return along[..., None] * [1.0, 0.0, 0.0] + np.arange(strands)[:, None] * [0.0, 0.3, 0.0]


def helix(nodes: int, strands: int) -> Array:
    """Helices of different radii: natural curvature everywhere, and torsion."""
    phase = np.linspace(0, 5, nodes)[:, None] + 0.3 * np.arange(strands)
    radius = 0.3 + 0.1 * np.arange(strands)
    return np.stack([radius * np.cos(phase), radius * np.sin(phase), 0.15 * phase], axis=-1)


def ring(nodes: int, strands: int) -> Array:
    """Closed ellipses, bent out of their planes."""
    phase = 2 * np.pi * np.arange(nodes)[:, None] / nodes + 0.3 * np.arange(strands)
    return np.stack([0.5 * np.cos(phase), 0.4 * np.sin(phase), 0.1 * np.sin(2 * phase)], axis=-1)


SHAPES: dict[str, Callable[[int, int], Array]] = {"line": line, "uneven": uneven, "helix": helix, "ring": ring}


@dataclass(frozen=True)
class Case:
    """A curve body.

    Attributes:
        shape: Name of its rest shape.
        material: Its material.
        options: Arguments of the term by keyword.
    """

    shape: str
    material: Material
    options: dict[str, Any]


CASES = {
    "string": Case("line", STRING, {}),
    "loop of string": Case("ring", STRING, {}),
    "rod": Case("line", ROD, {}),
    "uneven rod": Case("uneven", RUBBER, {"section": ROUND}),
    "paper": Case("uneven", PAPER, {}),
    "ribbon": Case("uneven", RUBBER, {"section": FLAT, "director": (0.0, 0.3, 1.0)}),
    "helix": Case("helix", RUBBER, {"section": ROUND}),
    "helical ribbon": Case("helix", RUBBER, {"section": FLAT}),
    "ring": Case("ring", RUBBER, {"section": FLAT}),
    "twistable": Case("line", ROD, {"framed": True}),
}
CLOSED = ("loop of string", "ring")


def spacing(rest: Array) -> float:
    """Mean length of the segments."""
    return float(np.linalg.norm(np.diff(rest, axis=0), axis=-1).mean())


def noise(rest: Array, size: float, seed: int = 1) -> Array:
    return np.random.default_rng(seed).normal(0.0, size * spacing(rest), rest.shape)


def crumpled(rest: Array) -> Array:
    """Every node displaced by a fifth of the spacing."""
    return rest + noise(rest, 0.2)


def stretched(rest: Array) -> Array:
    """Longer by 40 % one way, shorter by 20 % the other, sheared, turned, and not quite even."""
    F = np.array([[1.4, 0.25, 0.0], [0.1, 0.8, 0.0], [0.2, 0.0, 1.1]])
    return turned(rest @ F.T, (1, 2, 3), 0.7) + noise(rest, 0.03)


STATES: dict[str, Callable[[Array], Array]] = {"crumpled": crumpled, "stretched": stretched}


class Curve:
    """The elastic term of one curve body, with NumPy arrays of shape (n, strands, ...) going in and coming out."""

    def __init__(
        self, rest: Array, material: Material, real: Any = wp.float64, lane_width: int = 1, *, closed: bool = False,
        **options: Any,
    ) -> None:  # fmt: skip
        self.real, self.nodes, self.rest, self.closed = real, rest.shape[:2], rest, closed
        self.layout = Layout(self.nodes, lane_width, (closed, False))
        segments = self.nodes[0] - (not closed)
        self.grid = ParameterGrid(self.nodes, (1.0 / segments, 1.0), (closed, False), 1)
        self.force = CurveElasticity(self.grid, self.layout, rest, material, real, "cpu", **options)

    @staticmethod
    def of(name: str, nodes: tuple[int, int], real: Any = wp.float64, lane_width: int = 1) -> "Curve":
        """The case of that name."""
        case = CASES[name]
        rest = SHAPES[case.shape](*nodes)
        return Curve(rest, case.material, real, lane_width, closed=name in CLOSED, **case.options)

    def upload(self, values: Array) -> wp.array:
        return wp.array(self.layout.pack(values), dtype=self.real, device="cpu")

    def download(self, array: wp.array) -> Array:
        return self.layout.unpack(array.numpy())

    def poison(self) -> None:
        """Not a number in everything that a linearisation writes: what is read before it was written shows."""
        force, frames = self.force, self.force.frames
        arrays = [force.stretch, force.flux] + ([force.slopes] if force.stiffness.strains else [])
        if frames is not None:
            arrays += [frames._u, frames.lever, frames._joint, *frames._newton, frames._trial_angle]
            arrays += [frames.spins, frames._chain, frames.turn]
        # Where an open curve has no segment any more everything is zero and stays so.
        inside = self.layout.pack(np.ones((self.nodes[0] - (not self.closed), self.nodes[1])))[0] > 0
        for array in arrays:
            values = array.numpy().copy()
            values[:, inside] = np.nan
            array.assign(values)

    def energy(self, z: Array) -> float:
        partials = wp.zeros((self.layout.rows, self.layout.columns), dtype=wp.float64, device="cpu")
        self.force.add_energy(None, self.upload(z), partials)
        return float(partials.numpy().sum())

    def linearise(self, z: Array) -> None:
        self.poison()
        self._position = self.upload(z)
        self.force.linearise(None, self._position)

    def gradient(self, z: Array) -> Array:
        self.linearise(z)
        out = self.upload(np.zeros_like(z))
        self.force.add_gradient(None, self._position, out)
        return self.download(out)

    def product(self, p: Array) -> Array:
        """Hessian at the last linearised state times p."""
        out = self.upload(np.zeros_like(p))
        self.force.add_hessian_product(None, self.upload(p), out)
        return self.download(out)

    def blocks(self) -> Array:
        """Diagonal blocks at the last linearised state, shape (n, strands, 3, 3)."""
        out = self.upload(np.zeros((*self.nodes, 6)))
        self.force.add_block_diagonal(None, out)
        return self.download(out)[..., [0, 3, 4, 3, 1, 5, 4, 5, 2]].reshape(*self.nodes, 3, 3)

    def hessian(self) -> Array:
        """The Hessian at the last linearised state, dense, shape (3 n strands, 3 n strands)."""
        columns = [self.product(p.reshape(*self.nodes, 3)).ravel() for p in np.eye(3 * np.prod(self.nodes))]
        return np.array(columns).T

    def design(self) -> "DesignEnergy":
        """The oracle for the same curve, its frames as they start."""
        frames = self.force.frames
        return DesignEnergy(self, None if frames is None else (frames.start.tangents, frames.start.directors))


def dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=-1))


def length(a: Array) -> Array:
    return np.asarray(np.sqrt(dot(a, a)))


def transport(d: Array, t0: Array, t1: Array) -> Array:
    """d turned about t0 x t1 by the angle between the unit vectors t0 and t1: Rodrigues' formula."""
    axis, cosine = np.cross(t0, t1), dot(t0, t1)[..., None]
    return np.asarray(cosine * d + np.cross(axis, d) + axis * (dot(axis, d)[..., None] / (1 + cosine)))


class DesignEnergy:
    """Design 1.3 for one curve body: stretch, and bending and twist where the kernels claim to have them.

    Args:
        curve: The curve.
        frames: Tangents and first directors from which the frames start; None without frames.
    """

    def __init__(self, curve: Curve, frames: tuple[Array, Array] | None) -> None:
        self.closed, self.rest, self.frames = curve.closed, curve.rest, frames
        stiffness = curve.force.stiffness
        self.axial, self.weights = stiffness.axial**2, stiffness.bending**2
        if frames is not None:
            self.natural = np.zeros((*self.rest.shape[:2], 3))
            self.natural = self.strains(self.rest, np.zeros(self.axial.shape))

    def edges(self, z: Array) -> Array:
        return np.diff(np.concatenate([z, z[:1]]) if self.closed else z, axis=0)

    def pairs(self, values: Array) -> tuple[Array, Array]:
        """What of the segments before and behind each node that has both."""
        return (np.roll(values, 1, axis=0), values) if self.closed else (values[:-1], values[1:])

    def inner(self, values: Array) -> Array:
        return values if self.closed else values[1:-1]

    def binormal(self, z: Array) -> Array:
        a, b = self.pairs(self.edges(z))
        fold = 1e-6
        return np.asarray(2 * np.cross(a, b) / ((1 + fold) * length(a) * length(b) + dot(a, b))[..., None])

    def strains(self, z: Array, angle: Array) -> Array:
        """kappa_1, kappa_2 and the twist of the inner nodes."""
        tangents, directors = self.frames
        e = self.edges(z)
        t = e / length(e)[..., None]
        u = transport(directors, tangents, t)
        c, s = np.cos(angle)[..., None], np.sin(angle)[..., None]
        director = c * u + s * np.cross(t, u)
        (ta, tb), (ua, ub), (angle_a, angle_b) = self.pairs(t), self.pairs(u), self.pairs(angle)
        carried = transport(ua, ta, tb)
        turning = 2 * np.arctan(dot(np.cross(carried, ub), tb) / (1 + dot(carried, ub)))
        twist = angle_b - angle_a + turning
        da, _ = self.pairs(director)
        # Half way from one edge to the other; kb is normal to both, so that it does not matter about which to turn.
        c, s = np.cos(twist / 2)[..., None], np.sin(twist / 2)[..., None]
        n1 = c * da + s * np.cross(ta, da)
        kb = self.binormal(z)
        return np.stack([dot(kb, n1), dot(kb, np.cross(ta, n1)), twist], axis=-1)

    def energy(self, z: Array, angle: Array | None = None) -> Any:
        g, g0 = (dot(e, e) for e in (self.edges(z), self.edges(self.rest)))
        total = np.sum(self.axial * (g - g0) ** 2) / 8
        if self.weights.shape[-1] == 1:
            kb = self.binormal(z)
            total = total + np.sum(self.inner(self.weights)[..., 0] * dot(kb, kb)) / 2
        if self.weights.shape[-1] == 3:
            change = self.strains(z, angle) - self.natural
            total = total + np.sum(self.inner(self.weights) * change**2) / 2
        return total

    def settled(self, z: Array, held: Array | None = None, angle: Array | None = None) -> Array | None:
        """The angles of least energy, from those given; those of held segments stay."""
        if self.frames is None:
            return None
        start = np.zeros(self.axial.shape) if angle is None else angle.copy()
        free = np.ones(start.shape, dtype=bool) if held is None else ~held

        def value(x: Array) -> tuple[float, Array]:
            start[free] = x
            slopes = [self.slope(z, 0 * z, start, e.reshape(start.shape)) for e in np.eye(start.size)]
            return float(self.energy(z, start)), np.array(slopes).reshape(start.shape)[free]

        for _ in range(3):
            found = minimize(value, start[free], jac=True, method="BFGS", options={"gtol": 1e-11})
            start[free] = found.x
        return start

    def slope(self, z: Array, p: Array, angle: Array | None, turn: Array | None = None) -> float:
        """Derivative of the energy along p and a turn of the angles, by a complex step."""
        h = 1e-30
        if angle is not None:
            angle = angle + 1j * h * (0.0 if turn is None else turn)
        return float(self.energy(z + 1j * h * p, angle).imag / h)

    def weighted(self, z: Array, angle: Array | None) -> Array:
        """All strains as numbers whose squares are twice their energies; kb without what turns it lengthwise."""
        g, g0 = (dot(e, e) for e in (self.edges(z), self.edges(self.rest)))
        numbers = [np.sqrt(self.axial) * (g - g0) / 2]
        if self.weights.shape[-1] == 1:
            e = self.edges(z.real)
            a, b = self.pairs(e / length(e)[..., None])
            tangent = (a + b) / length(a + b)[..., None]
            kb = self.binormal(z)
            numbers.append(np.sqrt(self.inner(self.weights)) * (kb - dot(kb, tangent)[..., None] * tangent))
        if self.weights.shape[-1] == 3:
            numbers.append(np.sqrt(self.inner(self.weights)) * (self.strains(z, angle) - self.natural))
        return np.concatenate([x.ravel() for x in numbers])

    def projected_hessian(self, z: Array, angle: Array | None, held: Array | None = None) -> Array:
        """Gauss-Newton's Hessian of positions and angles with the free angles eliminated, and clipped tensions."""
        h = 1e-30
        J = np.array([self.weighted(z + 1j * h * p.reshape(z.shape), angle).imag / h for p in np.eye(z.size)])
        H = J @ J.T
        if angle is not None:
            free = np.flatnonzero(~held.ravel() if held is not None else np.ones(angle.size, dtype=bool))
            turns = np.eye(angle.size)[free].reshape(-1, *angle.shape)
            K = np.array([self.weighted(z + 0j, angle + 1j * h * turn).imag / h for turn in turns])
            if len(K):
                H = H - (J @ K.T) @ np.linalg.pinv(K @ K.T, rcond=1e-11) @ (J @ K.T).T
        g, g0 = (dot(e, e) for e in (self.edges(z), self.edges(self.rest)))
        tension = np.maximum(self.axial * (g - g0) / 2, 0)
        index = np.arange(z.size).reshape(z.shape)
        for i, strand in np.ndindex(tension.shape):
            ends = index[[i, (i + 1) % len(z)], strand]
            for c in range(3):
                H[np.ix_(ends[:, c], ends[:, c])] += tension[i, strand] * np.array([[1, -1], [-1, 1]])
        return H

    def gradient(self, z: Array, angle: Array | None) -> Array:
        return np.array([self.slope(z, p.reshape(z.shape), angle) for p in np.eye(z.size)]).reshape(z.shape)


class FakeModel:
    """What solvers ask of a model, for a curve body that no body describes yet.

    Attributes are those of :class:`warpdeform.model.Model`.
    """

    def __init__(self, curve: Curve, mass: Array, pinned: Array, positions: Array | None = None) -> None:
        self.curve, self.grid, self.layout, self.real = curve, curve.grid, curve.layout, curve.real
        self.lane_width, self.device = curve.layout.lane_width, wp.get_device("cpu")
        self.node_mass, self.initial_positions = mass, curve.rest if positions is None else positions
        self.lengths = (spacing(curve.rest), 1.0)
        self.spacing = float(segment_lengths(curve).min())
        self.has_pins = bool(pinned.any())
        self.mass = curve.upload(mass)
        self.free = curve.upload(~pinned)
        self.target = curve.upload(self.initial_positions * pinned[..., None])
        self.pins_move = False
        self.body = SimpleNamespace(velocity=np.zeros(3))

    def zeros(self, components: int) -> wp.array:
        return wp.zeros((components, self.layout.rows, self.layout.columns), dtype=self.real, device=self.device)

    def download(self, array: wp.array) -> Array:
        return self.curve.download(array)

    def place_targets(self, time: float) -> bool:
        """Pins stay where they are, and none lets go."""
        return False

    def move_targets(self, time: float) -> None:
        """Pins stay where they are."""


def segment_lengths(curve: Curve) -> Array:
    """Rest lengths of the segments, shape (segments, strands)."""
    rest = np.concatenate([curve.rest, curve.rest[:1]]) if curve.closed else curve.rest
    return np.asarray(np.linalg.norm(np.diff(rest, axis=0), axis=-1))
