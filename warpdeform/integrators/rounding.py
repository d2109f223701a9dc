"""What float32 rounds away of a fall: positions far from the origin, or very short steps.

Velocities of implicit methods are differences of positions over the stage's step, so that what is rounded away of a
position is not made up for later (docs/accuracy.md, "float32 and short steps").
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from warpdeform.errors import Mistake
from warpdeform.state import State

MOST_LOST = 0.01
"""Share of a fall that may be lost before it is said."""


@dataclass(frozen=True)
class LostFall:
    """The axis along which most of a fall is lost.

    Attributes:
        share: Largest share of what gravity adds in a stage that may be rounded away.
        resolved: What positions resolve there [m].
        moved: What gravity moves in a stage [m].
    """

    share: float = 0.0
    resolved: float = 0.0
    moved: float = 0.0

    @property
    def _seen(self) -> str:
        return f"resolves {self.resolved:.2g} m at the bodies, and gravity moves them by {self.moved:.2g} m in a stage"

    def mistake(self) -> Mistake:
        """The refusal of a scene whose bodies would stand still."""
        remedy = "Use float64, longer steps, or bring the scene nearer to the origin."
        return Mistake("precision", "float32", f"{self._seen}: they would stand still", remedy)

    def note(self) -> str:
        """The sentence about falls that are off."""
        return f"float32 {self._seen}: falls may be off by {self.share:.0%}; float64 does not lose that."


def worst_fall(states: Sequence[State], gravity: Sequence[float], tau: float) -> LostFall:
    """The axis along which float32 loses most of a fall.

    Args:
        states: The bodies, where they start.
        gravity: Acceleration of gravity [m/s2].
        tau: Shortest effective step of a stage [s].
    """
    worst = LostFall()
    for axis, pull in enumerate(gravity):
        reach = max(float(np.abs(state.model.initial_positions[..., axis]).max()) for state in states)
        resolved, moved = float(np.spacing(np.float32(reach))), abs(pull) * tau * tau
        if pull and 0.5 * resolved >= worst.share * moved:
            worst = LostFall(0.5 * resolved / moved if moved else np.inf, resolved, moved)
    return worst
