"""From the contacts that users name to what acts between bodies that feel each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpdeform.contact import Contact, contact_pairs
from warpdeform.crossings import closest
from warpdeform.errors import InputError, Mistake
from warpdeform.forces.contact import ContactSystem, Touching
from warpdeform.forces.contact_mesh import Surface
from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.forces.ties import RigidTies
from warpdeform.handle import BodyHandle
from warpdeform.settings import Settings
from warpdeform.skins import Skins

Array = NDArray[np.float64]

PRESSED = 1.0
"""Strain whose elastic forces the field is to hold where its design speed is left out."""
RANGE_OF_SPACING = 0.03
"""Range of a field over the spacing of the nodes, about, for this estimate."""
FADED = 4.0
"""Ranges beyond the gap at which the field of bodies ends: there it is 0.02 of what it is at the gap."""


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
    pairs = contact_pairs([handle.body for handle in handles], contacts)
    taking = [handle for handle in handles if any(handle.name in contact.bodies for contact in pairs)]
    if not taking:
        return None, None
    number = {handle.name: k for k, handle in enumerate(taking)}
    touching = []
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
    skins = Skins([handle.body for handle in taking], [each.bodies for each in touching])
    _check_start(taking, skins, touching, system)
    return system, skins


def _movable(handles: Sequence[BodyHandle], rigid: Sequence[RigidTies]) -> list[Array]:
    """1 where impulses may push a node, 0 where it is where others lead it."""
    movable = [np.ones(handle.nodes) for handle in handles]
    for handle, free in zip(handles, movable, strict=True):
        for ties in rigid:
            if ties.states[0] is handle.state:
                free[tuple(ties.nodes.T)] = 0.0
    return movable


def _check_start(
    handles: Sequence[BodyHandle], skins: Skins, touching: Sequence[Touching], system: ContactSystem
) -> None:
    """Refuse bodies that cross at the start, or whose skins overlap.

    Raises:
        InputError: Which bodies do, and where.
    """
    points = skins.joined([handle.model.initial_positions for handle in handles])
    skins.refuse_crossing(points)
    for handle in handles:
        handle.state.z.assign(handle.state.x)
    system.begin()
    system.linearise("z")
    if system.report().smallest_distance < 0.0:
        near = closest(points, skins.simplices, max(each.offset for each in touching), (skins.owner, skins.feels))
        first, second = (skins.place(vertices) for vertices in near.vertices)
        problem = f"{first} and {second} overlap at the start, {near.distance:.3g} m apart"
        raise InputError(
            Mistake("contact", None, problem, "Move them apart, or make them thinner; or use relax = true.")
        )
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
