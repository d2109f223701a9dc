"""How long steps are: fixed ones that are halved where they fail, or as long as an error estimate lets them be."""

from warpdeform.result import Outcome, StepRecord

FINEST = 64
"""A step that fails is repeated with half its length, down to this part of it."""
GOOD_STEPS = 2
"""Steps that have to succeed before the length is doubled again."""
MOST_GROWTH = 2.0
"""Largest ratio of a step to the one before it: BDF2 is stable below 1 + sqrt 2."""
LEAST_SHARE = 0.2
"""Most that a step shrinks at once."""
AIM = 0.9
"""Share of the step by which an estimate just meets its tolerance that is taken."""
LEAST_STEP = 1.0e-6
"""Shortest step that an error estimate may ask for, as a share of the longest."""


class StepControl:
    """Divides intervals of time into steps.

    One interval is passed through at a time: `begin` it, take the `step` it names, `judge` what became of that, until
    it is `over` or `given_up`.

    Attributes:
        over: The interval is done.
        given_up: Why the interval cannot be done: a step failed that must not be shorter.
    """

    def begin(self, start: float, end: float, length: float) -> None:
        """Enter an interval; it ends exactly where it should.

        Args:
            start: Its begin [s].
            end: Its end [s].
            length: Its length without the round-off of times [s], so that steps alike are alike to the bit.
        """
        self._start, self._end, self._whole = start, end, length
        self.over, self.given_up = False, False

    @property
    def step(self) -> tuple[float, float, float]:
        """Begin, end and length of the next step [s]."""
        raise NotImplementedError

    def judge(self, attempt: StepRecord) -> None:
        """Take note of how the step went."""
        raise NotImplementedError

    def reset(self) -> None:
        """Forget how earlier steps went."""


class FixedSteps(StepControl):
    """The interval as one step; after a failure in halves, quarters and so on, and back again once those succeed."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        self._width, self._successes = FINEST, 0

    def begin(self, start: float, end: float, length: float) -> None:
        super().begin(start, end, length)
        self._at = 0

    @property
    def step(self) -> tuple[float, float, float]:
        length = self._whole * self._width / FINEST
        return self._time(self._at), self._time(self._at + self._width), length

    def judge(self, attempt: StepRecord) -> None:
        if not attempt.completed:
            self.given_up = self._width == 1
            self._width, self._successes = max(self._width // 2, 1), 0
            return
        self._at += self._width
        self._successes += 1
        self.over = self._at == FINEST
        if self._successes >= GOOD_STEPS and self._width < FINEST and self._at % (2 * self._width) == 0:
            self._width, self._successes = 2 * self._width, 0

    def _time(self, at: int) -> float:
        return self._end if at == FINEST else self._start + self._whole * at / FINEST


class AdaptiveSteps(StepControl):
    """Steps whose estimated error stays below a tolerance, none longer than the interval.

    Args:
        tolerance: Largest error of a position in one step [m].
    """

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self.reset()

    def reset(self) -> None:
        self._length: float | None = None
        self._failures = 0

    def begin(self, start: float, end: float, length: float) -> None:
        super().begin(start, end, length)
        self._at = start
        if self._length is None:
            self._length = length

    @property
    def step(self) -> tuple[float, float, float]:
        assert self._length is not None
        left = self._whole if self._at == self._start else self._end - self._at
        if self._length >= left * (1.0 - 1e-9):
            return self._at, self._end, left
        # Two steps alike rather than one and a sliver.
        length = min(self._length, 0.5 * left)
        return self._at, self._at + length, length

    def judge(self, attempt: StepRecord) -> None:
        _, end, taken = self.step
        if attempt.completed or attempt.outcome is Outcome.INACCURATE:
            self._failures = 0
            fits = (self._tolerance / max(attempt.error, 1e-300)) ** (1.0 / (attempt.error_order + 1))
            self._length = taken * min(MOST_GROWTH, max(LEAST_SHARE, AIM * fits))
            if attempt.completed:
                self._at = end
                self._length = min(self._length, self._whole)
                self.over = end == self._end
            else:
                self.given_up = self._length < LEAST_STEP * self._whole
        else:
            self._failures += 1
            self._length = 0.5 * taken
            self.given_up = 2**self._failures > FINEST
