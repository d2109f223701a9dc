"""`study stability`: the map of a scene, cell by cell."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from warpdeform.device import find_device
from warpdeform.scene import BuiltScene
from warpdeform.study.bench.machine import core_for, describe
from warpdeform.study.bench.table import table
from warpdeform.study.files import StudyFiles
from warpdeform.study.stability.cells import METHODS, Cell, Found, Method, Verdict, run_cell
from warpdeform.study.stability.disorder import DISORDERS
from warpdeform.study.stability.picture import draw_map

Said = Callable[[str], None]

STIFFNESSES = (1e-3, 1e-1, 1e1, 1e3, 1e5, 1e7, 1e9)
TIME_STEPS = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1, 1.0)
DENSITIES = (0.01, 100.0)
"""Densities over the scene's that are tried beside it, from a smooth start."""


@dataclass
class StabilityMap:
    """The result of `study stability`.

    Attributes:
        machine: What it ran on.
        scene: The scene's name.
        nodes: Nodes of each body.
        precision: "float32" or "float64".
        steps: Steps of a run.
        strain: How much longer bodies start along their first axis.
        cells: Where on the map, and what was found there.
    """

    machine: dict[str, Any]
    scene: str
    nodes: list[list[int]]
    precision: str
    steps: int
    strain: float = 0.0
    cells: list[tuple[Cell, Found]] = field(default_factory=list)

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return {**asdict(self), "cells": [_row(cell, found) for cell, found in self.cells]}

    def heading(self) -> str:
        """What was studied, as one line."""
        grids = " and ".join(" x ".join(map(str, nodes)) for nodes in self.nodes)
        strained = f", strained by {self.strain:g}" if self.strain else ""
        return f"{self.scene}{strained}, {grids} nodes, {self.precision}, at most {self.steps} steps"

    def lines(self) -> list[str]:
        """How many cells of each method ended how, and the least that is wrong."""
        rows = []
        for label in dict.fromkeys(cell.method.label for cell, _ in self.cells):
            count = Counter(found.verdict for cell, found in self.cells if cell.method.label == label)
            rows.append([label, *(str(count[verdict]) for verdict in Verdict)])
        key = [f"{verdict.name.lower()}: {verdict.value}" for verdict in Verdict]
        return [self.heading(), "", *table(("method", *(v.name.lower() for v in Verdict)), rows), "", *key]


def cells(
    methods: Sequence[Method],
    stiffnesses: Sequence[float],
    steps: Sequence[float],
    densities: Sequence[float],
    disorders: Sequence[str],
    strain: float = 0.0,
) -> Iterator[Cell]:
    """Every disorder at the scene's density, and further densities from a smooth start."""
    starts = [(1.0, disorder) for disorder in disorders] + [(density, "smooth") for density in densities]
    for method in methods:
        for density, disorder in starts:
            for stiffness in stiffnesses:
                yield from (Cell(method, stiffness, dt, density, disorder, strain) for dt in steps)


def study_stability(
    scene: BuiltScene,
    files: StudyFiles,
    *,
    methods: Sequence[Method] = METHODS,
    stiffnesses: Sequence[float] = STIFFNESSES,
    time_steps: Sequence[float] = TIME_STEPS,
    densities: Sequence[float] = DENSITIES,
    disorders: Iterable[str] = tuple(DISORDERS),
    strain: float = 0.0,
    steps: int = 20,
    core: int | None = None,
    said: Said = lambda line: None,
) -> StabilityMap:
    """Run every cell and write CSV, JSON and picture; the CSV holds what is known at any time.

    Args:
        scene: The scene; its settings count but for integrator, steps and tolerances.
        files: Where to write.
        methods: Columns of the map.
        stiffnesses: Stiffnesses of the first body [N/m], as `stretching_stiffness` has them.
        time_steps: Time steps [s].
        densities: Densities over the scene's, beside 1.
        disorders: How bodies start.
        strain: How much longer bodies start along their first axis; below 0 they are compressed.
        steps: Steps of a run.
        core: Core to stay on.
        said: Told about progress.
    """
    nodes = [list(body.nodes) for body in scene.bodies]
    found = StabilityMap(describe(), scene.name, nodes, scene.settings.precision, steps, strain)
    places = list(cells(methods, stiffnesses, time_steps, densities, tuple(disorders), strain))
    files.start_rows(list(_row(places[0], Found(Verdict.STABLE))))
    label = ""
    with core_for(find_device(scene.settings.device), core):
        for cell in places:
            if cell.method.label != label:
                if label:
                    draw_map(found.cells, found.heading(), files.path(".png"))
                said(label := cell.method.label)
            found.cells.append((cell, run_cell(scene, cell, steps)))
            files.add_row(_row(*found.cells[-1]))
    files.write_json(found.as_dict())
    draw_map(found.cells, found.heading(), files.path(".png"))
    return found


def _row(cell: Cell, found: Found) -> dict[str, Any]:
    return {
        "method": cell.method.label, "stiffness": cell.stiffness, "dt": cell.dt, "density": cell.density,
        "disorder": cell.disorder, **vars(found), "verdict": found.verdict.name.lower(), "why": found.why[:100],
    }  # fmt: skip
