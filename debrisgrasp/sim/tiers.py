"""Scenes for trials of grasps, from simple to hard, each from a seed.

Every scene is settled by physics and seen once (`scenes`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng, require_range
from debrisgrasp._checked import checked
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Capsule, Cylinder, so3
from debrisgrasp.worlds import (
    Body,
    Ground,
    PileConfig,
    World,
    draw_body,
)

from .piles import settled_pile
from .scenes import CENTER, SceneConfig, TierScene, seen
from .settle import Settled, let_fall, settle

__all__ = ["TIERS", "tier_scene"]

_ATTEMPTS = 30
_BARS = ("lumber_2x4", "lumber_2x4", "lumber_4x4", "pipe", "board")


@checked
def tier_scene(tier: str, seed: int, config: SceneConfig | None = None) -> TierScene:
    """Make the scene of a tier with a seed, and look at it.

    Parameters
    ----------
    tier
        One of `TIERS`.
    seed
        The same seed gives the same scene.

    Raises
    ------
    UnknownNameError
        If there is no such tier.
    InputError
        If the seed is negative, or no arrangement in many tries stood and was in sight.
    MissingExtraError
        If MuJoCo is not installed.
    """
    if tier not in TIERS:
        raise UnknownNameError("tier", tier, TIERS)
    require_range("seed", seed, 0)
    config = config or SceneConfig()
    number = list(TIERS).index(tier)
    rng = np.random.default_rng([seed, number])
    for _ in range(_ATTEMPTS):
        found = TIERS[tier](rng)
        scene = None if found is None else seen(tier, seed, *found, config, rng)
        if scene is not None:
            return scene
    raise InputError(
        f"scene of tier {tier}",
        got=f"none in {_ATTEMPTS} tries that stands and is in sight",
        expected="one",
        mend="Take another seed.",
    )


Arranged = tuple[Settled, str | None]


def _piled(n_bodies: tuple[int, int], *arrangements: str) -> Callable[[Rng], Arranged]:
    config = PileConfig(n_bodies=n_bodies, center=CENTER, arrangements=arrangements)

    def arrange(rng: Rng) -> Arranged:
        return settled_pile(rng=rng, config=config), None

    return arrange


def _placed(
    kind: str,
    rng: Rng,
    at: tuple[float, float],
    rpy: tuple[float, float, float],
    name: str,
    mass: float | None = None,
) -> Body:
    turn = so3.from_rpy(np.array(rpy))
    place = [CENTER[0] + at[0], CENTER[1] + at[1], 0.0]
    body = draw_body(kind, rng=rng, name=name, mass=mass)
    return body.at(SE3.from_parts(turn, place))


def _fallen(bodies: list[Body]) -> Settled | None:
    settled = let_fall(World(tuple(bodies), Ground.level()))
    reach = [np.linalg.norm(b.T_base_body.p[:2] - CENTER) for b in settled.world.bodies]
    return settled if settled.is_at_rest and max(reach) < 0.7 else None


def _encumbered(rng: Rng) -> Arranged | None:
    """Lean something heavy on a bar that lies on the floor or on a support."""
    yaw = rng.uniform(-np.pi, np.pi)
    c, s = np.cos(yaw), np.sin(yaw)
    bodies = []
    if rng.random() < 0.6:
        base = str(rng.choice(["truss_ladder", "brick", "pallet", "lumber_4x4"]))
        bodies.append(_placed(base, rng, (0, 0), (0, 0, yaw + np.pi / 2), "base"))
    bar = str(rng.choice(_BARS))
    bodies.append(_placed(bar, rng, (0, 0), (0, 0, yaw), "candidate"))
    heavy = str(rng.choice(["cinder_block", "cinder_block", "lumber_4x4", "hedgehog"]))
    along, across = rng.uniform(-0.15, 0.15), rng.uniform(0.08, 0.2)
    place = (c * along - s * across, s * along + c * across)
    pitch = -rng.uniform(0.3, 0.7)
    mass = float(rng.uniform(6.0, 12.0))
    turn = (0.0, pitch, yaw + np.pi / 2 + rng.normal(0, 0.2))
    bodies.append(_placed(heavy, rng, place, turn, "load", mass))
    settled = _fallen(bodies)
    if settled is None or settled.bearers("load").get("candidate", 0.0) < 10.0:
        return None
    return settled, None


def _handle(rng: Rng) -> Arranged | None:
    """Put a crate with a handle among clutter; the crate is marked."""
    yaw = rng.uniform(-np.pi, np.pi)
    bodies = [_placed("crate_handle", rng, (0, 0), (0, 0, yaw), "target")]
    for k in range(int(rng.integers(0, 4))):
        angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.28, 0.45)
        place = (away * np.cos(angle), away * np.sin(angle))
        kind = str(rng.choice([*_BARS, "brick", "bucket", "cinder_block"]))
        turn = (0.0, 0.0, rng.uniform(-np.pi, np.pi))
        bodies.append(_placed(kind, rng, place, turn, f"{kind}_{k}"))
    settled = _fallen(bodies)
    if settled is None:
        return None
    upright = settled.world.bodies[0].T_base_body.R[2, 2]
    return (settled, "target") if upright > 0.9 else None


def _interlocked(rng: Rng) -> Arranged | None:
    """Put a pipe through a truss that lies on the floor."""
    kind = str(rng.choice(["truss_triangle", "truss_triangle", "ladder"]))
    yaw = rng.uniform(-np.pi, np.pi)
    frame = _placed(kind, rng, (0, 0), (0, 0, yaw), "truss")
    pipe = draw_body("pipe", rng=rng, name="pipe")
    lowest = min(float(solid.bounds.lower[2]) for solid in frame.solids)
    lift = 0.02 if kind == "truss_triangle" else 0.12
    frame = frame.at(
        SE3.from_parts(
            frame.T_base_body.R,
            frame.T_base_body.p + np.array([0.0, 0.0, lift - lowest]),
        )
    )
    radius, length = pipe.sizes["radius"], pipe.sizes["length"]
    steps = np.linspace(-0.5, 0.5, 60)[:, None] * length
    for _ in range(200):
        tilt, turn = rng.uniform(0.0, 1.0), rng.uniform(-np.pi, np.pi)
        axis = np.array(
            [np.cos(tilt) * np.cos(turn), np.cos(tilt) * np.sin(turn), np.sin(tilt)]
        )
        place = frame.T_base_body.apply([rng.uniform(-0.25, 0.25), 0.0, 0.0])
        middle = place + rng.normal(0, 0.02, 3) + axis * rng.uniform(-0.3, 0.3) * length
        line = middle + steps * axis
        gap = min(float(s.signed_distance(line).min()) for s in frame.solids)
        if gap > radius + 0.003 and line[:, 2].min() > radius + 0.003:
            break
    else:
        return None
    pose = SE3.from_parts(_turn_onto(pipe, axis), middle)
    settled = settle(World((frame, pipe.at(pose)), Ground.level()))
    return (settled, None) if settled.is_at_rest else None


def _turn_onto(pipe: Body, axis: FloatArray) -> FloatArray:
    """Rotation that puts the axis of a pipe along a direction."""
    part = pipe.parts[0]
    assert isinstance(part, (Cylinder, Capsule))
    own = part.T_frame_solid.R[:, 2]
    cross = np.cross(own, axis)
    size = float(np.linalg.norm(cross))
    if size < 1e-9:
        return np.eye(3)
    return so3.exp(cross / size * np.arctan2(size, own @ axis))


def _hedgehog(rng: Rng) -> Arranged | None:
    """Put one hedgehog barrier on the floor."""
    yaw = rng.uniform(-np.pi, np.pi)
    settled = _fallen([_placed("hedgehog", rng, (0, 0), (0, 0, yaw), "hedgehog")])
    return None if settled is None else (settled, None)


def _beam_on_edge(rng: Rng) -> Arranged | None:
    """Lay a beam with one end on a block, the other on the floor."""
    yaw = rng.uniform(-np.pi, np.pi)
    block = str(rng.choice(["cinder_block", "brick", "lumber_4x4"]))
    bar = str(rng.choice(["lumber_4x4", "lumber_2x4"]))
    c, s = np.cos(yaw), np.sin(yaw)
    settled = _fallen(
        [
            _placed(block, rng, (-0.15 * c, -0.15 * s), (0, 0, yaw + 1.57), "block"),
            _placed(bar, rng, (0.1 * c, 0.1 * s), (0.0, 0.25, yaw), "beam"),
        ]
    )
    if settled is None or settled.bearers("beam").get("block", 0.0) < 2.0:
        return None
    return settled, None


TIERS: Mapping[str, Callable[[Rng], Arranged | None]] = {
    "isolated": _piled((1, 1), "dropped"),
    "stacked": _piled((2, 3), "stacked"),
    "pile": _piled((3, 8)),
    "encumbered": _encumbered,
    "handle": _handle,
    "interlocked": _interlocked,
    "hedgehog": _hedgehog,
    "beam_on_edge": _beam_on_edge,
}
"""How the scenes of each tier are arranged; the order is part of the seeds."""
