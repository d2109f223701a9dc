"""The tables of `bench peers`."""

from collections.abc import Sequence

from warpdeform.study.bench.table import table
from warpdeform.study.peers.records import OURS, EngineFacts, PeerRun, fastest, front

LEVELS_M = (0.05, 0.02, 0.01, 0.005, 0.002, 0.001)
"""Errors within which the fastest runs are named [m]."""

_RUNS = (
    "engine, setting", "CPU s per s", "stretch", "lowest m", "c4 mm, 0.25 s", "0.5 s", "RMS mm, 0.25 s", "0.5 s",
    "c4 to ours, 0.5 s", "times ours",
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
            f"{nodes} x {nodes} nodes, * the engine's own example; errors against its own law, converged",
            "",
            *table(_RUNS, [_row(r) for r in some]),
        ]
        lines += ["", *_uncertainties(here, nodes), *_front_lines(some)]
        lines += [f"{_name(r)}: {r.trouble}" for r in some if r.trouble]
    return lines


def _row(run: PeerRun) -> list[str]:
    name = f"{_name(run)}{' *' if run.example else ''}"
    if run.trouble:
        return [name, _short(run.cpu_s_per_s), *["-"] * (len(_RUNS) - 2)]
    errors = [*_millimetres(run.block_own_m), *_millimetres(run.rms_own_m), _millimetres(run.block_ours_m)[-1]]
    gain = "" if run.engine == OURS else "-" if run.gain is None else _short(run.gain)
    return [name, _short(run.cpu_s_per_s), f"{run.max_stretch:.3f}", f"{run.lowest_m:.3f}", *errors, gain]


def _front_lines(runs: Sequence[PeerRun]) -> list[str]:
    """This engine against the peers' front at one size, and against the fastest of them at round errors."""
    best = front([run for run in runs if run.engine != OURS])
    lines = ["the peers' front, from the fastest to the most accurate:"] if best else []
    for run in best:
        said = f"{_short(run.gain)} times ours" if run.gain else "no run of ours is as accurate"
        lines.append(f"  {_name(run)}: {_short(1e3 * run.error_m)} mm, {_cost(run)}, {said}")
    return lines + [line for error_m in LEVELS_M for line in _level_lines(runs, error_m)]


def _level_lines(runs: Sequence[PeerRun], error_m: float) -> list[str]:
    """The fastest run of this engine and of the peers within an error."""
    ours = fastest([run for run in runs if run.engine == OURS], error_m)
    peer = fastest([run for run in runs if run.engine != OURS], error_m)
    told = [f"{_name(run)}, {_cost(run)}" if run else "none" for run in (ours, peer)]
    ratio = f": {_short(peer.cpu_s_per_s / ours.cpu_s_per_s)} times" if ours and peer else ""
    return [f"fastest within {1e3 * error_m:g} mm: {told[0]}; of the peers {told[1]}{ratio}"] if ours or peer else []


def _name(run: PeerRun) -> str:
    return f"{run.engine}, {run.setting}"


def _cost(run: PeerRun) -> str:
    return f"{_short(run.cpu_s_per_s)} s per s"


def _uncertainties(engines: Sequence[EngineFacts], nodes: int) -> list[str]:
    known = [e for e in engines if nodes in e.block_uncertainty_m]
    told = ", ".join(f"{e.name} {' and '.join(_millimetres(e.block_uncertainty_m[nodes]))}" for e in known)
    return [f"uncertainty of the references, c4 mm at 0.25 and 0.5 s: {told}"] if known else []


def _millimetres(errors: Sequence[float]) -> list[str]:
    return [_short(1e3 * error) for error in errors] or ["-", "-"]


def _short(number: float) -> str:
    """Two digits or all whole ones."""
    return f"{number:.2g}" if number < 100 else f"{number:.0f}"


def _seconds(seconds: float | None) -> str:
    return "-" if seconds is None else f"{seconds:.1f}"
