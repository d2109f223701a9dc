"""`warpdeform scenes`: the packaged scenes, and what a scene file may say."""

import typer

from warpdeform.cli.ending import ending_well, print_json


@ending_well
def scenes(
    schema: bool = typer.Option(False, "--schema", help="Print the JSON schema of scene files instead."),
    as_json: bool = typer.Option(False, "--json", help="Print one JSON object."),
) -> None:
    """List the packaged scenes, with a line about each."""
    from warpdeform.scene.read import scene_description, scene_names
    from warpdeform.scene.schema import json_schema

    if schema:
        print_json(json_schema())
        return
    found = {name: scene_description(name) for name in scene_names()}
    if as_json:
        print_json({"scenes": [{"name": name, "description": text} for name, text in found.items()]})
        return
    width = max(map(len, found), default=0)
    for name, text in found.items():
        typer.echo(f"{name:{width}}  {text}")
