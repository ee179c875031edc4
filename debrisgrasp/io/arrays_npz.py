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
            return {name: archive[name] for name in _KNOWN if name in present}, present
    except UNREADABLE_ARRAY as error:
        raise CaptureError(
            "archive",
            got=why_unreadable(error),
            expected="a whole .npz of plain arrays",
            mend="Copy it again from where it is whole, or write it again with "
            "Capture.save or numpy.savez_compressed.",
        ) from error


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names) or "no arrays"
