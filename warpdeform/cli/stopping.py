"""Ctrl-C and SIGTERM: end after the frame that is being computed, so that every file stays whole."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class Stop:
    """Whether the run was asked to end.

    Attributes:
        requested: Whether it was.
        patient: Whether to wait for the end of the frame; before the first one there is nothing to wait for.
    """

    def __init__(self) -> None:
        self.requested = False
        self.patient = False

    def __call__(self) -> bool:
        """Whether to stop now."""
        return self.requested

    def handle(self, number: int, frame: FrameType | None) -> None:
        """Take a signal: the first one waits for the frame, the second one does not."""
        if self.requested or not self.patient:
            raise KeyboardInterrupt
        self.requested = True


@contextmanager
def stopping() -> Iterator[Stop]:
    """Take SIGINT and SIGTERM as a wish to stop while the body runs."""
    stop = Stop()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {number: signal.signal(number, stop.handle) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield stop
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
