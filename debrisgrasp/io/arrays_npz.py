"""Captures as NumPy archives (.npz)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from debrisgrasp._unreadable import UNREADABLE_ARRAY, why_unreadable
from debrisgrasp.errors import CaptureError
from debrisgrasp.geometry import SE3, Intrinsics

from ._fields import CaptureFields, numeric

__all__ = ["read_npz"]

_KNOWN = (
    "depth",
    "K",
    "points",
    "viewpoint",
    "T_base_camera",
    "T_level_camera",
    "rgb",
    "mask",
    "labels",
)

_MOST_BYTES = 2_000_000_000
"""More than any camera or scanner gives at once: forty million points of doubles."""


def read_npz(path: Path) -> CaptureFields:
    """Read the known arrays of an archive; others are ignored."""
    arrays, present = _load_known(path)
    if "depth" in arrays and "K" not in arrays:
        raise CaptureError(
            "arrays",
            got=f"no 'K' beside 'depth' among {_listed(present)}",
            expected="'depth' together with 'K'",
        )
    if not {"depth", "points"} & arrays.keys():
        raise CaptureError(
            "arrays",
            got=_listed(present),
            expected="'depth' with 'K', or 'points' with 'viewpoint'",
        )
    result: CaptureFields = {}
    if "depth" in arrays:
        depth = arrays["depth"]
        if depth.ndim != 2:
            raise CaptureError(
                "depth", got=f"shape {depth.shape}", expected="(height, width)"
            )
        result["depth"] = depth
        K = numeric(arrays["K"], "K")
        result["intrinsics"] = Intrinsics.from_matrix(K, depth.shape)
    if "points" in arrays:
        result["points"] = arrays["points"]
        if "viewpoint" in arrays:
            result["viewpoint"] = arrays["viewpoint"]
    for pose in ("T_base_camera", "T_level_camera"):
        if pose in arrays:
            result[pose] = SE3.from_matrix(numeric(arrays[pose], pose), pose)
    for image in ("rgb", "mask", "labels"):
        if image in arrays:
            result[image] = arrays[image]
    return result


def _load_known(path: Path) -> tuple[dict[str, NDArray[Any]], tuple[str, ...]]:
    """Known arrays by name, and the names of all arrays of the archive."""
    try:
        # Opened here because NumPy leaves a file open that turns out to be no archive.
        with path.open("rb") as stream:
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ValueError("a single array")
            present = tuple(archive.files)
            known = [name for name in _KNOWN if name in present]
            _require_room(archive, known)
            return {name: archive[name] for name in known}, present
    except UNREADABLE_ARRAY as error:
        raise CaptureError(
            "archive",
            got=why_unreadable(error),
            expected="a whole .npz of plain arrays",
            mend="Copy it again from where it is whole, or write it again with "
            "Capture.save or numpy.savez_compressed.",
        ) from error


def _require_room(archive: np.lib.npyio.NpzFile, known: list[str]) -> None:
    """Refuse what is small on disk alone before it is unpacked."""
    wanted = {f"{name}.npy" for name in known}
    infos = archive.zip.infolist() if archive.zip is not None else []
    size = sum(info.file_size for info in infos if info.filename in wanted)
    if size > _MOST_BYTES:
        raise CaptureError(
            "archive",
            got=f"{size / 1e9:.1f} GB of {_listed(tuple(known))} once unpacked",
            expected=f"at most {_MOST_BYTES / 1e9:g} GB",
            mend="Crop the capture, or take every second pixel or point.",
        )


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names) or "no arrays"
