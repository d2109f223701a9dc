"""The picture of a stability map: a panel for each method and start, a colour for each end of a run."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from warpdeform.study.bench.scaling_picture import INK
from warpdeform.study.drawing import new_figure
from warpdeform.study.stability.cells import Cell, Found, Verdict

COLOURS = {
    Verdict.STABLE: "#3c9d5d",
    Verdict.DAMPED: "#b7d7a8",
    Verdict.RESCUED: "#edc949",
    Verdict.CAUGHT: "#e07b39",
    Verdict.REFUSED: "#bdbdbd",
    Verdict.UNSTABLE: "#8e1b2f",
}


def draw_map(cells: Sequence[tuple[Cell, Found]], heading: str, path: Path) -> None:
    """Draw a map.

    Args:
        cells: Its cells and what was found.
        heading: What was studied.
        path: The file.

    Raises:
        InputError: matplotlib is missing.
    """
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch

    methods = list(dict.fromkeys(cell.method.label for cell, _ in cells))
    starts = list(dict.fromkeys((cell.disorder, cell.density) for cell, _ in cells))
    stiffnesses, steps = (sorted({getattr(cell, name) for cell, _ in cells}) for name in ("stiffness", "dt"))
    order = list(Verdict)
    values = np.full((len(starts), len(methods), len(stiffnesses), len(steps)), np.nan)
    for cell, found in cells:
        row, column = starts.index((cell.disorder, cell.density)), methods.index(cell.method.label)
        place = stiffnesses.index(cell.stiffness), steps.index(cell.dt)
        values[row, column, place[0], place[1]] = order.index(found.verdict)
    figure = new_figure((1.0 + 1.25 * len(methods), 1.2 + 1.35 * len(starts)))
    panels = figure.subplots(len(starts), len(methods), sharex=True, sharey=True, squeeze=False)
    colours = ListedColormap([COLOURS[verdict] for verdict in order])
    for row, (disorder, density) in enumerate(starts):
        for column, method in enumerate(methods):
            panel = panels[row][column]
            edges = np.arange(len(steps) + 1) - 0.5, np.arange(len(stiffnesses) + 1) - 0.5
            panel.pcolormesh(
                *edges, values[row, column], cmap=colours, vmin=-0.5, vmax=len(order) - 0.5, edgecolors="white",
                linewidth=0.5,
            )  # fmt: skip
            panel.set_xticks(range(len(steps)), [_power(dt) for dt in steps], fontsize=6, rotation=90)
            panel.set_yticks(range(len(stiffnesses)), [_power(k) for k in stiffnesses], fontsize=6)
            panel.tick_params(length=0)
            if row == 0:
                panel.set_title(method.replace(", ", ",\n"), fontsize=7, color=INK)
            if column == 0:
                panel.set_ylabel(disorder + (f"\ndensity x {density:g}" if density != 1.0 else ""), fontsize=7)
    panels[-1][len(methods) // 2].set_xlabel("time step [s]", fontsize=8, color=INK)
    figure.supylabel("stiffness E A / L [N/m]", fontsize=8, color=INK)
    figure.suptitle(heading, fontsize=9, color=INK)
    names = [Patch(color=COLOURS[verdict], label=f"{verdict.name.lower()}: {verdict.value}") for verdict in order]
    figure.legend(handles=names, loc="outside lower center", ncols=2, fontsize=7, frameon=False)
    figure.savefig(str(path), dpi=130)


def _power(value: float) -> str:
    return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
