"""`warpdeform info`: what a scene needs."""

from __future__ import annotations

import dataclasses

import typer

from warpdeform.cli.ending import ending_well, print_json, stdout_for_json
from warpdeform.cli.options import Device, Integrator, Json, Precision, Scene, Set, asked_scene


@ending_well
def info(
    scene: Scene,
    sets: Set = None,
    device: Device = None,
    integrator: Integrator = None,
    precision: Precision = None,
    as_json: Json = False,
) -> None:
    """Print the bodies, terms, kernels and bytes that a scene needs."""
    with stdout_for_json(as_json):
        built = asked_scene(scene, sets, device=device, integrator=integrator, precision=precision)
        from warpdeform.scene.play import simulation_of

        found = simulation_of(built).info()
    if as_json:
        print_json({"scene": built.name, **dataclasses.asdict(found), "bytes_total": found.bytes_total})
        return
    for line in found.lines():
        typer.echo(line)
