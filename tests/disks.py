"""A disk that is full, as far as this process is concerned."""

from __future__ import annotations

import resource
import signal
from contextlib import contextmanager


@contextmanager
def files_up_to(size):
    """Let no file grow larger than so many bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
