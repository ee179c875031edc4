"""What the folder of a campaign says of all its runs."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

from debrisgrasp._files import read_schema
from debrisgrasp.errors import ConfigError

__all__ = ["CONTENTS", "RUNS", "SCHEMA", "read_header"]

SCHEMA = "debrisgrasp/campaign/1"
CONTENTS, RUNS = "contents", "runs"


def read_header(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Read a ``campaign.json``; what an older one lacks is left out.

    Raises
    ------
    ConfigError
        If it is of another kind, or its names of runs or digests are not texts.
    """
    header = read_schema(path, SCHEMA)
    runs, contents = header.get(RUNS, []), header.get(CONTENTS, {})
    if not isinstance(runs, list) or not all(isinstance(name, str) for name in runs):
        raise ConfigError(f"{path}, {RUNS}", got=repr(runs), expected="names of runs")
    if not isinstance(contents, Mapping) or not all(
        isinstance(digest, str) for digest in contents.values()
    ):
        raise ConfigError(
            f"{path}, {CONTENTS}", got=repr(contents), expected="digests by path"
        )
    return header
