"""The progress bar of a run and the lines at its end."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from warpdeform.result import ORDINARY, Outcome

if TYPE_CHECKING:
    from warpdeform.result import RunRecord
    from warpdeform.scene import BuiltScene


@contextmanager
def progress_bar(scene: BuiltScene, wanted: bool) -> Iterator[Callable[[int], None]]:
    """Show how far a run is, on stderr, if that is a terminal.

    Args:
        scene: What runs.
        wanted: Whether to show anything.

    Yields:
        A function to call with the number of frames done.
    """
    if not (wanted and sys.stderr.isatty()):
        yield lambda frames: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(bar_width=None),
        MofNCompleteColumn(),
        TextColumn("{task.fields[speed]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), refresh_per_second=8, transient=True) as progress:
        task = progress.add_task(f"{scene.name}: setting up", total=scene.frames, speed="")

        def show(frames: int) -> None:
            seconds = progress.tasks[0].speed
            speed = f"{seconds / scene.settings.fps:.2f} x real time" if seconds else ""
            progress.update(task, completed=frames, description=scene.name, speed=speed)

        yield show


def summary(record: RunRecord) -> list[str]:
    """What was written, how fast, with how many iterations and what residual."""
    speed = f", {record.sim_s / record.wall_s:.2f} x real time" if record.wall_s > 0 and record.sim_s > 0 else ""
    lines = [
        f"{record.frames} frames, {record.sim_s:.4g} s of {record.nodes} nodes in {record.wall_s:.3g} s{speed} "
        f"(set-up {record.setup_s:.2g} s; {record.integrator}, {record.precision}, {record.device})",
        f"{record.newton_iterations} Newton and {record.cg_iterations} CG iterations, "
        f"worst residual {record.max_residual:.3g} N/kg, longest edge {record.max_stretch:.4g} of its rest length",
    ]
    for outcome in Outcome:
        count = record.outcomes.get(outcome.name.lower(), 0)
        if count and outcome not in ORDINARY:
            lines.append(f"{count} of {record.steps + record.retries} steps: {outcome.value}")
    if record.retries:
        lines.append(f"{record.retries} steps were repeated with smaller ones")
    if record.output:
        size = Path(record.output).stat().st_size / 1e6
        lines.insert(0, f"wrote {record.output} ({size:.3g} MB)")
    return lines
