"""`bench kernels`: time and traffic of every pass, per node, beside a yardstick and the bandwidth of the machine."""

import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

from warpdeform.device import find_device
from warpdeform.model import LANE_WIDTHS
from warpdeform.study.bench.counting import Work, count, recorded_launches
from warpdeform.study.bench.machine import core_for, describe
from warpdeform.study.bench.passes import PASSES, YARDSTICK, Limit, Pass, Sheet
from warpdeform.study.bench.sampling import Sample
from warpdeform.study.bench.solid_passes import SOLID_PASSES, Block
from warpdeform.study.bench.stream import Stream
from warpdeform.study.bench.table import Target, table, targets_lines

LIMITS_FROM = 64
"""Nodes along a side from which on the limits hold: shorter rows leave lanes empty."""
_TRAFFIC_HEADER = (
    "pass", "bytes/node", "flops/node", "set, MB", "GB/s", "stream GB/s", "share", "GFlop/s",
)  # fmt: skip


@dataclass(frozen=True)
class Traffic:
    """What a pass moves and computes, counted from the source of its kernels, and how fast, by its minimum.

    Attributes:
        bytes_per_node: Compulsory traffic: each component that a launch reads or writes, once.
        flops_per_node: Floating-point operations.
        working_set_mb: All components that the pass touches [MB].
        gb_per_s: Bytes over time.
        stream_gb_per_s: What a copy or triad of the same working set reaches, whichever is higher.
        share: Share of `stream_gb_per_s`.
        gflop_per_s: Operations over time.
    """

    bytes_per_node: float
    flops_per_node: float
    working_set_mb: float
    gb_per_s: float
    stream_gb_per_s: float
    share: float
    gflop_per_s: float


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
        traffic: What it moves and computes, at the widest lanes.
    """

    name: str
    nodes: int
    width: int
    fastest_ns: float
    median_ns: float
    over_yardstick: float
    fastest_over_yardstick: float
    over_wide: float
    traffic: Traffic | None


@dataclass(frozen=True)
class KernelTimes:
    """The result of `bench kernels`."""

    machine: dict[str, Any]
    device: str
    precision: str
    repeats: int
    axes: int
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
            grid = " x ".join([str(nodes)] * self.axes)
            lines += [f"{grid} nodes, {self.precision}, {self.device}: ns per node", ""]
            lines += table(_header(here), [_row(here, name) for name in dict.fromkeys(p.name for p in here)])
            lines += ["", "traffic of the widest lanes, by the minimum; stream: a copy or triad of arrays as large", ""]
            lines += table(_TRAFFIC_HEADER, [_traffic_row(p.name, p.traffic) for p in here if p.traffic is not None])
            lines.append("")
        return lines + targets_lines(self.targets)


def bench_kernels(
    sizes: Sequence[int],
    *,
    precision: str = "float32",
    repeats: int = 50,
    device: str = "cpu",
    core: int | None = None,
    solid: bool = False,
    passes: Sequence[Pass] | None = None,
    said: Callable[[str], None] = lambda line: None,
) -> KernelTimes:
    """Time the passes.

    Each pass is recorded as a graph, as a step is, and all passes of all sizes are timed in turn, round after round, so
    that a busy spell hits all of them alike.

    Args:
        sizes: Nodes along each side of the sheets or blocks.
        precision: "float32" or "float64".
        repeats: Rounds.
        device: Warp device; a CUDA device has lane width 1 only.
        core: Core to stay on; None takes the first one allowed.
        solid: Time blocks instead of sheets.
        passes: What to time, the yardstick first; None times all of PASSES or SOLID_PASSES.
        said: Told about progress.

    Raises:
        InputError: There is no such device.
    """
    found = find_device(device)
    widths = (1,) if found.is_cuda else (LANE_WIDTHS[precision], 1)
    body, every = (Block, SOLID_PASSES) if solid else (Sheet, PASSES)
    machine, chosen = describe(), every if passes is None else passes
    with core_for(found, core):
        samples: list[_PassSample] = []
        streams: dict[tuple[int, int], Stream] = {}
        for nodes in sizes:
            said(f"{' x '.join([str(nodes)] * body.axes)}: preparing")
            sheets: list[Any] = [body(nodes, precision, width, found) for width in widths]
            samples += [_PassSample(each, sheet) for sheet in sheets for each in chosen]
            wanted = {s.vectors for s in samples if s.key[:2] == (nodes, widths[0])}
            streams |= {(nodes, vectors): Stream(sheets[0], vectors) for vectors in wanted}
        for k in range(repeats):
            said(f"round {k + 1} of {repeats}")
            for sample in samples:
                sample.time()
            for stream in streams.values():
                stream.time()
    bandwidths = {key: each.gb_per_s() for key, each in streams.items()}
    times = tuple(_summary(samples, widths[0], bandwidths))
    return KernelTimes(machine, str(found), precision, repeats, body.axes, times, _targets(times, widths[0], precision))


class _PassSample(Sample):
    """Samples of a pass on a sheet or block.

    Attributes:
        key: Nodes along each side, lane width, name of the pass.
        work: What the pass moves and computes, all nodes together.
        vectors: Its working set, in vectors per node.
    """

    def __init__(self, each: Pass, sheet: Any) -> None:
        with recorded_launches() as launches:
            each.launch(sheet)
        self.key = (sheet.side, sheet.width, each.name)
        self.work: Work = count(launches)
        self.vectors = round(self.work.working_set / (sheet.node_count * sheet.vector_size))
        super().__init__(partial(each.launch, sheet), sheet.node_count, sheet.device)


def _summary(
    samples: Sequence[_PassSample], widest: int, bandwidths: Mapping[tuple[int, int], float]
) -> Iterator[PassTime]:
    seconds = {sample.key: sample.seconds for sample in samples}
    for sample in samples:
        (nodes, width, name), values = sample.key, sample.seconds
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
            traffic=_traffic(sample, bandwidths[nodes, sample.vectors]) if width == widest else None,
        )


def _traffic(sample: _PassSample, stream_gb_per_s: float) -> Traffic:
    work, nodes, fastest_ns = sample.work, sample.nodes, 1e9 * min(sample.seconds)
    gb_per_s = work.bytes / nodes / fastest_ns
    return Traffic(
        bytes_per_node=work.bytes / nodes,
        flops_per_node=work.flops / nodes,
        working_set_mb=1e-6 * work.working_set,
        gb_per_s=gb_per_s,
        stream_gb_per_s=stream_gb_per_s,
        share=gb_per_s / stream_gb_per_s,
        gflop_per_s=work.flops / nodes / fastest_ns,
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


def _traffic_row(name: str, t: Traffic) -> list[str]:
    return [
        name,
        f"{t.bytes_per_node:.0f}",
        f"{t.flops_per_node:.0f}",
        f"{t.working_set_mb:.1f}",
        f"{t.gb_per_s:.1f}",
        f"{t.stream_gb_per_s:.1f}",
        f"{t.share:.0%}",
        f"{t.gflop_per_s:.1f}",
    ]
