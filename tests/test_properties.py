"""Random small scenes: each is refused with a clear message, or its frames are finite, or it is stopped with a reason.

Scenes are drawn from a few sets of terms, so that few kernels are compiled: curves, surfaces and solids, obstacles with
friction, wind, springs, pins; in one scene of five a value makes no sense. `WARPDEFORM_SEED` draws others, and
`WARPDEFORM_SCENES` more of them; the seed stands in the test's name.
"""

import os
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from warpdeform.errors import InputError, SimulationFailure
from warpdeform.scene import load_scene
from warpdeform.scene.play import simulation_of
from warpdeform.simulation import Simulation

SEED = int(os.environ.get("WARPDEFORM_SEED", "1987"))
SCENES = int(os.environ.get("WARPDEFORM_SCENES", "500"))
FRAMES = 3

Table = dict[str, Any]


def log_uniform(low: float, high: float) -> st.SearchStrategy[float]:
    return st.floats(np.log(low), np.log(high)).map(lambda x: float(f"{np.exp(x):.3g}"))


def vector(most: float) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(-most, most).map(lambda x: float(f"{x:.3g}")), min_size=3, max_size=3)


PLACED = {"position": vector(2.0), "rotation": vector(180.0), "velocity": vector(20.0), "drag": log_uniform(1e-3, 10.0)}
RUBBER = st.fixed_dictionaries(
    {
        "density": log_uniform(10.0, 1e4),
        "youngs_modulus": log_uniform(1e2, 1e6),
        "poisson_ratio": st.sampled_from([0.0, 0.3, 0.45]),
    }
)
CLOTH = st.fixed_dictionaries(
    {
        "areal_density": log_uniform(0.05, 5.0),
        "membrane_stiffness": log_uniform(1.0, 1e4),
        "poisson_ratio": st.sampled_from([0.0, 0.3]),
        "bending_stiffness": log_uniform(1e-6, 1e-2),
    }
)
COUNT = st.integers(2, 7)
SURFACE = st.fixed_dictionaries(
    {
        "nodes": st.lists(COUNT, min_size=2, max_size=2),
        "shape": st.fixed_dictionaries(
            {"kind": st.just("sheet"), "size": st.lists(log_uniform(0.05, 5.0), min_size=2, max_size=2)}
        ),
        "material": CLOTH,
    },
    optional={
        **PLACED,
        "pins": st.lists(st.sampled_from(["corner:0,0", "corner:1,1", "edge:u,0", "edge:v,1", "all"]), max_size=2),
        "springs": st.lists(
            st.fixed_dictionaries({"nodes": st.just("corner:0,1"), "stiffness": log_uniform(0.1, 1e3)}), max_size=1
        ),
    },
)
CURVE = st.fixed_dictionaries(
    {
        "nodes": st.lists(st.integers(2, 12), min_size=1, max_size=1),
        "shape": st.fixed_dictionaries({"kind": st.just("line"), "length": log_uniform(0.1, 5.0)}),
        "section": st.fixed_dictionaries({"radius": log_uniform(1e-3, 0.05)}),
        "material": RUBBER,
    },
    optional={**PLACED, "pins": st.lists(st.sampled_from(["end:0", "end:1", "end:0,2"]), max_size=2)},
)
SOLID = st.fixed_dictionaries(
    {
        "nodes": st.lists(st.integers(2, 4), min_size=3, max_size=3),
        "shape": st.fixed_dictionaries(
            {"kind": st.just("block"), "size": st.lists(log_uniform(0.05, 2.0), min_size=3, max_size=3)}
        ),
        "material": RUBBER,
    },
    optional={**PLACED, "pins": st.lists(st.sampled_from(["face:u,0", "face:w,1"]), max_size=1)},
)
OBSTACLE = st.one_of(
    st.fixed_dictionaries({"kind": st.just("plane")}),
    st.fixed_dictionaries({"kind": st.just("sphere"), "radius": log_uniform(0.05, 2.0)}),
    st.fixed_dictionaries({"kind": st.just("box"), "size": st.lists(log_uniform(0.1, 2.0), min_size=3, max_size=3)}),
    st.fixed_dictionaries(
        {"kind": st.just("capsule"), "radius": log_uniform(0.05, 1.0), "height": log_uniform(0.1, 2.0)}
    ),
).flatmap(
    lambda table: st.fixed_dictionaries(
        {key: st.just(value) for key, value in table.items()},
        optional={
            "position": vector(2.0),
            "rotation": vector(180.0),
            "friction": st.floats(0.0, 1.0),
            "path": st.fixed_dictionaries(
                {"times": st.just([0.0, 0.2]), "displacements": st.tuples(vector(0.1), vector(5.0)).map(list)}
            ),
        },
    )
)
SOLVER = st.fixed_dictionaries(
    {
        "integrator": st.sampled_from(
            ["bdf2", "tr-bdf2", "implicit-euler", "linear-implicit", "verlet", "terzopoulos"]
        ),
        "device": st.just("cpu"),
    },
    optional={
        "newton_iterations": st.integers(0, 3),
        "cg_tolerance": log_uniform(1e-4, 0.5),
        "cg_iterations": st.integers(1, 200),
        "preconditioner": st.sampled_from(["auto", "none", "jacobi", "block-jacobi"]),
        "substeps": st.integers(1, 3),
    },
)
SCENE = st.fixed_dictionaries(
    {
        "scene": st.fixed_dictionaries(
            {"fps": st.sampled_from([60.0, 240.0])},
            optional={"gravity": st.sampled_from([[0.0, 0.0, 0.0], [0.0, -100.0, 3.0], [0.0, 0.0, -9.81]])},
        ),
        "solver": SOLVER,
        "body": st.lists(st.one_of(SURFACE, CURVE, SOLID), min_size=1, max_size=2),
    },
    optional={
        "obstacle": st.lists(OBSTACLE, min_size=1, max_size=2),
        "wind": st.fixed_dictionaries({"velocity": vector(30.0)}),
    },
)
SENSELESS = st.sampled_from(
    [
        float("nan"),
        float("inf"),
        -float("inf"),
        0.0,
        -1.0,
        1e300,
        1e-300,
        10**30,
        -3,
        "nonsense",
        "",
        [],
        {},
        [1.0],
        True,
    ]
)


def leaves(table: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Paths of all values that are no tables."""
    if isinstance(table, dict):
        return [leaf for key, value in table.items() for leaf in leaves(value, (*path, key))]
    if isinstance(table, list) and table and not isinstance(table[0], str):
        return [path, *(leaf for k, value in enumerate(table) for leaf in leaves(value, (*path, k)))]
    return [path]


@st.composite
def spoilt(draw: Any) -> Table:
    """A scene with one value that makes no sense."""
    scene: Table = draw(SCENE)
    path = draw(st.sampled_from([leaf for leaf in leaves(scene) if leaf[-1] != "device"]))
    inner = scene
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = draw(SENSELESS)
    return scene


def toml(value: Any) -> str:
    """A value as TOML, tables inline."""
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{key} = {toml(item)}" for key, item in value.items()) + " }"
    if isinstance(value, list):
        return "[" + ", ".join(toml(item) for item in value) + "]"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else repr(value)


def assert_finite(simulation: Simulation) -> None:
    for handle in simulation.bodies:
        assert np.isfinite(handle.positions()).all()
        assert np.isfinite(handle.velocities()).all()


def assert_clear(error: InputError) -> None:
    for mistake in error.mistakes:
        assert mistake.key
        assert mistake.problem
        assert mistake.remedy.endswith((".", "?"))
    assert all(": " in line for line in str(error).splitlines())


def outcome(scene: Table, file: Path) -> str:
    """How a scene ends: "refused", "stopped" or "ran"; unclear messages and frames that are not finite fail."""
    file.write_text("\n".join(f"{key} = {toml(value)}" for key, value in scene.items()), encoding="utf-8")
    try:
        simulation = simulation_of(load_scene(file))
    except InputError as error:
        assert_clear(error)
        return "refused"
    assert_finite(simulation)
    for _ in range(FRAMES):
        try:
            simulation.advance_frame()
        except SimulationFailure as failure:
            remedy = failure.remedy
            assert_finite(simulation)
            return "stopped" if remedy.startswith("Use ") else remedy
        assert_finite(simulation)
    return "ran"


def ends(strategy: st.SearchStrategy[Table], number: int, count: int, folder: Path) -> Counter[str]:
    """How so many random scenes end."""
    ended: Counter[str] = Counter()

    @seed(number)
    @settings(
        max_examples=count, deadline=None, database=None, print_blob=True, suppress_health_check=list(HealthCheck)
    )
    @given(strategy)
    def check(scene: Table) -> None:
        how = outcome(scene, folder / "random.toml")
        assert how in ("refused", "stopped", "ran")
        ended[how] += 1

    check()
    print(f"seed {number}: {dict(ended)}")
    return ended


@pytest.mark.parametrize("number", range(SEED, SEED + 4))
def test_random_scenes_are_finite_or_stopped_with_a_reason(number: int, tmp_path: Path) -> None:
    ended = ends(SCENE, number, SCENES // 5, tmp_path)
    assert ended["ran"] > 0.5 * ended.total()


@pytest.mark.parametrize("number", [SEED])
def test_random_scenes_with_a_senseless_value_are_refused_or_finite(number: int, tmp_path: Path) -> None:
    ended = ends(spoilt(), number, SCENES // 5, tmp_path)
    assert ended["refused"] > 0.3 * ended.total()
