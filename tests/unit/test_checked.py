"""Arguments of the wrong type are named before any work."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from importlib import import_module
from pkgutil import walk_packages
from typing import Protocol

import numpy as np
import pytest

import debrisgrasp
from debrisgrasp._arrays import FloatArray
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import InputError
from debrisgrasp.executive import Executive, SimulatedTask, TaskSettings
from debrisgrasp.executive.simulated import injections_of, simulate
from debrisgrasp.io import Capture, data_path
from debrisgrasp.pipeline import recall_plan
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary, check
from debrisgrasp.segmentation import support_graph
from debrisgrasp.settings import Settings
from debrisgrasp.viz import (
    coverage_png,
    leg_png,
    preview_png,
    prototype_png,
    prototypes_html,
    reach_html,
    reach_png,
    report_html,
    report_png,
    segmentation_png,
    selection_html,
    selection_png,
)
from debrisgrasp.workbench import record

LIBRARY = PrototypeLibrary.load()


class Orders(Protocol):
    """Something that orders."""

    def order(self) -> None: ...


class Waiter:
    def order(self) -> None: ...


@checked
def serve(
    count: int,
    share: float | None = None,
    path: str | os.PathLike[str] = "",
    tell: Callable[[str], None] | None = None,
    who: Orders | None = None,
    points: FloatArray | None = None,
) -> int:
    """Serve."""
    return (count, share, path, tell, who, points)[0]


def has_default(setting) -> bool:
    return {setting.default, setting.default_factory} != {MISSING}


def settings_of(config) -> Iterator[tuple[str, object]]:
    """Names and values of the numbers in a configuration."""
    for setting in fields(config):
        value = getattr(config, setting.name)
        is_number = isinstance(value, float | int) and not isinstance(value, bool)
        if setting.init and is_number:
            yield setting.name, value


CONFIGS = [
    config
    for module in walk_packages(debrisgrasp.__path__, "debrisgrasp.")
    if not module.name.endswith("__main__")
    for name, config in vars(import_module(module.name)).items()
    if isinstance(config, type)
    and config.__module__ == module.name
    and name.endswith(("Config", "Schedule"))
    and is_dataclass(config)
    and all(has_default(setting) for setting in fields(config))
]


@pytest.mark.parametrize("config", CONFIGS, ids=lambda config: config.__name__)
def test_every_setting_refuses_what_is_no_such_number(config):
    for name, value in settings_of(config()):
        wrong = ["text", np.nan]
        if isinstance(value, int):
            wrong += [np.inf, 2.5]
        for other in wrong:
            with pytest.raises(InputError, match=name):
                config(**{name: other})


@pytest.mark.parametrize(
    "given",
    [
        {"count": 3},
        {"count": np.int64(3), "share": 1},
        {"count": 3, "share": np.float32(0.5), "who": Waiter()},
        {"count": 3, "path": os.curdir, "tell": print, "points": [0.0, 1.0]},
    ],
)
def test_what_the_annotations_allow_is_let_through(given):
    assert serve(**given) == 3


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"count": "3"}, ["count", "'3' (str)", "an integer"]),
        ({"count": True}, ["count", "True", "an integer"]),
        ({"count": 3.0}, ["3.0", "an integer"]),
        ({"count": 3, "share": "half"}, ["share", "a finite number or None"]),
        ({"count": 3, "path": None}, ["path", "got None", "a path"]),
        ({"count": 3, "tell": "me"}, ["tell", "a function or None"]),
        ({"count": 3, "who": Waiter}, ["who", "type", "an Orders or None"]),
    ],
)
def test_anything_else_is_named(given, words):
    with pytest.raises(InputError) as refused:
        serve(**given)
    for word in words:
        assert word in str(refused.value)


def test_a_missing_argument_is_left_to_python():
    with pytest.raises(TypeError, match="count") as refused:
        serve()
    assert refused.value.__context__ is None


def test_fields_of_a_record_are_checked():
    @checked_fields
    @dataclass(frozen=True, slots=True, kw_only=True)
    class Record:
        size: float = 1.0

    assert Record(size=2).size == 2
    with pytest.raises(InputError, match="size: got 'big'"):
        Record(size="big")


RNG = np.random.default_rng(0)
CALLS = {
    "segment": lambda _: debrisgrasp.segment("pile.npz"),
    "select": lambda c: debrisgrasp.select(debrisgrasp.segment(c), c),
    "plan": lambda _: debrisgrasp.plan("pile.npz"),
    "region": lambda c: debrisgrasp.plan(c, region=[0, 0, 0, 1, 1, 1]),
    "object": lambda c: debrisgrasp.plan(c, object_label="3"),
    "progress": lambda c: debrisgrasp.plan(c, progress=True),
    "config": lambda _: debrisgrasp.Pipeline(config={}),
    "policy": lambda _: debrisgrasp.Pipeline(policy="support"),
    "prototypes": lambda _: debrisgrasp.Pipeline(prototypes=["a", "b"]),
    "settings": lambda _: debrisgrasp.Pipeline.from_settings("site.yaml"),
    "site": lambda _: Settings(robot=3),
    "motion": lambda c: debrisgrasp.plan_motion(c),
    "calibrate": lambda _: debrisgrasp.calibrate(np.eye(4)),
    "clear": lambda _: debrisgrasp.clear("pile"),
    "load": lambda _: Capture.load(None),
    "robot of a task": lambda _: Executive("roman", rng=RNG),
    "simulate": lambda _: simulate("pile", TaskSettings(), pipeline=None, rng=RNG),
    "run": lambda _: SimulatedTask().run("folder"),
    "task of a pipeline": lambda _: SimulatedTask().settings("roman"),
    "faults": lambda _: injections_of("slip"),
    "support": lambda c: support_graph(c.cloud(), debrisgrasp.segment(c)),
    "record": lambda c: record(c, "part", "robotiq_3f", object_label=1),
    "check": lambda _: check(GripperModel.load("camhand"), "brick_102"),
    "report": lambda c: report_png("plan.png", c),
    "page": lambda c: report_html("plan.html", c),
    "segments": lambda c: segmentation_png("a.png", c, c.cloud(), c.labels),
    "order": lambda c: selection_png("order.png", c),
    "order page": lambda c: selection_html("order.html", c),
    "plan that was saved": lambda c: recall_plan("grasps.json", c, "none"),
    "coverage": lambda _: coverage_png("a.png", LIBRARY),
    "reach": lambda _: reach_png("a.png", LIBRARY),
    "reach page": lambda _: reach_html("a.html", LIBRARY),
    "leg": lambda _: leg_png("a.png", "leg", [], 150.0, nominal=np.zeros((2, 3))),
    "preview": lambda _: preview_png("a.png", LIBRARY),
    "names on a sheet": lambda _: prototype_png("a.png", ["brick_102"], {}),
    "names on a page": lambda _: prototypes_html("a.html", ["brick_102"], {}),
    "sheet without hands": lambda _: prototype_png("a.png", LIBRARY, {}),
    "page without hands": lambda _: prototypes_html("a.html", LIBRARY, {}),
    "sheet": lambda _: prototype_png("a.png", [], GripperModel.load("camhand")),
    "dictionary": lambda _: prototypes_html("a.html", [], ["camhand"]),
}


@pytest.mark.parametrize("call", CALLS)
def test_public_calls_name_the_argument_that_is_of_the_wrong_type(call):
    with pytest.raises(InputError, match=r"got .*, expected "):
        CALLS[call](Capture.load(data_path("captures", "pile.npz")))


def test_numbers_of_numpy_read_as_numbers():
    error = InputError("box", got=[np.float64(0.5), np.int64(2)], expected="three")
    assert "got [0.5, 2]," in str(error)


@checked
def stack(
    sizes: tuple[float, float],
    names: tuple[str, ...] = (),
    waiters: Sequence[Orders] = (),
) -> tuple[object, ...]:
    """Stack."""
    return sizes, names, waiters


def test_a_list_stands_for_a_tuple():
    assert stack([1, 2.5], ["a"]) == ((1, 2.5), ("a",), ())


@checked
def span(box: tuple[tuple[float, float], tuple[float, float]]) -> object:
    """Return it."""
    return box


def test_a_list_stands_for_a_tuple_inside_another():
    for box in ([[0, 1], [2, 3]], ([0, 1], [2, 3])):
        assert span(box) == ((0, 1), (2, 3))
    with pytest.raises(InputError, match=r"box\[1\]"):
        span([[0, 1], 2])


def test_an_array_stands_for_a_tuple():
    for box in (np.array([[0.0, 1.0], [2.0, 3.0]]), (np.arange(2), [2, 3])):
        assert span(box) == ((0, 1), (2, 3))
    with pytest.raises(InputError, match=r"box\[0\]: got 3 values"):
        span(np.zeros((2, 3)))
    with pytest.raises(InputError, match="box"):
        span(np.array(1.0))


@checked
def mesh(parts: tuple[FloatArray, tuple[int, ...]]) -> object:
    """Return it."""
    return parts


def test_an_array_stays_one_where_one_is_wanted():
    points, ids = mesh((np.zeros((2, 3)), np.arange(2)))
    assert isinstance(points, np.ndarray)
    assert ids == (0, 1)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"sizes": 3}, ["sizes", "3 (int)", "a tuple of 2"]),
        ({"sizes": (1.0, 2.0, 3.0)}, ["sizes", "3 values", "expected 2"]),
        ({"sizes": (1.0, "2")}, ["sizes[1]", "'2'", "a finite number"]),
        ({"sizes": (1.0, np.nan)}, ["sizes[1]", "nan", "a finite number"]),
        ({"sizes": (1, 2), "names": "ab"}, ["names", "'ab'", "a tuple"]),
        ({"sizes": (1, 2), "names": ("a", 3)}, ["names[1]", "a text"]),
        ({"sizes": (1, 2), "waiters": [Waiter(), 4]}, ["waiters[1]", "an Orders"]),
    ],
)
def test_what_a_tuple_or_a_sequence_holds_is_looked_at(given, words):
    with pytest.raises(InputError) as refused:
        stack(**given)
    for word in words:
        assert word in str(refused.value)


def test_no_number_is_larger_than_all_floats():
    with pytest.raises(InputError, match=r"share: got int, expected a finite number"):
        serve(3, share=10**400)
    serve(10**400)


def test_no_number_is_nan():
    with pytest.raises(InputError, match="share: got nan"):
        serve(3, share=float("nan"))


@checked
def keep(*, held: bool) -> bool:
    """Return it."""
    return held


def test_true_of_numpy_is_true():
    assert keep(held=np.array([1, 2]).max() > 1) is True
    assert keep(held=np.False_) is False
    for wrong in (1, "yes", np.int64(1), None):
        with pytest.raises(InputError, match="expected True or False"):
            keep(held=wrong)


def test_the_policy_that_is_proposed_can_be_made():
    with pytest.raises(InputError, match="SelectionPolicy") as caught:
        debrisgrasp.Pipeline(robot="none", policy="priority")
    call, _, module = caught.value.mend.removesuffix(".").partition(
        ", for instance, of "
    )
    name = call.removesuffix("()")
    assert hasattr(getattr(import_module(module), name)(), "order")
