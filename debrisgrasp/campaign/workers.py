"""Where runs are computed: processes here, or a Dask cluster.

Each kind can be opened again after it broke, and says how many runs it wants at once.
"""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    ProcessPoolExecutor,
    wait,
)
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from importlib import import_module
from multiprocessing import (
    forkserver,
    get_all_start_methods,
    get_context,
    resource_tracker,
)
from multiprocessing.connection import Connection
from typing import Any, NamedTuple, NoReturn, Protocol

from debrisgrasp._arrays import require_range
from debrisgrasp._signals import ENDINGS, signals_wait
from debrisgrasp._workers import cores
from debrisgrasp.errors import ConfigError, InputError, MissingExtraError

__all__ = ["ClusterWorkers", "Crew", "LocalWorkers", "OwnWorkers", "Workers"]

_THREAD_VARIABLES = (
    "MKL_NUM_THREADS",
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
)


class Crew(NamedTuple):
    """An executor that is open."""

    executor: Executor
    width: int
    """How many runs it is given at a time, so that no worker waits."""
    time_limit: float | None = None
    """A run that takes longer ends its worker, as one that crashes does [s]."""


class Workers(Protocol):
    """Opens executors."""

    def open(self) -> AbstractContextManager[Crew]:
        """Start workers; leaving the context ends what runs on them."""


@dataclass(frozen=True, slots=True)
class LocalWorkers:
    """Processes on this machine, with one thread of linear algebra each.

    They are not forked from this process, since a fork copies locks that other threads
    hold, but from a server without threads that has loaded the package once; where
    there is none, each is started anew. They ignore Ctrl-C, and end with their parent,
    however that ends.
    """

    count: int = 0
    """How many; 0: as many as there are cores."""
    time_limit: float = 1800.0
    """A run that takes longer ends its process [s]."""

    def __post_init__(self) -> None:
        if not 0 <= self.count <= 1024:
            raise ConfigError("workers", got=self.count, expected="0 to 1024")

    @contextmanager
    def open(self) -> Iterator[Crew]:
        """Start the processes."""
        count = self.count or cores()
        context = _context()
        reader, writer = context.Pipe(duplex=False)
        executor = ProcessPoolExecutor(
            count, mp_context=context, initializer=_follow_parent, initargs=(reader,)
        )
        try:
            with _one_thread_each():
                with _interrupts_wait(), suppress(BrokenExecutor):
                    _serve(context)
                    wait([executor.submit(int) for _ in range(count)])
                yield Crew(executor, 2 * count, self.time_limit)
        finally:
            # Ends every process, also those that wait for a lock that one which was
            # killed has taken with it: they are out of reach of the executor's signals.
            writer.close()
            executor.shutdown(wait=True, cancel_futures=True)
            reader.close()


@dataclass(frozen=True, slots=True)
class ClusterWorkers:
    """Workers of a Dask cluster (extra ``cluster``), with this package installed."""

    address: str
    """Of the scheduler, for instance ``tcp://10.0.0.5:8786``."""
    timeout: float = 30.0
    """Longest wait for the scheduler, and for its first worker [s]."""
    time_limit: float = 1800.0
    """A run that takes longer ends its worker, which its nanny starts again [s]."""

    @contextmanager
    def open(self) -> Iterator[Crew]:
        """Connect, or raise `InputError` if no scheduler answers or has workers."""
        client = self._client()
        try:
            try:
                client.wait_for_workers(1, timeout=self.timeout)
            except (OSError, TimeoutError) as error:
                raise self._refusal("no worker", "a worker or more") from error
            cores = sum(client.ncores().values())
            # A run that is sent twice counts once; the scheduler sees to the rest.
            executor = client.get_executor(pure=False)
            try:
                yield Crew(executor, 4 * max(cores, 1), self.time_limit)
            except BaseException:
                executor.shutdown(wait=False)  # none begins any more; nobody waits
                raise
            executor.shutdown()
        finally:
            client.close()

    def _client(self) -> Any:
        try:
            distributed = import_module("distributed")
        except ImportError as error:
            raise MissingExtraError("a campaign on a cluster", "cluster") from error
        try:
            return distributed.Client(
                self.address, timeout=self.timeout, set_as_default=False
            )
        except (OSError, TimeoutError, ValueError) as error:
            raise self._refusal(str(error), "a Dask scheduler that answers") from error

    def _refusal(self, got: str, expected: str) -> InputError:
        return InputError(
            f"cluster {self.address}",
            got=got,
            expected=expected,
            mend="Start `dask scheduler` and `dask worker`, and give its address.",
        )


@dataclass(frozen=True, slots=True)
class OwnWorkers:
    """Any other kind of executor.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> workers = OwnWorkers(lambda: ThreadPoolExecutor(4))
    """

    make: Callable[[], Executor]
    """Makes a new one, which is shut down in the end: the last may have broken."""
    width: int = 8
    """How many runs it is given at a time."""

    def __post_init__(self) -> None:
        if not callable(self.make):
            self._refuse(self.make)
        require_range("width", self.width, 1, 100_000)

    def _refuse(self, got: object) -> NoReturn:
        raise InputError(
            "make of OwnWorkers",
            got=type(got).__name__,
            expected="a function that makes an executor",
            mend="OwnWorkers(lambda: ProcessPoolExecutor(4)), for instance.",
        )

    @contextmanager
    def open(self) -> Iterator[Crew]:
        """Make an executor, and shut it down in the end.

        Raises
        ------
        InputError
            If what is made is none.
        """
        executor = self.make()
        if not isinstance(executor, Executor):
            self._refuse(executor)
        try:
            yield Crew(executor, self.width)
        finally:
            executor.shutdown(wait=True, cancel_futures=True)


def _context() -> Any:
    """How processes are started."""
    if "forkserver" not in get_all_start_methods():
        return get_context("spawn")
    context = get_context("forkserver")
    context.set_forkserver_preload(["debrisgrasp.campaign"])
    with signals_wait():  # it lets some through again once it has been started
        resource_tracker.ensure_running()
    return context


def _serve(context: Any) -> None:
    """Start the server of processes, out of reach of signals, as all that it starts.

    Terminals and services send them to a whole group; the parent ends its processes.
    """
    if context.get_start_method() != "forkserver":
        return
    with signals_wait():
        forkserver.ensure_running()


def _follow_parent(reader: Connection) -> None:
    """Leave Ctrl-C to the parent, and end when it does."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def wait() -> None:
        try:
            reader.recv()
        except (EOFError, OSError):
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Hold Ctrl-C back: a process that is starting would tell of its end at length.

    Other signals, too, where they do the same.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    before = {
        number: signal.signal(number, lambda number, _: held.append(number))
        for number in ENDINGS
        if callable(signal.getsignal(number))
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if held:
        raise KeyboardInterrupt


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that start now use one thread each, unless told otherwise."""
    added = [name for name in _THREAD_VARIABLES if name not in os.environ]
    os.environ.update(dict.fromkeys(added, "1"))
    try:
        yield
    finally:
        for name in added:
            os.environ.pop(name, None)
