"""Bodies as users describe them: node selectors, pins, springs, placement, and what is refused."""

from typing import Any

import numpy as np
import pytest

from warpdeform.body import Body, Pin, Spring, rotate
from warpdeform.errors import InputError
from warpdeform.material import Material
from warpdeform.selectors import select_nodes
from warpdeform.shape import arc, sheet

CLOTH = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3)
NODES = (3, 5)


@pytest.mark.parametrize(
    ("selector", "expected"),
    [
        ("corner:0,0", [[0, 0]]),
        ("corner:0,1", [[0, 4]]),
        ("corner:1,0", [[2, 0]]),
        ("corner:1,1", [[2, 4]]),
        ("edge:u,0", [[0, j] for j in range(5)]),
        ("edge:u,1", [[2, j] for j in range(5)]),
        ("edge:v,0", [[i, 0] for i in range(3)]),
        ("edge:v,1", [[i, 4] for i in range(3)]),
        ("edge:v,1,2", [[i, j] for i in range(3) for j in (3, 4)]),
        ("edge:u,0,2", [[i, j] for i in (0, 1) for j in range(5)]),
        ("edge:u,1,3", [[i, j] for i in range(3) for j in range(5)]),
        ("all", [[i, j] for i in range(3) for j in range(5)]),
        ([[1, 2], [0, 4]], [[1, 2], [0, 4]]),
        ([], []),
        (np.array([[2, 3]]), [[2, 3]]),
    ],
)
def test_selectors(selector: Any, expected: list[list[int]]) -> None:
    found = select_nodes(selector, NODES)
    assert found.shape == (len(expected), 2)
    assert found.tolist() == expected


@pytest.mark.parametrize(
    ("selector", "message"),
    [
        ("corner:0,2", 'is not a node selector of a surface. Use "corner:0,1"'),
        ("edge:w,0", "is not a node selector"),
        ("edge:u", "is not a node selector"),
        ("edge:u,0,4", "asks for 4 rows of 3. Use 1 to 3 rows."),
        ("edge:v,0,0", "asks for 0 rows of 5"),
        ([[1, 5]], r"[1, 5]: lies outside the grid. Use indices from [0, 0] to [2, 4]."),
        ([[-1, 0]], "lies outside the grid"),
        ([[0, 0], [3, 0]], "[3, 0]: lies outside the grid"),
        ([[1]], "is not a list of index pairs"),
        ([["a", "b"]], "is not a list of index pairs"),
        ([[0, 1, 2]], "is not a list of index pairs"),
        ([[0.5, 1]], "is not a list of index pairs"),
        ([[1, 0.5]], "is not a list of index pairs"),
        (7, "is not a list of index pairs"),
    ],
)
def test_selectors_that_are_refused(selector: Any, message: str) -> None:
    with pytest.raises(InputError) as error:
        select_nodes(selector, NODES)
    assert message in str(error.value)
    assert len(error.value.mistakes) == 1


@pytest.mark.parametrize("stiffness", [0.0, -1.0, np.nan, np.inf])
def test_springs_need_a_stiffness(stiffness: float) -> None:
    with pytest.raises(InputError, match=r"stiffness = .*must be positive"):
        Spring("all", stiffness)


def test_all_mistakes_of_a_body_at_once() -> None:
    with pytest.raises(InputError) as error:
        Body(
            "sheet", sheet(NODES), CLOTH, position=(0.0, np.nan, 0.0), rotation=(0, 0, 1), velocity=(1.0, 2.0),
            drag=-1.0, wind_coefficient=np.inf, initial_positions=np.zeros((5, 3, 3)),
            pins=(Pin("corner:0,0"), Pin([[9, 9]])), springs=(Spring("edge:q", 1.0),),
        )  # fmt: skip
    keys = [mistake.key for mistake in error.value.mistakes]
    expected = {"drag", "wind_coefficient", "position", "velocity", "rotation", "initial_positions", "pins.1"}
    assert set(keys) == expected | {"springs.0"}
    assert len(keys) == 8


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_initial_positions_must_be_finite(bad: float) -> None:
    positions = sheet(NODES).positions.copy()
    positions[1, 2, 0] = bad
    with pytest.raises(InputError, match="initial_positions"):
        Body("sheet", sheet(NODES), CLOTH, initial_positions=positions)


def test_rotation_of_length_zero_is_refused() -> None:
    with pytest.raises(InputError, match="rotation"):
        Body("sheet", sheet(NODES), CLOTH, rotation=(0.0, 0.0, 0.0, 0.0))


def test_placed_positions_turn_about_the_origin_then_move() -> None:
    half = np.sqrt(0.5)
    body = Body("sheet", sheet(NODES, (2.0, 1.0)), CLOTH, position=(0.0, 0.0, 5.0), rotation=(0.0, 0.0, half, half))
    assert body.nodes == NODES
    placed = body.placed_positions()
    np.testing.assert_allclose(placed[-1, 0], [0.0, 2.0, 5.0], atol=1e-15)
    np.testing.assert_allclose(placed[0, -1], [-1.0, 0.0, 5.0], atol=1e-15)


def test_initial_positions_win_and_are_copied() -> None:
    start = sheet(NODES).positions + 1.0
    body = Body("sheet", sheet(NODES), CLOTH, position=(9.0, 9.0, 9.0), initial_positions=start)
    placed = body.placed_positions()
    np.testing.assert_array_equal(placed, start)
    placed[:] = 0.0
    np.testing.assert_array_equal(body.placed_positions(), start)


def test_identity_leaves_every_bit() -> None:
    points = arc((7, 5)).positions
    turned = rotate((0.0, 0.0, 0.0, 1.0), points)
    np.testing.assert_array_equal(turned, points)
    assert turned is not points


def test_rotations_keep_lengths_whatever_the_length_of_the_quaternion() -> None:
    points = np.random.default_rng(2).normal(size=(4, 5, 3))
    quaternion = np.array([0.3, -1.2, 0.7, 2.0])
    turned = rotate(quaternion, points)
    np.testing.assert_allclose(np.linalg.norm(turned, axis=-1), np.linalg.norm(points, axis=-1), rtol=1e-14)
    np.testing.assert_allclose(turned, rotate(3.0 * quaternion, points), rtol=1e-13)
    back = rotate(quaternion * [-1, -1, -1, 1], turned)
    np.testing.assert_allclose(back, points, atol=1e-14)
    axis = quaternion[:3] / np.linalg.norm(quaternion[:3])
    np.testing.assert_allclose(turned @ axis, points @ axis, atol=1e-14)
