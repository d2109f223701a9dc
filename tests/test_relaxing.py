"""Starts that are relaxed: what overlaps is moved apart, little and without crossing, and starts gently."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from contacts import CLOTH
from numpy.typing import NDArray

import warpdeform as wd
from warpdeform.crossings import closest, crossing_pairs
from warpdeform.errors import InputError
from warpdeform.relaxing import ENOUGH, Relaxed, relax_start
from warpdeform.selectors import select_nodes
from warpdeform.simplices import Simplices, body_of_vertices

Array = NDArray[np.float64]

RUBBER = wd.Material(density=1200.0, youngs_modulus=1e6, poisson_ratio=0.4)
SHEET = wd.sheet((12, 12), (0.3, 0.3))
ENDS = (wd.Pin("edge:u,0"), wd.Pin("edge:u,1"))
GAP = 0.002


def felt(name: str, height: float, **words: Any) -> wd.Body:
    """A sheet that is 4 mm thick."""
    return wd.Body(name, SHEET, CLOTH, **{"contact_thickness": 0.004, "position": (0.0, 0.0, height)} | words)


def drop(length: float = 0.4, near: float = 0.004) -> wd.Body:
    """A sheet folded once, whose layers come nearer towards the ends, to a distance [m] less than its thickness."""
    shape = wd.sheet((41, 9), (length, 0.2 * length))
    u, radius = shape.positions[..., 0], 0.015
    beyond = 0.5 * (length - np.pi * radius)
    along = beyond - np.minimum(u, length - u)
    angle = np.clip((u - beyond) / radius, 0.0, np.pi)
    side = np.sign(u - 0.5 * length)
    slope = (radius - 0.5 * near) / beyond
    x = np.where(along > 0.0, -along, radius * np.sin(angle))
    z = np.where(along > 0.0, side * (radius - slope * along), -radius * np.cos(angle))
    positions = np.stack([x, shape.positions[..., 1], z], axis=-1)
    return wd.Body("drop", shape, CLOTH, initial_positions=positions, contact_thickness=0.005)


def rod(**words: Any) -> wd.Body:
    shape, section = wd.line((15,), 0.24), wd.Section.circular(0.003)
    return wd.Body("rod", shape, RUBBER, section=section, position=(0.031, 0.151, 0.001), **words)


def block(**words: Any) -> wd.Body:
    return wd.Body("block", wd.block((5, 5, 4), (0.12, 0.12, 0.09)), RUBBER, position=(0.09, 0.08, 0.001), **words)


STARTS: dict[str, tuple[list[wd.Body], list[tuple[str, str]], float]] = {
    # bodies, pairs, and how far nodes have to go at least: what the nearest two lack of thickness and gap
    "two sheets": ([felt("a", 0.0), felt("b", 0.002)], [("a", "b")], 0.004),
    "a sheet that is folded": ([drop()], [("drop", "drop")], 0.003),
    "a curve in the skin of a sheet": ([rod(), felt("a", 0.0, pins=ENDS)], [("rod", "a")], 0.006),
    "a curve that is held": ([rod(pins=(wd.Pin("all"),)), felt("a", 0.0, pins=ENDS)], [("rod", "a")], 0.006),
    "a solid in the skin of a sheet": ([block(), felt("a", 0.0)], [("block", "a")], 0.003),
    "three layers, the lowest held": (
        [felt("a", 0.0, pins=(wd.Pin("all"),)), felt("b", 0.003), felt("c", 0.0045)],
        [("a", "b"), ("b", "c"), ("a", "c")],
        0.0075,
    ),
}


def asking(pairs: list[tuple[str, str]], relax: bool = True) -> list[wd.Contact]:
    return [wd.Contact(pair, gap=GAP, relax=relax) for pair in pairs]


def placed(bodies: tuple[wd.Body, ...] | list[wd.Body]) -> tuple[Array, Simplices, NDArray[np.int64]]:
    """Positions, simplices, and the body of each node."""
    points = np.concatenate([body.placed_positions().reshape(-1, 3) for body in bodies])
    parts = [Simplices.of_grid(body.shape.grid) for body in bodies]
    return points, Simplices.joined(parts), body_of_vertices([part.vertices for part in parts])


def least_distance(bodies: tuple[wd.Body, ...], a: int, b: int) -> float:
    points, simplices, owner = placed(bodies)
    feels = np.zeros((len(bodies), len(bodies)), bool)
    feels[a, b] = feels[b, a] = True
    return closest(points, simplices, 0.03, (owner, feels)).distance


@pytest.mark.parametrize("name", STARTS)
def test_skins_are_a_gap_apart_and_nothing_has_crossed(name: str) -> None:
    bodies, pairs, missing = STARTS[name]
    done, relaxed = relax_start(bodies, asking(pairs))
    assert relaxed is not None
    points, simplices, owner = placed(done)
    assert len(crossing_pairs(points, simplices)) == 0
    named = {body.name: k for k, body in enumerate(done)}
    for pair in pairs:
        a, b = (named[each] for each in pair)
        offset = 0.5 * (done[a].skin_thickness + done[b].skin_thickness)
        if a != b:
            assert least_distance(done, a, b) >= offset + ENOUGH * GAP - 1e-12
            # On the sides that they were on: the order of heights is what it was.
            below, above = sorted((a, b), key=lambda k: bodies[k].placed_positions()[..., 2].mean())
            heights = [done[k].placed_positions()[..., 2] for k in (below, above)]
            assert heights[0].mean() < heights[1].mean()
    moved = np.linalg.norm(points - placed(bodies)[0], axis=1)
    assert relaxed.largest == pytest.approx(moved.max(), abs=1e-15)
    assert 0.4 * missing < relaxed.largest < 1.6 * missing
    assert dict(relaxed.moved) == {b.name: n for k, b in enumerate(done) if (n := int((moved[owner == k] > 0).sum()))}
    for before, after in zip(bodies, done, strict=True):
        for pin in before.pins:
            held = tuple(select_nodes(pin.nodes, before.nodes, before.kind).T)
            np.testing.assert_array_equal(after.placed_positions()[held], before.placed_positions()[held])
        assert after.shape is before.shape
        assert after.velocity == before.velocity


@pytest.mark.parametrize("name", STARTS)
def test_what_was_relaxed_starts_gently(name: str) -> None:
    bodies, pairs, missing = STARTS[name]
    settings = wd.Settings(device="cpu", gravity=(0.0, 0.0, 0.0), substeps=2)
    with pytest.raises(InputError, match=r"overlap at the start, .* or use relax = true"):
        wd.Simulation(bodies, contacts=asking(pairs, relax=False), settings=settings)
    simulation = wd.Simulation(bodies, contacts=asking(pairs), settings=settings)
    mass = sum(handle.mass for handle in simulation.bodies)
    for _ in range(6):
        simulation.step()
        # Fields hold 9.81 m/s2 at the gap, for 0.05 s; where skins overlap they are made to stop 1 m/s and more.
        assert simulation.record().energy.kinetic < 0.5 * mass * 0.2**2
    assert simulation.count_crossings() == 0
    record = simulation.record().contact
    assert record is not None
    assert record.relaxed is not None
    assert simulation.relaxed is not None
    assert record.relaxed == simulation.relaxed.largest
    assert 0.4 * missing < record.relaxed < 1.6 * missing
    assert record.smallest_distance is not None
    assert record.smallest_distance > 0.5 * GAP
    assert any(note.startswith("the start is relaxed: ") and "m at most" in note for note in simulation.notes)
    simulation.reset()
    again = simulation.record().contact
    assert again is not None
    assert again.relaxed == record.relaxed


def test_what_is_far_enough_apart_is_left_as_it_is() -> None:
    bodies = [felt("a", 0.0), felt("b", 0.0062)]
    done, relaxed = relax_start(bodies, asking([("a", "b")]))
    assert relaxed == Relaxed()
    assert relaxed.notes == ()
    assert all(after is before for after, before in zip(done, bodies, strict=True))
    done, relaxed = relax_start(bodies, asking([("a", "b")], relax=False))
    assert relaxed is None
    assert all(after is before for after, before in zip(done, bodies, strict=True))


def test_masses_say_who_moves() -> None:
    heavy = replace(felt("a", 0.0), material=replace(CLOTH, areal_density=9.0 * CLOTH.areal_density))
    done, _ = relax_start([heavy, felt("b", 0.002)], asking([("a", "b")]))
    a, b = (body.placed_positions()[..., 2] for body in done)
    assert np.ptp(a) < 1e-12  # as wholes
    assert np.ptp(b) < 1e-12
    assert -a.mean() == pytest.approx((b.mean() - 0.002) / 9.0, rel=1e-9)


def test_nodes_of_rigid_attachments_stay() -> None:
    bodies = [felt("a", 0.0, pins=(wd.Pin("edge:u,1"),)), felt("b", 0.002), felt("c", 0.0, position=(-0.3, 0.0, 0.002))]
    tie = wd.Attachment("c", "edge:u,1", "b", "edge:u,0")
    done, relaxed = relax_start(bodies, asking([("a", "b")]), [tie])
    assert relaxed is not None
    moved = done[1].placed_positions() != bodies[1].placed_positions()
    assert not moved[0].any()
    assert moved[3:].any()
    assert done[2] is bodies[2]
    settings = wd.Settings(device="cpu")
    wd.Simulation(bodies, contacts=asking([("a", "b")]), attachments=[tie], settings=settings).step()


ALL = (wd.Pin("all"),)
ACROSS = wd.Body("b", SHEET, CLOTH, position=(0.1, 0.13, 0.0), rotation=(0.3, 0, 0, 1))


@pytest.mark.parametrize(
    ("bodies", "contacts", "words"),
    [
        (
            [felt("a", 0.0, pins=ALL), felt("b", 0.003, pins=(wd.Pin([[4, 5]]),))],
            asking([("a", "b")]),
            r"contact.relax = true: (a .* and b|b .* and a) .*\[4, 5\].*, 0.003 m apart.* overlap at the start, "
            r"also after \d+ sweeps of moving them apart. .* let go of nodes that are held",
        ),
        (
            [felt("a", 0.0, pins=ALL), felt("b", 0.003, pins=ALL)],
            asking([("a", "b")]),
            r"apart; .*; .* and \d+ more pairs overlap at the start",
        ),
        ([felt("a", 0.0), ACROSS], asking([("a", "b")]), "cross at the start in .* relax = true does not help what cr"),
        (
            [felt("a", 0.0), felt("b", 0.003), felt("c", 0.006)],
            [wd.Contact(("a", "b"), relax=True), wd.Contact(("b", "c"))],
            r"[bc] .* and [bc] .* 0.003 m apart.* at the start. .* or use relax = true for them too",
        ),
        ([felt("a", 0.0)], asking([("a", "b")]), 'contact.bodies = "b": is not the name of a body'),
    ],
)
def test_what_cannot_be_relaxed_is_refused(bodies: list[wd.Body], contacts: list[wd.Contact], words: str) -> None:
    with pytest.raises(InputError, match=words):
        wd.Simulation(bodies, contacts=contacts, settings=wd.Settings(device="cpu"))


def test_pairs_that_do_not_ask_are_kept_from_overlapping() -> None:
    bodies = [felt("a", 0.0), felt("b", 0.002), felt("c", 0.0062)]
    done, _ = relax_start(bodies, [wd.Contact(("a", "b"), relax=True), wd.Contact(("b", "c"))])
    heights = [body.placed_positions()[..., 2].mean() for body in done]
    assert heights[1] - heights[0] == pytest.approx(0.006, abs=(1.0 - ENOUGH) * GAP)
    assert heights[2] - heights[1] > 0.004


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_wavy_layers_and_rods_that_almost_touch_do_not_cross_on_the_way(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape, height = wd.sheet((9, 9), (0.2, 0.2)), 0.0
    bodies = []
    for k in range(4):
        positions, before = shape.positions.copy(), height
        waves, phase = rng.normal(size=2) * 20.0, rng.uniform(0.0, 6.0)
        positions[..., 2] += 0.004 * np.sin(positions[..., :2] @ waves + phase)
        # As low as the layer below allows, node by node, and a little more.
        if bodies:
            below = bodies[-1].placed_positions()[..., 2]
            height = float((below - positions[..., 2]).max()) + 1e-6
        positions[..., 2] += height
        assert height >= before
        pins = (wd.Pin("corner:0,0"),) if k % 2 else ()
        bodies.append(wd.Body(f"s{k}", shape, CLOTH, initial_positions=positions, contact_thickness=0.004, pins=pins))
    top = float(bodies[-1].placed_positions()[..., 2].max())
    for k in range(2):
        section = wd.Section.circular(0.002)
        place = (0.01, 0.05 + 0.07 * k, top + 1e-5 * (k + 1))
        bodies.append(wd.Body(f"r{k}", wd.line((20,), 0.17), RUBBER, section=section, position=place))
    names = [body.name for body in bodies]
    pairs = [(a, b) for i, a in enumerate(names) for b in names[i:]]
    done, relaxed = relax_start(bodies, asking(pairs))
    assert relaxed is not None
    points, simplices, _ = placed(done)
    assert len(crossing_pairs(points, simplices)) == 0
    assert closest(points, simplices, 0.02).distance > 0.004
    assert 0.002 < relaxed.largest < 0.04
    means = [body.placed_positions()[..., 2].mean() for body in done[:5]]
    assert means == sorted(means)


def test_nothing_is_moved_through_what_is_in_its_way() -> None:
    table = felt("table", 0.0, pins=ALL, contact_thickness=0.008)
    silk, lid = (felt("silk", 0.001, contact_thickness=0.0), felt("lid", 0.003, pins=ALL, contact_thickness=0.0))
    contacts = [wd.Contact(("table", "silk"), relax=True), wd.Contact(("silk", "lid"))]
    # The way out leads through the lid.
    with pytest.raises(InputError, match=r"table .* overlap at the start, also after"):
        relax_start([table, silk, lid], contacts)
