"""The work-precision picture: error against time, both logarithmic, and the settings of the front by their names."""

import math
from collections.abc import Sequence
from pathlib import Path

from warpdeform.study.bench.scaling_picture import INK
from warpdeform.study.drawing import new_figure
from warpdeform.study.tradeoff.records import USABLE, Measured

COLOURS = {
    "bdf2": "#1f6f8b", "tr-bdf2": "#d1495b", "sdirk2": "#8f5ba8", "implicit-euler": "#edae49",
    "linear-implicit": "#b0a990", "energy-momentum": "#3c9d5d", "verlet": "#2b2b2b", "symplectic-euler": "#8a8a8a",
    "terzopoulos": "#c47f3d", "terzopoulos-exact": "#e3b587",
}  # fmt: skip
MARKERS = {"explicit": "^", "adaptive": "D", "coarse": "x"}


def draw_tradeoff(
    runs: Sequence[Measured], best: Sequence[Measured], default: str, least: float, heading: str, path: Path
) -> None:
    """Draw all runs, the front, and below which error nothing can be told.

    Args:
        runs: The runs.
        best: Those on the front.
        default: Name of the scene's own setting.
        least: Error over the size that the reference can tell.
        heading: What was studied.
        path: The file.

    Raises:
        InputError: matplotlib is missing.
    """
    figure = new_figure((11.0, 5.6))
    plot, names = figure.subplots(1, 2, width_ratios=(1.5, 1.0))
    shown = [run for run in runs if run.block < USABLE]
    for method, colour in COLOURS.items():
        own = [run for run in shown if run.values["integrator"] == method]
        for marker in ("o", *MARKERS.values()):
            here = [run for run in own if _marker(run) == marker]
            label = method if here and here[0] is own[0] else None
            plot.plot(
                [run.cpu_s_per_s for run in here], [run.block for run in here], marker, color=colour, markersize=5,
                alpha=0.8, label=label, linestyle="none",
            )  # fmt: skip
    steps = [(run.cpu_s_per_s, run.block) for run in best]
    plot.step(*zip(*steps, strict=True), where="post", color=INK, linewidth=1.0, zorder=0)
    for k, (x, y) in enumerate(steps):
        plot.annotate(str(k + 1), (x, y), (4, 4), textcoords="offset points", fontsize=8, color=INK)
    for run in (run for run in runs if run.name == default and run.block < USABLE):
        plot.plot(run.cpu_s_per_s, run.block, "o", markersize=13, markerfacecolor="none", color=INK)
    plot.axhspan(1e-12, least, color="#e4e4e4", zorder=-1)
    plot.annotate(
        "nothing can be told", (0.01, least), (0, -10), ("axes fraction", "data"), "offset points", fontsize=8
    )
    errors = [run.block for run in shown]
    bottom = 10.0 ** math.floor(math.log10(max(min([least, *errors]), 1e-9)))
    plot.set(xscale="log", yscale="log", ylim=(bottom, USABLE))
    plot.set_xlabel("CPU s per simulated s", color=INK)
    plot.set_ylabel("block-averaged error over the size", color=INK)
    plot.grid(which="major", color="#e4e4e4", linewidth=0.6)
    plot.spines[["top", "right"]].set_visible(False)
    plot.xaxis.set_minor_formatter("")
    names.legend(*plot.get_legend_handles_labels(), frameon=False, fontsize=8, loc="lower left")
    listed = [f"{k + 1}  {run.name}" for k, run in enumerate(best)]
    key = "triangles: explicit   diamonds: adaptive steps   crosses: coarser grids   ring: the scene's own"
    names.axis("off")
    names.text(
        0.0, 1.0, "The front:\n\n" + "\n".join(listed), va="top", fontsize=8, color=INK, transform=names.transAxes
    )
    figure.suptitle(heading, fontsize=10, color=INK)
    figure.supxlabel(key, fontsize=8, color=INK)
    figure.savefig(str(path), dpi=130)


def _marker(run: Measured) -> str:
    if run.grid != 1.0:
        return MARKERS["coarse"]
    if run.values["integrator"] in ("verlet", "symplectic-euler"):
        return MARKERS["explicit"]
    return MARKERS["adaptive"] if run.values["time_step"] == "adaptive" else "o"
