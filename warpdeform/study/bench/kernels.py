"""`bench kernels`: time per node of every pass, at the CPU's lane width and at width 1, beside the yardstick."""

import statistics
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import warp as wp

from warpdeform.device import find_device
from warpdeform.model import LANE_WIDTHS
from warpdeform.study.bench.machine import clock_of, describe, one_core
from warpdeform.study.bench.passes import PASSES, YARDSTICK, Limit, Pass, Sheet
from warpdeform.study.bench.table import Target, table, targets_lines

NODES_PER_SAMPLE = 1 << 17
"""Work of one sample: small grids repeat a pass this many nodes long, so that no sample is shorter than the clock."""
LIMITS_FROM = 64
"""Nodes along a side from which on the limits hold: shorter rows leave lanes empty."""


@dataclass(frozen=True)
class PassTime:
    """Time of a pass on one grid.

    Attributes:
        name: The pass.
        nodes: Nodes along each side.
        width: Lane width.
        fastest_ns: Minimum over the repeats, per node [ns].
        median_ns: Median over the repeats, per node [ns].
        over_yardstick: Ratio to the yardstick of the same width, grid and round: median over the rounds.
        fastest_over_yardstick: Ratio of the minima.
        over_wide: Ratio to the same pass at the widest lanes, of the minima.
    """

    name: str
    nodes: int
    width: int
    fastest_ns: float
    median_ns: float
    over_yardstick: float
    fastest_over_yardstick: float
    over_wide: float


@dataclass(frozen=True)
class KernelTimes:
    """The result of `bench kernels`."""

    machine: dict[str, Any]
    device: str
    precision: str
    repeats: int
    passes: tuple[PassTime, ...]
    targets: tuple[Target, ...]

    def as_dict(self) -> dict[str, Any]:
        """The result as plain numbers, strings, lists and dicts."""
        return asdict(self)

    def lines(self) -> list[str]:
        """The tables as people read them."""
        lines = []
        for nodes in dict.fromkeys(p.nodes for p in self.passes):
            here = [p for p in self.passes if p.nodes == nodes]
            lines += [f"{nodes} x {nodes} nodes, {self.precision}, {self.device}: ns per node", ""]
            lines += table(_header(here), [_row(here, name) for name in dict.fromkeys(p.name for p in here)])
            lines.append("")
        return lines + targets_lines(self.targets)


def bench_kernels(
    sizes: Sequence[int],
    *,
    precision: str = "float32",
    repeats: int = 50,
    device: str = "cpu",
    core: int | None = None,
    passes: Sequence[Pass] | None = None,
    said: Callable[[str], None] = lambda line: None,
) -> KernelTimes:
    """Time the passes.

    Each pass is recorded as a graph, as a step is, and all are timed in turn, round after round, so that a busy
    moment hits all of them alike.

    Args:
        sizes: Nodes along each side of the sheets.
        precision: "float32" or "float64".
        repeats: Rounds.
        device: Warp device; a CUDA device has lane width 1 only.
        core: Core to stay on; None takes the first one allowed.
        passes: What to time, the yardstick first; None times all of PASSES.
        said: Told about progress.

    Raises:
        InputError: There is no such device.
    """
    found = find_device(device)
    widths = (1,) if found.is_cuda else (LANE_WIDTHS[precision], 1)
    machine, chosen = describe(), PASSES if passes is None else passes
    times: list[PassTime] = []
    with one_core(None if found.is_cuda else core):
        for nodes in sizes:
            said(f"{nodes} x {nodes}: preparing")
            samples = {width: _record(Sheet(nodes, precision, width, found), chosen, found) for width in widths}
            said(f"{nodes} x {nodes}: timing")
            times += _summary(nodes, _rounds(samples, nodes, repeats, found))
    return KernelTimes(machine, str(found), precision, repeats, tuple(times), _targets(times, widths[0], precision))


@dataclass(frozen=True)
class _Recorded:
    """A pass recorded several times over; the graph does not keep the arrays of the sheet alive, so this does."""

    graph: Any
    copies: int
    sheet: Sheet


Graphs = dict[str, _Recorded]
Seconds = dict[int, dict[str, list[float]]]
"""For each lane width and pass, one time per node for each round."""


def _record(sheet: Sheet, passes: Sequence[Pass], device: Any) -> Graphs:
    graphs: Graphs = {}
    copies = max(1, NODES_PER_SAMPLE // sheet.state.model.grid.node_count)
    for each in passes:
        each.launch(sheet)  # loads the kernels, which a capture may not
        with wp.ScopedCapture(device=device) as capture:
            for _ in range(copies):
                each.launch(sheet)
        graphs[each.name] = _Recorded(capture.graph, copies, sheet)
    return graphs


def _rounds(samples: dict[int, Graphs], nodes: int, repeats: int, device: Any) -> Seconds:
    clock = clock_of(device)
    seconds: Seconds = {width: {name: [] for name in graphs} for width, graphs in samples.items()}
    for _ in range(repeats):
        for width, graphs in samples.items():
            for name, recorded in graphs.items():
                wp.capture_launch(recorded.graph)  # brings the arrays into the cache, as far as they fit
                wp.synchronize_device(device)
                start = clock()
                wp.capture_launch(recorded.graph)
                wp.synchronize_device(device)
                seconds[width][name].append((clock() - start) / (recorded.copies * nodes * nodes))
    return seconds


def _summary(nodes: int, seconds: Seconds) -> list[PassTime]:
    widest = next(iter(seconds))
    result = []
    for width, by_pass in seconds.items():
        yard = by_pass[YARDSTICK]
        for name, values in by_pass.items():
            result.append(
                PassTime(
                    name=name,
                    nodes=nodes,
                    width=width,
                    fastest_ns=1e9 * min(values),
                    median_ns=1e9 * statistics.median(values),
                    over_yardstick=statistics.median(v / y for v, y in zip(values, yard, strict=True)),
                    fastest_over_yardstick=min(values) / min(yard),
                    over_wide=min(values) / min(seconds[widest][name]),
                )
            )
    return result


def _targets(times: Sequence[PassTime], width: int, precision: str) -> tuple[Target, ...]:
    """The limits of the passes; they are set for wide lanes in float32 and rows of some length."""
    if width == 1 or precision != "float32":
        return ()
    limits = {each.name: each.limit for each in PASSES if each.limit is not None}
    return tuple(
        _target(time, limits[time.name])
        for time in times
        if time.width == width and time.name in limits and time.nodes >= LIMITS_FROM
    )


def _target(time: PassTime, limit: Limit) -> Target:
    where = f"{time.name}, {time.nodes} x {time.nodes}"
    if limit.over_yardstick is not None:
        return Target(where, "times the yardstick, median", time.over_yardstick, limit.over_yardstick)
    return Target(where, "ns/node, min", time.fastest_ns, limit.ns_per_node or 0.0)


def _header(times: Sequence[PassTime]) -> list[str]:
    header = ["pass"]
    for width in dict.fromkeys(t.width for t in times):
        header += [f"min, width {width}", f"median, width {width}", f"x yardstick, width {width}"]
    return header + (["width 1 / wide"] if len({t.width for t in times}) > 1 else [])


def _row(times: Sequence[PassTime], name: str) -> list[str]:
    row = [name]
    here = [t for t in times if t.name == name]
    for time in here:
        row += [f"{time.fastest_ns:.2f}", f"{time.median_ns:.2f}", f"{time.over_yardstick:.2f}"]
    return row + ([f"{here[-1].over_wide:.1f}"] if len(here) > 1 else [])
