"""Curves as bodies of a simulation: sections, natural shapes, clamps."""

import numpy as np
import pytest

from warpdeform.body import Body, Pin
from warpdeform.errors import InputError
from warpdeform.material import Material
from warpdeform.section import Section
from warpdeform.settings import Settings
from warpdeform.shape import line, sheet
from warpdeform.simulation import Simulation
from warpdeform.track import Track


def test_clamps_twist_a_rod_and_let_it_go() -> None:
    """A rod whose ends are clamped and turned against each other is twisted evenly; let go at one end it is not."""
    turn = Track([0.0, 0.5], [(0, 0, 0)] * 2, [(0, 0, 0, 1), (np.sin(0.5), 0.0, 0.0, np.cos(0.5))])
    pins = (Pin("end:0,2"), Pin("end:1,2", turn, until=0.6))
    material = Material(density=1100.0, youngs_modulus=1e7, poisson_ratio=0.45)
    rod = Body("rod", line((21,), 0.4), material, section=Section.circular(0.004), pins=pins)
    settings = Settings(device="cpu", precision="float64", gravity=(0, 0, 0), newton_iterations=3)
    simulation = Simulation([rod], settings=settings)
    for _ in range(36):
        simulation.step()
    handle = simulation["rod"]
    twists = handle.elasticity.frames.strains(handle.state.x)[2:-2, 0, 2]
    np.testing.assert_allclose(twists, 1.0 / 19, rtol=1e-6)
    stiffness = material.curve(rod.section).torsion
    assert simulation.record().energy.elastic == pytest.approx(0.5 * stiffness * 1.0 / (0.4 * 19 / 20), rel=1e-6)
    for _ in range(6):
        simulation.step()
    assert np.abs(handle.elasticity.frames.strains(handle.state.x)[2:-2, 0, 2]).max() < 1e-6


MISTAKEN = {
    "section of a sheet": ({"shape": sheet((3, 3)), "section": Section.circular(0.01)}, "does not go with a surface"),
    "natural": ({"shape": line((5,)), "natural": line((4,))}, r"has nodes \[4, 1\], the rest shape \[5, 1\]"),
    "director": ({"shape": line((5,)), "director": (0.0, 0.0, 0.0)}, "not all zero"),
}


@pytest.mark.parametrize("name", MISTAKEN)
def test_curves_refuse_what_does_not_fit(name: str) -> None:
    arguments, words = MISTAKEN[name]
    material = {"surface": Material.preset("cotton")}.get(
        arguments["shape"].kind, Material(axial_stiffness=10.0, bending_stiffness=1e-4, linear_density=0.01)
    )
    with pytest.raises(InputError, match=words):
        Body("bad", material=material, **arguments)
