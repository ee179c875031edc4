"""Scenes that are seen once, by a camera where RoMan's is, with its errors.

The pose that a planner is told is off by a calibration error.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray, Rng, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import SE3, Intrinsics, so3
from debrisgrasp.worlds import StereoNoise, World, draw_intrinsics, look_at, render

from .settle import Settled

__all__ = ["CENTER", "SceneConfig", "TierScene", "scene_of", "seen", "seen_again"]

CENTER = (1.1, 0.0)
"""Where scenes lie: within reach of RoMan's arms [m]."""
EYE = (0.40, 0.02, 0.93)
"""Where RoMan's head has the camera [m]."""
_OWN = 1000
"""Seeds of scenes of your own are others than those of the tiers."""
_FEWEST_PIXELS = 150


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
    """One of `TIERS`, or another name if the bodies are your own."""
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


@checked
def scene_of(
    settled: Settled,
    seed: int,
    *,
    name: str = "own",
    target: str | None = None,
    config: SceneConfig | None = None,
) -> TierScene:
    """Look at bodies of your own as at those of a tier.

    Parameters
    ----------
    settled
        Bodies at rest, as `let_fall` leaves them; RoMan's arms get to what lies around
        (1.1, 0) in the frame of the base [m].
    seed
        Of the errors of camera and calibration.
    name
        Stands for the tier in records.
    target
        Body to mark; None: the planner chooses.

    Raises
    ------
    InputError
        If they don't rest, hardly any of them is in sight, or the seed is negative.
    UnknownNameError
        If no body has the name of the target.
    """
    require_range("seed", seed, 0)
    if target is not None:
        settled.world.index(target)
    if not settled.is_at_rest:
        raise InputError("scene", got="bodies that move", expected="bodies at rest")
    rng = np.random.default_rng([seed, _OWN])
    scene = seen(name, seed, settled, target, config or SceneConfig(), rng)
    if scene is None:
        raise InputError(
            f"scene {name}",
            got="the target, or more than two bodies, hidden, or small in the image",
            expected="bodies in sight of the camera, which looks at their middle",
            mend=f"Put them near x {CENTER[0]} m, y {CENTER[1]} m, beside each other.",
        )
    return scene


def seen(
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
