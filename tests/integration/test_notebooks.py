"""The notebooks run from top to bottom, and their stored outputs show something."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest

from .test_docs import anchors

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")
pytest.importorskip("ipykernel")

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))

TELLING = {
    "1_segment_a_pile": "ground removed",
    "2_plan_and_explain": "grasps on object",
    "3_calibrate": "ptu_tilt_joint slipped",
    "4_make_a_prototype": "my_post fits",
    "5_clear_a_pile": "plan_grasp",
}


def outputs(notebook: Any) -> list[Any]:
    return [output for cell in notebook.cells for output in cell.get("outputs", ())]


def printed(notebook: Any) -> str:
    texts = (o.text for o in outputs(notebook) if o.output_type == "stream")
    return "".join(texts)


def pictures(notebook: Any) -> list[str]:
    found = (o.get("data", {}) for o in outputs(notebook))
    return [kind for data in found for kind in data if kind.startswith("image/")]


def test_every_notebook_is_tested():
    assert {path.stem for path in NOTEBOOKS} == set(TELLING)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    client = nbclient.NotebookClient(
        notebook,
        timeout=300,
        kernel_name="python3",
        resources={"metadata": {"path": str(tmp_path)}},
    )
    client.execute(env=os.environ | {"MPLCONFIGDIR": str(tmp_path)})
    assert TELLING[path.stem] in printed(notebook)
    assert pictures(notebook)


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_outputs_can_be_read_without_running(path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    assert TELLING[path.stem] in printed(notebook)
    assert pictures(notebook)
    assert path.stat().st_size < 600_000
    text = path.read_text()
    assert not re.search(r"/(home|root|tmp|Users)/", text), "a path of some machine"
    assert not [o for o in outputs(notebook) if o.get("name") == "stderr"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_links_lead_somewhere(path):
    notebook = nbformat.read(path, as_version=4)
    texts = "\n".join(c.source for c in notebook.cells if c.cell_type == "markdown")
    for target in re.findall(r"\]\(([^)\s]+)\)", texts):
        file, _, anchor = target.partition("#")
        assert (path.parent / file).is_file(), target
        assert not anchor or anchor in anchors(path.parent / file), target
