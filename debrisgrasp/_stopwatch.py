"""Where the time goes, how much of it is left, and who is told."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["Progress", "Stopwatch"]

Progress = Callable[[str, float], None]
"""Called with the name of the stage and the share of it that is done, in [0, 1]."""


class Stopwatch:
    """Times the stages, tells the time left, and passes progress on."""

    def __init__(
        self, deadline: float | None, progress: Progress | None = None
    ) -> None:
        self.seconds: dict[str, float] = {}
        self.has_cut = False
        """Whether anybody who asked was told that it is late."""
        self._start = time.monotonic()
        self._deadline = deadline
        self._progress = progress or (lambda _stage, _share: None)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Time what happens inside, adding up repeated stages."""
        begin = time.monotonic()
        self._progress(name, 0.0)
        yield
        spent = time.monotonic() - begin
        self.seconds[name] = self.seconds.get(name, 0.0) + spent
        self._progress(name, 1.0)

    def report(self, name: str, share: float) -> None:
        """Tell how much of a stage is done."""
        self._progress(name, share)

    def left(self) -> float | None:
        """Seconds until the deadline, negative when it has passed; None without one."""
        if self._deadline is None:
            return None
        return self._deadline - (time.monotonic() - self._start)

    def is_late(self) -> bool:
        """Whether the deadline has passed."""
        left = self.left()
        is_late = left is not None and left < 0
        self.has_cut |= is_late
        return is_late
