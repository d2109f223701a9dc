"""`bench terms`: what each term of a body costs in time, memory and compilation; absent ones cost nothing."""

import json
import shutil
import statistics
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from warpdeform.device import find_device
from warpdeform.scene import load_scene
from warpdeform.scene.play import simulation_of
from warpdeform.simulation import Simulation
from warpdeform.study.bench.machine import core_for, describe
from warpdeform.study.bench.runs import time_steps
from warpdeform.study.bench.start import first_frame
from warpdeform.study.bench.table import table

SCENE = "hanging"
"""The scene whose values every variant replaces."""
SOLVER = {
    "solver.newton_iterations": 1,
    "solver.cg_iterations": 10,
    "solver.cg_tolerance": 1e-12,
    "solver.preconditioner": "block-jacobi",
    "solver.device": "cpu",
    "scene.gravity": [0.0, 0.0, 0.0],
}
"""One Newton iteration of ten iterations of conjugate gradient: every variant does the same work."""
_MEMBRANE = {"areal_density": 0.2, "membrane_stiffness": 1000.0, "poisson_ratio": 0.3}
_DOWN = [0.0, 0.0, -1.0]
_GRAVITY = {"scene.gravity": [0.0, 0.0, -9.81]}
_WIND = {"wind": {"velocity": [3.0, 0.0, 0.0], "gust": 0.3}}
_BALL = {"kind": "sphere", "radius": 0.2, "position": [0.0, 0.0, 0.0]}
_HEADER = ("term", "ns/node/step", "of the body alone", "bytes/node", "modules", "compile s")


@dataclass(frozen=True)
class Family:
    """A body alone, and the terms that it can have besides.

    Attributes:
        name: What the body is.
        values: Values of the scene for the body alone.
        terms: Name of each term, and the values that add it.
    """

    name: str
    values: Mapping[str, Any]
    terms: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class TermCost:
    """What a term costs on top of its body alone; of the body alone, everything.

    Attributes:
        term: The term.
        ns_per_node_per_step: Time of a step [ns], minimum over the rounds.
        share: The same as a share of the body alone, median of the ratios of each round.
        bytes_per_node: Device memory [bytes].
        compiled: Modules that a first start compiles where what the body alone needs is in the cache [s].
    """

    term: str
    ns_per_node_per_step: float
    share: float
    bytes_per_node: float
    compiled: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class TermCosts:
    """The result of `bench terms`: the costs of each family, the body alone first."""

    machine: dict[str, Any]
    precision: str
    core: int | None
    families: dict[str, tuple[TermCost, ...]]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The tables as people read them."""
        lines = [f"{self.precision}, one core; a step of one Newton iteration of ten iterations of conjugate gradient"]
        for name, (body, *terms) in self.families.items():
            rows = [_row(body, ""), *(_row(term, "+ ") for term in terms)]
            lines += ["", name, "", *table(_HEADER, rows)]
        return lines


def families(side: int) -> tuple[Family, ...]:
    """The bodies of the benchmark and their terms.

    Args:
        side: Nodes along each side of the sheet; strands and the block have about as many nodes in all.
    """
    return _sheet(side), _tube(side), _strands(side), _block(side)


def _sheet(side: int) -> Family:
    shell = {"body.0.material": _MEMBRANE | {"bending_stiffness": 1e-5}}
    box = {"kind": "box", "size": [0.2, 0.2, 0.2], "position": [0.0, 0.5, 0.0]}
    return Family(
        f"sheet of {side} x {side} nodes, membrane alone",
        {"body.0.nodes": [side, side], "body.0.velocity": _DOWN, "body.0.material": _MEMBRANE},
        {
            "bending": shell,
            "gravity": _GRAVITY,
            "drag": {"body.0.drag": 0.5},
            "a spring": {"body.0.springs": [{"nodes": [[1, 1]], "stiffness": 5.0}]},
            "wind with gusts": _WIND,
            "an obstacle, not touched": {"obstacle": [_BALL]},
            "the same with friction": {"obstacle": [_BALL | {"friction": 0.4}]},
            "two obstacles, not touched": {"obstacle": [_BALL, box]},
            "a rest shape that grows": {"body.0.rest": {"times": [0.0, 1.0], "scale": [1.0, 1.1]}},
        },
    )


def _tube(side: int) -> Family:
    body = {
        "name": "tube",
        "kind": "surface",
        "nodes": [side, side],
        "shape": {"kind": "tube", "radius": 0.2, "length": 1.0},
        "material": _MEMBRANE,
        "position": [0.0, 0.0, 1.5],
        "velocity": _DOWN,
        "pins": ["corner:0,0"],
    }
    name = f"tube of {side} x {side} nodes, membrane alone"
    return Family(name, {"body": [body]}, {"pressure": {"body.0.pressure": 10.0}})


def _strands(side: int) -> Family:
    strands = max(1, side * side // 32)
    thread = {"linear_density": 1e-3, "axial_stiffness": 10.0, "bending_stiffness": 0.0}
    rod = thread | {"bending_stiffness": 1e-6}
    body = {
        "name": "hair",
        "kind": "curve",
        "nodes": [32],
        "strands": {"count": [strands], "size": [1.0]},
        "shape": {"kind": "line", "length": 0.2},
        "section": {"radius": 5e-4},
        "material": thread,
        "position": [0.0, 0.0, 1.5],
        "velocity": _DOWN,
        "pins": ["end:0"],
    }
    return Family(
        f"{strands} strands of 32 nodes, stretch alone",
        {"body": [body]},
        {
            "bending": {"body.0.material": rod},
            "bending and twist": {"body.0.material": rod | {"torsional_stiffness": 1e-6}},
            "gravity": _GRAVITY,
            "wind with gusts": _WIND,
            "an obstacle, not touched": {"obstacle": [_BALL]},
        },
    )


def _block(side: int) -> Family:
    cube = max(4, round(side ** (2.0 / 3.0)))
    rubber = {"density": 1000.0, "youngs_modulus": 1e5, "poisson_ratio": 0.4}
    body = {
        "name": "block",
        "kind": "solid",
        "nodes": [cube, cube, cube],
        "shape": {"kind": "block", "size": [0.2, 0.2, 0.2]},
        "material": rubber,
        "velocity": _DOWN,
        "position": [0.0, 0.0, 1.5],
        "pins": ["face:w,1"],
    }
    return Family(
        f"block of {cube} x {cube} x {cube} nodes, boxes",
        {"body": [body]},
        {
            "a barrier against inversion": {"body.0.material": rubber | {"inversion_barrier": 2e4}},
            "gravity": _GRAVITY,
            "wind with gusts": _WIND,
            "an obstacle, not touched": {"obstacle": [_BALL]},
        },
    )


def bench_terms(
    side: int = 128,
    *,
    precision: str = "float32",
    repeats: int = 9,
    steps: int = 4,
    core: int | None = None,
    compile_: bool = True,
    said: Callable[[str], None] = lambda line: None,
) -> TermCosts:
    """Time every family with and without each of its terms.

    All variants of a family are timed in turn, round after round, so that a busy spell hits all of them alike. Each
    also starts once in a process of its own, with a kernel cache that holds what the body alone needs.

    Args:
        side: Nodes along each side of the sheet.
        precision: "float32" or "float64".
        repeats: Rounds.
        steps: Time steps of a variant in a round.
        core: Core to stay on; None takes the first one allowed.
        compile_: Start the processes; without them no modules are told.
        said: Told about progress.
    """
    machine = describe()
    solver = {**SOLVER, "solver.precision": precision}
    costs = {}
    with (
        core_for(find_device("cpu"), core) as chosen,
        tempfile.TemporaryDirectory(prefix="warpdeform-bench-") as folder,
    ):
        for k, family in enumerate(families(side)):
            said(family.name)
            variants = {"": {}, **family.terms}
            values = {term: {**solver, **family.values, **own} for term, own in variants.items()}
            compiled = _compiled(values, Path(folder) / str(k), said) if compile_ else {term: {} for term in values}
            built = {term: simulation_of(load_scene(SCENE, own)) for term, own in values.items()}
            costs[family.name] = _costs(built, steps, repeats, compiled)
    return TermCosts(machine, precision, chosen, costs)


def _costs(
    simulations: Mapping[str, Simulation], steps: int, repeats: int, compiled: Mapping[str, dict[str, float]]
) -> tuple[TermCost, ...]:
    for simulation in simulations.values():
        simulation.step()
    rounds = [{term: time_steps(s, steps)[0] for term, s in simulations.items()} for _ in range(repeats)]
    nodes = simulations[""].record().nodes
    size = {term: s.info().bytes_total / nodes for term, s in simulations.items()}
    fastest = {term: 1e9 * min(r[term] for r in rounds) / (nodes * steps) for term in simulations}
    alone = TermCost("the body alone", fastest[""], 1.0, size[""], compiled[""])
    return (
        alone,
        *(
            TermCost(
                term,
                fastest[term] - fastest[""],
                statistics.median(r[term] / r[""] for r in rounds) - 1.0,
                size[term] - size[""],
                compiled[term],
            )
            for term in list(simulations)[1:]
        ),
    )


def _compiled(
    values: Mapping[str, Mapping[str, Any]], folder: Path, said: Callable[[str], None]
) -> dict[str, dict[str, float]]:
    """Modules that each variant compiles [s]: the body alone with an empty cache, the others with its cache."""
    folder.mkdir()
    found = {}
    for k, (term, own) in enumerate(values.items()):
        said(f"  cold start: {term or 'the body alone'}")
        cache = folder / f"cache{k}"
        if k:
            shutil.copytree(folder / "cache0", cache)
        found[term] = first_frame(SCENE, folder, cache.name, json.dumps(own)).compiled
        if k:
            shutil.rmtree(cache)
    return found


def _row(cost: TermCost, sign: str) -> Sequence[str]:
    return (
        f"{sign}{cost.term}",
        f"{cost.ns_per_node_per_step:.0f}",
        f"{cost.share:.0%}",
        f"{cost.bytes_per_node:.0f}",
        str(len(cost.compiled)),
        f"{sum(cost.compiled.values()):.1f}",
    )
