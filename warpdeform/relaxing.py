"""Starts whose skins are too near, moved apart before the simulation is built (host, double precision).

Pairs are points over triangles, and edges with the closest points of both, ends included: with x the nodes of a pair, b
their weights and n the way from one closest point to the other, its distance is d = n . sum b_i x_i. No pair of bodies
that feel each other is to be nearer than where its skins are a gap apart, nor, within a body, nearer than 0.9 of its
distance at rest (below that pairs feel each other). A sweep

1. finds all pairs that are nearer than `REACH` times what is asked for;
2. finds displacements u with n . sum b_i u_i >= (what is missing) for all of them, by projected Jacobi iterations that
   give node i  l b_i n / m_i : the smallest such displacements, measured by mass, as far as the iterations come;
3. cuts each node's displacement to `SHARE`, less than half, of the distance of the nearest thing that it, or a simplex
   that it belongs to, could meet: so nothing crosses on the way, whatever the directions.

The first sweeps move bodies as wholes, by a translation each, which strains nothing; they end when that no longer takes
half of the worst overlap away. Then single nodes move. Pinned nodes, nodes that follow another body and those that they
follow do not move, nor, as wholes, do bodies that have some. What crosses is not relaxed: a rule that finds out which
side a node belongs to would have to guess, and the guess could be wrong without anybody seeing it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpdeform.attachment import Attachment, find_all_ties
from warpdeform.body import Body
from warpdeform.contact import Contact, contact_pairs, spacing_of
from warpdeform.crossings import overlapping, point_distances, segment_distances
from warpdeform.errors import InputError, Mistake
from warpdeform.measure import node_measures
from warpdeform.near import Near, boxes, distinct, edges_between, points_over
from warpdeform.selectors import select_nodes
from warpdeform.skins import NAMED, Skins

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

REACH = 1.05
"""Distance up to which pairs are looked at, over the distance that they should have."""
SHARE = 0.45
"""Share of the distance of the nearest thing that a node moves in a sweep at most."""
ENOUGH = 0.9
"""Share of the gap that is enough: sweeps aim at all of it."""
KEPT = 0.05
"""Share of the gap that pairs are held to which do not ask to be relaxed, once they are near."""
REST_SHARE = 0.9
"""Share of the distance at rest beyond which two things of one body do not feel each other, as in the search."""
WHOLE_SWEEPS, SWEEPS = 40, 100
"""Most sweeps that move bodies as wholes, and nodes."""
PATIENCE = 10
"""Sweeps after which something must have become better."""
ROUNDS, WHOLE_ROUNDS = 60, 200
"""Most iterations for the displacements of a sweep: of nodes, and, one pair at a time, of wholes."""
OVERRELAXED = 1.5
"""Factor of the Jacobi iterations; below 2 they converge, since each pair is damped by all at its nodes."""
USEFUL = 0.5
"""Largest share of the worst overlap that translations may leave to be made."""


@dataclass(frozen=True)
class Relaxed:
    """What was done to a start.

    Attributes:
        largest: How far a node was moved at most [m].
        moved: Nodes that were moved, by the name of their body.
        sweeps: Sweeps that it took.
        missing: What skins still lack of what was to be reached at most [m]; 0 where all do.
    """

    largest: float = 0.0
    moved: tuple[tuple[str, int], ...] = ()
    sweeps: int = 0
    missing: float = 0.0

    @property
    def notes(self) -> tuple[str, ...]:
        """As sentences for people; none if there was nothing to do."""
        notes = []
        if self.moved:
            nodes = ", ".join(f"{count} nodes of {name}" for name, count in self.moved)
            notes.append(f"the start is relaxed: {nodes} moved, by {self.largest:.3g} m at most.")
        if self.missing > 0.0:
            notes.append(f"no skins overlap, but some stay up to {self.missing:.3g} m nearer than their gap.")
        return tuple(notes)


def relax_start(
    bodies: Sequence[Body], contacts: Sequence[Contact], attachments: Sequence[Attachment] = ()
) -> tuple[tuple[Body, ...], Relaxed | None]:
    """Bodies whose skins are nowhere nearer than their gap, where contacts ask for it.

    Args:
        bodies: All bodies.
        contacts: Pairs that are named; those with `relax` are moved apart, the others kept from overlapping.
        attachments: What ties bodies to each other.

    Returns:
        The bodies, with other initial positions where nodes were moved, the same objects elsewhere; what was done, None
        if no contact asks for it.

    Raises:
        InputError: Bodies that cross; skins that overlap of pairs that do not ask to be relaxed; skins that still
            overlap after all sweeps; and those of `contact_pairs` and of attachments.
    """
    if not any(contact.relax for contact in contacts):
        return tuple(bodies), None
    pairs = contact_pairs(bodies, contacts)
    taking = [body for body in bodies if any(body.name in pair.bodies for pair in pairs)]
    start = _Start(taking, pairs, _held_nodes(bodies, attachments))
    before = start.points.copy()
    start.skins.refuse_crossing(before)
    sweeps, missing = start.relax()
    distances = np.linalg.norm(start.points - before, axis=1)
    counts = np.bincount(start.skins.owner[distances > 0.0], minlength=len(taking))
    moved = {body.name: k for k, body in enumerate(taking) if counts[k]}
    done = tuple(
        replace(body, initial_positions=start.positions(moved[body.name])) if body.name in moved else body
        for body in bodies
    )
    numbers = tuple((name, int(counts[k])) for name, k in moved.items())
    return done, Relaxed(float(distances.max()), numbers, sweeps, missing)


def _held_nodes(bodies: Sequence[Body], attachments: Sequence[Attachment]) -> dict[str, NDArray[np.bool_]]:
    """Nodes that stay where they are, by the names of their bodies."""
    named = {body.name: body for body in bodies}
    held = {body.name: np.zeros(body.nodes, bool) for body in bodies}
    for body in bodies:
        for pin in body.pins:
            held[body.name][tuple(select_nodes(pin.nodes, body.nodes, body.kind).T)] = True
    for attachment, ties in zip(attachments, find_all_ties(attachments, named), strict=True):
        if attachment.stiffness is None:
            held[attachment.body][tuple(ties.nodes.T)] = True
            held[attachment.to][tuple(np.moveaxis(ties.points, -1, 0))] = True
    return held


class _Start:
    """Positions of all bodies that feel something, and what is asked of them.

    Args:
        bodies: The bodies.
        pairs: Which feel each other, and how.
        held: Nodes that may not move, by name of the body.
    """

    def __init__(self, bodies: Sequence[Body], pairs: Sequence[Contact], held: dict[str, NDArray[np.bool_]]) -> None:
        number = {body.name: k for k, body in enumerate(bodies)}
        named = [(number[pair.bodies[0]], number[pair.bodies[1]]) for pair in pairs]
        self.skins = Skins(bodies, named)
        self.points = self.skins.joined([body.placed_positions() for body in bodies])
        self._rest = self.skins.joined([body.shape.positions for body in bodies])
        masses = [node_measures(body.shape.grid, body.shape.positions, body.density) for body in bodies]
        inverse = [np.where(held[body.name], 0.0, 1.0 / mass) for body, mass in zip(bodies, masses, strict=True)]
        self._inverse = np.concatenate([each.reshape(-1) for each in inverse])
        self._inverse_wholes = np.array(
            [0.0 if held[body.name].any() else 1.0 / mass.sum() for body, mass in zip(bodies, masses, strict=True)]
        )
        self._aim, self._enough, self._touch = (np.zeros((len(bodies), len(bodies))) for _ in range(3))
        self._asked = np.zeros((len(bodies), len(bodies)), bool)
        spacings = [spacing_of(body) for body in bodies]
        for (a, b), pair in zip(named, pairs, strict=True):
            gap = pair.gap_at(min(spacings[a], spacings[b]))
            offset = 0.5 * (bodies[a].skin_thickness + bodies[b].skin_thickness)
            aim, enough = (1.0, ENOUGH) if pair.relax else (KEPT, 0.5 * KEPT)
            for i, j in ((a, b), (b, a)):
                self._aim[i, j], self._enough[i, j] = offset + aim * gap, offset + enough * gap
                self._touch[i, j], self._asked[i, j] = offset, pair.relax
        self._reach = REACH * float(self._aim.max())
        # How far each node may move [m], whatever the others do; and what other bodies leave it.
        self._room, self._room_as_wholes = np.zeros(0), np.zeros(0)

    def positions(self, body: int) -> Array:
        """Positions of a body, shape (*nodes, 3)."""
        return self.points[self.skins.owner == body].reshape(*self.skins.bodies[body].nodes, 3)

    def relax(self) -> tuple[int, float]:
        """Move nodes until everything is far enough apart.

        Returns:
            Sweeps that it took, and what is still missing at most [m].

        Raises:
            InputError: What overlaps that is not to be moved, or cannot be moved apart.
        """
        near = self._near()
        overlap = np.flatnonzero((near.distance < near.touch) & ~near.asked)
        if len(overlap):
            remedy = "Move them apart, make them thinner, or use relax = true for them too."
            raise InputError(Mistake("contact", None, f"{self._places(near, overlap)} at the start", remedy))
        sweeps = 0
        for most, find in ((WHOLE_SWEEPS, self._move_wholes), (SWEEPS, self._move_nodes)):
            worst: list[tuple[float, float]] = []
            while len(worst) < most:
                if (near.distance >= near.enough).all():
                    return sweeps, 0.0
                worst.append((float((near.enough - near.distance).max()), float(near.distance.min())))
                displacements = find(near)
                if displacements is None or _stalls(worst):
                    break
                self.points += displacements
                near, sweeps = self._near(), sweeps + 1
        overlap = np.flatnonzero(near.distance < near.touch)
        if len(overlap):
            problem = f"{self._places(near, overlap)} at the start, also after {sweeps} sweeps of moving them apart"
            remedy = "Move them apart, make them thinner, or let go of nodes that are held there."
            raise InputError(Mistake("contact.relax", True, problem, remedy))
        return sweeps, float((near.aim - near.distance).max())

    def _places(self, near: Near, overlap: Ints) -> str:
        """Which pairs overlap, the deepest first."""
        near = near.where(overlap)
        near = near.where(distinct(near))
        order = np.argsort(near.distance - near.touch, kind="stable")
        named = []
        for k in order[:NAMED]:
            first, second = (self.skins.place(side) for side in near.sides(int(k)))
            named.append(f"{first} and {second}, {near.distance[k]:.3g} m apart")
        rest = f" and {len(order) - NAMED} more pairs" if len(order) > NAMED else ""
        return f"{'; '.join(named)}{rest} overlap"

    # Displacements ----------------------------------------------------------------------------------------------------

    def _move_wholes(self, near: Near) -> Array | None:
        """A translation of each body that is not held anywhere; None if that does not help enough."""
        inverse, (a, b) = self._inverse_wholes, near.owners.T
        near = near.where((a != b) & (inverse[a] + inverse[b] > 0.0))
        missing, (a, b) = near.aim - near.distance, near.owners.T
        worst = float(np.max(missing, initial=0.0))
        if worst <= 0.0:
            return None
        moves = np.zeros((len(inverse), 3))
        for _ in range(WHOLE_ROUNDS):
            left = missing - np.einsum("kx,kx->k", near.normal, moves[a] - moves[b])
            k = int(np.argmax(left))
            if left[k] < 0.01 * worst:
                break
            push = left[k] / (inverse[a[k]] + inverse[b[k]]) * near.normal[k]
            moves[a[k]] += inverse[a[k]] * push
            moves[b[k]] -= inverse[b[k]] * push
        if left.max() > USEFUL * worst:
            return None
        # One factor for all, so that who moves by how much stays a matter of their masses.
        room = np.full(len(inverse), np.inf)
        np.minimum.at(room, self.skins.owner, self._room_as_wholes)
        length = np.linalg.norm(moves, axis=1)
        moves *= min(1.0, float(np.min(room / np.maximum(length, 1e-300))))
        return np.asarray(moves[self.skins.owner])

    def _move_nodes(self, near: Near) -> Array:
        """A displacement of each node."""
        near = near.where(distinct(near))
        nodes, local = np.unique(near.vertices, return_inverse=True)
        v, w, n = local.reshape(-1, 4), near.weights, near.normal
        pull = self._inverse[near.vertices] * w
        strength = pull * w
        missing = near.aim - near.distance
        worst = float(missing.max())
        impulses, moves = np.zeros(len(n)), np.zeros((len(nodes), 3))
        for _ in range(ROUNDS):
            left = missing - np.einsum("kv,kvx,kx->k", w, moves[v], n)
            acting = (left > 0.0) | (impulses > 0.0)
            if left.max() < 0.01 * worst:
                break
            counts = np.bincount(v[acting].reshape(-1), (w[acting] != 0.0).reshape(-1), len(nodes))
            damping = np.einsum("kv,kv->k", strength, counts[v])
            acting &= damping > 0.0
            wanted = impulses + OVERRELAXED * left / np.where(acting, damping, 1.0)
            change = np.where(acting, np.maximum(wanted, 0.0) - impulses, 0.0)
            impulses += change
            given = (pull * change[:, None])[..., None] * n[:, None]
            for axis in range(3):
                moves[:, axis] += np.bincount(v.reshape(-1), given[..., axis].reshape(-1), len(nodes))
        length = np.linalg.norm(moves, axis=1)
        moves *= np.minimum(1.0, self._room[nodes] / np.maximum(length, 1e-300))[:, None]
        found = np.zeros_like(self.points)
        found[nodes] = moves
        return found

    # Pairs ------------------------------------------------------------------------------------------------------------

    def _near(self) -> Near:
        """All pairs of bodies that feel each other, as near as asked for or nearer; notes the room of nodes."""
        simplices, p, rest = self.skins.simplices, self.points, self._rest
        used, edges, triangles = np.unique(simplices.edges)[:, None], simplices.edges, simplices.triangles
        searches: tuple[tuple[Ints, Ints, Callable[..., tuple[Array, Array]], Callable[..., Array]], ...] = (
            (used, triangles, points_over, point_distances),
            (edges, edges, edges_between, segment_distances),
        )
        self._room, self._room_as_wholes = (np.full(len(p), SHARE * self._reach) for _ in range(2))
        parts = []
        for own, others, measure, rest_distances in searches:
            between_edges = own is others
            for i, j in overlapping(boxes(p, own), boxes(p, others), self._reach):
                if between_edges:
                    i, j = i[i < j], j[i < j]
                felt = self.skins.feels[self.skins.owner[own[i, 0]], self.skins.owner[others[j, 0]]]
                felt &= ~simplices.shares_vertex(own[i], others[j])
                first, second = own[i[felt]], others[j[felt]]
                r, weights = measure(p[first], p[second])
                distance = np.linalg.norm(r, axis=1)
                counted = weights[:, 0] >= 0.0
                if not counted.all():
                    distance[~counted] = point_distances(p[first[~counted]], p[second[~counted]])
                vertices = np.concatenate([first, second], axis=1)
                owners = np.stack([self.skins.owner[first[:, 0]], self.skins.owner[second[:, 0]]], axis=1)
                a, b = owners.T
                self._leave_room(vertices, distance, a != b)
                close = counted & (distance < REACH * self._aim[a, b])
                first, second, vertices, distance = first[close], second[close], vertices[close], distance[close]
                owners = owners[close]
                a, b = owners.T
                # Below the share of the rest distance pairs of one body feel each other, above they do not.
                limit = np.where(a == b, REST_SHARE * rest_distances(rest[first], rest[second]), np.inf)
                asked = {
                    name: np.minimum(getattr(self, f"_{name}")[a, b], share * limit)
                    for name, share in (("aim", 1.01), ("enough", 1.001), ("touch", 1.0))
                }
                parts.append(
                    Near(
                        vertices=vertices,
                        weights=weights[close],
                        normal=r[close] / np.maximum(distance, 1e-300)[:, None],
                        distance=distance,
                        owners=owners,
                        edges=np.full(len(a), between_edges),
                        asked=self._asked[a, b],
                        **asked,
                    )
                )
        found = Near.joined(parts)
        return found.where(found.distance < REACH * found.aim)

    def _leave_room(self, vertices: Ints, distance: Array, between: NDArray[np.bool_]) -> None:
        """Let the nodes of pairs, shape (k, 4), move no farther than a share of their distance."""
        np.minimum.at(self._room, vertices.reshape(-1), SHARE * np.repeat(distance, 4))
        vertices, distance = vertices[between], distance[between]
        np.minimum.at(self._room_as_wholes, vertices.reshape(-1), SHARE * np.repeat(distance, 4))


def _stalls(worst: Sequence[tuple[float, float]]) -> bool:
    """Whether sweeps get nowhere, by what each found: what is missing at most, and the least distance."""
    if len(worst) <= PATIENCE:
        return False
    (missing, least), (missing_then, least_then) = worst[-1], worst[-1 - PATIENCE]
    # Things that almost touch have to move in small steps at first.
    return missing > 0.99 * missing_then and least < 2.0 * least_then
