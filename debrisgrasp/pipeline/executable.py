"""The first grasp of a plan that can be carried out as a whole.

A grasp is worth nothing if the arm can't get to it, or is stuck once it holds the
object. For each grasp in turn the whole chain is planned: from the present posture to
the pre-grasp, the straight approach, and the straight lift. Approach and lift must also
be possible with the hand pushed aside as far as compliance lets it go.

Searches for the way there are short at first. Those that find none are followed by one
long search for all grasps together: a tree that leaves the corner in which the arm
stands serves them all.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any

from debrisgrasp._arrays import FloatArray, Rng
from debrisgrasp._checked import checked
from debrisgrasp._stopwatch import Progress, Stopwatch
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError, InputError
from debrisgrasp.io.motion_json import motion_to_dict, save_motion
from debrisgrasp.kinematics import ArmReach, RobotModel, with_hand
from debrisgrasp.motion import MotionSpace
from debrisgrasp.planning import Grasp, GraspPlan

from .grasp_chain import GraspChain, GraspMotion, MotionsConfig
from .passage import Passage
from .reasons import NOT_TRIED

__all__ = ["GraspMotions", "first_executable"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GraspMotions:
    """The grasp to carry out, or why there is none."""

    chosen: GraspMotion | None
    passed_over: tuple[tuple[int, str], ...]
    """Other grasps: place in the plan, and what stops them. If only a long search found
    the way some may come after the one chosen."""
    robot: str = ""
    """Name of the robot that they are for."""

    @property
    def tried(self) -> tuple[tuple[int, str], ...]:
        """Those of the grasps passed over for which there was time."""
        return tuple(over for over in self.passed_over if over[1] != NOT_TRIED)

    @property
    def why_none(self) -> str:
        """Why no grasp can be carried out; empty if one can."""
        if self.chosen is not None:
            return ""
        if not self.passed_over:
            return "the plan has no grasp"
        n, left = len(self.tried), len(self.passed_over) - len(self.tried)
        index, reason = self.tried[0]
        why = f"none of {counted(n, 'grasp')} tried can be carried out; "
        why += f"grasp {index + 1}: "
        more = f"; {left} more were not tried, the deadline had passed" if left else ""
        return why + reason + more

    def to_json(self) -> dict[str, Any]:
        """Return what `save` writes, as JSON values."""
        chosen = self.chosen
        return motion_to_dict(
            {} if chosen is None else chosen.trajectories,
            robot=self.robot,
            arm=None if chosen is None else chosen.arm,
            index=None if chosen is None else chosen.index,
            passed_over=self.passed_over,
        )

    @checked
    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the motions as JSON (docs/formats.md); earlier ones are replaced.

        Raises
        ------
        ConfigError
            If the file's name does not end in .json.
        OutputError
            If it can't be written, or a file is there that holds no motions.
        """
        save_motion(self.to_json(), path)


def first_executable(
    plan: GraspPlan,
    robot: RobotModel,
    space: MotionSpace,
    *,
    passage: Passage | None = None,
    present: Mapping[str, float] | None = None,
    known: Mapping[str, FloatArray] | None = None,
    config: MotionsConfig | None = None,
    accepted: Callable[[GraspMotion], str] | None = None,
    rng: Rng,
    deadline: float | None = None,
    progress: Progress | None = None,
) -> GraspMotions:
    """Find the first grasp of a plan whose whole chain of motions is feasible.

    Parameters
    ----------
    plan
        Grasps, best first, made for the robot.
    space
        Obstacles of the arm.
    passage
        What hand and held object must pass by on approach and lift, and how the fingers
        stand; None tests the arm alone, with the hand at rest.
    present
        Joint values now [rad or m]; None: each arm stands in its present posture.
    known
        By arm, postures (k, d) of ways that it has gone from there: what led it to one
        grasp leads it most of the way to the next.
    accepted
        Says of a feasible chain what else speaks against it, or nothing; None: nothing
        does.
    deadline
        Seconds after which no further grasp is tried, and a long search gives up.

    Raises
    ------
    ConfigError, InputError
        If the deadline is not positive, the plan is for a floating hand, or ``present``
        names a joint that the robot has not.
    """
    robot.joint_values(present)
    if deadline is not None and not deadline > 0:
        raise ConfigError(
            "deadline",
            got=f"{deadline} s",
            expected="a positive number of seconds, or none",
        )
    watch = Stopwatch(deadline, progress)
    config = config or MotionsConfig()
    chains: dict[tuple[object, ...], GraspChain] = {}
    passed_over: dict[int, str] = {}

    def judged(found: GraspMotion | str) -> str:
        if isinstance(found, str):
            return found
        return "" if accepted is None else accepted(found)

    for index, grasp in enumerate(plan.grasps):
        if grasp.arm is None or grasp.joints is None:
            raise InputError(
                f"grasp {index + 1}",
                got="no arm",
                expected="one that an arm takes",
                mend="Plan with a robot rather than for a floating hand.",
            )
        if passed_over and watch.is_late():
            passed_over[index] = NOT_TRIED
            continue
        key = grasp.arm, grasp.preshape, grasp.opening
        if key not in chains:
            arm = _arm_for(grasp, grasp.arm, robot, passage, present)
            ways = (known or {}).get(grasp.arm)
            chains[key] = GraspChain(arm, space, passage, config, ways)
        watch.report("motion", index / len(plan.grasps))
        found = chains[key].motion(grasp, index, rng, watch)
        refused = judged(found)
        if isinstance(found, GraspMotion) and not refused:
            return _motions(found, passed_over, robot)
        if isinstance(found, GraspMotion):
            chains[key].drop({index})
        passed_over[index] = refused
    chosen = _sought(chains.values(), judged, passed_over, rng, watch)
    return _motions(chosen, passed_over, robot)


def _motions(
    chosen: GraspMotion | None, passed_over: Mapping[int, str], robot: RobotModel
) -> GraspMotions:
    over = tuple(passed_over.items())
    return GraspMotions(chosen=chosen, passed_over=over, robot=robot.name)


def _sought(
    chains: Collection[GraspChain],
    judged: Callable[[GraspMotion | str], str],
    passed_over: dict[int, str],
    rng: Rng,
    watch: Stopwatch,
) -> GraspMotion | None:
    """Seek long for a way to the grasps that wait, and note what stops each."""
    share = 1.0 / max(sum(bool(chain.waiting) for chain in chains), 1)
    for chain in chains:
        while chain.waiting and not watch.is_late():
            found = chain.sought(rng, share, watch)
            refused = judged(found)
            indices = {ready.index for ready in chain.waiting}
            if isinstance(found, GraspMotion):
                indices = {found.index}
                if not refused:
                    del passed_over[found.index]
                    return found
            passed_over.update(dict.fromkeys(indices, refused))
            chain.drop(indices)
    return None


def _arm_for(
    grasp: Grasp,
    name: str,
    robot: RobotModel,
    passage: Passage | None,
    present: Mapping[str, float] | None,
) -> ArmReach:
    """Arm that takes a grasp, its fingers as they stand on the way in."""
    fingers, opened = {}, robot
    if passage is not None:
        fingers = passage.finger_joints(grasp)
        opened = with_hand(robot, name, passage.hand_solids(grasp))
    held = _on_robot(fingers, robot, name)
    return ArmReach(opened, name, present=present, locked=held)


def _on_robot(
    fingers: Mapping[str, float], robot: RobotModel, arm: str
) -> dict[str, float]:
    """Values of a hand's joints by the names that they have in the robot's file.

    A robot puts the name of the hand before them; joints that it doesn't have stay out.
    """
    below = robot.tree.links_below(robot.arm(arm).hand)
    names = [name for name, j in robot.tree.joints.items() if j.child in below]
    return {
        name: value
        for finger, value in fingers.items()
        for name in names
        if name == finger or name.endswith(f"_{finger}")
    }
