"""Every public name says what it is, its shapes and units, frames and errors."""

from __future__ import annotations

import ast
import inspect
import re
import textwrap
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

from .test_architecture import LAYERS

PUBLIC = ["", *sorted(part for part in LAYERS if not part.startswith("_"))]
"""Subpackages and modules that a user may import from."""
SHAPE = re.compile(r"shape|\(\.\.\.|\([\w +*]+,[\w +*,]*\)|\[[^\]]+\]|unit|in \[0, 1\]")
"""What a shape or a unit looks like in words."""
FRAME = re.compile(r"frame|base|camera|palm|tool|hand|coordinates|region|turn|pose of")
NAMES_ITS_FRAMES = re.compile(r"(Ts?|R)_[a-z]+_[a-z]+$")
"""As in ``T_base_hand``, which needs no more words."""


def names() -> Iterator[tuple[str, str, Any]]:
    for part in PUBLIC:
        path = f"debrisgrasp.{part}".rstrip(".")
        module = import_module(path)
        for name in getattr(module, "__all__", ()):
            value = getattr(module, name)
            if callable(value) and getattr(value, "__module__", "").startswith(
                "debrisgrasp"
            ):
                yield path, name, value


def params() -> list[Any]:
    unique = {id(value): (path, name, value) for path, name, value in names()}
    return [
        pytest.param(value, id=f"{path}.{name}")
        for path, name, value in unique.values()
    ]


@pytest.mark.parametrize("value", params())
def test_has_a_docstring(value):
    assert (inspect.getdoc(value) or "").strip()
    if not inspect.isclass(value):
        return
    for name, member in vars(value).items():
        if name.startswith("_") or not (
            inspect.isfunction(member) or isinstance(member, property)
        ):
            continue
        assert inspect.getdoc(member), f"{value.__name__}.{name}"


def test_arrays_in_records_say_shape_or_unit():
    missing = []
    for param in params():
        value = param.values[0]
        if inspect.isclass(value):
            missing += [f"{value.__name__}.{name}" for name in untold(value)]
    assert not missing


def functions(value: Any) -> Iterator[tuple[str, Any]]:
    """Public functions of a value: itself, or the methods of a class."""
    if inspect.isfunction(value):
        yield value.__qualname__, value
    if not inspect.isclass(value):
        return
    for name, member in vars(value).items():
        inner = getattr(member, "fget", getattr(member, "__func__", member))
        if not name.startswith("_") and inspect.isfunction(inner):
            yield f"{value.__name__}.{name}", inner


def public_functions() -> list[tuple[str, Any]]:
    return [each for param in params() for each in functions(param.values[0])]


def test_functions_of_arrays_say_shapes_or_units():
    assert not [
        name
        for name, function in public_functions()
        if any("Array" in str(kind) for kind in function.__annotations__.values())
        and not SHAPE.search(inspect.getdoc(function) or "")
    ]


def test_poses_say_their_frames():
    missing = []
    for name, function in public_functions():
        if function.__module__.startswith("debrisgrasp.geometry"):
            continue  # it knows no frames
        for argument, kind in function.__annotations__.items():
            said = name.rpartition(".")[2] if argument == "return" else argument
            if re.search(r"\bSE3\b", str(kind)) and not (
                NAMES_ITS_FRAMES.match(said)
                or FRAME.search(inspect.getdoc(function) or "")
            ):
                missing.append(f"{name}: {argument}")
    assert not missing


def test_functions_tell_the_errors_that_they_raise():
    missing = []
    for name, function in public_functions():
        tree = ast.parse(textwrap.dedent(inspect.getsource(function)))
        raised = {
            ast.unparse(node.exc.func)
            for node in ast.walk(tree)
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call)
        } - {"AssertionError", "NotImplementedError"}
        doc = inspect.getdoc(function) or ""
        missing += [
            f"{name}: {error}"
            for error in raised
            if error.endswith("Error") and error not in doc
        ]
    assert not missing


def untold(kind: type) -> list[str]:
    """Array fields of a class without shape or unit in their docstring."""
    tree = ast.parse(inspect.getsource(kind))
    (body,) = (node.body for node in tree.body if isinstance(node, ast.ClassDef))
    found = []
    for node, following in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.AnnAssign) or not isinstance(node.target, ast.Name):
            continue
        if node.target.id.startswith("_") or "Array" not in ast.unparse(
            node.annotation
        ):
            continue
        text = ""
        if isinstance(following, ast.Expr) and isinstance(
            following.value, ast.Constant
        ):
            text = str(following.value.value)
        if not SHAPE.search(text):
            found.append(node.target.id)
    return found


def test_the_api_pages_cover_every_public_part():
    pages = Path(__file__).parents[2] / "docs" / "api"
    covered = set(re.findall(r"^::: debrisgrasp\.(\w+)", _text(pages), re.MULTILINE))
    known = {part for part in PUBLIC if part and part not in ("cli", "api")}
    facade = {"perception", "pipeline", "executable", "settings"}
    assert covered >= known - facade, known - facade - covered


def test_a_command_is_named_that_draws_each_picture():
    docs = Path(__file__).parents[2] / "docs"
    told = (docs / "pictures.py").read_text()
    assert [p.name for p in (docs / "images").iterdir() if p.name not in told] == []


def _text(folder: Path) -> str:
    return "\n".join(path.read_text() for path in sorted(folder.glob("*.md")))
