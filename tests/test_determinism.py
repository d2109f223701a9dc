"""Bit-identical runs: every kind of body in either precision, whatever ran before, in this process or another."""

import hashlib
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bodies import REAL_TIME, busy, hanging, run

from warpdeform.body import Body, Pin
from warpdeform.material import Material
from warpdeform.obstacle import Obstacle
from warpdeform.section import Section
from warpdeform.shape import block, line
from warpdeform.simulation import Simulation
from warpdeform.track import Track

RUBBER = Material(density=1000.0, youngs_modulus=1e5, poisson_ratio=0.3)
METHODS = ("bdf2", "tr-bdf2", "verlet")
PRECISIONS = ("float32", "float64")


def bits(method: str, precision: str) -> str:
    """A fingerprint of where a rope, a sheet and a cube are, a few steps after they met the ground."""
    bodies = [
        Body("rope", line((17,), 0.5), RUBBER, section=Section.circular(0.01), pins=(Pin("end:0"),)),
        hanging((9, 10), pins=(Pin("corner:0,0"),)),
        Body("cube", block((3, 4, 4), (0.1, 0.1, 0.1)), RUBBER, velocity=(0.0, 0.0, -2.0)),
    ]
    ground = Obstacle("plane", track=Track.fixed((0.0, 0.0, -0.05)), friction=0.3)
    settings = replace(REAL_TIME, integrator=method, precision=precision, fps=120.0)
    simulation = Simulation(bodies, obstacles=[ground], settings=settings)
    return hashlib.sha256(b"".join(np.ascontiguousarray(array).tobytes() for array in run(simulation, 6))).hexdigest()


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("method", METHODS)
def test_runs_do_not_depend_on_what_ran_before(method: str, precision: str) -> None:
    first = bits(method, precision)
    beside = busy(precision=precision)
    run(beside, 2)
    assert bits(method, precision) == first
    assert bits("implicit-euler", precision) != first


def test_another_process_has_the_same_bits() -> None:
    program = "import test_determinism as t; print(*(t.bits(m, p) for m in t.METHODS for p in t.PRECISIONS))"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {[*sys.path, str(Path(__file__).parent)]!r}; {program}"],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    here = [bits(method, precision) for method in METHODS for precision in PRECISIONS]
    assert done.stdout.splitlines()[-1].split() == here
