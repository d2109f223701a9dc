"""Error against CPU time, one marker per engine and setting."""

from collections.abc import Sequence
from pathlib import Path

from warpdeform.errors import InputError, Mistake
from warpdeform.study.peers.records import PeerRun, front

MARKERS = ("o", "s", "^", "v", "D", "P")
COLOURS = ("#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#8c564b", "#ff7f0e")


def draw_peers(runs: Sequence[PeerRun], path: Path) -> None:
    """Draw block-averaged error at 0.5 s against CPU time, one panel per size; rings mark the engines' own examples.

    Args:
        runs: The runs.
        path: The picture file.

    Raises:
        InputError: matplotlib is missing, or no run has an error.
    """
    measured = [run for run in runs if run.error_m < float("inf")]
    if not measured:
        raise InputError(Mistake("--picture", str(path), "has nothing to show", "Use sizes below 256 nodes."))
    try:
        import matplotlib as mpl
    except ImportError:
        remedy = "Install the extra: pip install 'warpdeform[peers]'."
        raise InputError(Mistake("--picture", str(path), "needs matplotlib", remedy)) from None
    mpl.use("agg")
    from matplotlib import pyplot as plt

    sizes, names = sorted({run.nodes for run in measured}), list(dict.fromkeys(run.engine for run in measured))
    figure, panels = plt.subplots(1, len(sizes), figsize=(1.0 + 4.2 * len(sizes), 4.4), sharey=True, squeeze=False)
    for nodes, panel in zip(sizes, panels[0], strict=True):
        for k, name in enumerate(names):
            here = [run for run in measured if run.engine == name and run.nodes == nodes]
            best = front(here, float("inf"))
            look = {"color": COLOURS[k % len(COLOURS)], "linewidth": 1.0}
            panel.plot([r.cpu_s_per_s for r in best], [1e3 * r.error_m for r in best], **look)
            marks = [r.cpu_s_per_s for r in here], [1e3 * r.error_m for r in here]
            panel.plot(*marks, MARKERS[k % len(MARKERS)], label=name, markersize=6, **look)
            shown = [r for r in here if r.example]
            rings = [r.cpu_s_per_s for r in shown], [1e3 * r.error_m for r in shown]
            panel.plot(*rings, "o", markersize=13, markerfacecolor="none", **look)
        panel.set(xscale="log", yscale="log", title=f"{nodes} x {nodes}", xlabel="CPU s per simulated s")
        panel.grid(visible=True, which="both", alpha=0.25)
    panels[0][0].set_ylabel("error at 0.5 s, block-averaged, own law [mm]")
    panels[0][-1].legend(fontsize=8)
    figure.tight_layout()
    figure.savefig(path, dpi=130)
    plt.close(figure)
