"""``doctor``: whether all is installed, works, and fits the file of a site."""

from __future__ import annotations

import argparse
import json
import shutil
import sys
import textwrap
from collections.abc import Sequence
from dataclasses import asdict

from debrisgrasp.settings import Settings

from . import doctor_checks
from .doctor_checks import Finding
from .site_arguments import add_site
from .tables import columns

__all__ = ["add", "table"]

_NARROWEST = 30
"""Texts are not written in lines of fewer characters."""


def add(parser: argparse.ArgumentParser) -> None:
    """Add ``doctor``."""
    parser.description = (
        "Exit status: 0 sound, 1 something must be mended, 2 the site's "
        "file, or one that it names, can't be used."
    )
    add_site(parser)
    parser.add_argument(
        "--json", action="store_true", help="print JSON for machines instead of text"
    )
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    sections = {"installation": list(doctor_checks.installation())}
    settings = Settings()
    if arguments.site is not None:
        settings = Settings.load(arguments.site)
        sections[f"site {arguments.site}"] = list(doctor_checks.site(settings))
    sections["self-test"] = list(doctor_checks.self_test(settings))
    faults = [
        f"{finding.what}: {finding.text}"
        for findings in sections.values()
        for finding in findings
        if finding.status == "fault"
    ]
    if arguments.json:
        content = {
            name: [asdict(finding) for finding in findings]
            for name, findings in sections.items()
        }
        print(json.dumps({"sound": not faults, "checks": content}, indent=1))
        return 1 if faults else 0
    # Where nobody looks, each finding is one line, as tools like it.
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else None
    for name, findings in sections.items():
        print(table(name, findings, width) + "\n")
    print("to mend: " + "; ".join(faults) if faults else "all is well")
    return 1 if faults else 0


def table(name: str, findings: Sequence[Finding], width: int | None) -> str:
    """Write findings below each other, their texts in lines that fit a width."""
    first = max(map(len, [name, *(finding.what for finding in findings)]))
    status = max((len(finding.status) for finding in findings), default=0)
    room = None if width is None else max(width - first - status - 4, _NARROWEST)
    rows = []
    for finding in findings:
        lines = [finding.text]
        if room is not None:
            lines = textwrap.wrap(finding.text, room, break_on_hyphens=False) or [""]
        rows.append([finding.what, finding.status, lines[0]])
        rows += [["", "", line] for line in lines[1:]]
    return columns([name, "", ""], rows)
