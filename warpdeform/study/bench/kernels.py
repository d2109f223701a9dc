"""`bench kernels`: time per node of every pass, at the CPU's lane width and at width 1, beside the yardstick."""

import statistics
from collections.abc import Callable, Iterator, Sequence
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

    Each pass is recorded as a graph, as a step is, and all passes of all sizes are timed in turn, round after round, so
    that a busy spell hits all of them alike.

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
    with one_core(None if found.is_cuda else core):
        samples = []
        for nodes in sizes:
            said(f"{nodes} x {nodes}: preparing")
            sheets = [Sheet(nodes, precision, width, found) for width in widths]
            samples += [_Sample(each, sheet, found) for sheet in sheets for each in chosen]
        for k in range(repeats):
            said(f"round {k + 1} of {repeats}")
            for sample in samples:
                sample.time()
    times = tuple(_summary(samples, widths[0]))
    return KernelTimes(machine, str(found), precision, repeats, times, _targets(times, widths[0], precision))


class _Sample:
    """A pass on a sheet, recorded as a graph; it keeps the sheet's arrays alive, which the graph does not.

    Attributes:
        key: Nodes along each side, lane width, name of the pass.
        seconds: Times per node of the rounds so far [s].
    """

    def __init__(self, each: Pass, sheet: Sheet, device: Any) -> None:
        count = sheet.state.model.grid.node_count
        self.key = (sheet.state.layout.nodes[0], sheet.width, each.name)
        self.seconds: list[float] = []
        self._sheet, self._device, self._clock = sheet, device, clock_of(device)
        copies = max(1, NODES_PER_SAMPLE // count)
        self._node_passes = copies * count
        each.launch(sheet)  # loads the kernels, which a capture may not
        with wp.ScopedCapture(device=device) as capture:
            for _ in range(copies):
                each.launch(sheet)
        self._graph = capture.graph

    def time(self) -> None:
        """Take one more time."""
        wp.capture_launch(self._graph)  # brings the arrays into the cache, as far as they fit
        wp.synchronize_device(self._device)
        start = self._clock()
        wp.capture_launch(self._graph)
        wp.synchronize_device(self._device)
        self.seconds.append((self._clock() - start) / self._node_passes)


def _summary(samples: Sequence[_Sample], widest: int) -> Iterator[PassTime]:
    seconds = {sample.key: sample.seconds for sample in samples}
    for (nodes, width, name), values in seconds.items():
        yard = seconds[nodes, width, YARDSTICK]
        yield PassTime(
            name=name,
            nodes=nodes,
            width=width,
            fastest_ns=1e9 * min(values),
            median_ns=1e9 * statistics.median(values),
            over_yardstick=statistics.median(v / y for v, y in zip(values, yard, strict=True)),
            fastest_over_yardstick=min(values) / min(yard),
            over_wide=min(values) / min(seconds[nodes, widest, name]),
        )


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
