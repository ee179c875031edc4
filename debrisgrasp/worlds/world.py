"""What there is: bodies on a ground."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3

from .body import Body
from .ground import Ground

__all__ = ["World"]


@checked_fields
@dataclass(frozen=True, slots=True, eq=False, repr=False)
class World:
    """Bodies on a ground, frame base (z up).

    Raises
    ------
    InputError
        If there is no body, or two share a name.
    """

    bodies: tuple[Body, ...]
    ground: Ground = field(default_factory=Ground.level)
    name: str = "world"

    def __post_init__(self) -> None:
        if not self.bodies:
            raise InputError("bodies of a world", got="none", expected="one or more")
        counts = Counter(body.name for body in self.bodies)
        twice = [name for name, count in counts.items() if count > 1]
        if twice:
            raise InputError(
                "names of bodies", got=f"{twice} more than once", expected="one of each"
            )

    def __repr__(self) -> str:
        """Name and size: all of it would fill a screen."""
        return f"World({self.name!r}, bodies={len(self.bodies)})"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the bodies, in order."""
        return tuple(body.name for body in self.bodies)

    def index(self, name: str) -> int:
        """Position of a body among the bodies, by its name.

        Raises
        ------
        UnknownNameError
            If no body has it.
        """
        if name not in self.names:
            raise UnknownNameError("body", name, self.names)
        return self.names.index(name)

    @checked
    def placed(self, poses: Sequence[SE3]) -> World:
        """Return the same bodies at other poses ``T_base_body``.

        Raises
        ------
        InputError
            If there is not one pose for each body.
        """
        if len(poses) != len(self.bodies):
            raise InputError(
                "poses", got=len(poses), expected=f"one for each of {len(self.bodies)}"
            )
        moved = [b.at(pose) for b, pose in zip(self.bodies, poses, strict=True)]
        return replace(self, bodies=tuple(moved))

    def without(self, *names: str) -> World:
        """Return the world without some of its bodies."""
        gone = {self.index(name) for name in names}
        kept = [body for i, body in enumerate(self.bodies) if i not in gone]
        return replace(self, bodies=tuple(kept))
