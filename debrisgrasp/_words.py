"""How quantities are written for people."""

from __future__ import annotations

__all__ = [
    "arm_called",
    "as_text",
    "counted",
    "in_kilograms",
    "shortened",
    "shown_path",
]

_LONGEST_NAME = 255
"""Letters of the longest name that a file has on the usual systems."""


def arm_called(name: str) -> str:
    """Call an arm by its name, which may say already that it is one.

    Examples
    --------
    >>> arm_called("right"), arm_called("arm"), arm_called("left_arm")
    ('right arm', 'arm', 'left_arm')
    """
    return name if name.lower().endswith("arm") else f"{name} arm"


def as_text(name: str) -> str:
    """Write the name of a file, whose bytes may be no text, for pictures and pages."""
    return name.encode(errors="replace").decode()


def counted(n: int, noun: str, plural: str = "") -> str:
    """Write how many there are of something; its plural ends in s if none is given."""
    return f"{n} {noun}" if n == 1 else f"{n} {plural or noun + 's'}"


def in_kilograms(*masses: float) -> str:
    """Write a mass, or from which to which [kg]: two digits, and never a power of ten.

    Examples
    --------
    >>> in_kilograms(0.2449), in_kilograms(331.0), in_kilograms(1.2, 12.4)
    ('0.24 kg', '330 kg', '1.2 to 12 kg')
    """
    return " to ".join(f"{float(f'{mass:.2g}'):.10g}" for mass in masses) + " kg"


def shortened(words: str, most: int = 80) -> str:
    """Cut words that are longer than so many characters, and say so.

    Examples
    --------
    >>> shortened("0.125, 0.25, 0.5", most=10)
    '0.125, ...'
    """
    return words if len(words) <= most else f"{words[: most - 3]}..."


def shown_path(path: object) -> str:
    """Write a path for a message: of a name that no file can have only the beginning.

    Examples
    --------
    >>> len(shown_path("/tmp/" + 300 * "x"))
    85
    """
    names = str(path).split("/")
    return "/".join(n if len(n) <= _LONGEST_NAME else shortened(n) for n in names)
