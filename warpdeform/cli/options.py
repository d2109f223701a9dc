"""Options that several commands share, and the scene that they ask for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

import typer

from warpdeform.cli.ending import quiet_warp

if TYPE_CHECKING:
    from warpdeform.scene import BuiltScene

Scene = Annotated[str, typer.Argument(help="Name of a packaged scene, or path of a scene file.", metavar="SCENE")]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a key, e.g. body.0.nodes=[33,33]; may be repeated."),
]
Frames = Annotated[int | None, typer.Option("--frames", help="Write exactly this many samples.")]
Fps = Annotated[float | None, typer.Option("--fps", help="Frames per second; the time step follows.")]
Device = Annotated[str | None, typer.Option("--device", help="auto, cpu, cuda:0, ...")]
Integrator = Annotated[
    str | None,
    typer.Option(
        "--integrator",
        help="bdf2, tr-bdf2, sdirk2, implicit-euler, energy-momentum, linear-implicit, verlet, symplectic-euler, "
        "terzopoulos, terzopoulos-exact.",
    ),
]
Precision = Annotated[str | None, typer.Option("--precision", help="float32 or float64.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but errors.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")]


def asked_scene(
    scene: str,
    sets: list[str] | None,
    *,
    frames: int | None = None,
    fps: float | None = None,
    device: str | None = None,
    integrator: str | None = None,
    precision: str | None = None,
) -> BuiltScene:
    """The scene that a command line asks for.

    Raises:
        InputError: Everything that is wrong with the file and the options.
    """
    quiet_warp()
    from warpdeform.scene import Override, load_scene, parse_override

    overrides = [parse_override(text) for text in sets or ()]
    flags = {
        "scene.fps": ("--fps", fps),
        "solver.device": ("--device", device),
        "solver.integrator": ("--integrator", integrator),
        "solver.precision": ("--precision", precision),
    }
    overrides += [Override(key, value, flag) for key, (flag, value) in flags.items() if value is not None]
    return load_scene(scene, overrides, frames=frames)
