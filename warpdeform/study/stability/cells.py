"""One cell of the stability map: a short run of a scene made stiffer, denser and more disordered, and how it ended."""

import time
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

import numpy as np

from warpdeform.body import Body
from warpdeform.errors import InputError, SimulationFailure
from warpdeform.integrators import INTEGRATORS
from warpdeform.material import Material
from warpdeform.measure import node_measures
from warpdeform.scene import BuiltScene
from warpdeform.simulation import Simulation
from warpdeform.study.stability.disorder import disordered

STEPS = 20
"""Steps of a run."""
MOST_S = 2.0
"""A run ends early after so long [s]; it is judged by what it did until then."""
GAIN = 1e-2
"""Energy that may appear, over the weight times the size: what the compact matrix of design 6.6 allows."""
STORED_GAIN = 1.0
"""What may appear beside it, over what the start has stored: violent starts are sampled coarsely by explicit steps."""
ROUND_OFF = {"float32": 3e-6, "float64": 1e-12}
"""Strain that positions of that precision cannot tell from none, squared times stiffness it is energy."""
LOSS = 0.5
"""Share of the energy set free that a run may lose before it counts as damped."""
STIFFNESSES = ("membrane_stiffness", "shear_stiffness", "bending_stiffness", "youngs_modulus", "shear_modulus",
               "axial_stiffness", "torsional_stiffness", "eta", "xi", "inversion_barrier")  # fmt: skip
DENSITIES = ("density", "areal_density", "linear_density")


class Verdict(Enum):
    """How a run ended; the value is the sentence for people."""

    STABLE = "ran, and gained no energy"
    DAMPED = "ran, and lost more than half of the energy that was set free"
    RESCUED = "ran after failed steps were repeated in shorter ones"
    CAUGHT = "diverged, was caught and stopped"
    REFUSED = "was refused: too long a step, or a scene that the method cannot run"
    UNSTABLE = "gained energy without being caught"


@dataclass(frozen=True)
class Method:
    """A method, and how far its Newton iteration goes.

    Attributes:
        name: The integrator.
        newton: Newton iterations; 0 to tolerance.
    """

    name: str
    newton: int = 0

    @property
    def unbent(self) -> bool:
        """Whether it runs surfaces without their bending only."""
        return self.name == "energy-momentum"

    @property
    def label(self) -> str:
        """Its name on the map."""
        own = getattr(INTEGRATORS[self.name], "iterations", None) if not INTEGRATORS[self.name].explicit else None
        plain = INTEGRATORS[self.name].explicit or "terzopoulos" in self.name or own == 1
        return self.name if plain or not self.newton else f"{self.name}, Newton {self.newton}"

    @property
    def settings(self) -> dict[str, Any]:
        """Its solver settings: explicit methods with the step as it is, so that they refuse what they cannot take."""
        step = "fixed" if INTEGRATORS[self.name].explicit else "auto"
        return {
            "integrator": self.name, "newton_iterations": self.newton, "time_step": step, "substeps": 1,
            "cg_tolerance": 1e-3 if self.newton == 0 else 1e-2, "cg_iterations": 1000, "threads": 1,
        }  # fmt: skip


METHODS = (*(Method(name) for name in INTEGRATORS), Method("bdf2", 1))


@dataclass(frozen=True)
class Cell:
    """A place on the map.

    Attributes:
        method: The method.
        stiffness: E A / L of the body along its first axis [N/m]; all its moduli are scaled alike.
        dt: Time step [s].
        density: Its density over the scene's.
        disorder: How it starts.
        strain: How much longer it starts along its first axis.
    """

    method: Method
    stiffness: float
    dt: float
    density: float = 1.0
    disorder: str = "smooth"
    strain: float = 0.0


@dataclass(frozen=True)
class Found:
    """How the run of a cell went.

    Attributes:
        verdict: In a word.
        steps: Steps that were completed.
        gain: Largest gain of energy over the weight times the size.
        lost: Energy lost in the end over what was set free.
        stretch: Largest stretch of any step.
        first_stretch: Largest stretch of the start.
        round_off: Steps that Newton ended at round-off.
        retries: Attempts at steps that failed.
        why: What was said, if it did not run to its end.
    """

    verdict: Verdict
    steps: int = 0
    gain: float = float("nan")
    lost: float = float("nan")
    stretch: float = float("nan")
    first_stretch: float = float("nan")
    round_off: int = 0
    retries: int = 0
    why: str = ""


def stretching_stiffness(body: Body) -> float:
    """E A / L of a body that is pulled along its first axis [N/m]; of the first cell where the material varies."""
    shape = body.shape.positions
    sides = [
        float(np.linalg.norm(np.diff(shape, axis=axis), axis=-1).sum(axis=axis).mean())
        for axis in range(body.shape.grid.dimension)
    ]
    material, first = body.material, lambda value: float(np.ravel(np.asarray(value, dtype=float))[0])
    if body.kind == "curve":
        if material.youngs_modulus is not None:
            assert body.section is not None
            return first(material.youngs_modulus) * body.section.area / sides[0]
        return first(material.axial_stiffness if material.axial_stiffness is not None else material.eta) / sides[0]
    modulus = next(
        first(value)
        for value in (material.membrane_stiffness, material.youngs_modulus, material.eta)
        if value is not None
    )
    if body.kind == "surface":
        thick = first(material.thickness) if material.youngs_modulus is not None else 1.0
        return modulus * thick * sides[1] / sides[0]
    return modulus * sides[1] * sides[2] / sides[0]


def scaled(material: Material, stiffness: float, density: float) -> Material:
    """A material with all moduli, and all densities, so many times as large."""

    def times(value: Any, factor: float) -> Any:
        if isinstance(value, tuple):
            return tuple(factor * one for one in value)
        return None if value is None else factor * value

    values = {name: times(getattr(material, name), stiffness) for name in STIFFNESSES}
    return replace(material, **values, **{name: times(getattr(material, name), density) for name in DENSITIES})


def run_cell(scene: BuiltScene, cell: Cell, steps: int = STEPS, most_s: float = MOST_S) -> Found:
    """Run a cell.

    Args:
        scene: The scene; its first body sets the scale of the stiffness.
        cell: Where on the map.
        steps: Steps to take.
        most_s: When to stop early [s].
    """
    factor = cell.stiffness / stretching_stiffness(scene.bodies[0])
    bodies = []
    for body in scene.bodies:
        material = scaled(body.material, factor, cell.density)
        if cell.method.unbent and body.kind == "surface":
            material = replace(material, bending_stiffness=None, bending_multipliers=None)
        bodies.append(disordered(replace(body, material=material), cell.disorder, cell.strain))
    settings = replace(scene.settings, fps=1.0 / cell.dt, **cell.method.settings)
    try:
        simulation = Simulation(
            bodies, obstacles=scene.obstacles, attachments=scene.attachments, wind=scene.wind, settings=settings
        )
    except InputError as error:
        return Found(Verdict.REFUSED, why=str(error))
    return judge(simulation, steps, most_s)


def judge(simulation: Simulation, steps: int, most_s: float = np.inf) -> Found:
    """Step a simulation and say how it went."""
    bodies = [handle.body for handle in simulation.bodies]
    size = max(float(np.ptp(body.placed_positions().reshape(-1, 3), axis=0).max()) for body in bodies)
    mass = sum(float(node_measures(b.shape.grid, b.shape.positions, b.density).sum()) for b in bodies)
    weight = mass * float(np.linalg.norm(simulation.gravity)) * size
    energy = simulation.record().energy
    stored = energy.elastic + energy.field
    at_first = energy.kinetic + stored + energy.gravity
    finest = ROUND_OFF[simulation.settings.precision] * max(1.0, _reach(simulation) / size)
    grain = sum(stretching_stiffness(body) * (size * finest) ** 2 * body.shape.grid.node_count for body in bodies)
    first = max(handle.max_stretch() for handle in simulation.bodies)
    gain, lost, freed, stretch, done, why = -np.inf, 0.0, energy.kinetic, first, 0, ""
    started = time.perf_counter()
    for _ in range(steps):
        try:
            simulation.step()
        except SimulationFailure as failure:
            why = str(failure)
            break
        done += 1
        energy = simulation.record().energy
        potential = energy.elastic + energy.field + energy.gravity
        lost = at_first - (potential + energy.kinetic - energy.work_in)
        gain = max(gain, -lost)
        freed = max(freed, at_first - potential)
        stretch = max(stretch, *(handle.max_stretch() for handle in simulation.bodies))
        if time.perf_counter() - started > most_s:
            why = f"stopped after {most_s:g} s"
            break
    record = simulation.record()
    unit = weight or max(stored, 1e-300)
    if why and not why.startswith("stopped"):
        verdict = Verdict.REFUSED if record.outcomes.get("too_long") else Verdict.CAUGHT
    elif gain > GAIN * weight + STORED_GAIN * stored + grain:
        verdict = Verdict.UNSTABLE
    elif record.retries:
        verdict = Verdict.RESCUED
    elif freed > GAIN * unit and lost > LOSS * freed:
        verdict = Verdict.DAMPED
    else:
        verdict = Verdict.STABLE
    return Found(
        verdict, done, gain / unit, lost / freed if freed > 0.0 else 0.0, stretch, first,
        record.outcomes.get("round_off", 0), record.retries, why,
    )  # fmt: skip


def _reach(simulation: Simulation) -> float:
    """Largest coordinate of any node [m]: positions keep digits relative to it."""
    return max(float(np.abs(handle.positions()).max()) for handle in simulation.bodies)
