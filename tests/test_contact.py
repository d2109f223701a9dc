"""Bodies that feel each other in simulations: nothing crosses, the same bits every time, mistakes in words."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import warpdeform as wd
from warpdeform import launching
from warpdeform.crossings import crossing_pairs
from warpdeform.errors import InputError, SimulationFailure
from warpdeform.simplices import Simplices

Array = np.ndarray[Any, Any]

CLOTH = wd.Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-4)
SETTINGS = wd.Settings(device="cpu", substeps=2)


def falling(nodes: tuple[int, int] = (17, 17), **settings: Any) -> wd.Simulation:
    """A sheet falls on its edge and folds up; another piece falls on it from the side."""
    captured = settings.pop("captured", True)
    shape = wd.sheet(nodes, (0.6, 0.6))
    upright = shape.positions[..., [2, 1, 0]] + [0.0, 0.0, 0.02]
    upright[..., 0] += 0.02 * np.sin(9.0 * upright[..., 2]) * np.cos(4.0 * upright[..., 1])
    sheet = wd.Body("sheet", shape, CLOTH, initial_positions=upright, velocity=(0.0, 0.0, -2.0), self_contact=True)
    moving = {"position": (0.1, 0.1, 0.3), "velocity": (-3.0, 0.0, -1.0)}
    piece = wd.Body("piece", wd.sheet((9, 12), (0.3, 0.4)), CLOTH, self_contact=True, **moving)
    return wd.Simulation(
        [sheet, piece],
        obstacles=[wd.Obstacle("plane", friction=0.4)],
        contacts=[wd.Contact(("sheet", "piece"), friction=0.3)],
        settings=replace(SETTINGS, **settings),
        captured=captured,
    )


def crossings(simulation: wd.Simulation) -> int:
    parts = [Simplices.of_grid(handle.model.grid) for handle in simulation.bodies]
    points = np.concatenate([handle.positions().reshape(-1, 3) for handle in simulation.bodies])
    return len(crossing_pairs(points, Simplices.joined(parts)))


def run(simulation: wd.Simulation, steps: int) -> list[Array]:
    for _ in range(steps):
        simulation.step()
    return [array for body in simulation.bodies for array in (body.positions(), body.velocities())]


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_what_falls_folds_and_hits_never_crosses(precision: str) -> None:
    simulation = falling(precision=precision)
    for _ in range(45):
        simulation.advance_frame()
        assert crossings(simulation) == 0
    record = simulation.record()
    assert record.contact is not None
    assert record.contact.pairs > 20
    assert record.contact.lost == 0
    assert record.contact.smallest_distance is not None
    assert 0.0 < record.contact.smallest_distance < 0.002
    assert 0.0 < record.contact.guard_active < record.contact.guard_active_most < 0.5
    assert record.as_dict()["contact"]["pairs"] == record.contact.pairs
    lowest = min(float(body.positions()[..., 2].min()) for body in simulation.bodies)
    assert lowest > 0.0


def test_without_contact_the_same_bodies_cross() -> None:
    simulation = falling()
    free = wd.Simulation(
        [replace(handle.body, self_contact=False) for handle in simulation.bodies],
        obstacles=simulation.obstacles,
        settings=simulation.settings,
    )
    run(free, 90)
    assert crossings(free) > 100
    assert free.record().contact is None


def test_runs_have_the_same_bits_whatever_shares_or_captures_their_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launching, "SHARED_FROM", 0)
    first = falling()
    expected = run(first, 24)
    first.reset()
    for other in (first, falling(captured=False), falling(threads=2), falling()):
        for a, b in zip(run(other, 24), expected, strict=True):
            np.testing.assert_array_equal(a, b)


def test_a_pair_that_flies_freely_keeps_its_momentum() -> None:
    shape = wd.sheet((9, 9), (0.3, 0.3))
    bodies = [
        wd.Body("still", shape, CLOTH),
        wd.Body("fast", shape, CLOTH, position=(0.07, 0.04, 0.02), velocity=(0.5, 0.0, -4.0)),
    ]
    settings = replace(SETTINGS, gravity=(0.0, 0.0, 0.0), precision="float64", newton_iterations=0, cg_tolerance=1e-8)
    simulation = wd.Simulation(bodies, contacts=[wd.Contact(("still", "fast"), friction=0.3)], settings=settings)

    def momentum() -> Array:
        return sum((h.model.node_mass[..., None] * h.velocities()).sum(axis=(0, 1)) for h in simulation.bodies)

    before = momentum()
    run(simulation, 12)
    speeds = [h.velocities()[..., 2].mean() for h in simulation.bodies]
    assert abs(speeds[1] - speeds[0]) < 1.0  # they have hit each other
    assert np.abs(momentum() - before).max() < 1e-5 * np.abs(before).max()


def test_what_rests_on_another_keeps_the_gap_that_was_asked_for() -> None:
    table = wd.Body("table", wd.sheet((12, 12), (0.5, 0.5)), CLOTH, pins=[wd.Pin("all")])
    cloth = wd.Body("cloth", wd.sheet((9, 9), (0.3, 0.3)), CLOTH, position=(0.113, 0.087, 0.006))
    simulation = wd.Simulation(
        [table, cloth],
        contacts=[wd.Contact(("table", "cloth"), gap=0.004, friction=0.5)],
        settings=replace(SETTINGS, newton_iterations=3),
    )
    run(simulation, 240)
    heights = simulation["cloth"].positions()[2:-2, 2:-2, 2]
    # A point of the finer cloth carries less than its share where it faces fewer points of the coarser one.
    assert heights.mean() == pytest.approx(0.004, rel=0.1)
    assert np.abs(simulation["cloth"].velocities()).max() < 1e-3


def test_layers_as_thick_as_they_are_lie_so_far_apart() -> None:
    shape = wd.sheet((9, 9), (0.3, 0.3))
    bodies = [
        wd.Body("table", wd.sheet((12, 12), (0.5, 0.5)), CLOTH, position=(-0.1, -0.1, 0.0), pins=[wd.Pin("all")]),
        wd.Body("felt", shape, CLOTH, position=(0.0, 0.0, 0.012), contact_thickness=0.01),
        wd.Body("silk", shape, CLOTH, position=(0.01, 0.02, 0.022), contact_thickness=0.0),
    ]
    pairs = [("table", "felt"), ("felt", "silk"), ("table", "silk")]
    contacts = [wd.Contact(pair, gap=0.002, friction=0.3) for pair in pairs]
    simulation = wd.Simulation(bodies, contacts=contacts, settings=replace(SETTINGS, newton_iterations=3))
    run(simulation, 200)
    felt, silk = (simulation[name].positions()[2:-2, 2:-2, 2].mean() for name in ("felt", "silk"))
    assert felt == pytest.approx(0.005 + 0.002, abs=4e-4)
    assert silk - felt == pytest.approx(0.005 + 0.002, abs=4e-4)


def test_pins_lead_a_body_through_others_as_far_as_there_is_a_way() -> None:
    bar = wd.Body(
        "bar",
        wd.sheet((5, 2), (0.4, 0.05)),
        CLOTH,
        position=(-0.05, 0.12, 0.02),
        pins=[wd.Pin("all", wd.Track.line((0.0, 0.0, 0.0), (0.0, 0.0, -0.5), 0.0, 0.25))],
    )
    sheet = wd.Body("sheet", wd.sheet((9, 9), (0.3, 0.3)), CLOTH, self_contact=True)
    contacts = [wd.Contact(("bar", "sheet"))]
    simulation = wd.Simulation([bar, sheet], contacts=contacts, settings=SETTINGS)
    for _ in range(30):
        simulation.advance_frame()
        assert crossings(simulation) == 0
    assert simulation["bar"].positions()[..., 2] == pytest.approx(0.02 - 0.5, abs=1e-5)
    assert simulation["sheet"].positions()[..., 2].mean() < -0.4
    held = replace(sheet, pins=(wd.Pin("all"),))
    simulation = wd.Simulation([bar, held], contacts=contacts, settings=SETTINGS)
    with pytest.raises(SimulationFailure, match=r'body "bar".*pins cannot follow their path: bodies in contact leave'):
        run(simulation, 60)
    assert crossings(simulation) == 0
    assert simulation.record().outcomes["blocked"] > 0


IMPLICIT = ("implicit-euler", "tr-bdf2", "sdirk2", "linear-implicit")


@pytest.mark.parametrize("integrator", IMPLICIT)
def test_nothing_crosses_under_any_method_that_solves_for_its_forces(integrator: str) -> None:
    simulation = falling((9, 9), integrator=integrator, substeps=1)
    for _ in range(30):
        simulation.advance_frame()
        assert crossings(simulation) == 0
    record = simulation.record().contact
    assert record is not None
    assert record.guard_active > 0.0


@pytest.mark.parametrize(
    ("integrator", "words"),
    [
        ("verlet", 'integrator = "verlet": is stable below steps that contact'),
        ("energy-momentum", "cannot forbid crossing: contact holds back the middle of its steps"),
        ("terzopoulos", "takes forces as they are before the step, and contact has to be solved for"),
    ],
)
def test_methods_that_cannot_forbid_crossing_are_refused(integrator: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        falling((9, 9), integrator=integrator, time_step="auto" if integrator == "verlet" else "fixed")


def test_what_hangs_rigidly_on_another_does_not_cross_either() -> None:
    shape = wd.sheet((7, 7), (0.3, 0.3))
    top = wd.Body("top", wd.sheet((7, 3), (0.3, 0.1)), CLOTH, pins=[wd.Pin("edge:v,0")])
    below = wd.Body("below", shape, CLOTH, position=(0.0, 0.1, 0.0), self_contact=True)
    ball = wd.Body("ball", wd.sheet((5, 5), (0.2, 0.2)), CLOTH, position=(0.05, 0.1, 0.1), velocity=(0.0, 0.0, -6.0))
    simulation = wd.Simulation(
        [top, below, ball],
        attachments=[wd.Attachment("below", "edge:v,0", "top", "edge:v,1")],
        contacts=[wd.Contact(("ball", "top")), wd.Contact(("ball", "below"))],
        settings=SETTINGS,
    )
    for _ in range(30):
        simulation.advance_frame()
        parts = [simulation["below"], simulation["ball"]]
        points = np.concatenate([handle.positions().reshape(-1, 3) for handle in parts])
        assert len(crossing_pairs(points, Simplices.joined([Simplices.of_grid(h.model.grid) for h in parts]))) == 0
    apart = simulation["below"].positions()[:, 0] - simulation["top"].positions()[:, -1]
    assert np.abs(apart).max() < 1e-6


def test_info_tells_what_contact_costs() -> None:
    simulation = falling()
    (contact,) = simulation.info().couplings
    assert contact.name == "contact"
    assert "contact_guard.find_risks" in contact.kernels
    nodes = sum(handle.model.grid.node_count for handle in simulation.bodies)
    assert 0 < contact.bytes < 2500 * nodes
    assert any(line.startswith("contact: ") for line in simulation.info().lines())


SHEET = wd.sheet((6, 6), (0.3, 0.3))


@pytest.mark.parametrize(
    ("bodies", "contacts", "words"),
    [
        ([wd.Body("a", SHEET, CLOTH)], [("a", "b")], 'contact.bodies = "b": is not the name of a body. Use one of: a'),
        ([wd.Body("a", SHEET, CLOTH)], [("a", "a"), ("a", "a")], "are named twice"),
        (
            [wd.Body("a", SHEET, CLOTH, self_contact=True, contact_thickness=0.05)],
            [],
            "contact_thickness = 0.05: of a is too thick for its node spacing of 0.06 m.*contact_thickness = 0.036",
        ),
        (
            [
                wd.Body("a", SHEET, CLOTH),
                wd.Body("b", SHEET, CLOTH, position=(0.1, 0.13, 0.0), rotation=(0.3, 0, 0, 1)),
            ],
            [("a", "b")],
            r"a and b cross at the start in \d+ places: . \[\d, \d\] \[\d, \d\] through . \[\d",
        ),
        (
            [wd.Body("a", SHEET, CLOTH), wd.Body("b", SHEET, CLOTH, position=(0, 0, 0.004), contact_thickness=0.02)],
            [("a", "b")],
            r"overlap at the start, 0.004 m apart. Move them apart, or make them thinner",
        ),
    ],
)
def test_what_cannot_be_is_refused(bodies: list[wd.Body], contacts: list[tuple[str, str]], words: str) -> None:
    with pytest.raises(InputError, match=words):
        wd.Simulation(bodies, contacts=[wd.Contact(pair) for pair in contacts], settings=SETTINGS)


def test_starts_that_cross_are_accepted_where_nothing_feels_it() -> None:
    through = wd.Body("b", SHEET, CLOTH, position=(0.1, 0.13, 0.0), rotation=(0.3, 0, 0, 1))
    bodies = [wd.Body("a", SHEET, CLOTH, self_contact=True), through]
    assert wd.Simulation(bodies, settings=SETTINGS).contact is not None


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        ({"friction": -0.1}, "friction = -0.1: must lie between 0 and 10"),
        ({"gap": 0.0}, "gap = 0.0: must lie between 1e-6 and 1 m"),
        ({"design_speed": -1.0}, "design_speed = -1.0: must lie between"),
        ({"bodies": ("a",)}, "must be two names"),
    ],
)
def test_words_of_a_contact_are_checked(words: dict[str, Any], problem: str) -> None:
    with pytest.raises(InputError, match=problem):
        wd.Contact(**{"bodies": ("a", "b")} | words)
    with pytest.raises(InputError, match=r"contact_thickness = nan: must be finite"):
        wd.Body("a", SHEET, CLOTH, contact_thickness=float("nan"))


def test_crossings_are_counted_of_what_feels_each_other() -> None:
    bodies = [wd.Body("a", SHEET, CLOTH), wd.Body("b", SHEET, CLOTH, position=(0.02, 0.03, 0.05))]
    through = SHEET.positions[..., [2, 1, 0]] + [0.13, 0.01, -0.14]
    for contacts, expected in (([wd.Contact(("a", "b"))], True), ([wd.Contact(("a", "a"))], False), ([], False)):
        simulation = wd.Simulation(bodies, contacts=contacts, settings=SETTINGS)
        assert simulation.count_crossings() == 0
        handle = simulation["b"]
        handle.state.x.assign(handle.model.layout.pack(through.astype(np.float32)))
        assert (simulation.count_crossings() > 3) == expected


def test_obstacles_hold_the_skin_at_the_gap() -> None:
    rubber = wd.Material(density=1200.0, youngs_modulus=1e6, poisson_ratio=0.4, damping=10.0)
    rod = wd.Body("rod", wd.line((9,), 0.2), rubber, section=wd.Section.circular(0.003), position=(0.0, 0.0, 0.006))
    felt = wd.Body("felt", SHEET, CLOTH, position=(0.0, 0.2, 0.008), contact_thickness=0.01)
    simulation = wd.Simulation([rod, felt], obstacles=[wd.Obstacle("plane", gap=0.002)], settings=SETTINGS)
    run(simulation, 240)
    assert simulation["rod"].positions()[..., 2] == pytest.approx(0.003 + 0.002, abs=1e-4)
    assert simulation["felt"].positions()[..., 2] == pytest.approx(0.005 + 0.002, abs=1e-4)
