"""Finding the device that a simulation runs on."""

from typing import Any

import warp as wp

from warpdeform.errors import InputError, Mistake


def find_device(name: str) -> Any:
    """The Warp device of that name; "auto" is the first CUDA device, or the CPU.

    Raises:
        InputError: There is no such device; the message lists those that exist.
    """
    wp.init()
    if name == "auto":
        return wp.get_preferred_device()
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError):
        names = ", ".join(str(device) for device in wp.get_devices())
        raise InputError(
            Mistake("device", name, "does not exist on this machine", f"Use auto or one of: {names}.")
        ) from None
