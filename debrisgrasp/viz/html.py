"""The report as one page for the browser, which needs nothing but itself."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from html import escape
from importlib.resources import files
from typing import Any

from debrisgrasp._checked import checked
from debrisgrasp._files import require_suffix, write_atomic

from .payload import payload
from .report import Report

__all__ = ["filled_page", "report_html", "with_head", "write_page"]


@checked
def report_html(path: str | os.PathLike[str], report: Report) -> None:
    """Write the report as an interactive page that opens without a network.

    The table of grasps selects what the 3-D view shows: hand, posture of the arm and
    approach. ``page.html#grasp=3`` opens with the third grasp selected. Equal reports
    give equal files.

    Parameters
    ----------
    path
        Where to write; an existing file is replaced only when the page is complete.
    report
        What to show. A plan without grasps shows the scene and why there is none.

    Raises
    ------
    ConfigError, OutputError
        If the file has another suffix, or can't be written.
    """
    page = filled_page("report.html", "report.js", report.title, payload(report))
    write_page(path, page)


def write_page(path: str | os.PathLike[str], page: str) -> None:
    """Write a page, whole or not at all; its name ends in .html."""
    require_suffix(path, (".html",), "a page")
    write_atomic(path, page)


def filled_page(page: str, script: str, title: str, content: Mapping[str, Any]) -> str:
    """Return one of our pages with its script, style, viewer and data inside it."""
    data = json.dumps(content, allow_nan=False, separators=(",", ":"))
    # Inside a script element only "<" could end it early, whatever names the data hold.
    data = data.replace("<", "\\u003c")
    viewer = _asset("viewer.js")
    parts = {"viewer": viewer, "script": _asset(script), "data": data}
    return with_head(page, title, parts)


def with_head(page: str, title: str, parts: Mapping[str, str]) -> str:
    """Return one of our pages with the head that all share, and its parts inside it."""
    style = _asset("report.css")
    head = _filled(_asset("head.html"), {"title": escape(title), "style": style})
    own = {**parts, "head": head, "title": escape(title)}
    return _filled(_asset(page), own)


def _filled(page: str, parts: Mapping[str, str]) -> str:
    # Split before filling, so that no part is searched for the marks of another.
    first, *rest = page.split("{{")
    pieces = [first]
    for chunk in rest:
        name, _, text = chunk.partition("}}")
        pieces += [parts[name], text]
    return "".join(pieces)


def _asset(name: str) -> str:
    folder = files("debrisgrasp.viz") / "assets"
    return (folder / name).read_text(encoding="utf-8")
