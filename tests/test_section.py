"""Cross-sections against the textbook."""

import math

import pytest

from warpdeform.errors import InputError
from warpdeform.section import Section


def test_a_disc() -> None:
    disc = Section.circular(0.002)
    assert disc.area == pytest.approx(math.pi * 4e-6)
    assert disc.moments == pytest.approx((math.pi * 0.25 * 16e-12,) * 2)
    assert disc.torsion == pytest.approx(sum(disc.moments))
    assert disc.radius == pytest.approx(0.002)
    assert disc.extent == (0.004, 0.004)


@pytest.mark.parametrize(
    ("ratio", "coefficient"), [(1.0, 0.1406), (1.5, 0.1958), (2.0, 0.2287), (4.0, 0.2808), (10.0, 0.3123)]
)
def test_torsion_of_a_rectangle(ratio: float, coefficient: float) -> None:
    """J = coefficient a b^3 (Timoshenko and Goodier, table in article 109)."""
    for width, height in ((ratio * 0.01, 0.01), (0.01, ratio * 0.01)):
        section = Section.rectangular(width, height)
        assert section.torsion == pytest.approx(coefficient * ratio * 1e-8, rel=5e-4)


def test_a_rectangle_bends_hardest_about_the_director_along_its_short_side() -> None:
    section = Section.rectangular(width=0.03, height=0.01)
    assert section.area == pytest.approx(3e-4)
    assert section.moments == pytest.approx((0.03 * 0.01**3 / 12, 0.01 * 0.03**3 / 12))
    assert section.extent == (0.03, 0.01)
    assert math.pi * section.radius**2 == pytest.approx(section.area)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf, "1", None, True])
def test_bad_lengths_are_refused_with_their_unit(bad: object) -> None:
    with pytest.raises(InputError, match=r"radius.*must be a positive number.*Use m"):
        Section.circular(bad)
    with pytest.raises(InputError) as caught:
        Section.rectangular(bad, -2.0)
    assert [mistake.key for mistake in caught.value.mistakes] == ["width", "height"]
