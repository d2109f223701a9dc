"""The figures that studies draw on; matplotlib is an extra."""

from typing import Any

from warpdeform.errors import InputError, Mistake


def new_figure(size: tuple[float, float]) -> Any:
    """An empty figure of that size [inches].

    Raises:
        InputError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        problem, remedy = f"needs matplotlib ({error})", "Run pip install 'warpdeform[pictures]'."
        raise InputError(Mistake("the picture", None, problem, remedy)) from None
    return Figure(figsize=size, layout="constrained")
