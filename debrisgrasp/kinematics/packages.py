"""Where files of ROS packages are, as ``package://NAME/...`` names them."""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

from debrisgrasp.errors import ConfigError

__all__ = ["PACKAGE_SCHEME", "file_at", "package_folders"]

PACKAGE_SCHEME = "package://"


def file_at(name: str | Path, folder: Path = Path()) -> Path:
    """Path of ``package://NAME/rest``, or of another file as seen from a folder.

    Packages are sought in ``$ROS_PACKAGE_PATH``, in the ``share`` folders of
    ``$AMENT_PREFIX_PATH``, and among the robots of the Python package
    example-robot-data.

    Raises
    ------
    ConfigError
        If there is no such file; names the folders that were searched.
    """
    # A path has lost one of the slashes.
    scheme, _, inside = str(name).partition(":/")
    if scheme != "package":
        return folder / name
    inside = inside.lstrip("/")
    folders = tuple(package_folders())
    for share in folders:
        if (share / inside).is_file():
            return share / inside
    raise ConfigError(
        f"file {PACKAGE_SCHEME}{inside}",
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
