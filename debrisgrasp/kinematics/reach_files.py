"""Reachability maps on disk: saved, loaded, and kept in the user's cache.

A map is bound to the hash of its chain, which covers geometry, limits and the tool at
the tip, and to the code that built it. A file of anything else is refused.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import sys
import warnings
from dataclasses import asdict, fields
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from debrisgrasp._checked import checked
from debrisgrasp._files import write_atomic
from debrisgrasp._unreadable import UNREADABLE_ARRAY, PathLike, why_unreadable
from debrisgrasp.errors import ConfigError, OutputError

from . import descent, formulas, reach_map, serial
from .chain import KinematicChain
from .reach_map import ReachMap, ReachMapConfig

__all__ = ["cache_folder", "cached_reach_map", "load_reach_map", "save_reach_map"]

_SCHEMA = "debrisgrasp/reach-map/1"
_OTHER = "other content than a map has"
_VARIABLE = "DEBRISGRASP_CACHE"
_VERSIONS = 3
"""Of so many versions of the code the cache keeps a map."""


def cache_folder() -> Path | None:
    """Folder for what can be built again, or None where there is no home.

    ``$DEBRISGRASP_CACHE`` if set; else as the platform has it: ``$XDG_CACHE_HOME`` or
    ``~/.cache``, on macOS ``~/Library/Caches``, on Windows ``%LOCALAPPDATA%``, and in
    there ``debrisgrasp``. It need not exist.
    """
    if chosen := os.environ.get(_VARIABLE):
        return Path(chosen)
    if chosen := os.environ.get("XDG_CACHE_HOME"):
        return Path(chosen) / "debrisgrasp"
    if sys.platform == "win32" and (chosen := os.environ.get("LOCALAPPDATA")):
        return Path(chosen) / "debrisgrasp"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    inner = "Library/Caches" if sys.platform == "darwin" else ".cache"
    return home / inner / "debrisgrasp"


@checked
def cached_reach_map(
    chain: KinematicChain, config: ReachMapConfig | None = None
) -> ReachMap:
    """Take the map of a chain from the user's cache, or build it and leave it there.

    A file that is damaged, or belongs to something else, is replaced with a warning
    that says so. Where the cache can't be written, the map is built every time. Several
    versions of the code keep a file each; of older ones only the newest two stay.

    Raises
    ------
    ConfigError
        If there is no map for such a chain; see `ReachMap.build`.
    """
    config = config or ReachMapConfig()
    folder = cache_folder()
    if folder is None:
        return ReachMap.build(chain, config)
    name = f"reach-{chain.hash}-{_digest(asdict(config))}"
    path = folder / f"{name}-{_maker()}.npz"
    if path.exists():
        try:
            found = load_reach_map(path, chain)
            _require(found.config, config, "settings of the map", path)
        except ConfigError as error:
            warnings.warn(f"{error} It is built again.", stacklevel=2)
        else:
            return found
    built = ReachMap.build(chain, config)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        save_reach_map(built, path)
        files = [path for path in folder.glob(f"{name}*.npz") if path.is_file()]
        files.sort(key=lambda path: path.stat().st_mtime)
        for old in files[:-_VERSIONS]:
            old.unlink(missing_ok=True)
    except OSError:
        # A cache is a convenience: without one everything works, only later.
        pass
    return built


@checked
def save_reach_map(built: ReachMap, path: PathLike) -> None:
    """Write a map, whole or not at all.

    Raises
    ------
    OutputError
        If it can't be written.
    """
    values = {field.name: getattr(built, field.name) for field in fields(ReachMap)}
    arrays: dict[str, Any] = {
        k: v for k, v in values.items() if isinstance(v, np.ndarray)
    }
    facts = {k: v for k, v in values.items() if k not in arrays and k != "config"}
    facts |= {"schema": _SCHEMA, "maker": _maker(), "config": asdict(built.config)}
    stream = io.BytesIO()
    arrays["facts"] = np.array(json.dumps(facts))
    np.savez(stream, **arrays)
    try:
        write_atomic(path, stream.getvalue())
    except FileNotFoundError as error:
        raise OutputError(path, "there is no such folder") from error


@checked
def load_reach_map(path: PathLike, chain: KinematicChain) -> ReachMap:
    """Read the map of a chain.

    Raises
    ------
    ConfigError
        If the file can't be read, is no map, or is out of date: built for other
        geometry, limits or tool, or by another version. Says which.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            arrays = {name: content[name] for name in content.files}
    except UNREADABLE_ARRAY as error:
        why = f"no map, or a part of one ({why_unreadable(error)})"
        raise _unusable(path, why) from error
    try:
        facts = json.loads(str(arrays.pop("facts")))
        schema, maker = facts.pop("schema"), facts.pop("maker", None)
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _unusable(path, _OTHER) from error
    _require(schema, _SCHEMA, "schema", path)
    _require(maker, _maker(), "version of the code that built", path)
    try:
        found = ReachMap(
            **{**facts, "config": ReachMapConfig(**facts["config"])}, **arrays
        )
    except (TypeError, KeyError) as error:
        raise _unusable(path, _OTHER) from error
    _require(
        found.chain_hash, chain.hash, "geometry, limits or tool of the chain in", path
    )
    return found


def _require(got: Any, wanted: Any, what: str, path: PathLike) -> None:
    if got != wanted:
        raise ConfigError(
            f"{what} {path}",
            got=got,
            expected=str(wanted),
            mend="The reachability map is out of date.",
        )


def _unusable(path: PathLike, why: str) -> ConfigError:
    return ConfigError(
        f"reachability map {path}", got=why, expected="a map written by this version"
    )


@cache
def _maker() -> str:
    """Digest of the code that decides what a map holds."""
    digest = hashlib.sha256()
    for module in (reach_map, serial, descent, formulas):
        source = Path(module.__file__ or "")
        digest.update(source.read_bytes() if source.is_file() else b"")
    return digest.hexdigest()[:16]


def _digest(values: dict[str, Any]) -> str:
    text = json.dumps(values, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:8]
