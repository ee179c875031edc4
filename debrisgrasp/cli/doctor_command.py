"""``doctor``: whether all is installed, works, and fits the file of a site."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict

from debrisgrasp.settings import Settings

from . import doctor_checks
from .site_arguments import add_site
from .tables import columns

__all__ = ["add"]


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add ``doctor``."""
    parser = subparsers.add_parser(
        "doctor",
        help="check the installation and a site's settings; plan on a shipped capture",
        description="Exit status: 0 sound, 1 something must be mended, 2 the site's "
        "file, or one that it names, can't be used.",
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
    for name, findings in sections.items():
        rows = [[finding.what, finding.status, finding.text] for finding in findings]
        print(columns([name, "", ""], rows) + "\n")
    print("to mend: " + "; ".join(faults) if faults else "all is well")
    return 1 if faults else 0
