"""What was found about an object, kept as long as that lives."""

from __future__ import annotations

from typing import TypeVar
from weakref import WeakKeyDictionary

__all__ = ["Memo"]

Key = TypeVar("Key")
Value = TypeVar("Value")


class Memo(WeakKeyDictionary[Key, Value]):
    """Values by object; a copy in another process begins without any."""

    def __reduce__(self) -> tuple[object, ...]:
        return Memo, ()
