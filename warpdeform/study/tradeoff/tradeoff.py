"""`study tradeoff`: the settings of a scene's solver against each other, by time and by error."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, field
from typing import Any

from warpdeform.device import find_device
from warpdeform.errors import InputError, Mistake
from warpdeform.settings import Settings
from warpdeform.study.bench.machine import core_for, describe
from warpdeform.study.bench.table import table, three_digits
from warpdeform.study.files import StudyFiles
from warpdeform.study.tradeoff.course import Asked, observe, seconds_per_second
from warpdeform.study.tradeoff.knobs import Knob, Knobs
from warpdeform.study.tradeoff.ladder import Setting, refined, sweep
from warpdeform.study.tradeoff.picture import draw_tradeoff
from warpdeform.study.tradeoff.records import Measured, cheapest, front
from warpdeform.study.tradeoff.reference import Reference, make_reference

Said = Callable[[str], None]

ERRORS = (0.05, 0.02, 0.01, 0.005, 0.001)
"""Block-averaged errors over the size for which the cheapest setting is named."""


@dataclass
class Tradeoff:
    """The result of `study tradeoff`.

    Attributes:
        machine: What it ran on.
        scene: The scene's name.
        overrides: What was changed of it.
        nodes: Nodes of each body.
        default: The scene's own setting.
        reference: What runs are compared with, as plain values.
        least: Error over the size below which nothing tells settings apart.
        runs: The settings.
        knobs: What each knob contributes.
        target: The error over the size that was asked for.
        repeats: Runs under the clock, of which the fastest counts.
    """

    machine: dict[str, Any]
    scene: str
    overrides: list[str]
    nodes: list[list[int]]
    default: str
    reference: dict[str, Any]
    least: float
    repeats: int
    target: float | None = None
    runs: list[Measured] = field(default_factory=list)
    knobs: list[Knob] = field(default_factory=list)

    @property
    def front(self) -> list[Measured]:
        """The settings that no other one beats in time and error."""
        return front(self.runs, self.least)

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        best = {f"{error:g}": run.name for error in ERRORS if (run := cheapest(self.runs, error))}
        return {**asdict(self), "front": [run.name for run in self.front], "cheapest": best}

    def heading(self) -> str:
        """What was studied, as one line."""
        grids = " and ".join(" x ".join(map(str, nodes)) for nodes in self.nodes)
        changed = f" with {', '.join(self.overrides)}" if self.overrides else ""
        return f"{self.scene}{changed}: {grids} nodes, errors at {self.reference['horizon_s']:.3g} s"

    def lines(self) -> list[str]:
        """The tables as people read them."""
        facts, size = self.reference, self.reference["size_m"]
        about = [
            f"reference: {_said(facts['setting'])}; from it with steps twice as long "
            f"{facts['with_double_steps_m']['block'] / size:.1e}, from {_said(facts['second'])} "
            f"{facts['uncertainty_m']['block'] / size:.1e} of the size",
            f"noise floor (started 1e-6 of the size apart): {facts['noise_floor_m']['block'] / size:.1e} of the size, "
            f"{facts['noise_floor_m']['rms']:.1e} m root mean square",
        ]
        shown = [*self.front, *(run for run in self.runs if run.name == self.default and run not in self.front)]
        rows = [[("" if run in self.front else "(default) ") + run.name, *_cells(run)] for run in shown]
        header = (
            "on the front", "CPU s per s", "error", "RMS [m]", "energy", "lowest [m]", "stretch", "period",
            "Newton", "CG",
        )  # fmt: skip
        best = [
            f"cheapest with an error of {error:g} of the size: {run.name} ({run.cpu_s_per_s:.2g} CPU s per s)"
            for error in (ERRORS if self.target is None else (self.target,))
            if (run := cheapest(self.runs, error))
        ]
        failed = [f"{run.name}: {run.trouble}" for run in self.runs if run.trouble]
        knobs = [[k.knob, k.value, k.against, *_knob_cells(k)] for k in self.knobs]
        turned = table(("knob", "value", "against", "error", "RMS [m]"), knobs) if knobs else []
        count = f"{len(self.runs)} settings, {len(failed)} of which could not run; {self.repeats} repeats"
        return [self.heading(), *about, count, "", *table(header, rows), "", *best, "", *turned]


def _said(values: dict[str, Any]) -> str:
    return f"{values['integrator']} with {values['substeps']} steps a frame"


def _cells(run: Measured) -> list[str]:
    period = "-" if run.period is None else f"{run.period:.3f}"
    return [
        three_digits(run.cpu_s_per_s), f"{run.block:.1e}", f"{run.rms_m:.1e}", f"{run.energy:+.4f}",
        f"{run.lowest_m:+.4f}", f"{run.stretch:.3f}", period, str(run.newton_iterations), str(run.cg_iterations),
    ]  # fmt: skip


def _knob_cells(knob: Knob) -> list[str]:
    if knob.trouble:
        return ["failed", "failed"]
    return [f"{knob.block:.1e}", f"{knob.rms_m:.1e}"]


def study_tradeoff(
    asked: Asked,
    files: StudyFiles,
    *,
    horizon_s: float | None = None,
    target: float | None = None,
    repeats: int = 3,
    settings: Iterable[Setting] | None = None,
    knobs: bool = True,
    core: int | None = None,
    said: Said = lambda line: None,
) -> Tradeoff:
    """Sweep the settings of a scene and write CSV, JSON and picture, which hold what is known at any time.

    Args:
        asked: The scene.
        files: Where to write.
        horizon_s: Time at which positions are compared [s]; None lets the noise floor decide.
        target: Error over the size that a setting is wanted for; refused where nothing could tell.
        repeats: Runs under the clock.
        settings: What to compare; None takes the whole ladder.
        knobs: Measure what each knob contributes too.
        core: Core to stay on.
        said: Told about progress.

    Raises:
        InputError: The scene has no reference, or the target is below what the reference can tell.
    """
    machine, device = describe(), find_device(asked.device)
    scene = asked.under(Setting())
    with core_for(device, core):
        said("references")
        reference = make_reference(asked, horizon_s)
        least = reference.least_error / reference.size
        if target is not None and target < least:
            problem = f"is below what can be told: the references and the noise floor are {least:.1e} of the size"
            raise InputError(Mistake("--target", target, problem, f"Use at least {least:.1e}."))
        found = Tradeoff(
            machine=machine,
            scene=scene.name,
            overrides=[f"{o.key}={o.value}" for o in asked.overrides],
            nodes=[list(body.nodes) for body in scene.bodies],
            default=Setting().name(scene.settings),
            reference=reference.as_dict(),
            least=least,
            repeats=repeats,
            target=target,
        )
        files.start_rows(list(Measured("", Setting().over(scene.settings)).row()))
        ladder = sweep(reference.needed, reference.size) if settings is None else settings
        fresh = _measure_all(asked, reference, ladder, scene.settings, repeats, found, files, said)
        best = [setting for run, setting in fresh if run in found.front]
        if settings is None:
            more = list(refined(best, scene.settings))
            _measure_all(asked, reference, more, scene.settings, repeats, found, files, said)
        for knob in Knobs(asked, reference).measure() if knobs else ():
            said(f"{knob.knob}: {knob.value}")
            found.knobs.append(knob)
    files.write_json(found.as_dict())
    draw_tradeoff(found.runs, found.front, found.default, least, found.heading(), files.path(".png"))
    return found


def _measure_all(
    asked: Asked,
    reference: Reference,
    ladder: Iterable[Setting],
    settings: Settings,
    repeats: int,
    found: Tradeoff,
    files: StudyFiles,
    said: Said,
) -> list[tuple[Measured, Setting]]:
    fresh = []
    for setting in _new(ladder, settings, {run.name for run in found.runs}):
        run = _measure(asked, reference, setting, settings, repeats)
        said(f"{run.name}: {run.trouble or f'{run.cpu_s_per_s:.3g} s per s, {run.block:.1e}'}")
        found.runs.append(run)
        fresh.append((run, setting))
        files.add_row(run.row())
    files.write_json(found.as_dict())
    return fresh


def _new(ladder: Iterable[Setting], settings: Settings, known: set[str]) -> Iterator[Setting]:
    """Those that have not been measured."""
    for setting in ladder:
        name = setting.name(settings)
        if name not in known:
            known.add(name)
            yield setting


def _measure(asked: Asked, reference: Reference, setting: Setting, settings: Settings, repeats: int) -> Measured:
    name, values = setting.name(settings), setting.over(settings)
    frames = len(reference.course.positions) - 1
    try:
        scene = asked.under(setting)
        course = observe(scene, frames)
        if course.trouble:
            return Measured(name, values, setting.grid, retries=course.record.retries, trouble=course.trouble)
        seconds = seconds_per_second(scene, reference.horizon, repeats)
    except InputError as error:
        return Measured(name, values, setting.grid, trouble=str(error))
    exact, record = reference.course, course.record
    error_, period, expected = reference.error(course), course.period(), exact.period()
    gain, exact_gain = (c.energies[-1] - c.energies[0] for c in (course, exact))
    return Measured(
        name,
        values,
        setting.grid,
        cpu_s_per_s=seconds,
        block=error_.block / reference.size,
        rms_m=error_.rms,
        energy=(gain - exact_gain) / reference.scale,
        lowest_m=course.lowest - exact.lowest,
        stretch=record.max_stretch / exact.record.max_stretch,
        period=period / expected if period and expected else None,
        estimate_m=record.error_estimate["time_step"],
        steps=record.steps,
        retries=record.retries,
        newton_iterations=record.newton_iterations,
        cg_iterations=record.cg_iterations,
    )
