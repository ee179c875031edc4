"""Random piles at rest, as a camera or a robot finds them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng
from debrisgrasp.errors import InputError
from debrisgrasp.worlds import PileConfig, generate_pile

from .settle import SettleConfig, Settled, let_fall

__all__ = ["settled_pile"]

_NEAR, _FAR = 0.75, 0.95
"""Distance from the middle [m] beyond which a lone body is left out, and beyond which
any body means that the pile has fallen apart."""
_ATTEMPTS = 20


def settled_pile(
    *,
    rng: Rng,
    config: PileConfig | None = None,
    settling: SettleConfig | None = None,
    name: str = "",
) -> Settled:
    """Draw piles until one comes to rest in one place.

    Bodies that rolled away and touch no other are left out.

    Parameters
    ----------
    rng
        Source of randomness; the same state gives the same pile.
    config
        Which piles are drawn.
    settling
        How bodies are let down.
    name
        Name of the world; the arrangement is added.

    Raises
    ------
    InputError
        If none of twenty did: the settings make piles that can't stand.
    MissingExtraError
        If MuJoCo is not installed.
    """
    config = config or PileConfig()
    for _ in range(_ATTEMPTS):
        pile = let_fall(generate_pile(rng=rng, config=config, name=name), settling)
        distance = _distances(pile, config)
        touching = {i for c in pile.contacts if c.a >= 0 for i in (c.a, c.b)}
        strays = [
            body.name
            for i, body in enumerate(pile.world.bodies)
            if distance[i] > _NEAR and i not in touching
        ]
        n_left = len(pile.world.bodies) - len(strays)
        if not pile.is_at_rest or n_left < config.n_bodies[0]:
            continue
        pile = _without(pile, strays)
        if (_distances(pile, config) < _FAR).all():
            return pile
    raise InputError(
        "piles that come to rest",
        got=f"none of {_ATTEMPTS}",
        expected="one",
        mend="Allow more time to settle, or less spread.",
    )


def _distances(pile: Settled, config: PileConfig) -> FloatArray:
    places = np.array([body.T_base_body.p[:2] for body in pile.world.bodies])
    return np.asarray(np.linalg.norm(places - config.center, axis=1))


def _without(pile: Settled, names: list[str]) -> Settled:
    """Leave out bodies that touch nothing but the ground."""
    if not names:
        return pile
    kept = [i for i, name in enumerate(pile.world.names) if name not in names]
    number = {old: new for new, old in enumerate(kept)} | {-1: -1}
    contacts = tuple(
        replace(contact, a=number[contact.a], b=number[contact.b])
        for contact in pile.contacts
        if contact.b in number
    )
    return replace(pile, world=pile.world.without(*names), contacts=contacts)
