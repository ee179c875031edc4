"""The exceptions of debrisgrasp.

Every exception carries the facts of its message as attributes, so that a program can
react to them as well as a person. Facts about the world that a robot must survive (no
grasp found, pose out of reach) are results, not exceptions.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from difflib import get_close_matches

__all__ = [
    "CaptureError",
    "ChoiceError",
    "ConfigError",
    "DebrisGraspError",
    "DriverError",
    "FrameMismatchError",
    "InputError",
    "MissingExtraError",
    "OutputError",
    "ShapeError",
    "UnknownNameError",
]


_MANY, _NEAREST = 16, 5
"""Of more names than this, only some of the nearest are listed."""
_LONGEST = 400
"""More characters of a value than this hide the message around it."""
_NUMPY_SCALAR = re.compile(r"\bnp\.\w+\(([^()]*)\)")
"""How NumPy shows a number of its own in a list; people write the number."""


class DebrisGraspError(Exception):
    """Root of all exceptions that debrisgrasp raises on purpose.

    They can be pickled, so that they come out of worker processes as they are.
    """

    def __reduce__(self) -> tuple[object, ...]:
        """Rebuild from message and facts, not from the parameters of a subclass."""
        return _rebuilt, (type(self), self.args, self.__dict__)


class InputError(DebrisGraspError, ValueError):
    """Something the caller supplied has no honest result.

    Parameters
    ----------
    what
        Which quantity is wrong, in the caller's words.
    got
        The value that arrived.
    expected
        The limit or form that was needed.
    mend
        The next thing to do, as a sentence.
    """

    def __init__(
        self, what: str, *, got: object, expected: str, mend: str = ""
    ) -> None:
        self.what, self.got, self.expected, self.mend = what, got, expected, mend
        shown = _cut(_NUMPY_SCALAR.sub(r"\1", str(got)))
        message = f"{what}: got {shown}, expected {expected}."
        super().__init__(f"{message} {mend}" if mend else message)


class ShapeError(InputError):
    """An array has the wrong shape."""


class CaptureError(InputError):
    """A capture, or the file it comes from, can't be used."""


class ConfigError(InputError):
    """A setting, or a file of settings, is malformed or out of range."""

    @classmethod
    def about(cls, what: str, error: InputError) -> ConfigError:
        """Make the same complaint as another error, about what the caller calls it."""
        return cls(what, got=error.got, expected=error.expected, mend=error.mend)


class ChoiceError(ConfigError):
    """Arm, hand and prototypes that were chosen don't go together."""


class DriverError(DebrisGraspError, RuntimeError):
    """A device of the robot does not answer, or refuses."""

    def __init__(self, device: str, reason: str, mend: str = "") -> None:
        self.device, self.reason, self.mend = device, reason, mend
        message = f"{device}: {reason}."
        super().__init__(f"{message} {mend}" if mend else message)


class OutputError(DebrisGraspError, OSError):
    """A result can't be written; what was there before is left as it was.

    Parameters
    ----------
    path
        Where it should have gone.
    reason
        Why it could not.
    mend
        What there is now, and the next thing to do, as sentences.
    """

    def __init__(
        self,
        path: object,
        reason: str,
        mend: str = "Nothing was changed; give another place.",
    ) -> None:
        self.path, self.reason, self.mend = path, reason, mend
        super().__init__(f"can't write {_cut(str(path))}: {reason}. {mend}")


class UnknownNameError(InputError):
    """A name is not among those that are known.

    Parameters
    ----------
    kind
        What it is a name of.
    name
        The one that arrived.
    known
        Those that there are; of many only some are listed.
    listed_by
        Command that prints them all, if there is one.
    mend
        How to make another name known, if there is a way.
    """

    def __init__(
        self,
        kind: str,
        name: object,
        known: Iterable[str],
        *,
        listed_by: str = "",
        mend: str = "",
    ) -> None:
        self.kind, self.name, self.known = kind, name, tuple(known)
        is_number = str(name).lstrip("-").isdigit()
        near = [] if is_number else get_close_matches(str(name), self.known, n=_NEAREST)
        expected = "one of " + (", ".join(self.known) or "none: there are none")
        if len(self.known) > _MANY:
            holding = [n for n in self.known if str(name) and str(name) in n]
            shown = near or holding[:_NEAREST] or self.known[:_NEAREST]
            expected = f"one of {len(self.known)} names, such as {', '.join(shown)}"
        mends = [f"Did you mean {near[0]!r}?"] if near else []
        if listed_by:
            mends.append(f"`{listed_by}` lists them.")
        if mend:
            mends.append(mend)
        super().__init__(
            f"unknown {kind}",
            got=repr(name),
            expected=expected,
            mend=" ".join(mends),
        )


class FrameMismatchError(InputError):
    """Two quantities that meet in one formula live in different frames."""

    def __init__(self, what: str, *, expected_frame: str, got_frame: str) -> None:
        self.expected_frame, self.got_frame = expected_frame, got_frame
        super().__init__(
            f"frame of {what}",
            got=repr(got_frame),
            expected=repr(expected_frame),
            mend=f"Map it first with T_{expected_frame}_{got_frame}.apply(...).",
        )


class MissingExtraError(DebrisGraspError, ImportError):
    """A feature needs an optional package that is not installed, or not as it must."""

    def __init__(self, feature: str, extra: str, found: str = "") -> None:
        self.feature, self.extra, self.found = feature, extra, found
        told = f" ({found})" if found else ""
        super().__init__(
            f"{feature} needs the extra {extra!r}{told}: "
            f"pip install 'debrisgrasp[{extra}]'"
        )


def _cut(shown: str) -> str:
    if len(shown) <= _LONGEST:
        return shown
    return f"{shown[:_LONGEST]}... ({len(shown)} characters)"


def _rebuilt(
    kind: type[DebrisGraspError], args: tuple[object, ...], facts: dict[str, object]
) -> DebrisGraspError:
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(facts)
    return error
