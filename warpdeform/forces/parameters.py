"""Numbers that the host changes between steps and recorded kernels read."""

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray


class Parameters:
    """A small device array that the host writes between steps, and only when its values change.

    Recorded kernels keep scalars as they were, but see what arrays hold: so whatever changes from step to step (step
    size, gravity, wind, moving points) goes through one of these.

    Attributes:
        array: The device array.
    """

    def __init__(self, values: ArrayLike, real: Any, device: Any) -> None:
        """Make the array with its first values."""
        self._host = np.array(values, dtype=wp.dtype_to_numpy(real))
        self.array: wp.array = wp.array(self._host, dtype=real, device=device)

    @property
    def values(self) -> NDArray[Any]:
        """What the array holds, on the host."""
        return self._host.copy()

    def write(self, values: ArrayLike) -> bool:
        """Set the values, of the shape given at first; does nothing if they are what the array holds.

        Returns:
            Whether they were others.
        """
        new = np.asarray(values, dtype=self._host.dtype)
        changed = not np.array_equal(new, self._host)
        if changed:
            self._host[...] = new
            self.array.assign(self._host)
        return changed

    def bytes(self) -> int:
        """Device memory [bytes]."""
        return int(self._host.nbytes)
