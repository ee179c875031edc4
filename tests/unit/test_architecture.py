"""Imports only point down, and importing the package has no side effect."""

from __future__ import annotations

import ast
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[2] / "debrisgrasp"

LAYERS = {
    "errors": 0,
    "_physics": 0,
    "_words": 0,
    "_locks": 0,
    "_arrays": 1,
    "_memo": 1,
    "_checked": 1,
    "_parsing": 1,
    "_files": 2,
    "_fields": 2,
    "_stopwatch": 1,
    "_unreadable": 1,
    "_signals": 1,
    "_workers": 1,
    "geometry": 2,
    "segmentation": 3,
    "prototypes": 3,
    "kinematics": 3,
    "calibration": 3,
    "worlds": 3,
    "planning": 4,
    "control": 4,
    "motion": 4,
    "robot": 5,
    "sim": 5,
    "io": 5,
    "viz": 5,
    "_site_limits": 4,
    "_joints": 4,
    "_site_file": 6,
    "sim_robot": 6,
    "_calibrating": 6,
    "ros": 6,
    "settings": 7,
    "pipeline": 8,
    "workbench": 8,
    "executive": 9,
    "trials": 9,
    "campaign": 10,
    "viewer": 10,
    "api": 11,
    "cli": 12,
}

MODULES = sorted(
    path for path in PACKAGE.rglob("*.py") if path.name not in ("__main__.py",)
)


def part_of(path: Path) -> str:
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imported_parts(path: Path) -> set[str]:
    found = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            parts = node.module.split(".")
            if parts[0] == "debrisgrasp" and len(parts) > 1:
                found.add(parts[1])
    return found


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_only_point_down(path):
    own = part_of(path)
    if own in ("__init__", "__main__"):
        return
    for other in imported_parts(path) - {own}:
        assert LAYERS[other] < LAYERS[own], f"{own} imports {other}"


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_relative_imports_stay_within_their_folder(path):
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom):
            assert node.level <= 1


@pytest.mark.parametrize(
    "name",
    ["", *(f".{part}" for part in LAYERS if (PACKAGE / part / "__init__.py").exists())],
)
def test_every_public_name_exists(name):
    module = import_module(f"debrisgrasp{name}")
    missing = [public for public in module.__all__ if not hasattr(module, public)]
    assert not missing


def fresh(code: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip()


def test_import_prints_nothing_and_loads_nothing_heavy():
    heavy = "{'scipy', 'pinocchio', 'coal', 'fcl', 'trimesh', 'matplotlib', 'plotly'}"
    code = f"import debrisgrasp, sys; print(sorted({heavy} & set(sys.modules)))"
    assert fresh(code) == "[]"


@pytest.mark.parametrize(
    ("words", "told"),
    [(["--version"], "debrisgrasp "), (["--help"], "usage: debrisgrasp ")],
)
def test_the_version_and_the_commands_are_told_at_once(words, told):
    code = (
        "import sys\n"
        "from debrisgrasp.cli import main\n"
        "try:\n"
        f"    main({words})\n"
        "except SystemExit as end:\n"
        "    print(end.code, {'numpy', 'scipy'} & set(sys.modules))"
    )
    *lines, rest = fresh(code).splitlines()
    assert lines[0].startswith(told)
    assert rest == "0 set()"


def test_import_of_the_facade_leaves_random_state_and_log_handlers_alone():
    code = (
        "import logging, random, numpy as np\n"
        "before = np.random.get_state()[1].tolist(), random.getstate()\n"
        "import debrisgrasp.api\n"
        "after = np.random.get_state()[1].tolist(), random.getstate()\n"
        "print(before == after, logging.getLogger('debrisgrasp').handlers)"
    )
    assert fresh(code) == "True []"
