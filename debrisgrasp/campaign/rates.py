"""How often which fault is injected into the runs of a campaign."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from debrisgrasp._arrays import Rng
from debrisgrasp._fields import is_number_as_text
from debrisgrasp._files import read_yaml, schema_found
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.executive import State
from debrisgrasp.robot import INJECTABLE, Injection

__all__ = ["FaultRates", "Rate", "random_faults"]

_SCHEMA = "debrisgrasp/fault-rates/1"
_POINTLESS = "YAML reads 1e-3 and what stands in quotes as text: write 1.0e-3 or 0.001."
ANYWHERE = "any"
_STATES = tuple(state.value for state in State)
_STRUCK = tuple(name for name in _STATES if name != State.CLEARED.value)
"""States that are drawn: nothing can go wrong any more in the one that is left out."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rate:
    """With this probability, one of these faults strikes a run."""

    rate: float
    """In [0, 1]."""
    one_of: tuple[str, ...]
    """Names from `debrisgrasp.robot.INJECTABLE`, each as likely as the others."""
    state: str | None = None
    """State in which it begins, ``"any"``, or None for where it usually shows."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.rate <= 1.0:
            raise ConfigError("rate of a fault", got=self.rate, expected="0 to 1")
        if not self.one_of:
            raise ConfigError(
                "one_of of a rate", got="nothing", expected="names of faults"
            )
        for name in self.one_of:
            if name not in INJECTABLE:
                raise UnknownNameError("fault", name, INJECTABLE)
        if self.state is not None and self.state not in (ANYWHERE, *_STATES):
            raise UnknownNameError("state of a rate", self.state, (ANYWHERE, *_STATES))

    def drawn(self, rng: Rng) -> Injection | None:
        """Draw whether it strikes, and what."""
        # Drawn in any case, so that one rate does not shift the draws of the next.
        strikes, which, where = rng.random(3)
        name = self.one_of[int(which * len(self.one_of))]
        state = self.state
        if state == ANYWHERE:
            state = _STRUCK[int(where * len(_STRUCK))]
        if strikes >= self.rate:
            return None
        return Injection(fault=name, state=state)


@dataclass(frozen=True, slots=True)
class FaultRates:
    """Rates that are independent of each other."""

    rates: tuple[Rate, ...] = ()

    def drawn(self, rng: Rng) -> tuple[Injection, ...]:
        """Faults of one run."""
        found = [rate.drawn(rng) for rate in self.rates]
        return tuple(injection for injection in found if injection is not None)

    @staticmethod
    def load(path: str | os.PathLike[str]) -> FaultRates:
        """Read a YAML file (docs/campaigns.md).

        Raises
        ------
        ConfigError
            Naming the file and the entry that is wrong.
        """
        content = read_yaml(path)
        if not isinstance(content, Mapping) or content.get("schema") != _SCHEMA:
            raise ConfigError(
                f"{path}", got=schema_found(content), expected=f"schema: {_SCHEMA}"
            )
        entries = content.get("rates")
        if not isinstance(entries, list) or not entries:
            raise ConfigError(f"{path}, rates", got=entries, expected="a list of rates")
        unknown = sorted(map(str, content.keys() - {"schema", "rates"}))
        if unknown:
            raise ConfigError(f"{path}", got=unknown, expected="schema and rates")
        return FaultRates(
            tuple(
                _rate(entry, f"{path}, rate {i + 1}") for i, entry in enumerate(entries)
            )
        )


def _rate(entry: Any, where: str) -> Rate:
    if not isinstance(entry, Mapping):
        raise ConfigError(where, got=entry, expected="rate: and one_of:")
    unknown = sorted(map(str, entry.keys() - set(Rate.__slots__)))
    missing = sorted({"rate", "one_of"} - entry.keys())
    if unknown or missing:
        raise ConfigError(
            where,
            got=f"without {missing[0]}" if missing else f"with {unknown[0]}",
            expected="rate: and one_of:, and state: if need be",
        )
    rate, names = entry["rate"], entry["one_of"]
    names = [names] if isinstance(names, str) else names
    if isinstance(rate, bool) or not isinstance(rate, int | float):
        raise ConfigError(
            f"{where}, rate",
            got=repr(rate),
            expected="a number, 0 to 1",
            mend=_POINTLESS if is_number_as_text(rate) else "",
        )
    if not isinstance(names, list) or not all(isinstance(n, str) for n in names):
        raise ConfigError(f"{where}, one_of", got=names, expected="names of faults")
    try:
        return Rate(rate=rate, one_of=tuple(names), state=entry.get("state"))
    except InputError as error:
        raise ConfigError.about(where, error) from error


def random_faults(rng: Rng) -> tuple[Injection, ...]:
    """Draw one fault or two different ones, each at any state: an attack on the task.

    Half of them strike where they usually show.
    """
    names = rng.choice(sorted(INJECTABLE), size=int(rng.integers(1, 3)), replace=False)
    return tuple(
        Injection(
            fault=str(name),
            state=None if rng.random() < 0.5 else str(rng.choice(_STRUCK)),
            at=float(rng.choice([0.0, round(float(rng.uniform(0.0, 2.0)), 3)])),
        )
        for name in names
    )
