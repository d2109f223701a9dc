"""The ladder on the hanging sheet (design 6.2): errors of the methods at half a second; docs/accuracy.md has the table.

`pytest tests/integrators/test_swing.py -m slow -s` prints it.
"""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from bodies import CLOTH, MEMBRANE, PRECISE, hanging

from warpdeform.body import Pin
from warpdeform.material import Material
from warpdeform.simulation import Simulation

Array = np.ndarray[Any, Any]

SETTINGS = replace(PRECISE, newton_tolerance=1e-5, cg_tolerance=1e-3)


def swing(integrator: str, substeps: int, material: Material = CLOTH, **settings: Any) -> tuple[Array, Simulation]:
    """Positions of a sheet of 33 x 33 nodes, hung by two corners from flat, after 0.5 s."""
    body = hanging((33, 33), material=material, pins=(Pin("corner:0,0"), Pin("corner:1,0")))
    options = {"integrator": integrator, "substeps": substeps} | settings
    simulation = Simulation([body], settings=replace(SETTINGS, **options))
    for _ in range(30):
        simulation.advance_frame()
    return simulation["sheet"].positions(), simulation


def rms(a: Array, b: Array) -> float:
    return float(np.sqrt(np.mean(np.sum((a - b) ** 2, axis=-1))))


@pytest.mark.slow
def test_the_ladder() -> None:
    reference, twice = (swing("verlet", steps)[0] for steps in (256, 128))
    print(f"\nreference: verlet, 256 and 128 steps a frame, apart by {rms(reference, twice):.1e} m", end="")
    membrane = swing("verlet", 256, MEMBRANE)[0]
    rows: dict[str, list[float]] = {}
    ladder = {
        "linear-implicit": {}, "implicit-euler": {}, "bdf2": {}, "sdirk2": {}, "tr-bdf2": {},
        "bdf2, one iteration": {"newton_iterations": 1}, "tr-bdf2, two iterations": {"newton_iterations": 2},
        "energy-momentum": {},
    }  # fmt: skip
    for name, options in ladder.items():
        method = name.split(",")[0]
        material, exact = (MEMBRANE, membrane) if method == "energy-momentum" else (CLOTH, reference)
        runs = [swing(method, steps, material, **options) for steps in (1, 2, 4)]
        rows[name] = [rms(positions, exact) for positions, _ in runs]
        estimates = [simulation.record().error_estimate["time_step"] for _, simulation in runs]
        ratios = [estimate / error for estimate, error in zip(estimates, rows[name], strict=True)]
        print(f"\n{name:24s} error {' '.join(f'{e:.1e}' for e in rows[name])}", end="")
        print(f"   estimate over error {' '.join(f'{ratio:.1f}' for ratio in ratios)}", end="")
    for coarse in range(3):
        assert rows["linear-implicit"][coarse] > rows["implicit-euler"][coarse]
        assert rows["implicit-euler"][coarse] > rows["bdf2"][coarse] > rows["tr-bdf2"][coarse]
