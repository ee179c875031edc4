"""Write the pictures and pages that a command was asked for."""

from __future__ import annotations

import os
from argparse import ArgumentParser
from collections.abc import Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from debrisgrasp._files import read_json, require_writable
from debrisgrasp.errors import ConfigError, OutputError
from debrisgrasp.io import Capture
from debrisgrasp.prototypes import CoverageMap, GraspPrototype, GripperModel, check
from debrisgrasp.segmentation import Candidate, Segmentation, support_graph

if TYPE_CHECKING:
    from debrisgrasp.pipeline import PlanningResult

from .values import some_path

__all__ = [
    "PAGE_FORMS",
    "PICTURE_FORMS",
    "REPORT_FORMS",
    "add_reports",
    "print_written",
    "require_own",
    "require_own_labels",
    "require_places",
    "write_coverage",
    "write_plan_reports",
    "write_prototype_sheet",
    "write_segmentation_picture",
    "write_selection_report",
]

REPORT_FORMS = (".html", ".png")
"""Suffixes of the reports of a plan."""
PICTURE_FORMS = (".png",)
"""Suffixes of what is only drawn, not written as a page."""
PAGE_FORMS = (".html",)
"""Suffixes of what is only written as a page."""
_FORMS: Mapping[tuple[str, ...], str] = {PICTURE_FORMS: "picture", PAGE_FORMS: "page"}


def add_reports(parser: ArgumentParser, what: str) -> None:
    """Add ``--report`` for a command that writes a page, a picture, or both."""
    parser.add_argument(
        "--report",
        type=some_path,
        action="append",
        default=[],
        metavar="FILE",
        help=f"{what} as {' or '.join(REPORT_FORMS)}; may be given twice",
    )


def require_places(
    reports: Iterable[Path | None],
    forms: Sequence[str],
    *others: Path | None,
    source: Path | None = None,
) -> None:
    """Raise before any work is done if a result could not be written after it.

    Parameters
    ----------
    reports
        Files whose suffix names their form; None stands for one not asked for.
    forms
        The suffixes that reports may have.
    others
        Further files to write.
    source
        What is read, which no result may replace.
    """
    wanted = [path for path in reports if path]
    for path in wanted:
        if path.suffix.lower() not in forms:
            raise ConfigError(
                f"name of a {_FORMS.get(tuple(forms), 'picture or page')}",
                got=str(path),
                expected="a name that ends in " + " or ".join(forms),
            )
    taken = set() if source is None else {os.path.realpath(source)}
    for path in (*wanted, *(path for path in others if path)):
        require_writable(path)
        if os.path.realpath(path) in taken:
            raise OutputError(path, "it is what is read, or another result goes there")
        taken.add(os.path.realpath(path))


def require_own(path: Path | None, schema: str) -> None:
    """Raise if a file is there that is no earlier result, but somebody's own.

    Parameters
    ----------
    path
        Of a result as JSON; None stands for one not asked for.
    schema
        Of such results, whatever their version; an empty file is nobody's.
    """
    if path is None or not _is_filled(path):
        return
    family, _, _ = schema.rpartition("/")
    try:
        content = read_json(path)
    except ConfigError:
        content = None
    found = content.get("schema") if isinstance(content, dict) else None
    if str(found).rpartition("/")[0] != family:
        raise OutputError(path, f"what is there is not of {family}, and would be lost")


def require_own_labels(path: Path | None) -> None:
    """Raise if arrays (.npz) are there that are more than labels, as captures are."""
    if path is None or not _is_filled(path):
        return
    try:
        with np.load(path) as content:
            names = list(content)
    except (OSError, ValueError, BadZipFile):
        names = []
    if names != ["labels"]:
        raise OutputError(path, "what is there is not labels alone, and would be lost")


def _is_filled(path: Path) -> bool:
    return path.is_file() and path.stat().st_size > 0


def print_written(*paths: Path | None) -> None:
    """Say which files were written, if any were."""
    if written := ", ".join(str(path) for path in paths if path):
        print(f"wrote {written}")


def write_plan_reports(result: PlanningResult, paths: Sequence[Path]) -> None:
    """Write a report per path, in the form that its suffix names."""
    if not paths:
        return
    viz = _drawing()
    report = viz.Report.of(result, result.capture.name)
    writers = {".png": viz.report_png, ".html": viz.report_html}
    for path in paths:
        writers[path.suffix.lower()](path, report)


def write_segmentation_picture(
    capture: Capture,
    segmentation: Segmentation,
    order: Sequence[Candidate],
    path: Path,
) -> None:
    """Write the capture with its objects in colours, numbered if there is an order."""
    _drawing().segmentation_png(
        path, capture, capture.cloud(), segmentation, order=tuple(order)
    )


def write_selection_report(
    capture: Capture,
    segmentation: Segmentation,
    order: Sequence[Candidate],
    path: Path,
) -> None:
    """Write who lies on whom and the order of removal, in the form of the suffix."""
    viz = _drawing()
    writers = {".png": viz.selection_png, ".html": viz.selection_html}
    cloud = capture.cloud()
    report = viz.SelectionReport(
        capture=capture,
        cloud=cloud,
        segmentation=segmentation,
        support=support_graph(segmentation, cloud),
        order=tuple(order),
    )
    writers[path.suffix.lower()](path, report)


def write_prototype_sheet(
    path: Path,
    prototypes: Sequence[GraspPrototype],
    grippers: Mapping[str, GripperModel],
) -> None:
    """Write a picture or a page of prototypes, each with its hand."""
    if path.suffix.lower() == ".png":
        _drawing().prototype_png(path, prototypes, grippers)
        return
    findings = {
        p.name: [str(finding) for finding in check(p, grippers[p.gripper])]
        for p in prototypes
    }
    _drawing().prototypes_html(path, prototypes, grippers, findings)


def write_coverage(path: Path, coverage: CoverageMap) -> None:
    """Write the map of what a dictionary covers."""
    _drawing().coverage_png(path, coverage)


def _drawing() -> ModuleType:
    """Load what draws only when something is to be drawn; it takes a second."""
    return import_module("debrisgrasp.viz")
