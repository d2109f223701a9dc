"""Rods under a load at their end against Euler's elastica: bent across, and beyond the load at which a column buckles.

A rod of unit free length is clamped by pinning its first two nodes, in the middle between them. A spring to a point a
million lengths away pulls its end with a force that keeps size and direction. All loads are strands of one body.
"""

import csv
from pathlib import Path

import numpy as np
from physics.statics import Array, equilibrium, listed, orders, percent

from warpdeform.body import Body, Pin, Spring
from warpdeform.material import Material
from warpdeform.shape import line, strands

DATA = Path(__file__).parents[1] / "data"
BENDING = 1.0
"""EI [N m2]."""
FAR = 1e6
ROD = Material(linear_density=1.0, axial_stiffness=1e5, bending_stiffness=BENDING)
"""It shortens or lengthens by less than 1e-4 under the largest load."""


def reference(file: str, column: str, values: Array) -> list[Array]:
    """The columns of a reference at some values of its first one, as (value, ...) by row."""
    with (DATA / file).open() as lines:
        rows = [{key: float(number) for key, number in row.items()} for row in csv.DictReader(lines)]
    by_value = {row[column]: row for row in rows}
    return [np.array([by_value[value][key] for value in values]) for key in rows[0] if key != column]


def pulled(cells: int, loads: Array, direction: Array, angles: Array) -> Array:
    """Ends of the rods at rest, from where the clamp acts, shape (k, 3).

    Args:
        cells: Segments of each rod.
        loads: Force at the end of each rod [N].
        direction: Where it pulls to, a unit vector.
        angles: Where to start: by how much each rod turns from its clamp to its end, evenly [rad].
    """
    length = cells / (cells - 0.5)
    clamp = 0.5 * length / cells
    shape = strands(line((cells + 1,), length), np.zeros((len(loads), 3)))
    along = np.maximum(shape.positions[..., 0] - clamp, 0.0)
    start = np.stack([np.sin(angles * along), 0.0 * along, np.cos(angles * along) - 1.0], axis=-1) / angles[:, None]
    start[..., 0] += clamp
    start[:2] = shape.positions[:2]
    body = Body(
        "rods",
        shape,
        ROD,
        initial_positions=start,
        pins=(Pin("end:0,2"),),
        springs=tuple(
            Spring([[cells, k]], load / FAR, tuple(float(x) for x in FAR * direction)) for k, load in enumerate(loads)
        ),
    )
    ends = equilibrium(body, gravity=(0.0, 0.0, 0.0))["rods"].positions()[-1]
    return np.asarray(ends - [clamp, 0.0, 0.0])


def test_rods_bend_under_a_load_at_their_end_as_the_elastica_does() -> None:
    loads = np.array([1.0, 3.0, 10.0])
    shortening, drop, angle, _ = reference("tip_load_elastica.csv", "PL2_over_EI", loads)
    errors = []
    for cells in (10, 20, 40):
        ends = pulled(cells, loads * BENDING, np.array([0.0, 0.0, -1.0]), np.radians(angle))
        errors.append([1 - ends[:, 0], -ends[:, 2]] / np.array([shortening, drop]) - 1)
    print(f"\nload at the end of a rod, P L^2/EI {loads.tolist()}, 40 cells: shortening", end=" ")
    print(f"{percent(errors[-1][0])}; drop {percent(errors[-1][1])}; orders {listed(orders(errors)[-1])}", end="")
    assert np.abs(errors[-1]).max() < 5e-3
    assert orders(errors).min() > 1.8


def test_a_column_that_has_buckled_follows_the_elastica() -> None:
    # A column pinned at both ends is two of these, each from its middle: P_c = (pi/2)^2 EI / L^2.
    degrees = np.array([40.0, 80.0, 120.0])
    over, distance, deflection = reference("postbuckling_pinned.csv", "end_angle_deg", degrees)
    errors = []
    for cells in (10, 20, 40):
        critical = 0.25 * np.pi**2 * BENDING
        ends = pulled(cells, over * critical, np.array([-1.0, 0.0, 0.0]), np.radians(degrees))
        errors.append([ends[:, 0] - distance, -0.5 * ends[:, 2] - deflection])
    print(
        f"\nbuckled column, P/Pc {over.round(3).tolist()}, 40 cells: errors over its length, distance of the ends",
        end=" ",
    )
    print(f"{percent(errors[-1][0])}; deflection {percent(errors[-1][1])}; orders {listed(orders(errors)[-1])}", end="")
    assert np.abs(errors[-1]).max() < 5e-3
    assert orders(errors).min() > 1.7
