"""The tables of `bench peers`."""

from collections.abc import Sequence

from warpdeform.study.bench.table import table
from warpdeform.study.peers.records import OURS, USABLE_M, EngineFacts, PeerRun, front

_RUNS = (
    "engine, setting", "CPU s per s", "runs", "stretch", "lowest m", "own c4 mm, 0.25 s", "0.5 s", "own RMS mm, 0.25 s",
    "0.5 s", "to ours c4 mm, 0.25 s", "0.5 s", "times ours",
)  # fmt: skip
_ENGINES = ("engine", "version", "first start s", "warm start s", "law")


def peers_lines(engines: Sequence[EngineFacts], runs: Sequence[PeerRun]) -> list[str]:
    """All tables: engines, runs by size, and what else is to be said of them."""
    here = [engine for engine in engines if engine.version]
    rows = [[e.name, e.version, _seconds(e.first_run_s), _seconds(e.warm_s), e.law] for e in here]
    lines = [*table(_ENGINES, rows), ""]
    lines += [f"missing: {e.name} ({e.install})" for e in engines if not e.version]
    for nodes in dict.fromkeys(run.nodes for run in runs):
        some = [run for run in runs if run.nodes == nodes]
        lines += [
            "",
            f"{nodes} x {nodes} nodes (* the engine's own example)",
            "",
            *table(_RUNS, [_row(r) for r in some]),
        ]
        lines += ["", *_uncertainties(here, nodes), *_front_lines(some)]
        lines += [f"{r.engine}, {r.setting}: {r.trouble}" for r in some if r.trouble]
    return lines


def _row(run: PeerRun) -> list[str]:
    name = f"{run.engine}, {run.setting}{' *' if run.example else ''}"
    shape = [f"{run.max_stretch:.3f}", f"{run.lowest_m:.3f}"] if run.max_stretch < 1e3 else ["-", "-"]
    columns = (run.block_own_m, run.rms_own_m, run.block_ours_m)
    errors = [text for column in columns for text in _millimetres(column if not run.trouble else ())]
    gain = "-" if run.gain is None else f"{run.gain:.2g}"
    return [name, f"{run.cpu_s_per_s:.3g}", str(run.repeats), *shape, *errors, "" if run.engine == OURS else gain]


def _front_lines(runs: Sequence[PeerRun]) -> list[str]:
    """Ratios along the peers' front at one size."""
    best = front([run for run in runs if run.engine != OURS])
    lines = (
        [f"fastest peers with an error below {1e3 * USABLE_M:g} mm, from the fastest to the most accurate:"]
        if best
        else []
    )
    for run in best:
        said = f"{run.gain:.2g} times ours" if run.gain else "no run of ours is as accurate"
        lines.append(
            f"  {run.engine}, {run.setting}: {1e3 * run.error_m:.2g} mm in {run.cpu_s_per_s:.3g} s per s, {said}"
        )
    return lines


def _uncertainties(engines: Sequence[EngineFacts], nodes: int) -> list[str]:
    known = [e for e in engines if nodes in e.block_uncertainty_m]
    told = ", ".join(f"{e.name} {' and '.join(_millimetres(e.block_uncertainty_m[nodes]))}" for e in known)
    return [f"uncertainty of the references, c4 mm at 0.25 and 0.5 s: {told}"] if known else []


def _millimetres(errors: Sequence[float]) -> list[str]:
    return [f"{1e3 * error:.2g}" if error < 1.0 else f"{1e3 * error:.0f}" for error in errors] or ["-", "-"]


def _seconds(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds:.1f}"
