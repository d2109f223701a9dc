"""From the contacts that users name to the terms of bodies that feel each other."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from warpdeform.contact import Contact
from warpdeform.errors import InputError, Mistake
from warpdeform.forces.contact import ContactSystem, Touching
from warpdeform.forces.contact_mesh import Surface
from warpdeform.forces.obstacle_field import ObstacleField
from warpdeform.handle import BodyHandle
from warpdeform.settings import Settings

PRESSED = 1.0
"""Strain whose elastic forces the field is to hold where its design speed is left out."""
RANGE_OF_SPACING = 0.03
"""Range of a field over the spacing of the nodes, about, for this estimate."""
FADED = 4.0
"""Ranges beyond the gap at which the field of bodies ends: there it is 0.02 of what it is at the gap."""


def add_contacts(
    handles: Sequence[BodyHandle], contacts: Sequence[Contact], settings: Settings
) -> ContactSystem | None:
    """Give bodies that feel each other, or themselves, a term for it.

    Args:
        handles: All bodies of a simulation.
        contacts: Pairs that are named; bodies with `self_contact` are added to them.
        settings: Solver settings.

    Returns:
        What the terms share; None if nothing feels anything.

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
        return None
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
    system = ContactSystem([h.state for h in taking], surfaces, [h.model.node_mass for h in taking], touching)
    fields = [(h, each) for h in taking for each in h.terms if isinstance(each, ObstacleField)]
    system.guarding.others += [(field, handle.state) for handle, field in fields]
    for handle, term in zip(taking, system.terms(), strict=True):
        handle.terms = (*handle.terms, term)
    pushed = any(not obstacle.track.static for _, field in fields for obstacle in field.obstacles)
    if pushed or any(handle.model.pins_move for handle in taking):
        system.targets = tuple(handle.model.target for handle in taking)
    return system


def _check(contact: Contact, names: Sequence[str]) -> bool:
    for name in contact.bodies:
        if name not in names:
            remedy = f"Use one of: {', '.join(names)}."
            raise InputError(Mistake("contact.bodies", name, "is not the name of a body", remedy))
    return True


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
