"""How intervals are divided into steps: halves after failures, an estimate of the error, ends that are met exactly."""

from itertools import pairwise

import numpy as np
import pytest

from warpdeform.integrators.control import FINEST, MOST_GROWTH, AdaptiveSteps, FixedSteps, StepControl
from warpdeform.result import Outcome, StepRecord

GOOD = StepRecord(Outcome.CONVERGED)
BAD = StepRecord(Outcome.STALLED, completed=False, steps=0, retries=1)


def divided(control: StepControl, start: float, end: float, fails: set[int] = frozenset()) -> list[float]:  # type: ignore[assignment]
    """Times that an interval is divided by, where the attempts numbered in `fails` do."""
    control.begin(start, end, end - start)
    times, attempt = [start], 0
    while not (control.over or control.given_up):
        a, b, length = control.step
        assert a == times[-1] < b <= end
        assert length == pytest.approx(b - a, rel=1e-12)
        control.judge(BAD if attempt in fails else GOOD)
        if attempt not in fails:
            times.append(b)
        attempt += 1
    return times


def test_fixed_steps_are_the_interval() -> None:
    control = FixedSteps()
    assert divided(control, 0.0, 0.1) == [0.0, 0.1]
    assert divided(control, 0.1, 0.2) == [0.1, 0.2]


def test_steps_alike_are_alike_to_the_bit() -> None:
    control, dt = FixedSteps(), 1.0 / 60.0
    for n in range(100):
        control.begin(n * dt, (n + 1) * dt, dt)
        assert control.step == (n * dt, (n + 1) * dt, dt)
        control.judge(GOOD)


def test_a_failure_halves_the_step_and_two_successes_double_it_again() -> None:
    control = FixedSteps()
    assert divided(control, 1.0, 2.0, {0, 1}) == [1.0, 1.25, 1.5, 2.0]
    assert divided(control, 2.0, 3.0) == [2.0, 2.5, 3.0]
    assert divided(control, 3.0, 4.0) == [3.0, 4.0]
    # A failure later on: what is done stays done.
    assert divided(control, 0.0, 1.0, {0, 2}) == [0.0, 0.5, 0.75, 1.0]
    control.reset()
    assert divided(control, 0.0, 1.0) == [0.0, 1.0]


def test_a_step_is_not_divided_beyond_a_64th() -> None:
    control = FixedSteps()
    assert divided(control, 0.0, 1.0, set(range(6))) == [k / 64 for k in (0, 1, 2, 4, 6, 8, 12, 16, 24, 32, 48, 64)]
    control.reset()
    assert divided(control, 0.0, 1.0, set(range(7))) == [0.0]
    assert control.given_up
    assert FINEST == 2**6


def adapted(control: AdaptiveSteps, end: float, frames: int, error: float, order: int) -> tuple[list[float], int]:
    """Times of accepted steps, and attempts that were rejected, where the estimate is error * step^(order + 1)."""
    times, rejected = [0.0], 0
    for frame in range(frames):
        control.begin(frame * end, (frame + 1) * end, end)
        while not control.over:
            _, b, length = control.step
            estimate = error * length ** (order + 1)
            good = estimate <= 1.0
            outcome = Outcome.CONVERGED if good else Outcome.INACCURATE
            control.judge(StepRecord(outcome, completed=good, error=estimate, error_order=order))
            rejected += not good
            if good:
                times.append(b)
        assert times[-1] == (frame + 1) * end
    return times, rejected


@pytest.mark.parametrize("order", [1, 2])
def test_adaptive_steps_keep_to_the_tolerance_and_end_with_the_frame(order: int) -> None:
    control = AdaptiveSteps(1.0)
    best = 0.03
    times, rejected = adapted(control, 0.25, 8, best ** -(order + 1), order)
    steps = np.diff(times)
    assert steps.max() <= best
    assert steps[-20:].min() > 0.4 * best
    assert rejected < 6
    assert len(times) < 1.35 * 2.0 / (0.9 * best)
    assert max(b / a for a, b in pairwise(steps)) <= MOST_GROWTH * (1 + 1e-9)


def test_adaptive_steps_are_as_long_as_the_frame_where_they_may_be() -> None:
    times, rejected = adapted(AdaptiveSteps(1.0), 0.25, 4, 1e-9, 2)
    assert (times, rejected) == ([0.0, 0.25, 0.5, 0.75, 1.0], 0)


def test_adaptive_steps_give_up() -> None:
    control = AdaptiveSteps(1.0)
    control.begin(0.0, 1.0, 1.0)
    for attempt in range(7):
        assert not control.given_up, attempt
        control.judge(BAD)
    assert control.given_up
    control.reset()
    control.begin(0.0, 1.0, 1.0)
    count = 0
    while not control.given_up:
        control.judge(StepRecord(Outcome.INACCURATE, completed=False, error=1e30, error_order=2))
        count += 1
    assert 5 < count < 12
