"""The engines by name."""

from warpdeform.errors import InputError, Mistake
from warpdeform.study.peers.engine import Engine
from warpdeform.study.peers.mujoco_flex import MuJoCo
from warpdeform.study.peers.newton_solvers import NewtonStyle3D, NewtonVBD, NewtonXPBD
from warpdeform.study.peers.ours import Ours
from warpdeform.study.peers.taichi_springs import Taichi

ENGINES: dict[str, Engine] = {
    engine.name: engine for engine in (Ours(), NewtonVBD(), NewtonXPBD(), NewtonStyle3D(), MuJoCo(), Taichi())
}
"""All of them, this engine first."""


def find_engines(names: list[str]) -> list[Engine]:
    """The engines of these names; all of them for an empty list.

    Raises:
        InputError: There is no such engine.
    """
    unknown = [name for name in names if name not in ENGINES]
    if unknown:
        remedy = f"Use some of: {', '.join(ENGINES)}."
        raise InputError([Mistake("--engines", name, "is not known", remedy) for name in unknown])
    return [ENGINES[name] for name in names or ENGINES]
