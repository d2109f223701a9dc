"""Node selectors of curves and solids; those of surfaces are in test_body.py."""

from typing import Any

import numpy as np
import pytest

from warpdeform.errors import InputError
from warpdeform.selectors import select_nodes

STRANDS = (5, 3)
BLOCK = (3, 4, 5)


def box(*ranges: Any) -> list[list[int]]:
    index = np.meshgrid(*ranges, indexing="ij")
    return np.stack(index, axis=-1).reshape(-1, len(ranges)).tolist()  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("selector", "expected"),
    [
        ("end:0", [[0, 0], [0, 1], [0, 2]]),
        ("end:1", [[4, 0], [4, 1], [4, 2]]),
        ("end:0,2", box([0, 1], range(3))),
        ("end:1,5", box(range(5), range(3))),
        ("all", box(range(5), range(3))),
        ([[2, 1], [4, 0]], [[2, 1], [4, 0]]),
        ([2], [[2, 0], [2, 1], [2, 2]]),
        (np.array([0, 4]), box([0, 4], range(3))),
        ([], []),
    ],
)
def test_selectors_of_curves(selector: Any, expected: list[list[int]]) -> None:
    found = select_nodes(selector, STRANDS, "curve")
    assert found.shape == (len(expected), 2)
    assert found.tolist() == expected


def test_indices_name_the_nodes_of_a_single_strand() -> None:
    assert select_nodes([0, 4], (5, 1), "curve").tolist() == [[0, 0], [4, 0]]


@pytest.mark.parametrize(
    ("selector", "expected"),
    [
        ("corner:0,0,1", [[0, 0, 4]]),
        ("corner:1,1,0", [[2, 3, 0]]),
        ("edge:u,0,1", box(range(3), [0], [4])),
        ("edge:v,1,0", box([2], range(4), [0])),
        ("edge:w,1,1", box([2], [3], range(5))),
        ("face:u,0", box([0], range(4), range(5))),
        ("face:v,1", box(range(3), [3], range(5))),
        ("face:w,1,2", box(range(3), range(4), [3, 4])),
        ("all", box(range(3), range(4), range(5))),
        ([[1, 2, 3]], [[1, 2, 3]]),
    ],
)
def test_selectors_of_solids(selector: Any, expected: list[list[int]]) -> None:
    assert select_nodes(selector, BLOCK, "solid").tolist() == expected


@pytest.mark.parametrize(
    ("kind", "nodes", "selector", "message"),
    [
        ("curve", STRANDS, "corner:0,0", 'is not a node selector of a curve. Use "end:0"'),
        ("curve", STRANDS, "edge:u,0", "is not a node selector of a curve"),
        ("curve", STRANDS, "end:2", "is not a node selector of a curve"),
        ("curve", STRANDS, "end:0,6", "asks for 6 nodes of 5. Use 1 to 5 nodes."),
        ("curve", STRANDS, [5], "[5, 0]: lies outside the grid. Use indices from [0, 0] to [4, 2]."),
        ("curve", STRANDS, [[0, 3]], "[0, 3]: lies outside the grid"),
        ("curve", STRANDS, [[0], [0, 1]], "is not a list of indices"),
        ("solid", BLOCK, "corner:0,0", 'is not a node selector of a solid. Use "corner:0,0,1"'),
        ("solid", BLOCK, "edge:u,0", "is not a node selector of a solid"),
        ("solid", BLOCK, "face:x,0", "is not a node selector of a solid"),
        ("solid", BLOCK, "face:v,0,5", "asks for 5 layers of 4. Use 1 to 4 layers."),
        ("solid", BLOCK, [[0, 0]], "is not a list of index triples"),
        ("solid", BLOCK, [[0, 0, 5]], "Use indices from [0, 0, 0] to [2, 3, 4]."),
        ("surface", STRANDS, "end:0", "is not a node selector of a surface"),
        ("surface", STRANDS, "face:u,0", "is not a node selector of a surface"),
        ("surface", STRANDS, "edge:u,0,1,1", "is not a node selector of a surface"),
        ("surface", STRANDS, "corner:0,0,1", "is not a node selector of a surface"),
        ("surface", STRANDS, [0, 1], "is not a list of index pairs"),
    ],
)
def test_bad_selectors_say_what_there_is(kind: str, nodes: tuple[int, ...], selector: Any, message: str) -> None:
    with pytest.raises(InputError) as error:
        select_nodes(selector, nodes, kind)
    assert message in str(error.value)
    assert len(error.value.mistakes) == 1
