"""Write the pictures and pages that a command was asked for."""

from __future__ import annotations

import os
from argparse import ArgumentParser
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np

from debrisgrasp._files import require_picture, require_suffix, require_writable
from debrisgrasp.errors import OutputError
from debrisgrasp.io import Capture
from debrisgrasp.io.depth_images import files_read
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
    "require_own_labels",
    "require_places",
    "telling_written",
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
        What is read, a file or a folder, of which no result may replace anything.
    """
    wanted = [path for path in reports if path]
    what = f"a {_FORMS.get(tuple(forms), 'picture or page')}"
    read = () if source is None else files_read(source)
    taken = {os.path.realpath(path) for path in read}
    for path in (*wanted, *(path for path in others if path)):
        require_writable(path)
        if os.path.realpath(path) in taken:
            raise OutputError(path, "it is what is read, or another result goes there")
        taken.add(os.path.realpath(path))
    for path in wanted:
        require_picture(path, forms, what)


def require_own_labels(path: Path) -> None:
    """Raise unless labels belong to a place: a .npz without the arrays of a capture."""
    require_suffix(path, (".npz",), "a file of labels")
    if not path.is_file() or not path.stat().st_size:
        return
    try:
        with np.load(path) as content:
            names = list(content)
    except (OSError, ValueError, BadZipFile):
        names = []
    if names != ["labels"]:
        raise OutputError(path, "what is there is not labels alone, and would be lost")


@contextmanager
def telling_written(*paths: Path | None) -> Iterator[None]:
    """Have an error in writing some files, in this order, tell of those before it."""
    try:
        yield
    except OutputError as error:
        places, failed = [str(path) for path in paths if path], str(error.path)
        before = places[: places.index(failed)] if failed in places else []
        if not before:
            raise
        mend = f"{error.mend} Written before it: {', '.join(before)}."
        raise OutputError(error.path, error.reason, mend) from error


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
