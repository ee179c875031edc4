"""Scenes for trials of grasps, from simple to hard, each from a seed.

Every scene is settled by physics and seen once by a camera where RoMan's is. The pose
that a planner is told is off by a calibration error.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp.errors import InputError, UnknownNameError
from debrisgrasp.geometry import SE3, Capsule, Cylinder, Intrinsics, so3
from debrisgrasp.worlds import (
    Body,
    Ground,
    PileConfig,
    StereoNoise,
    World,
    draw_body,
    draw_intrinsics,
    look_at,
    render,
)

from .piles import settled_pile
from .settle import Settled, let_fall, settle

__all__ = ["TIERS", "SceneConfig", "TierScene", "seen_again", "tier_scene"]

CENTER = (1.1, 0.0)
"""Where scenes lie: within reach of RoMan's arms [m]."""
EYE = (0.40, 0.02, 0.93)
"""Where RoMan's head has the camera [m]."""
_ATTEMPTS = 30
_FEWEST_PIXELS = 150
_BARS = ("lumber_2x4", "lumber_2x4", "lumber_4x4", "pipe", "board")


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SceneConfig:
    """What a planner is up against."""

    noise: bool = True
    """Whether depth has the errors of a stereo camera."""
    calibration_shift: float = 0.005
    """Length of the error of the camera's position [m]."""
    calibration_turn: float = np.radians(0.5)
    """Angle of the error of its orientation [rad]."""

    def __post_init__(self) -> None:
        require_range("calibration_shift", self.calibration_shift, 0.0, 0.2)
        require_range("calibration_turn", self.calibration_turn, 0.0, 0.5)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TierScene:
    """A world at rest, and one look at it."""

    tier: str
    seed: int
    settled: Settled
    target: str | None
    """Body that a mask marks; None: the planner chooses."""
    intrinsics: Intrinsics
    depth: FloatArray
    """As measured [m], NaN where nothing was, shape (height, width)."""
    labels: IntArray
    """0 ground, 1.. bodies in the order of the world, -1 nothing, (height, width)."""
    T_base_camera: SE3
    """Where the camera is."""
    T_base_camera_believed: SE3
    """Where calibration has it."""

    @property
    def world(self) -> World:
        """Bodies and ground."""
        return self.settled.world

    @property
    def mask(self) -> np.ndarray | None:
        """Pixels of the target, if there is one."""
        if self.target is None:
            return None
        return np.asarray(self.labels == self.world.index(self.target) + 1)


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
        If no arrangement in many tries stood and was in sight.
    MissingExtraError
        If MuJoCo is not installed.
    """
    if tier not in TIERS:
        raise UnknownNameError("tier", tier, TIERS)
    config = config or SceneConfig()
    number = list(TIERS).index(tier)
    rng = np.random.default_rng([seed, number])
    for _ in range(_ATTEMPTS):
        found = TIERS[tier](rng)
        scene = None if found is None else _seen(tier, seed, *found, config, rng)
        if scene is not None:
            return scene
    raise InputError(
        f"scene of tier {tier}",
        got=f"none in {_ATTEMPTS} tries that stands and is in sight",
        expected="one",
        mend="Take another seed.",
    )


def _seen(
    tier: str,
    seed: int,
    settled: Settled,
    target: str | None,
    config: SceneConfig,
    rng: Rng,
) -> TierScene | None:
    """Look at a world; None if too little of it is in sight."""
    bodies = settled.world.bodies
    middle = np.mean([body.T_base_body.p for body in bodies], axis=0)
    intrinsics = draw_intrinsics(rng)
    pose = look_at(EYE, [*middle[:2], 0.1])
    exact = render(settled.world, intrinsics, pose)
    pixels = np.bincount(exact.labels[exact.labels > 0], minlength=len(bodies) + 1)
    is_seen = pixels[1:] >= _FEWEST_PIXELS
    if is_seen.sum() < max(1, len(bodies) - 2):
        return None
    if target is not None and not is_seen[settled.world.index(target)]:
        return None
    depth = _measured(exact.depth, intrinsics, config, rng)
    shift, turn = (_direction(rng) for _ in range(2))
    believed = SE3.from_parts(
        so3.exp(config.calibration_turn * turn) @ pose.R,
        pose.p + config.calibration_shift * shift,
    )
    return TierScene(
        tier=tier,
        seed=seed,
        settled=settled,
        target=target,
        intrinsics=intrinsics,
        depth=depth,
        labels=exact.labels,
        T_base_camera=pose,
        T_base_camera_believed=believed,
    )


def seen_again(
    scene: TierScene, settled: Settled, *, rng: Rng, config: SceneConfig | None = None
) -> TierScene:
    """Look, from the same place, at what has become of the scene of a tier.

    Parameters
    ----------
    settled
        What is there now; without the target of the scene, there is none.
    rng
        Source of the errors of the depth; those of the calibration stay.
    """
    exact = render(settled.world, scene.intrinsics, scene.T_base_camera)
    target = scene.target if scene.target in settled.world.names else None
    return replace(
        scene,
        settled=settled,
        target=target,
        depth=_measured(exact.depth, scene.intrinsics, config or SceneConfig(), rng),
        labels=exact.labels,
    )


def _measured(
    depth: FloatArray, intrinsics: Intrinsics, config: SceneConfig, rng: Rng
) -> FloatArray:
    """Depth as a camera has it, NaN where nothing was."""
    if config.noise:
        noise = StereoNoise(sigma=float(rng.uniform(0.0015, 0.002)))
        depth = noise.noisy(depth, intrinsics, rng=rng).depth
    return np.where(depth > 0, depth, np.nan)


def _direction(rng: Rng) -> FloatArray:
    way = rng.standard_normal(3)
    return np.asarray(way / np.linalg.norm(way))


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
