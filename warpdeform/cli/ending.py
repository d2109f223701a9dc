"""How commands end: exit codes, errors as lines on stderr, one JSON object on stdout."""

from __future__ import annotations

import functools
import json
import math
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any, ParamSpec, TypeVar

import typer

FAILED = 1
REFUSED = 2
INTERRUPTED = 130

Arguments = ParamSpec("Arguments")
Result = TypeVar("Result")


def ending_well(command: Callable[Arguments, Result]) -> Callable[Arguments, Result]:
    """Make a command end with an exit code and one line for each error, instead of a traceback."""

    @functools.wraps(command)
    def wrapped(*args: Arguments.args, **kwargs: Arguments.kwargs) -> Result:
        from warpdeform.errors import InputError, WarpdeformError

        try:
            return command(*args, **kwargs)
        except InputError as error:
            complain(str(error).splitlines())
            raise typer.Exit(REFUSED) from None
        except WarpdeformError as error:
            complain(str(error).splitlines())
            raise typer.Exit(FAILED) from None
        except KeyboardInterrupt as interrupt:
            complain(["interrupted", *getattr(interrupt, "__notes__", [])])
            raise typer.Exit(INTERRUPTED) from None

    return wrapped


def complain(lines: Iterable[str]) -> None:
    """Write lines to stderr."""
    for line in lines:
        typer.echo(line, err=True)


@contextmanager
def stdout_for_json(wanted: bool) -> Iterator[None]:
    """Send what is printed inside to stderr, so that stdout holds the JSON object alone."""
    if not wanted:
        yield
        return
    stdout, sys.stdout = sys.stdout, sys.stderr
    try:
        yield
    finally:
        sys.stdout = stdout


def print_json(values: Mapping[str, Any]) -> None:
    """Print one JSON object; numbers that JSON cannot say become null."""
    typer.echo(json.dumps(_plain(values), indent=2, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, str | int | float | bool) or value is None:
        return value
    return str(value)


def quiet_warp() -> None:
    """Keep Warp from telling about devices and modules on stdout."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
