"""The packaged scenes, run to their end: what a person expects of them is true."""

import pytest

from warpdeform.scene import load_scene, scene_names
from warpdeform.scene.checks import CHECKS, History
from warpdeform.scene.play import play
from warpdeform.simulation import Simulation


def test_every_packaged_scene_has_a_check() -> None:
    assert set(CHECKS) == set(scene_names())


@pytest.mark.parametrize("name", sorted(CHECKS))
def test_scene_ends_as_it_should(name: str) -> None:
    history, last = History(), []

    def observe(simulation: Simulation) -> None:
        last[:] = [simulation]
        history.observe(simulation)

    played = play(load_scene(name, {"solver.device": "cpu"}), on_frame=observe)
    assert played.failure is None
    broken = [str(claim) for claim in CHECKS[name](last[0], history) if not claim.holds]
    assert not broken, "\n".join(broken)
