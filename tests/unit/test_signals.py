"""A signal while modules load ends a command, and is never lost in one of them."""

from __future__ import annotations

import signal
import sys

import pytest

from debrisgrasp import cli
from debrisgrasp._signals import ENDINGS, signals_wait


@pytest.fixture
def hears_signals():
    """Hear them as a terminal's process does: in the background some are ignored."""
    before = {
        number: signal.signal(number, signal.default_int_handler) for number in ENDINGS
    }
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("hears_signals")
@pytest.mark.parametrize("number", ENDINGS)
def test_what_loads_meanwhile_hears_nothing_of_a_signal(
    tmp_path, monkeypatch, capsys, number
):
    name = f"swallows_{number.name.lower()}"
    (tmp_path / f"{name}.py").write_text(
        "import signal\ntry:\n"
        f"    signal.raise_signal(signal.{number.name})\n"
        "except BaseException:\n    pass\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(cli, "import_module", lambda _: __import__(name))
    assert cli.main(["--version"]) == 130
    assert "interrupted" in capsys.readouterr().err
    assert name in sys.modules  # it loaded to its end


def test_signals_wait_in_here_and_not_beyond():
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    with signals_wait():
        inside = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert set(ENDINGS) <= inside
    assert signal.pthread_sigmask(signal.SIG_BLOCK, ()) == before


def test_what_is_ignored_stays_ignored(monkeypatch):
    """As under nohup: a terminal that is lost ends nothing then."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    heard = []
    monkeypatch.setattr(
        cli, "import_module", lambda _: heard.append(signal.getsignal(signal.SIGHUP))
    )
    try:
        with pytest.raises(AttributeError):  # what was loaded is no program
            cli.main(["--version"])
    finally:
        signal.signal(signal.SIGHUP, before)
    assert heard == [signal.SIG_IGN]
