"""What each knob contributes to the error, the others at the scene's settings (the table of design 6.4)."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from warpdeform.errors import InputError
from warpdeform.integrators import INTEGRATORS
from warpdeform.linear import PRECONDITIONERS
from warpdeform.study.tradeoff.course import Asked, Course, apart, observe
from warpdeform.study.tradeoff.ladder import CG_CAPS, TIGHT, Setting
from warpdeform.study.tradeoff.reference import Reference

METHODS = ("implicit-euler", "bdf2", "sdirk2", "tr-bdf2")
TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)
GRIDS = (0.25, 0.5, 1.0, 2.0)
MOST_NODES = 20_000
"""Nodes of the finest grid at most; there grids are compared with the next coarser one."""
_SOLVED = {"cg_tolerance": 1e-8, "cg_iterations": 5000, "precision": "float64"}


@dataclass(frozen=True)
class Knob:
    """What one value of a knob contributes.

    Attributes:
        knob: The knob.
        value: Its value.
        against: What it is compared with.
        block: Block-averaged distance at the horizon over the size.
        rms_m: Root mean square distance there [m].
        trouble: Why it could not be measured.
    """

    knob: str
    value: str
    against: str
    block: float = float("nan")
    rms_m: float = float("nan")
    trouble: str = ""


class Knobs:
    """Turns one knob after the other.

    Args:
        asked: The scene.
        reference: Its reference.
    """

    def __init__(self, asked: Asked, reference: Reference) -> None:
        self._asked, self._reference = asked, reference
        self._settings = asked.under(Setting()).settings

    def measure(self) -> Iterator[Knob]:
        """Every row of the table, one at a time."""
        yield from self._time()
        yield from self._newton()
        yield from self._linear()
        yield from self._grid()

    def _time(self) -> Iterator[Knob]:
        steps = self._settings.substeps
        exact = self._reference.course
        for name in METHODS:
            for count in (steps, 2 * steps, 4 * steps):
                tight = Setting({**TIGHT, "integrator": name, "substeps": count})
                value = f"{name}, {count} a frame"
                yield self._row("method and step, all else tight", value, "the reference", tight, exact)

    def _newton(self) -> Iterator[Knob]:
        converged = {**_SOLVED, "newton_iterations": 0, "newton_tolerance": 1e-6}
        method = INTEGRATORS[self._settings.integrator]
        if method.explicit or getattr(method, "iterations", None) is not None:
            return
        euler = self._run(Setting({**converged, "integrator": "implicit-euler"}))
        name = "Newton, linear systems solved"
        for what, values in (
            ("1 from the last position, no search (linear-implicit)", {"integrator": "linear-implicit"}),
            ("1 from the predictor (implicit-euler)", {"integrator": "implicit-euler", "newton_iterations": 1}),
        ):
            yield self._row(name, what, "backward Euler, converged", Setting({**_SOLVED, **values}), euler)
        exact = self._run(Setting(converged))
        for count in (1, 2, 3, 4):
            values = {**_SOLVED, "newton_iterations": count}
            yield self._row(name, f"{count} ({method.name})", "converged", Setting(values), exact)

    def _linear(self) -> Iterator[Knob]:
        if INTEGRATORS[self._settings.integrator].explicit:
            return
        exact = self._run(Setting(_SOLVED))
        double = {"precision": "float64"}
        for tolerance in TOLERANCES:
            values = {**double, "cg_tolerance": tolerance, "cg_iterations": 5000}
            yield self._row("CG tolerance", f"{tolerance:.0e}", "1e-08", Setting(values), exact)
        for cap in CG_CAPS:
            values = {**double, "cg_iterations": cap}
            yield self._row("CG cap", str(cap), "CG to 1e-08", Setting(values), exact)
        for name in PRECONDITIONERS:
            values = {**double, "preconditioner": name}
            yield self._row("preconditioner", name, "CG to 1e-08", Setting(values), exact)
        same = self._run(Setting(double))
        yield self._row("precision", "float32", "float64", Setting({"precision": "float32"}), same)

    def _grid(self) -> Iterator[Knob]:
        """The explicit reference on coarser and finer grids, against the finest."""
        courses: list[tuple[float, Course]] = []
        for factor in GRIDS:
            values = dict(self._reference.setting.values)
            try:
                built = self._asked.under(Setting({}, factor))
                if sum(int(np.prod(body.nodes)) for body in built.bodies) > MOST_NODES:
                    continue
                grown = [Setting({"integrator": "verlet", "substeps": 1, "precision": "float64"}, factor)]
                if values["integrator"] == "verlet":
                    finer = observe(self._asked.under(grown[0]), 1).record.steps
                    values["substeps"] = max(2 * finer, 1)
                courses.append((factor, observe(self._asked.under(Setting(values, factor)), self._reference.horizon)))
            except InputError as error:
                yield Knob("grid", f"x {factor:g}", "", trouble=str(error))
        if len(courses) < 2:
            return
        finest, exact = courses[-1]
        for factor, course in courses[:-1]:
            yield self._compared("grid", f"x {factor:g}", f"x {finest:g}, both by the reference", course, exact)

    def _run(self, setting: Setting) -> Course:
        return observe(self._asked.under(setting), self._reference.horizon)

    def _row(self, knob: str, value: str, against: str, setting: Setting, exact: Course) -> Knob:
        try:
            course = self._run(setting)
        except InputError as error:
            return Knob(knob, value, against, trouble=str(error))
        return self._compared(knob, value, against, course, exact)

    def _compared(self, knob: str, value: str, against: str, course: Course, exact: Course) -> Knob:
        at = self._reference.horizon
        if course.trouble or exact.trouble:
            return Knob(knob, value, against, trouble=course.trouble or exact.trouble)
        found = apart(course.positions[at], exact.positions[at], self._reference.bodies)
        return Knob(knob, value, against, found.block / self._reference.size, found.rms)
