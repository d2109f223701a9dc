"""Opening USD files, with a clear line for each way in which that fails."""

from __future__ import annotations

import re
from pathlib import Path

from pxr import Tf, Usd

from warpdeform.errors import InputError, Mistake

READABLE = (".usd", ".usda", ".usdc", ".usdz")


def open_stage(path: str | Path, key: str) -> Usd.Stage:
    """Open a USD file.

    Args:
        path: A .usd, .usda, .usdc or .usdz file.
        key: The key that mistakes are reported under.

    Raises:
        InputError: Unknown suffix, no such file, or no USD in it.
    """
    path = Path(path).expanduser()

    def refuse(problem: str, remedy: str) -> InputError:
        return InputError(Mistake(key, str(path), problem, remedy))

    if path.suffix not in READABLE:
        raise refuse("is no USD file by its suffix", f"Use {', '.join(READABLE)}.")
    if not path.is_file():
        raise refuse("is a folder" if path.is_dir() else "does not exist", "Give the path of a USD file.")
    try:
        return Usd.Stage.Open(str(path))
    except Tf.ErrorException as error:
        reasons = re.findall(r": '(.*)'$", str(error), re.MULTILINE)
        detail = f" ({reasons[0]})" if reasons else ""
        raise refuse(f"cannot be read as USD{detail}", "Check the file, for example with usdview or usdcat.") from error
