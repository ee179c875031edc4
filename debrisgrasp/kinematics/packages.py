"""Where files of ROS packages are, as ``package://NAME/...`` names them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from debrisgrasp.errors import ConfigError

__all__ = ["PACKAGE_SCHEME", "package_file", "package_folders"]

PACKAGE_SCHEME = "package://"


def package_file(uri: str) -> Path:
    """Path of ``package://NAME/rest``.

    Packages are sought in ``$ROS_PACKAGE_PATH``, in the ``share`` folders of
    ``$AMENT_PREFIX_PATH``, and among the robots of the Python package
    example-robot-data.

    Raises
    ------
    ConfigError
        If there is no such file; names the folders that were searched.
    """
    inside = uri.removeprefix(PACKAGE_SCHEME)
    folders = tuple(package_folders())
    for folder in folders:
        if (folder / inside).is_file():
            return folder / inside
    raise ConfigError(
        f"file {uri}",
        got="no such file in " + (", ".join(map(str, folders)) or "any folder"),
        expected="a package in $ROS_PACKAGE_PATH or $AMENT_PREFIX_PATH",
        mend="Robots of example-robot-data come with the extra 'robots': "
        "pip install 'debrisgrasp[robots]'.",
    )


def package_folders() -> Iterator[Path]:
    """List the folders in which packages are sought."""
    for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep):
        if entry:
            yield Path(entry)
    for entry in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if entry:
            yield Path(entry) / "share"
    spec = find_spec("cmeel")
    for root in (spec and spec.submodule_search_locations) or ():
        share = Path(root).parent / "cmeel.prefix" / "share"
        if (share / "example-robot-data").is_dir():
            yield share
