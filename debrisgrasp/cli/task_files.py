"""Which files a task reads, and what they hold."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from debrisgrasp.executive.simulated import SimulatedTask

__all__ = ["contents_of"]


def contents_of(task: SimulatedTask) -> dict[str, str]:
    """Digests of a task's site, of the files that names, and of its mask, by path.

    Raises
    ------
    ConfigError, UnknownNameError
        As `contents_of_site` and `digest` do.
    """
    if task.site is None and task.mask is None:
        return {}
    from debrisgrasp.campaign import contents_of_site, digest  # slow to load

    contents = {} if task.site is None else contents_of_site(task.site)
    if task.mask is not None:
        contents[task.mask] = digest(task.mask)
    return contents
