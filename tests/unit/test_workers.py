"""Work done beside other work."""

from __future__ import annotations

import threading

import numpy as np
import pytest

from debrisgrasp import _workers
from debrisgrasp._workers import beside


@pytest.fixture(autouse=True)
def _two_cores(monkeypatch):
    monkeypatch.setattr(_workers, "cores", lambda: 2)


def test_a_second_worker_does_it_on_a_thread_of_its_own():
    with beside(threading.get_ident, workers=2) as ask:
        assert ask() != threading.get_ident()


@pytest.mark.parametrize(("workers", "cores"), [(1, 8), (2, 1)])
def test_one_worker_does_it_when_asked(monkeypatch, workers, cores):
    monkeypatch.setattr(_workers, "cores", lambda: cores)
    done = []
    with beside(lambda: done.append(threading.get_ident()), workers=workers) as ask:
        assert not done
        ask()
    assert done == [threading.get_ident()]


def test_asking_raises_what_the_work_raised():
    def work() -> None:
        raise ValueError("no")

    with beside(work, workers=2) as ask, pytest.raises(ValueError, match="no"):
        ask()
    with beside(work, workers=2):
        pass  # nobody asked


def test_settings_for_invalid_values_hold_on_the_thread_too():
    def work() -> None:
        np.zeros(1) / 0.0

    caught = pytest.raises(FloatingPointError)
    with np.errstate(invalid="raise"), beside(work, workers=2) as ask, caught:
        ask()


def test_work_is_over_when_the_caller_fails():
    done = threading.Event()
    with pytest.raises(KeyError), beside(done.set, workers=2):
        raise KeyError
    assert done.is_set()
