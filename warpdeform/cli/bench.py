"""`warpdeform bench`: what kernels, steps and starts cost on this machine, and how the cost grows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Protocol

import typer

from warpdeform.cli.ending import ending_well, print_json, stdout_for_json
from warpdeform.cli.options import Json, Precision, Set

if TYPE_CHECKING:
    from collections.abc import Sequence

bench = typer.Typer(no_args_is_help=True, help="Time kernels, steps and starts; medians, minima and ratios.")

Sizes = Annotated[str, typer.Option("--sizes", metavar="N,N,...", help="Nodes along each side of the sheets.")]
Repeats = Annotated[int, typer.Option("--repeats", min=1, help="Rounds that count.")]
Core = Annotated[int | None, typer.Option("--core", min=0, help="Core to stay on; the first allowed by default.")]
BenchDevice = Annotated[str, typer.Option("--device", help="cpu, cuda:0, ... or auto.")]


class Result(Protocol):
    """What every benchmark returns."""

    @property
    def machine(self) -> dict[str, Any]:
        """What it ran on."""

    def as_dict(self) -> dict[str, Any]:
        """As plain values."""

    def lines(self) -> Sequence[str]:
        """As people read it."""


@bench.command()
@ending_well
def kernels(
    sizes: Annotated[
        str | None,
        typer.Option("--sizes", metavar="N,N,...", help="Nodes along each side; 64 to 512, of blocks 17 to 65."),
    ] = None,
    solid: Annotated[bool, typer.Option("--solid", help="Blocks instead of sheets.")] = False,
    precision: Precision = None,
    repeats: Repeats = 30,
    device: BenchDevice = "cpu",
    core: Core = None,
    as_json: Json = False,
) -> None:
    """Time each pass of a Newton step in ns per node, beside a yardstick, at the CPU's lane width and at width 1."""

    def run() -> Result:
        from warpdeform.study.bench.kernels import bench_kernels

        return bench_kernels(
            _numbers("--sizes", sizes or ("17,33,65" if solid else "64,128,256,512")),
            precision=_checked(precision),
            repeats=repeats,
            device=device,
            core=core,
            solid=solid,
            said=_say,
        )

    report(run, as_json)


@bench.command()
@ending_well
def step(
    sizes: Annotated[
        str | None,
        typer.Option("--sizes", metavar="N,N,...", help="Nodes along each side; 32 to 128, on CUDA 64 to 2048."),
    ] = None,
    newton: Annotated[str, typer.Option("--newton", metavar="N,N,...", help="Newton iterations per step.")] = "1,2",
    scene: Annotated[str, typer.Option("--scene", help="Name or path of the scene.")] = "hanging",
    precision: Precision = None,
    repeats: Repeats = 5,
    device: BenchDevice = "cpu",
    core: Core = None,
    sets: Set = None,
    as_json: Json = False,
) -> None:
    """Time a scene on one core or a GPU: seconds per simulated second, iterations, memory, share of copy bandwidth."""

    def run() -> Result:
        from warpdeform.scene import parse_override
        from warpdeform.study.bench.step import bench_step

        return bench_step(
            _numbers("--sizes", sizes) if sizes else None,
            newton=_numbers("--newton", newton, least=0),
            scene=scene,
            precision=_checked(precision),
            device=device,
            repeats=repeats,
            core=core,
            overrides=[parse_override(text) for text in sets or ()],
            said=_say,
        )

    report(run, as_json)


@bench.command()
@ending_well
def threads(
    sizes: Annotated[str, typer.Option("--sizes", metavar="N,N,...", help="Nodes along each side.")] = "64,128,256,512",
    counts: Annotated[str, typer.Option("--threads", metavar="N,N,...", help="Threads beside one.")] = "2",
    scene: Annotated[str, typer.Option("--scene", help="Name or path of the scene.")] = "hanging",
    repeats: Repeats = 5,
    sets: Set = None,
    as_json: Json = False,
) -> None:
    """Time a step shared by threads beside one thread, and compare the results to the bit."""

    def run() -> Result:
        from warpdeform.scene import parse_override
        from warpdeform.study.bench.threads import bench_threads

        return bench_threads(
            _numbers("--sizes", sizes),
            _numbers("--threads", counts, least=1),
            scene=scene,
            repeats=repeats,
            overrides=[parse_override(text) for text in sets or ()],
            said=_say,
        )

    report(run, as_json)


@bench.command()
@ending_well
def iterations(
    sizes: Annotated[str, typer.Option("--sizes", metavar="N,N,...", help="Nodes along the longer side.")] = "17,33,65",
    scenes: Annotated[str, typer.Option("--scenes", metavar="S,S,...", help="Scenes.")] = "hanging,flag,carpet",
    steps: Annotated[int, typer.Option("--steps", min=1, help="Steps of a run at most.")] = 36,
    precision: Annotated[str, typer.Option("--precision", help="float64 (to 1e-4) or float32 (to 1e-3).")] = "float64",
    sets: Set = None,
    as_json: Json = False,
) -> None:
    """Count the iterations of conjugate gradient with multigrid until a sheet folds, over sizes and materials."""

    def run() -> Result:
        from warpdeform.scene import parse_override
        from warpdeform.study.bench.iterations import bench_iterations

        return bench_iterations(
            _numbers("--sizes", sizes),
            scenes=scenes.split(","),
            steps=steps,
            precision=_checked(precision),
            overrides=[parse_override(text) for text in sets or ()],
            said=_say,
        )

    report(run, as_json)


@bench.command()
@ending_well
def scaling(
    sizes: Sizes = "16,32,64,128,256,512,1024",
    scene: Annotated[str, typer.Option("--scene", help="Name or path of the scene.")] = "hanging",
    duration: Annotated[float, typer.Option("--duration", help="Simulated time of every size [s].")] = 0.5,
    precision: Precision = None,
    device: BenchDevice = "cpu",
    core: Core = None,
    sets: Set = None,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Draw the curves (.png, .svg, .pdf).")
    ] = None,
    as_json: Json = False,
) -> None:
    """Time a scene on finer and finer grids: cost per node and step, iterations, memory."""

    def run() -> Result:
        from warpdeform.scene import parse_override
        from warpdeform.study.bench.scaling import bench_scaling
        from warpdeform.study.bench.scaling_picture import check_picture, draw_scaling

        if picture is not None:
            check_picture(picture)
        found = bench_scaling(
            _numbers("--sizes", sizes),
            scene=scene,
            duration=duration,
            precision=_checked(precision),
            device=device,
            core=core,
            overrides=[parse_override(text) for text in sets or ()],
            said=_say,
        )
        if picture is not None:
            draw_scaling(found, picture)
        return found

    report(run, as_json)


@bench.command()
@ending_well
def terms(
    side: Annotated[int, typer.Option("--size", min=4, help="Nodes along each side of the sheet.")] = 128,
    precision: Precision = None,
    repeats: Repeats = 9,
    core: Core = None,
    as_json: Json = False,
) -> None:
    """Time bodies of every kind with and without each term: ns, bytes and compile seconds that the term adds."""

    def run() -> Result:
        from warpdeform.study.bench.terms import bench_terms

        return bench_terms(side, precision=_checked(precision), repeats=repeats, core=core, said=_say)

    report(run, as_json)


@bench.command()
@ending_well
def start(
    scene: Annotated[str, typer.Option("--scene", help="Name or path of the scene.")] = "hanging",
    repeats: Repeats = 5,
    as_json: Json = False,
) -> None:
    """Time fresh processes: `--help`, and the first frame with an empty and with a full kernel cache."""

    def run() -> Result:
        from warpdeform.study.bench.start import bench_start

        return bench_start(scene, repeats=repeats, said=_say)

    report(run, as_json)


@bench.command()
@ending_well
def peers(
    sizes: Sizes = "32,64,128",
    engines: Annotated[str, typer.Option("--engines", metavar="NAME,...", help="Which engines; all by default.")] = "",
    repeats: Repeats = 5,
    limit: Annotated[float, typer.Option("--limit", min=1.0, help="CPU seconds at which a run is given up.")] = 200.0,
    quick: Annotated[bool, typer.Option("--quick", help="One run each, limit 20 CPU seconds, no starts.")] = False,
    core: Core = None,
    cache: Annotated[Path | None, typer.Option("--cache", help="Folder that keeps the references.")] = None,
    picture: Annotated[Path | None, typer.Option("--picture", help="Picture of error against time to draw.")] = None,
    as_json: Json = False,
) -> None:
    """Time other engines on the sheet of `hanging`, and their errors: one core, CPU seconds per simulated second."""

    def run() -> Result:
        from warpdeform.study.peers.bench import Effort, bench_peers

        effort = Effort(repeats=1, enough_s=0.0, limit_s=20.0) if quick else Effort(repeats=repeats, limit_s=limit)
        times = bench_peers(
            _numbers("--sizes", sizes, least=3),
            engines=[name.strip() for name in engines.split(",")] if engines else (),
            effort=effort,
            core=core,
            cache=cache,
            starts=not quick,
            said=_say,
        )
        if picture is not None:
            from warpdeform.study.peers.picture import draw_peers

            draw_peers(times.runs, picture)
        return times

    report(run, as_json)


@bench.command()
@ending_well
def block(
    nodes: Annotated[int, typer.Option("--size", min=3, help="Nodes along each side.")] = 10,
    seconds: Annotated[float, typer.Option("--duration", min=0.05, help="Simulated time [s].")] = 2.0,
    repeats: Repeats = 3,
    core: Core = None,
    as_json: Json = False,
) -> None:
    """Drop a block of rubber on the ground, here, in MuJoCo and in Newton: CPU time, how deep it dips, its volume."""

    def run() -> Result:
        from warpdeform.study.peers.block_bench import bench_block

        return bench_block(nodes, seconds=seconds, repeats=repeats, core=core, said=_say)

    report(run, as_json)


def report(run: Callable[[], Result], as_json: bool) -> None:
    """Run a benchmark or study and print what it found, for people or as JSON."""
    from warpdeform.cli.ending import quiet_warp

    with stdout_for_json(as_json):
        quiet_warp()
        result = run()
    if as_json:
        print_json(result.as_dict())
        return
    from warpdeform.study.bench.machine import sentence

    typer.echo(sentence(result.machine))
    typer.echo("")
    for line in result.lines():
        typer.echo(line)


def _say(line: str) -> None:
    typer.echo(line, err=True)


def _numbers(option: str, text: str, least: int = 2) -> list[int]:
    from warpdeform.errors import InputError, Mistake

    words = text.split(",")
    if not all(word.strip().isdigit() and int(word) >= least for word in words):
        problem = f"must be whole numbers of at least {least}, separated by commas"
        raise InputError(
            Mistake(option, text, problem, "Use for example 64,128." if least > 1 else "Use for example 1,2.")
        )
    return [int(word) for word in words]


def _checked(precision: str | None) -> str:
    from warpdeform.errors import InputError, Mistake

    if precision not in (None, "float32", "float64"):
        raise InputError(Mistake("--precision", precision, "is not a precision", "Use float32 or float64."))
    return precision or "float32"
