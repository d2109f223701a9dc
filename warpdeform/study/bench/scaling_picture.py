"""The picture of `bench scaling`: two panels over the number of nodes, both axes logarithmic."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from warpdeform.errors import InputError, Mistake
from warpdeform.study.bench.scaling import MOST_GROWTH, REFERENCE, Scaling, SizeCost
from warpdeform.study.drawing import new_figure

SUFFIXES = (".png", ".svg", ".pdf")
INK, LINE, FAINT = "#2b2b2b", "#1f6f8b", "#9a9a9a"


def check_picture(path: Path) -> None:
    """Refuse, before anything runs, a picture that could not be written.

    Raises:
        InputError: Unknown kind of file, no such folder, or matplotlib is not installed.
    """
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(Mistake("--picture", str(path), "is no kind of picture", f"End it in {', '.join(SUFFIXES)}."))
    if not path.parent.is_dir():
        raise InputError(Mistake("--picture", str(path), "lies in a folder that does not exist", "Make the folder."))
    new_figure((9.0, 3.8))


def draw_scaling(scaling: Scaling, path: Path) -> None:
    """Draw seconds per simulated second, and the cost per node and step, against the nodes.

    Raises:
        InputError: matplotlib is not installed.
    """
    figure = new_figure((9.0, 3.8))
    costs = sorted(scaling.sizes, key=lambda cost: cost.nodes)
    nodes = [cost.nodes for cost in costs]
    whole, each = figure.subplots(1, 2)
    _curve(whole, costs, [cost.median for cost in costs], "seconds per simulated second")
    whole.axhline(1.0, color=FAINT, linewidth=0.8)
    whole.annotate("real time", (nodes[-1], 1.0), (0, 3), textcoords="offset points", ha="right", color=FAINT)
    ends = [costs[0].median * count / nodes[0] for count in (nodes[0], nodes[-1])]
    whole.plot(
        (nodes[0], nodes[-1]), ends, color=FAINT, linewidth=0.8, linestyle=":", label="in proportion to the nodes"
    )
    whole.legend(frameon=False, loc="upper left")
    _curve(each, costs, [cost.ns_per_node_per_step for cost in costs], "ns per node and step")
    for cost in costs:
        if cost.side == REFERENCE:
            limit = MOST_GROWTH * cost.ns_per_node_per_step
            each.axhline(limit, color=FAINT, linewidth=0.8)
            label = f"{MOST_GROWTH:g} times {REFERENCE} x {REFERENCE}"
            each.annotate(label, (nodes[0], limit), (0, 3), textcoords="offset points", ha="left", color=FAINT)
    figure.suptitle(scaling.heading(), fontsize=10, color=INK)
    figure.savefig(str(path), dpi=160)


def _curve(axes: Any, costs: Sequence[SizeCost], values: Sequence[float], name: str) -> None:
    axes.loglog([cost.nodes for cost in costs], values, color=LINE, marker="o", markersize=4, linewidth=1.6)
    axes.set_ylim(10.0 ** math.floor(math.log10(min(values))), 10.0 ** math.ceil(math.log10(max(values))))
    axes.set_xticks([cost.nodes for cost in costs], [f"{cost.side}\u00b2" for cost in costs])
    axes.set_xticks([], minor=True)
    axes.set_xlabel("nodes", color=INK)
    axes.set_ylabel(name, color=INK)
    axes.grid(which="major", color="#e4e4e4", linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
