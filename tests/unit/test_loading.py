"""A signal while modules load ends a command, and is never lost in one of them."""

from __future__ import annotations

import signal
import sys
import threading

import pytest

from debrisgrasp import cli
from debrisgrasp.cli.loading import signals_wait


@pytest.fixture
def hears_ctrl_c():
    """Take Ctrl-C as a terminal's process does: in the background it may be ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("hears_ctrl_c")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
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


def test_beside_the_main_thread_signals_are_left_alone():
    masks = []

    def look():
        with signals_wait():
            masks.append(signal.pthread_sigmask(signal.SIG_BLOCK, ()))

    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert not masks[0] & {signal.SIGINT, signal.SIGTERM}
    with signals_wait():
        inside = signal.pthread_sigmask(signal.SIG_BLOCK, ())
    assert {signal.SIGINT, signal.SIGTERM} <= inside
