"""Standard output and error that work goes on without when they can't be written."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from typing import Any, TextIO, cast

__all__ = ["SteadyOutput", "steady_output"]


class SteadyOutput:
    """A stream whose first failure is kept, and after which nothing is written.

    A robot does not stop in the middle of its work because a log is full, or because
    whoever read it has gone.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self.fault: OSError | None = None
        """What the stream failed with."""

    def write(self, text: str) -> int:
        """Write, unless the stream has failed."""
        if self.fault is None:
            try:
                self._pass_on(text)
            except OSError as error:
                self._give_up(error)
        return len(text)

    def flush(self) -> None:
        """Pass on what was written, unless the stream has failed."""
        if self.fault is None:
            try:
                self._stream.flush()
            except OSError as error:
                self._give_up(error)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)

    def _pass_on(self, text: str) -> None:
        """Write; letters that the stream has not, as in names of files, as codes."""
        try:
            self._stream.write(text)
        except UnicodeEncodeError:
            encoding = self._stream.encoding
            coded = text.encode(encoding, "backslashreplace").decode(encoding)
            self._stream.write(coded)

    def _give_up(self, error: OSError) -> None:
        self.fault = error
        # What the stream still holds would fail again as the interpreter ends.
        with suppress(OSError, ValueError):
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, self._stream.fileno())
            os.close(nowhere)


@contextmanager
def steady_output() -> Iterator[SteadyOutput]:
    """Have what is printed meanwhile fail once at most; gives standard output."""
    # Without a terminal, as in some services, there may be neither.
    with Path(os.devnull).open("w", encoding="utf-8") as nothing:
        out = SteadyOutput(sys.stdout or nothing)
        told = SteadyOutput(sys.stderr or nothing)
        with redirect_stdout(cast(TextIO, out)), redirect_stderr(cast(TextIO, told)):
            try:
                yield out
            finally:
                out.flush()
                told.flush()
