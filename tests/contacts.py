"""Bodies that feel each other for tests, and what their pairs should be, from the definitions and in NumPy."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

import warpdeform as wd
from warpdeform.crossings import point_distances, segment_distances
from warpdeform.forces.contact import ContactSystem, Touching
from warpdeform.forces.contact_mesh import Surface
from warpdeform.model import Model
from warpdeform.obstacle import field_constants
from warpdeform.simplices import Simplices
from warpdeform.state import State

Array = NDArray[Any]

CLOTH = wd.Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-4)
GAP = 0.012
CPU = wp.get_device("cpu")


def touching(a: int, b: int, gap: float = GAP, offset: float = 0.0, friction: float = 0.0) -> Touching:
    """Bodies that stop 2 m/s and rest at a gap [m]."""
    constants = field_constants(2.0, gap, 9.81)
    cutoff = gap + 4.0 * constants.range
    return Touching((a, b), constants.design_speed, constants.range, cutoff, gap, offset, friction)


class Scene:
    """Bodies, their states and what they share; positions are given and taken by body.

    Args:
        shapes: Rest shapes.
        pairs: Which bodies feel each other; by default each itself and every other.
        precision: "float64" or "float32".
        lane_width: Nodes per lane group; None takes what suits the CPU.
        pins: Nodes of the first body that are held.
        offset: Distance of the middle surfaces at which the skins touch [m].
        friction: Coefficient.
    """

    def __init__(
        self,
        shapes: Sequence[wd.RestShape],
        pairs: Sequence[Touching] | None = None,
        precision: str = "float64",
        lane_width: int | None = None,
        pins: Sequence[Any] = (),
        offset: float = 0.0,
        friction: float = 0.0,
    ) -> None:
        count = len(shapes)
        bodies = [
            wd.Body(f"body{k}", shape, CLOTH, pins=[wd.Pin(pin) for pin in pins] if k == 0 else ())
            for k, shape in enumerate(shapes)
        ]
        if pairs is None:
            pairs = [touching(a, b, offset=offset, friction=friction) for a in range(count) for b in range(a, count)]
        self.iteration: wp.array = wp.zeros(1, dtype=wp.int32, device=CPU)
        self.models = [Model(body, precision, CPU, lane_width) for body in bodies]
        self.states = [State(model, self.iteration) for model in self.models]
        surfaces = [Surface(model.grid, model.body.shape.positions, model.spacing) for model in self.models]
        self.system = ContactSystem(self.states, surfaces, [model.node_mass for model in self.models], pairs)
        self.simplices = Simplices.joined([Simplices.of_grid(model.grid) for model in self.models])

    def place(self, positions: Sequence[Array], vector: str = "z") -> None:
        for model, state, values in zip(self.models, self.states, positions, strict=True):
            getattr(state, vector).assign(model.layout.pack(values))

    def take(self, vector: str) -> list[Array]:
        pairs = zip(self.models, self.states, strict=True)
        return [model.download(getattr(state, vector)) for model, state in pairs]

    def begin(self, positions: Sequence[Array]) -> None:
        """Begin a step at some positions."""
        self.place(positions, "x")
        self.system.begin()

    def finish(self) -> None:
        self.system.finish()

    def linearise(self, positions: Sequence[Array]) -> None:
        self.place(positions)
        self.system.linearise("z")

    def energy(self, positions: Sequence[Array]) -> float:
        """Of the listed pairs at other positions."""
        self.place(positions, "trial")
        for state in self.states:
            state.partials.zero_()
        self.system.add_energy("trial")
        return sum(float(state.partials.numpy().sum()) for state in self.states)

    def gradient(self) -> Array:
        """Gradient at the positions of `linearise`, all bodies one after the other, shape (nodes, 3)."""
        for state in self.states:
            state.gradient.zero_()
        self.system.add_gradient("z", "gradient")
        return np.concatenate([each.reshape(-1, 3) for each in self.take("gradient")])

    def blocks(self) -> Array:
        """Diagonal blocks, shape (nodes, 3, 3)."""
        found = []
        for state, model in zip(self.states, self.models, strict=True):
            blocks = model.zeros(6)
            self.system.add_node_blocks(state, blocks)
            found.append(model.download(blocks).reshape(-1, 6))
        return np.concatenate(found)[:, [[0, 3, 4], [3, 1, 5], [4, 5, 2]]]

    def product(self, direction: Array) -> Array:
        """The whole Hessian times a vector, both of shape (nodes, 3)."""
        self.place(self.split(direction), "search")
        diagonal = np.einsum("nij,nj->ni", self.blocks(), direction)
        for state in self.states:
            state.product.zero_()
        self.system.add_hessian_product("search", "product")
        return diagonal + np.concatenate([each.reshape(-1, 3) for each in self.take("product")])

    def guard(self, positions: Sequence[Array], directions: Sequence[Array]) -> list[Array]:
        """What the guard makes of displacements."""
        self.place(positions)
        self.place(directions, "direction")
        self.system.begin()
        self.system.guard("z", "direction")
        return self.take("direction")

    def split(self, values: Array) -> list[Array]:
        """Values of all nodes, shape (nodes, 3), by body."""
        ends = np.cumsum([model.grid.node_count for model in self.models])[:-1]
        return [
            part.reshape(*model.grid.nodes, 3) for part, model in zip(np.split(values, ends), self.models, strict=True)
        ]

    def numbers(self) -> Array:
        """Number of the node in each slot, bodies one after the other; -1 in slots without one."""
        mesh, starts = self.system.slots.mesh, np.cumsum([0, *(m.grid.node_count for m in self.models)])
        numbers = np.full(mesh.slot_count, -1)
        for start, slots in zip(starts[:-1], mesh.slots, strict=True):
            shown = slots >= 0
            numbers[slots[shown]] = start + np.flatnonzero(shown)
        return numbers

    def pairs(self) -> tuple[set[tuple[int, ...]], set[tuple[int, ...]], set[tuple[int, ...]]]:
        """Listed pairs by node: point and triangle; edges that feel each other from afar, and only when close."""
        pairs = self.system.list
        numbers, listed = self.numbers(), pairs.pairs.numpy()[: pairs.counts.numpy()[0]]
        points, far, close = set(), set(), set()
        for pair in listed:
            a, b, c, d = (int(numbers[pair[name]]) for name in "abcd")
            if not pair["edges"]:
                points.add((a, *sorted((b, c, d))))
            else:
                first, second = sorted([tuple(sorted((a, b))), tuple(sorted((c, d)))])
                (close if pair["close"] else far).add((*first, *second))
        return points, far, close


def wrinkled(nodes: tuple[int, int], seed: int = 0, height: float = 0.03) -> tuple[wd.RestShape, Array]:
    """A flat sheet, and positions of it with wrinkles a few nodes wide."""
    shape = wd.sheet(nodes, (1.0, 1.0))
    rng = np.random.default_rng(seed)
    x = shape.positions.copy()
    for _ in range(4):
        wave = rng.normal(size=2) * 12.0
        x[..., 2] += height / 2 * np.sin(x[..., :2] @ wave + rng.uniform(0.0, 6.0))
    return shape, x


def folded(nodes: tuple[int, int], gap: float, seed: int = 0) -> tuple[wd.RestShape, Array]:
    """A sheet folded once around a half circle, its halves a wavering gap apart."""
    shape, x = wrinkled(nodes, seed, 0.2 * gap)
    u, radius = x[..., 0], 0.5 * gap
    middle, arc = 0.45, np.pi * radius
    angle = np.clip((u - middle) / radius, 0.0, np.pi)
    beyond = np.maximum(u - middle - arc, 0.0)
    folded = np.stack(
        [np.minimum(u, middle) + radius * np.sin(angle) - beyond, x[..., 1], radius * (1.0 - np.cos(angle))], axis=-1
    )
    folded[..., 2] += x[..., 2]
    folded[..., 1] += 0.3 * beyond
    return shape, folded


def expected_pairs(points: Array, simplices: Simplices, cutoff: float) -> set[tuple[int, ...]]:
    """Points and triangles that feel each other, by the definition: of a feature that all triangles see as closest."""
    triangles = simplices.triangles
    found = set()
    for node in np.unique(simplices.edges):
        p = np.broadcast_to(points[node], (len(triangles), 1, 3))
        own = (triangles == node).any(axis=1)
        distance = point_distances(p, points[triangles])
        for t in np.flatnonzero((distance < cutoff) & ~own):
            corners = triangles[t]
            feature = closest_feature(points[node], points[corners])
            around = [k for k, other in enumerate(triangles) if set(corners[feature]) <= set(other)]
            if t == min(around) and all(abs(distance[k] - distance[t]) < 1e-12 for k in around):
                found.add((int(node), *sorted(int(c) for c in corners)))
    return found


def closest_feature(p: Array, corners: Array) -> list[int]:
    """Corners of the smallest part of a triangle that holds the point closest to p."""
    distance = point_distances(p[None, None], corners[None])[0]
    for k in range(3):
        if abs(np.linalg.norm(p - corners[k]) - distance) < 1e-12:
            return [k]
    for k in range(3):
        pair = [k, (k + 1) % 3]
        if abs(segment_distances(np.array([[p, p]]), corners[pair][None])[0] - distance) < 1e-12:
            return pair
    return [0, 1, 2]


def strip(count: int) -> wd.RestShape:
    """A flat sheet of as many nodes each way, 1 m wide."""
    return wd.sheet((count, count), (1.0, 1.0))
