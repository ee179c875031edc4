"""A robot with drives, weight and contacts, in a world that has them too."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields

from debrisgrasp._arrays import Rng
from debrisgrasp.errors import InputError
from debrisgrasp.geometry import Solid
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import GripperModel, load_grippers
from debrisgrasp.robot import FakeConfig, FakeRobot, FakeTruth
from debrisgrasp.worlds import World

from .arm import SimArm, SimForceSensor
from .gripper import SimGripper
from .physics import RobotPhysics
from .stage import SimStage

__all__ = ["SimRobot", "SimTruth", "sim_robot"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SimTruth(FakeTruth):
    """What really happened, which no device tells."""

    peak_time: Mapping[str, float]
    """When the largest force acted, by arm [s]."""
    deepest: Mapping[str, float]
    """How deep a hand entered a body at most, by arm [m]."""
    seconds: float
    """Simulated time [s]."""


class SimRobot(FakeRobot):
    """Devices of a robot in physics, and the truth behind them; made by `sim_robot`.

    Head, camera, base and clock are those of a `FakeRobot`; arms, wrists and hands are
    simulated, and so is everything that they touch.
    """

    arms: dict[str, SimArm]  # type: ignore[assignment]
    hands: dict[str, SimGripper]  # type: ignore[assignment]
    sensors: dict[str, SimForceSensor]  # type: ignore[assignment]
    _stage: SimStage  # type: ignore[assignment]
    _arm_type = SimArm
    _sensor_type = SimForceSensor

    def __init__(
        self,
        model: RobotModel,
        world: World,
        *,
        rng: Rng,
        config: FakeConfig,
        physics: RobotPhysics,
        grippers: Mapping[str, GripperModel],
    ) -> None:
        self._physics = physics
        super().__init__(model, world, rng=rng, config=config, grippers=grippers)

    def truth(self) -> SimTruth:
        """Return what no device tells.

        Raises
        ------
        InputError
            If the simulation diverged.
        """
        stage = self._stage
        if stage.has_diverged:
            raise InputError(
                "simulation of a robot",
                got="one that diverged",
                expected="finite motion",
                mend="Take a smaller time_step, or bodies that don't overlap.",
            )
        known = super().truth()
        values = {field.name: getattr(known, field.name) for field in fields(known)}
        return SimTruth(
            **values,
            peak_time=dict(stage.peak_time),
            deepest=dict(stage.deepest),
            seconds=self.timeline.now,
        )

    def change_world(self, change: Callable[[World], World]) -> bool:
        """Let bodies be others, or elsewhere; refused: physics has its own way."""
        del change
        return False

    def change_friction(self, friction: float) -> None:
        """Make everything as slick, or as rough."""
        self._stage.set_friction(friction)

    def stick(self, seconds: float) -> None:
        """Let hands keep hold of what they hold; there is no glue in physics.

        Raises
        ------
        InputError
            Always.
        """
        raise _only_kinematic(f"sticking for {seconds:g} s")

    def misplace(self, margin: float, arm: str | None = None) -> bool:
        """Put a joint where its own stops keep it from.

        Raises
        ------
        InputError
            Always.
        """
        raise _only_kinematic(f"a joint of {arm or 'an arm'} {margin:g} rad off")

    def _look_at_links(self) -> None:
        """Links are solid here: the stage knows what they meet."""

    def _make_hand(self, arm: str, gripper: GripperModel) -> SimGripper:
        return SimGripper(
            arm,
            gripper,
            self.timeline,
            self.config,
            self.violations,
            self._physics.hand,
        )

    def _make_stage(self, world: World) -> SimStage:  # type: ignore[override]
        return SimStage(
            self.model,
            world,
            self.arms,
            self.hands,
            self.sensors,
            {name: self._T_ee_ft(name) for name in self.arms},
            self._drives,
            self.config,
            self._physics,
        )

    @staticmethod
    def _weighed(hand: GripperModel) -> Sequence[Solid]:
        """All solids, the fingers open."""
        return hand.solids(next(iter(hand.preshapes)), hand.opening_range[1])


def sim_robot(
    model: RobotModel,
    world: World,
    *,
    rng: Rng,
    config: FakeConfig | None = None,
    physics: RobotPhysics | None = None,
    grippers: Mapping[str, GripperModel] | None = None,
) -> SimRobot:
    """Put a robot in physics before a world.

    Parameters
    ----------
    model
        Which robot, whose URDF gives masses and inertias; arms start in their idle
        posture.
    world
        Bodies at rest, in the frame of the base; `debrisgrasp.sim.settled_pile` makes
        such.
    rng
        Source of all randomness: the same state and the same commands give the same
        run.
    config
        How wrong its devices are. What it says of contacts and friction does not count
        here.
    physics
        Servo of the joints, hands and contacts.
    grippers
        Hands by name; None: those that ship.

    Returns
    -------
    SimRobot
        With ``robot`` and ``truth()`` as `debrisgrasp.robot.fake_robot` has them.

    Raises
    ------
    UnknownNameError
        If an arm carries a hand that is not among them.
    ConfigError
        If the URDF gives a link of an arm no mass, or the period of the devices is not
        a whole number of steps.
    MissingExtraError
        If MuJoCo is not installed.
    """
    hands = load_grippers() if grippers is None else grippers
    return SimRobot(
        model,
        world,
        rng=rng,
        config=config or FakeConfig(),
        physics=physics or RobotPhysics(),
        grippers=hands,
    )


def _only_kinematic(what: str) -> InputError:
    return InputError(
        "change of a robot in physics",
        got=what,
        expected="what physics allows",
        mend="Inject this fault into a fake_robot.",
    )
