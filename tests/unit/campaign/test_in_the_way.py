"""What was in the way at the start of a run, and what of it is in the end."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from debrisgrasp.campaign import UNCLASSIFIED, RunSpec, account, fake_run, run_fake
from debrisgrasp.executive import TaskSettings
from debrisgrasp.geometry import SE3, Box
from debrisgrasp.worlds import Body, World

SETTINGS = TaskSettings()


def block(name: str, *p: float, mass: float = 1.0, height: float = 0.3) -> Body:
    solid = Box([0.1, 0.1, height / 2])
    return Body(name, "block", (solid,), mass, T_base_body=SE3.from_parts(p=p))


def counted(begun: list[Body], ended: list[Body]) -> tuple[list[str], list[str]]:
    truth = SimpleNamespace(begun=World(tuple(begun)), world=World(tuple(ended)))
    found = account(truth, SETTINGS)
    return [b.name for b in found.gone], [b.name for b in found.kept]


@pytest.mark.parametrize(
    ("end", "is_gone"),
    [
        ((1.0, 0.0, 0.15), False),
        ((1.4, 0.0, 0.15), False),  # put down 0.4 m away, and still in the way
        ((0.2, 1.2, 0.15), True),  # at the drop-off
        ((2.5, 0.0, 0.15), True),  # lost beyond the workspace
    ],
)
def test_an_object_counts_once_wherever_it_ends(end, is_gone):
    gone, kept = counted([block("a", 1.0, 0.0, 0.15)], [block("a", *end)])
    assert (gone, kept) == ((["a"], []) if is_gone else ([], ["a"]))


def test_what_fell_so_flat_that_it_is_driven_over_is_out_of_the_way():
    begun, ended = block("a", 1.0, 0.0, 0.15), block("a", 1.0, 0.0, 0.02, height=0.04)
    assert counted([begun], [ended]) == (["a"], [])


def test_only_what_was_in_the_way_and_can_be_carried_counts():
    bodies = [
        block("heavy", 1.0, 0.0, 0.15, mass=SETTINGS.max_mass + 1),
        block("low", 1.2, 0.0, 0.02, height=0.04),
        block("beside", 1.0, 1.5, 0.15),
    ]
    aside = [block(b.name, 0.2, 1.2, 0.15, mass=b.mass) for b in bodies]
    assert counted(bodies, aside) == ([], [])


def test_what_was_there_in_a_run_that_ended_by_an_exception_counts(monkeypatch):
    def broken(*_: object, **__: object) -> None:
        raise ZeroDivisionError("told to")

    monkeypatch.setattr(fake_run, "simulate", broken)
    record = run_fake(RunSpec(name="x", seed=4, tier="single"))
    assert record.outcome == UNCLASSIFIED
    assert "ZeroDivisionError: told to" in record.error
    assert (record.n_objects, record.n_removed) == (1, 0)
