"""Weights and frames of curves: sections, the paper's weights, and everything that must be refused."""

from typing import Any

import numpy as np
import pytest
from curves import FLAT, PAPER, ROD, ROUND, RUBBER, STRING, helix, line, ring, uneven

from warpdeform.errors import InputError
from warpdeform.forces.curve_coefficients import (
    binormals,
    curve_stiffness,
    material_frames,
    material_strains,
    node_lengths,
    segment_lengths,
    transported,
)
from warpdeform.grid import ParameterGrid
from warpdeform.material import Material
from warpdeform.section import Section

Array = np.ndarray[Any, Any]


def grid(rest: Array, closed: bool = False) -> ParameterGrid:
    segments = max(rest.shape[0] - (not closed), 1)
    return ParameterGrid(rest.shape[:2], (1.0 / segments, 1.0), (closed, False), 1)


def test_weights_are_the_stiffness_of_the_section_over_rest_lengths() -> None:
    rest = uneven(7, 2)
    stiffness = curve_stiffness(grid(rest), rest, RUBBER, FLAT)
    lengths = segment_lengths(grid(rest), rest)
    np.testing.assert_allclose(stiffness.axial**2, 1e6 * FLAT.area / lengths**3)
    share = node_lengths(grid(rest), lengths)[1:-1]
    shear = 1e6 / 2.6
    for k, law in enumerate((1e6 * FLAT.moments[0], 1e6 * FLAT.moments[1], shear * FLAT.torsion)):
        np.testing.assert_allclose(stiffness.bending[1:-1, :, k] ** 2, law / share)
    assert not stiffness.bending[[0, -1]].any()
    assert stiffness.floor == pytest.approx(1e-6 * lengths.min() ** 2)


def test_every_strand_may_have_a_section_of_its_own() -> None:
    rest = line(7, 3)
    thin = Section.circular(0.05)
    many = curve_stiffness(grid(rest), rest, RUBBER, [ROUND, thin, ROUND])
    for strand, section in ((0, ROUND), (1, thin)):
        one = curve_stiffness(grid(rest), rest, RUBBER, section)
        np.testing.assert_array_equal(many.axial[:, strand], one.axial[:, strand])
        np.testing.assert_array_equal(many.bending[:, strand], one.bending[:, strand])
    assert many.strains == 2
    assert curve_stiffness(grid(rest), rest, RUBBER, [ROUND, FLAT, ROUND]).strains == 3
    with pytest.raises(InputError, match=r"section = 2.*another number of strands: 3"):
        curve_stiffness(grid(rest), rest, RUBBER, [ROUND, ROUND])


def test_the_papers_weights_are_those_of_a_rod() -> None:
    """EA = 2 eta and EI = xi where the parameter is the rest length (design 1.4)."""
    rest = line(7, 2)
    unit = rest / np.linalg.norm(rest[-1] - rest[0], axis=-1)[:, None]
    rod = Material(linear_density=0.1, axial_stiffness=2 * PAPER.eta, bending_stiffness=PAPER.xi)
    ours, theirs = (curve_stiffness(grid(unit), unit, material) for material in (rod, PAPER))
    np.testing.assert_allclose(theirs.axial, ours.axial)
    np.testing.assert_allclose(theirs.bending, ours.bending)


def test_the_variant_is_what_the_curve_needs() -> None:
    straight, bent = line(7, 2), helix(7, 2)
    assert curve_stiffness(grid(straight), straight, STRING).strains == 0
    assert curve_stiffness(grid(bent), bent, STRING).strains == 0
    assert curve_stiffness(grid(straight), straight, ROD).strains == 2
    assert curve_stiffness(grid(bent), bent, ROD).strains == 3
    assert curve_stiffness(grid(bent), bent, ROD, natural=straight).strains == 2
    assert curve_stiffness(grid(straight), straight, ROD, natural=bent).strains == 3
    assert curve_stiffness(grid(straight), straight, ROD, framed=True).strains == 3


def test_frames_without_a_director_are_parallel_along_the_curve() -> None:
    rest = helix(17, 3)
    frames = material_frames(grid(rest), rest)
    t, d = frames.tangents, frames.directors
    np.testing.assert_allclose(np.sum(t * d, -1), 0.0, atol=1e-15)
    np.testing.assert_allclose(np.sum(d * d, -1), 1.0, rtol=1e-15)
    np.testing.assert_allclose(transported(d[:-1], t[:-1], t[1:]), d[1:], atol=1e-14)
    strains = material_strains(grid(rest), rest, frames)
    np.testing.assert_allclose(strains[..., 2], 0.0, atol=1e-14)
    kb = binormals(grid(rest), rest)
    np.testing.assert_allclose(np.linalg.norm(strains[..., :2], axis=-1), np.linalg.norm(kb, axis=-1), rtol=1e-13)
    # A plane curve bends about one axis: the director that starts normal to its plane stays so.
    flat = helix(17, 1) * [1.0, 1.0, 0.0]
    found = material_strains(grid(flat), flat, material_frames(grid(flat), flat, (0.0, 0.0, 1.0)))
    assert np.abs(found[1:-1, :, 0]).min() > 0.2
    np.testing.assert_allclose(found[..., 1], 0.0, atol=1e-14)


def test_a_closed_curve_has_its_holonomy_as_natural_twist() -> None:
    rest = ring(16, 1)
    strains = material_strains(grid(rest, True), rest, material_frames(grid(rest, True), rest))
    np.testing.assert_allclose(strains[1:, :, 2], 0.0, atol=1e-14)
    assert abs(strains[0, 0, 2]) > 0.01


@pytest.mark.parametrize(
    ("rest", "closed", "options", "message"),
    [
        (line(1, 2), False, {}, r"nodes = 1: are too few for a curve\. Use at least 2"),
        (ring(3, 2), True, {}, r"nodes = 3: are too few for a closed curve\. Use at least 4"),
        (line(5, 2)[[0, 1, 1, 2, 3]], False, {}, r"shape = \[1, 0\]: has a segment without length"),
        (line(5, 2), False, {"natural": line(6, 2)}, r"natural = \[6, 2, 3\]: has another shape.*\(5, 2, 3\)"),
        (line(5, 2), False, {"natural": line(5, 2) * [1, 1, np.nan]}, r"natural.*not finite"),
    ],
)
def test_shapes_that_are_no_curves_are_refused(rest: Array, closed: bool, options: Any, message: str) -> None:
    with pytest.raises(InputError, match=message):
        curve_stiffness(grid(rest, closed), rest, ROD, **options)


@pytest.mark.parametrize(
    ("director", "message"),
    [
        ((1.0, 0.0), r"director = \[2\]: is the shape of no set of directors"),
        (np.ones((3, 3)), "is the shape of no set of directors"),
        ((2.0, 0.0, 0.0), r"lies along the curve at \[0\]"),
        (np.tile([1e-9, 0.0, 0.0], (4, 2, 1)), r"lies along the curve at \[0, 0\]"),
        ((0.0, 0.0, 0.0), "lies along the curve"),
    ],
)
def test_directors_that_are_none_are_refused(director: Any, message: str) -> None:
    rest = np.linspace(0, 1, 5)[:, None, None] * np.array([1.0, 0.0, 0.0]) + np.zeros((1, 2, 1))
    with pytest.raises(InputError, match=message):
        material_frames(grid(rest), rest, director)
