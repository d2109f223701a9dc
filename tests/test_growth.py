"""Keyframes of rest shapes that change, and everything about them that is refused."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from warpdeform.body import Body
from warpdeform.errors import InputError
from warpdeform.growth import Growth
from warpdeform.material import Material
from warpdeform.shape import block, line, sheet
from warpdeform.varying import Varying

CLOTH = Material(areal_density=0.2, membrane_stiffness=1000.0, poisson_ratio=0.3, bending_stiffness=1e-5)


def refusal(call: Callable[..., Any], *arguments: Any, **options: Any) -> str:
    with pytest.raises(InputError) as caught:
        call(*arguments, **options)
    return str(caught.value)


def test_keyframes_are_linear_and_stay_at_their_ends() -> None:
    growth = Growth([1.0, 3.0], [1.0, 0.5], [[0.0, 0.0], [4.0, -2.0]])
    for time, scale, bent in ((0.0, 1.0, 0.0), (1.0, 1.0, 0.0), (2.5, 0.625, 0.75), (9.0, 0.5, 1.0)):
        scales, curvatures = growth.at(time, 2, 3)
        assert scales.tolist() == [scale, scale]
        np.testing.assert_allclose(curvatures, np.array([4.0, -2.0, 0.0]) * bent)
    along = Growth([0.0, 1.0], [[1.0, 1.0], [2.0, 1.0]])
    assert along.at(0.5, 2, 3)[0].tolist() == [1.5, 1.0]
    curl = Growth([0.0], curvature=[[5.0, 0.0, 1.0]])
    assert [part.tolist() for part in curl.at(0.0, 2, 3)] == [[1.0, 1.0], [5.0, 0.0, 1.0]]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (([],), "times = []: does not have the right shape"),
        (([1.0, 0.0], [1.0, 1.0]), "times = [1.0, 0.0]: must increase from keyframe to keyframe"),
        (([[0.0, 1.0]],), "times"),
        (([0.0, 1.0], [1.0]), "scale = [1.0]: has 1 entries for 2 times"),
        (([0.0, 1.0], [1.0, 0.0]), "scale = [1.0, 0.0]: must lie between 0.05 and 20"),
        (([0.0, 1.0], [1.0, np.nan]), "scale"),
        (([0.0, 1.0], None, [[1.0, 0.0]]), "curvature = [[1.0, 0.0]]: has 1 entries for 2 times"),
        (([0.0, 1.0], None, [[1.0, 0.0], [1.0]]), "curvature"),
        (([0.0], None, None, [[0.0, 2.0]] * np.ones((2, 2))), "where: must be shares from 0 to 1"),
        (([0.0], None, None, "all"), 'where = "all": is neither an array of numbers nor a function'),
    ],
)
def test_bad_keyframes_are_refused(arguments: tuple[Any, ...], said: str) -> None:
    assert said in refusal(Growth, *arguments)


def test_all_mistakes_are_said_at_once() -> None:
    said = refusal(Growth, [1.0, 0.0], [1.0], [[1.0]])
    assert [line.split(" ")[0] for line in said.splitlines()] == ["scale", "curvature", "times"]


@pytest.mark.parametrize(
    ("growth", "said"),
    [
        (
            Growth([0.0], [[1.0, 1.0, 1.1]]),
            "growth.scale = [[1.0, 1.0, 1.1]]: has 3 factors for each time, where a surface",
        ),
        (Growth([0.0], curvature=[[1.0]]), "growth.curvature = [[1.0]]: has 1 numbers for each time"),
        (
            Growth([0.0], where=np.ones((3, 3))),
            "growth.where: has the shape 3 x 3, which is that of neither nodes nor cells",
        ),
        (Growth([0.0], where=lambda u, v: 2 * u), "growth.where: must be shares from 0 to 1"),
    ],
)
def test_what_does_not_fit_the_body_is_refused(growth: Growth, said: str) -> None:
    assert said in refusal(Body, "leaf", sheet((5, 4)), CLOTH, growth=growth)


@pytest.mark.parametrize(
    ("growth", "said"),
    [
        (
            Growth([0.0], [[1.0, 1.1]]),
            "growth.scale = [[1.0, 1.1]]: has 2 factors for each time, where a curve has one",
        ),
        (Growth([0.0], curvature=[[1.0]]), "has 1 numbers for each time, where a curve has two curvatures and a twist"),
        (Growth([0.0], where=np.ones((3, 3))), "growth.where: has the shape 3 x 3"),
    ],
)
def test_what_does_not_fit_a_curve_is_refused(growth: Growth, said: str) -> None:
    wire = Material(linear_density=0.1, axial_stiffness=50.0, bending_stiffness=0.1)
    assert said in refusal(Body, "hair", line((5,)), wire, growth=growth)


@pytest.mark.parametrize(
    ("growth", "said"),
    [
        (Growth([0.0], [[1.0, 1.1]]), "growth.scale = [[1.0, 1.1]]: has 2 factors for each time, where a solid has 3"),
        (Growth([0.0], curvature=[[1.0, 0.0]]), "has 2 numbers for each time, where a solid has no natural curvature"),
        (Growth([0.0], where=np.ones((3, 3))), "growth.where: has the shape 3 x 3"),
    ],
)
def test_what_does_not_fit_a_solid_is_refused(growth: Growth, said: str) -> None:
    rubber = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3)
    assert said in refusal(Body, "jelly", block((3, 4, 5)), rubber, growth=growth)
    Body("jelly", block((3, 4, 5)), rubber, growth=Growth([0.0], [[1.0, 1.0, 1.2]], where=lambda u, v, w: w))


def test_what_does_not_bend_does_not_curl() -> None:
    curl = Growth([0.0], curvature=[[5.0, 0.0]])
    membrane = replace(CLOTH, bending_stiffness=None)
    assert "growth.curvature = [[5.0, 0.0]]: needs a surface that bends" in refusal(
        Body, "leaf", sheet((5, 4)), membrane, growth=curl
    )
    Body("leaf", sheet((5, 4)), membrane, growth=Growth([0.0], [1.1], [[0.0, 0.0]]))
    string = Material(linear_density=0.1, axial_stiffness=50.0)
    assert "growth.curvature = [[5.0, 0.0]]: needs a curve that bends" in refusal(
        Body, "hair", line((5,)), string, growth=curl
    )
    Body("hair", line((5,)), string, growth=Growth([0.0], [1.1]))
    Body("hair", line((5,)), replace(string, bending_stiffness=0.1), growth=curl)


def test_shares_of_places() -> None:
    grid = sheet((5, 4)).grid
    cells, nodes = Growth([0.0]).shares(grid)
    assert cells.shape == (4, 3)
    assert nodes.min() == nodes.max() == 1.0
    cells, nodes = Growth([0.0], where=Varying(lambda u, v: u)).shares(grid)
    np.testing.assert_allclose(nodes[:, 0], np.linspace(0, 1, 5))
    np.testing.assert_allclose(cells[:, 0], [0.125, 0.375, 0.625, 0.875])
