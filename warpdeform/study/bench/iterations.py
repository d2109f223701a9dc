"""`bench iterations`: how many iterations conjugate gradient needs with multigrid, over scenes, sizes and materials."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from warpdeform.scene import Override
from warpdeform.scene.build import BuiltScene
from warpdeform.scene.measure import folds
from warpdeform.scene.play import simulation_of
from warpdeform.study.bench.machine import describe
from warpdeform.study.bench.runs import scene_of
from warpdeform.study.bench.table import Target, table, targets_lines

SCENES = ("hanging", "flag", "carpet")
SIZES = (17, 33, 65)
STRETCHING = (1e2, 1e3, 1e5)
BENDING = (1e-5, 1e-2)
FOLDED = 60.0
"""Angle between neighbouring cells from which on a sheet counts as folded [degrees]."""
MOST_ITERATIONS = 40.0
TOLERANCES = {"float64": 1e-4, "float32": 1e-3}
_HEADER = ("scene", "nodes", "stretching N/m", "bending N m", "steps", "folds, degrees", "mean CG", "most CG")


@dataclass(frozen=True)
class Count:
    """Iterations of one run, up to the first fold.

    Attributes:
        scene: Name of the scene.
        nodes: Nodes along u and v.
        stretching: Membrane stiffness [N/m]; None leaves the scene's material as it is.
        bending: Bending stiffness [N m]; None likewise.
        steps: Steps until the sheet was folded, or all.
        fold: Largest angle between neighbouring cells that was met [degrees].
        mean: Conjugate gradient iterations of a linear solve, mean.
        most: The same, largest.
    """

    scene: str
    nodes: tuple[int, ...]
    stretching: float | None
    bending: float | None
    steps: int
    fold: float
    mean: float
    most: int


@dataclass(frozen=True)
class Counts:
    """The result of `bench iterations`."""

    machine: dict[str, Any]
    precision: str
    tolerance: float
    runs: tuple[Count, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The table as people read it."""
        head = f"multigrid, {self.precision}, to {self.tolerance:g}, until cells meet at more than {FOLDED:g} degrees"
        return [head, "", *table(_HEADER, [_row(run) for run in self.runs]), "", *targets_lines(self.targets)]


def bench_iterations(
    sizes: Sequence[int] = SIZES,
    *,
    scenes: Sequence[str] = SCENES,
    steps: int = 36,
    precision: str = "float64",
    overrides: Iterable[Override] = (),
    said: Callable[[str], None] = lambda line: None,
) -> Counts:
    """Run scenes with multigrid alone and count.

    Args:
        sizes: Nodes along the longer side of the first body; the other side follows its shape.
        scenes: Names or paths; the first body of each is a sheet.
        steps: Steps of a run at most.
        precision: "float64", solved to 1e-4, or "float32", to 1e-3.
        overrides: Further values of the scene files.
        said: Told about progress.

    Raises:
        InputError: A scene or an override is not in order.
    """
    overrides, tolerance = list(overrides), TOLERANCES[precision]
    solver = {
        "solver.precision": precision,
        "solver.preconditioner": "multigrid",
        "solver.cg_tolerance": tolerance,
        "solver.newton_iterations": 1,
        "solver.device": "cpu",
    }
    runs = []
    for scene in scenes:
        materials: list[tuple[float, float] | None] = [None]
        if scene == "hanging":
            materials = [(stretching, bending) for stretching in STRETCHING for bending in BENDING]
        for side in sizes:
            for material in materials:
                said(f"{scene}, {side}, {material or 'its own material'}")
                built = scene_of(scene, side, solver | _material(material), overrides, keep_aspect=True)
                runs.append(_counted(scene, built, material, steps))
    targets = [Target(f"{scene}, {precision}", "iterations", _most(runs, scene), MOST_ITERATIONS) for scene in scenes]
    return Counts(describe(), precision, tolerance, tuple(runs), tuple(targets))


def _material(material: tuple[float, float] | None) -> dict[str, object]:
    if material is None:
        return {}
    keys = ("body.0.material.membrane_stiffness", "body.0.material.bending_stiffness")
    return dict(zip(keys, material, strict=True))


def _counted(scene: str, built: BuiltScene, material: tuple[float, float] | None, steps: int) -> Count:
    simulation = simulation_of(built)
    body = simulation.bodies[0]
    found: list[float] = []
    fold = 0.0
    for _ in range(steps):
        record = simulation.step()
        worst = folds(body.positions())
        if worst > FOLDED:
            break
        fold = max(fold, worst)
        found.append(record.cg_iterations / record.newton_iterations)
    stretching, bending = material or (None, None)
    most = int(np.ceil(max(found, default=0.0)))
    return Count(scene, body.nodes, stretching, bending, len(found), fold, float(np.mean(found or [0.0])), most)


def _row(run: Count) -> list[str]:
    def number(value: float | None) -> str:
        return "its own" if value is None else f"{value:g}"

    nodes = " x ".join(map(str, run.nodes))
    material = (number(run.stretching), number(run.bending))
    return [run.scene, nodes, *material, str(run.steps), f"{run.fold:.0f}", f"{run.mean:.1f}", str(run.most)]


def _most(runs: Sequence[Count], scene: str) -> float:
    return float(max(run.most for run in runs if run.scene == scene))
