"""What the files hold that decide what runs are: an edited one makes other runs."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from hashlib import sha256
from pathlib import Path
from typing import Any

from debrisgrasp._files import is_yaml
from debrisgrasp.errors import ConfigError
from debrisgrasp.settings import Settings

from .header import CONTENTS, read_header

__all__ = ["contents_of_site", "digest", "edited", "edited_since"]


def contents_of_site(path: str | os.PathLike[str]) -> dict[str, str]:
    """Digests of a site's file, and of the files and folders that it names, by path.

    Raises
    ------
    ConfigError, UnknownNameError
        As `Settings.load` does; also for a file that can't be read.
    """
    site = Settings.load(path)
    named = (
        site.grippers,
        site.prototypes,
        site.success,
        site.calibration,
        site.camera_file,
    )
    places = [Path(path), *(place for place in named if place is not None)]
    if is_yaml(site.robot):
        places.append(Path(site.robot))
    return {str(file): digest(file) for place in places for file in _files(place)}


def edited_since(folder: str | os.PathLike[str], spec: Mapping[str, Any]) -> list[str]:
    """Say which files of the site of a run are others than when its campaign began.

    Nothing is said if the folder holds no campaign, or one of an older version.
    """
    header = Path(folder) / "campaign.json"
    if spec.get("site") is None or not header.is_file():
        return []
    kept = read_header(header).get(CONTENTS, {})
    now = contents_of_site(spec["site"])
    return edited(kept, {**kept, **now}) if kept else []


def digest(path: str | os.PathLike[str]) -> str:
    """SHA-256 of what a file holds, or `ConfigError`."""
    try:
        return sha256(Path(path).read_bytes()).hexdigest()
    except OSError as error:
        reason = error.strerror or str(error)
        raise ConfigError(str(path), got=reason, expected="a readable file") from error


def edited(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    """Say of each file whose digests differ, by path, what became of it."""
    words = []
    for path in sorted(before.keys() | now.keys()):
        if path not in before:
            words.append(f"no record of what {path} held")
        elif path not in now:
            words.append(f"{path}, which is not used any more")
        elif before[path] != now[path]:
            words.append(f"{path} with another content")
    return words


def _files(place: Path) -> Iterator[Path]:
    if not place.is_dir():
        yield place
        return
    for path in sorted(place.rglob("*")):
        is_hidden = any(part.startswith(".") for part in path.relative_to(place).parts)
        if path.is_file() and not is_hidden:
            yield path
