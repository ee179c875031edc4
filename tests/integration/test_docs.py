"""The documents tell the truth: code runs, links lead somewhere, commands parse."""

from __future__ import annotations

import ast
import re
import shlex
from dataclasses import fields, is_dataclass
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import numpy as np
import pytest
import yaml

import debrisgrasp
from debrisgrasp.cli.program import build_parser
from debrisgrasp.errors import MissingExtraError
from debrisgrasp.io import data_path
from debrisgrasp.prototypes import GripperModel, PrototypeLibrary, check
from debrisgrasp.segmentation import LccpConfig, SupportAware
from debrisgrasp.settings import SiteLimits

ROOT = Path(__file__).parents[2]
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def blocks(path: Path, *languages: str) -> list[str]:
    found = FENCE.findall(path.read_text())
    return [body for language, body in found if language in languages]


def named(*languages: str) -> list[object]:
    return [
        pytest.param(body, id=f"{path.stem}-{number}")
        for path in DOCUMENTS
        for number, body in enumerate(blocks(path, *languages), start=1)
    ]


def commands() -> list[object]:
    lines = []
    for path in DOCUMENTS:
        for body in blocks(path, "", "sh"):
            joined = body.replace("\\\n", " ")
            words = (shlex.split(line, comments=True) for line in joined.splitlines())
            lines += [line[1:] for line in words if line[:1] == ["debrisgrasp"]]
    return [pytest.param(line, id=" ".join(line)) for line in lines]


def yaml_block(document: str, name: str) -> str:
    """Return the block that describes the prototype or hand of that name."""
    for body in blocks(ROOT / "docs" / document, "yaml"):
        if yaml.safe_load(body).get("name") == name:
            return body
    raise LookupError(name)


@pytest.fixture(scope="module")
def grasps_json(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("plan") / "grasps.json"
    capture = debrisgrasp.Capture.load(data_path("captures", "pile.npz"))
    debrisgrasp.plan(capture, robot="none", gripper="camhand").save(path)
    return path.read_text()


@pytest.fixture
def prelude(tmp_path, monkeypatch, grasps_json) -> dict[str, object]:
    """What a reader has at hand: the arrays of a capture, and files made earlier on.

    ``depth``, ``K`` and ``T_base_camera`` are those of the bundled capture. The working
    folder holds it as my_capture.npz, a plan as grasps.json, the hand and prototype of
    docs/prototypes.md, and the site of docs/configuration.md.
    """
    monkeypatch.chdir(tmp_path)
    with np.load(data_path("captures", "pile.npz")) as archive:
        arrays = {key: archive[key] for key in ("depth", "K", "T_base_camera")}
    np.savez("my_capture.npz", **arrays)
    Path("grasps.json").write_text(grasps_json)
    Path("site.yaml").write_text(blocks(ROOT / "docs/configuration.md", "yaml")[0])
    Path("parallel_jaw.yaml").write_text(yaml_block("prototypes.md", "parallel_jaw"))
    Path("jaw_prototypes").mkdir()
    Path("jaw_prototypes/pipe.yaml").write_text(
        yaml_block("prototypes.md", "pipe_065")
        .replace("robotiq_3f", "parallel_jaw")
        .replace("basic", "parallel")
        .replace("0.1]", "0.085]")
    )
    return dict(arrays)


@pytest.mark.parametrize("source", named("python"))
def test_python_runs(source, prelude):
    try:
        exec(compile(source, "document", "exec"), {"__name__": "document", **prelude})
    except MissingExtraError as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("arguments", commands())
def test_command_parses(arguments):
    assert build_parser(arguments).parse_args(arguments).run


def test_there_are_commands_and_code_to_test():
    assert len(commands()) > 15
    assert len(named("python")) > 10


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(path):
    for target in LINK.findall(path.read_text()):
        if "://" in target:
            continue
        file, _, anchor = target.partition("#")
        document = path.parent / file if file else path
        assert document.exists(), target
        if anchor:
            assert anchor in anchors(document), target


def anchors(path: Path) -> set[str]:
    """Anchors of the headings, as the usual renderers of Markdown make them."""
    prose = FENCE.sub("", path.read_text())
    headings = re.findall(r"^#+ (.*)$", prose, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in headings}


@pytest.mark.parametrize("source", named("json", "yaml"))
def test_settings_are_well_formed(source):
    assert isinstance(yaml.safe_load(source), dict)


def test_the_prototype_that_is_shown_is_sound(tmp_path):
    (tmp_path / "pipe_065.yaml").write_text(yaml_block("prototypes.md", "pipe_065"))
    (prototype,) = PrototypeLibrary.load(tmp_path)
    assert not check(prototype, GripperModel.load(prototype.gripper))


@pytest.mark.usefixtures("prelude")
def test_the_hand_that_is_shown_closes_on_its_prototype():
    hand = GripperModel.load("parallel_jaw.yaml")
    (prototype,) = PrototypeLibrary.load("jaw_prototypes", grippers={hand.name: hand})
    assert hand.opening_range == pytest.approx((0.0, 0.12))
    assert not check(prototype, hand)


def test_settings_of_the_planner_are_listed_with_their_defaults():
    rows = re.findall(
        r"^\| `([\w.]+)` \| ([\dN(\"][^|]*) \|",
        (ROOT / "docs/planner.md").read_text(),
        re.M,
    )
    listed = {name: ast.literal_eval(value) for name, value in rows}
    pipeline = debrisgrasp.PipelineConfig()
    actual = settings(debrisgrasp.PlannerConfig()) | {
        item.name: getattr(pipeline, item.name)
        for item in fields(pipeline)
        if not is_dataclass(getattr(pipeline, item.name))
    }
    assert listed == actual


def test_settings_of_selection_are_listed_with_their_defaults():
    rows = re.findall(
        r"^\| `([\w.]+)` \| ([\d(][^|]*) \|",
        (ROOT / "docs/selection.md").read_text(),
        re.M,
    )
    listed = {name: ast.literal_eval(value) for name, value in rows}
    actual = settings(SupportAware())
    del actual["point"]  # an array; the text names it
    assert listed == actual


def test_every_setting_of_lccp_is_mapped_to_its_name_in_pcl():
    table = (ROOT / "docs/segmentation.md").read_text()
    rows = re.findall(r"^\|[^|]*\|[^|]*\| `([a-z_.]+)` \|", table, re.M)
    assert sorted(rows) == sorted(settings(LccpConfig()))


def settings(config: object, section: str = "") -> dict[str, object]:
    """Values of a record and of those inside it, by their dotted names."""
    found: dict[str, object] = {}
    for item in fields(config):  # type: ignore[arg-type]  # records only
        value, name = getattr(config, item.name), section + item.name
        found |= settings(value, name + ".") if is_dataclass(value) else {name: value}
    return found


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_modules_that_are_named_exist(path):
    text = path.read_text()
    for file in re.findall(r"`(data/[\w/]+(?:\.yaml|/))`", text):
        assert (ROOT / file).exists(), file


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_scripts_that_are_named_exist(path):
    text = path.read_text()
    for script in re.findall(r"(?:examples|docs)/[\w/]+\.py", text):
        assert (ROOT / script).is_file(), script
    for module in re.findall(r"python -m (tests\.benchmarks\.\w+)", text):
        assert (ROOT / f"{module.replace('.', '/')}.py").is_file(), module


def test_the_site_that_is_shown_is_sound(tmp_path):
    (tmp_path / "site.yaml").write_text(
        blocks(ROOT / "docs/configuration.md", "yaml")[0]
    )
    settings = debrisgrasp.Settings.load(tmp_path / "site.yaml")
    assert settings.robot_model().limits("right").hardware.force == 100.0


def test_fields_of_a_site_are_listed():
    text = (ROOT / "docs/configuration.md").read_text()
    listed = re.findall(
        r"`([\w.]+)`", "".join(re.findall(r"^\| (`.*?) \|", text, re.M))
    )
    names = {item.name for item in fields(debrisgrasp.Settings)} - {"path", "limits"}
    names |= {f"limits.{item.name}" for item in fields(SiteLimits)} | {"schema"}
    inside = {"policy": "selection.", "priority_point": "selection."}
    inside |= dict.fromkeys(("calibration", "camera_pose", "camera_file"), "camera.")
    assert set(listed) == {
        inside.get(name, "") + name.removeprefix("camera_") for name in names
    }


def test_the_paper_map_names_what_exists():
    """Every equation has its row, and each function of a row is in the package."""
    text = (ROOT / "docs/paper_map.md").read_text()
    rows = re.findall(r"^\| (.+?) \| (.+?) \| .+ \|$", text, re.MULTILINE)
    equations = " ".join(left for left, _ in rows)
    for number in range(1, 15):
        spans = re.findall(r"Eq\. (\d+)-(\d+)", equations)
        is_inside = any(int(a) <= number <= int(b) for a, b in spans)
        assert is_inside or re.search(rf"Eq\. {number}\b|\({number}[ab]?\)", equations)
    known = public_names()
    cells = " ".join(right for _, right in rows)
    named = re.findall(r"`((?:\w+\.)*[A-Za-z]\w{2,})`", cells)
    written = [n for n in named if not n.startswith("T_") and not n.endswith(".yaml")]
    missing = [name for name in written if name not in known]
    assert len(written) > 40
    assert not missing


def public_names() -> set[str]:
    """Names of modules, what is public in them, and attributes of public classes."""
    known = {"R_BE"}
    for item in walk_packages(debrisgrasp.__path__, "debrisgrasp."):
        if item.name.split(".")[1] in ("__main__", "cli", "sim_robot"):
            continue
        module = import_module(item.name)
        path = item.name.removeprefix("debrisgrasp.")
        known.add(path)
        for name in getattr(module, "__all__", ()):
            value = getattr(module, name)
            known |= {name, f"{path}.{name}"}
            for inner in dir(value) if isinstance(value, type) else ():
                known |= {inner, f"{name}.{inner}", f"{path}.{name}.{inner}"}
    return known


def test_every_page_is_in_the_navigation():
    content = (ROOT / "mkdocs.yml").read_text().partition("\nnav:\n")[2]
    pages = list(re.findall(r": ([\w/]+\.md)$", content, re.M))
    written = (ROOT / "docs").rglob("*.md")
    assert sorted(pages) == sorted(str(p.relative_to(ROOT / "docs")) for p in written)
