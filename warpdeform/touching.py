"""From the contacts that users name to what acts between bodies that feel each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpdeform.contact import Contact
from warpdeform.crossings import closest, crossing_pairs
from warpdeform.errors import InputError, Mistake
from warpdeform.forces.contact import ContactSystem, Touching
from warpdeform.forces.contact_mesh import Surface
from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.forces.ties import RigidTies
from warpdeform.handle import BodyHandle
from warpdeform.settings import Settings
from warpdeform.simplices import Simplices

Array = NDArray[np.float64]

PRESSED = 1.0
"""Strain whose elastic forces the field is to hold where its design speed is left out."""
RANGE_OF_SPACING = 0.03
"""Range of a field over the spacing of the nodes, about, for this estimate."""
LARGEST_THICKNESS = 0.6
"""Thickness over node spacing from which on a node would touch the triangles beside its own, 0.7 spacings away."""
FADED = 4.0
"""Ranges beyond the gap at which the field of bodies ends: there it is 0.02 of what it is at the gap."""


class Skins:
    """What bodies that feel each other show, for counting what crosses (host).

    Attributes:
        handles: The bodies.
        simplices: Their edges and triangles, all bodies one after the other.
        owner: Body of each node.
        feels: Whether one body feels another.
    """

    def __init__(self, handles: Sequence[BodyHandle], touching: Sequence[Touching]) -> None:
        self.handles = tuple(handles)
        self.simplices = Simplices.joined([Simplices.of_grid(h.model.grid) for h in handles])
        counts = [h.model.grid.node_count for h in handles]
        self.owner = np.repeat(np.arange(len(handles)), counts)
        self._number = np.concatenate([np.arange(n) for n in counts])
        self.feels = np.zeros((len(handles), len(handles)), bool)
        for each in touching:
            a, b = each.bodies
            self.feels[a, b] = self.feels[b, a] = True

    def crossing(self, points: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Edges and the triangles that they go through, by their nodes, of bodies that feel each other."""
        pairs = crossing_pairs(points, self.simplices)
        edges, triangles = self.simplices.edges[pairs[:, 0]], self.simplices.triangles[pairs[:, 1]]
        felt = self.feels[self.owner[edges[:, 0]], self.owner[triangles[:, 0]]]
        return edges[felt], triangles[felt]

    def count(self) -> int:
        """Crossings now."""
        points = np.concatenate([h.positions().reshape(-1, 3).astype(np.float64) for h in self.handles])
        return len(self.crossing(points)[0])

    def place(self, vertices: Sequence[int]) -> str:
        """Body and nodes, for messages."""
        handle = self.handles[self.owner[vertices[0]]]
        nodes = [[int(k) for k in np.unravel_index(self._number[v], handle.nodes)] for v in dict.fromkeys(vertices)]
        return f"{handle.name} {' '.join(str(node) for node in nodes)}"


def add_contacts(
    handles: Sequence[BodyHandle],
    contacts: Sequence[Contact],
    settings: Settings,
    rigid: Sequence[RigidTies] = (),
) -> tuple[ContactSystem | None, Skins | None]:
    """What acts between bodies that feel each other, or themselves.

    Args:
        handles: All bodies of a simulation.
        contacts: Pairs that are named; bodies with `self_contact` are added to them.
        settings: Solver settings.
        rigid: Nodes that follow others.

    Returns:
        The coupling, and what counts crossings; None if nothing feels anything.

    Raises:
        InputError: Pairs that are named twice or whose bodies do not exist.
    """
    names = [handle.name for handle in handles]
    pairs = [contact for contact in contacts if _check(contact, names)]
    named = [frozenset(contact.bodies) for contact in pairs]
    pairs += [
        Contact((handle.name, handle.name))
        for handle in handles
        if handle.body.self_contact and frozenset((handle.name,)) not in named
    ]
    if len(set(named)) < len(named):
        twice = next(pair for pair in named if named.count(pair) > 1)
        raise InputError(Mistake("contact.bodies", tuple(twice), "are named twice", "Name every pair once."))
    taking = [handle for handle in handles if any(handle.name in contact.bodies for contact in pairs)]
    if not taking:
        return None, None
    number = {handle.name: k for k, handle in enumerate(taking)}
    touching = []
    _check_thickness(taking, pairs)
    for contact in pairs:
        a, b = (taking[number[name]] for name in contact.bodies)
        spacing = min(a.model.spacing, b.model.spacing)
        gap, constants = contact.constants(
            settings.gravity, spacing, max(_expected_speed(a, b, settings), _press(a, b))
        )
        touching.append(
            Touching(
                bodies=(number[a.name], number[b.name]),
                design_speed=constants.design_speed,
                range=constants.range,
                cutoff=gap + FADED * constants.range,
                gap=gap,
                offset=0.5 * (a.body.skin_thickness + b.body.skin_thickness),
                friction=contact.friction,
            )
        )
    surfaces = [Surface(h.model.grid, h.rest_positions, h.model.spacing) for h in taking]
    states = [h.state for h in taking]
    system = ContactSystem(states, surfaces, [h.model.node_mass for h in taking], touching, _movable(taking, rigid))
    system.guarding.rigid = tuple(ties for ties in rigid if ties.states[0] in states)
    fields = [(h, each) for h in taking for each in h.terms if isinstance(each, ObstacleField)]
    system.guarding.others += [(field, handle.state) for handle, field in fields]
    pushed = any(not obstacle.track.static for _, field in fields for obstacle in field.obstacles)
    if pushed or any(handle.model.pins_move for handle in taking):
        system.targets = tuple(handle.model.target for handle in taking)
    skins = Skins(taking, touching)
    _check_start(skins, touching, system)
    return system, skins


def _movable(handles: Sequence[BodyHandle], rigid: Sequence[RigidTies]) -> list[Array]:
    """1 where impulses may push a node, 0 where it is where others lead it."""
    movable = [np.ones(handle.nodes) for handle in handles]
    for handle, free in zip(handles, movable, strict=True):
        for ties in rigid:
            if ties.states[0] is handle.state:
                free[tuple(ties.nodes.T)] = 0.0
    return movable


def _check(contact: Contact, names: Sequence[str]) -> bool:
    for name in contact.bodies:
        if name not in names:
            remedy = f"Use one of: {', '.join(names)}."
            raise InputError(Mistake("contact.bodies", name, "is not the name of a body", remedy))
    return True


def _check_thickness(handles: Sequence[BodyHandle], pairs: Sequence[Contact]) -> None:
    """Refuse bodies that feel themselves and are so thick that neighbours touch, or have nothing to feel.

    Raises:
        InputError: What is wrong with which of them.
    """
    mistakes = []
    for handle in handles:
        if not any(contact.bodies == (handle.name, handle.name) for contact in pairs):
            continue
        thickness, largest = handle.body.skin_thickness, LARGEST_THICKNESS * handle.model.spacing
        if thickness > largest:
            problem = (
                f"of {handle.name} is too thick for its node spacing of {handle.model.spacing:.3g} m to feel itself"
            )
            remedy = f"Use contact_thickness = {largest:.3g} or less, or fewer nodes."
            mistakes.append(Mistake("contact_thickness", thickness, problem, remedy))
        if handle.body.kind == "curve" and handle.nodes[1] == 1 and handle.nodes[0] < 4:
            problem = f"{handle.name} has no two parts that could touch: it is one strand of {handle.nodes[0]} nodes"
            mistakes.append(Mistake("self_contact", True, problem, "Leave it out, or use 4 nodes or more."))
    if mistakes:
        raise InputError(mistakes)


def _check_start(skins: Skins, touching: Sequence[Touching], system: ContactSystem) -> None:
    """Refuse bodies that cross at the start, or whose skins overlap.

    Raises:
        InputError: Which bodies do, and where.
    """
    points = np.concatenate([h.model.initial_positions.reshape(-1, 3) for h in skins.handles])
    edges, triangles = skins.crossing(points)
    if len(edges):
        where = [f"{skins.place(e)} through {skins.place(t)}" for e, t in zip(edges[:5], triangles[:5], strict=True)]
        names = {skins.handles[skins.owner[v]].name for v in (*edges[:, 0], *triangles[:, 0])}
        problem = f"{' and '.join(sorted(names))} cross at the start in {len(edges)} places: {'; '.join(where)}"
        raise InputError(Mistake("contact", None, problem, "Move them apart, or let them not feel each other."))
    for handle in skins.handles:
        handle.state.z.assign(handle.state.x)
    system.begin()
    system.linearise("z")
    if system.report().smallest_distance < 0.0:
        near = closest(points, skins.simplices, max(each.offset for each in touching), (skins.owner, skins.feels))
        first, second = (skins.place(vertices) for vertices in near.vertices)
        problem = f"{first} and {second} overlap at the start, {near.distance:.3g} m apart"
        raise InputError(Mistake("contact", None, problem, "Move them apart, or make them thinner."))
    system.reset()


def _press(a: BodyHandle, b: BodyHandle) -> float:
    """Speed whose field holds what a body strained by `PRESSED` presses with, node by node [m/s].

    A node of mass m whose elastic block is D presses with about D h times the strain on what it is wrapped around; the
    field of a range eps carries about m V^2/(2 eps). Of twisted cloth a field made for its speed carries a hundredth.
    """
    squares = []
    for handle in (a, b):
        model, state = handle.model, handle.state
        blocks = model.zeros(6)
        handle.elasticity.linearise(state, state.x)
        handle.elasticity.add_block_diagonal(state, blocks)
        stiffness = model.download(blocks)[..., :3].mean(axis=-1)
        shown = stiffness > 0.0
        rate = float(np.median(stiffness[shown] / model.node_mass[shown])) if shown.any() else 0.0
        squares.append(2.0 * PRESSED * RANGE_OF_SPACING * model.spacing**2 * rate)
    return math.sqrt(max(squares))


def _expected_speed(a: BodyHandle, b: BodyHandle, settings: Settings) -> float:
    """The fastest at which they can be expected to meet [m/s]: their first motion, and a fall over their extent."""
    points = np.concatenate([h.model.initial_positions.reshape(-1, 3) for h in (a, b)])
    fall = math.sqrt(2.0 * math.hypot(*settings.gravity) * float(np.linalg.norm(np.ptp(points, axis=0))))
    apart = np.subtract(a.body.velocity, b.body.velocity)
    return float(np.linalg.norm(apart)) + fall
