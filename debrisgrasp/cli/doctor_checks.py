"""What `debrisgrasp doctor` looks at, one function for each thing."""

from __future__ import annotations

import platform
import re
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, requires, version

import numpy as np

import debrisgrasp
from debrisgrasp._files import data_path, write_atomic
from debrisgrasp._words import arm_called, counted
from debrisgrasp.errors import DebrisGraspError, InputError
from debrisgrasp.executive import (
    TaskSettings,
    is_held_where_it_rests,
    require_above_ground,
    require_drop_off,
    require_own_joints,
    require_own_sides,
    require_room,
    require_watching,
)
from debrisgrasp.geometry import SE3, so3
from debrisgrasp.io import Capture
from debrisgrasp.io.calibration_json import load_calibration
from debrisgrasp.io.depth_images import load_camera
from debrisgrasp.kinematics import ArmReach, LimitSet, RobotModel, cache_folder
from debrisgrasp.kinematics.limits import LEAST_MARGIN
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.prototypes import check
from debrisgrasp.settings import Settings

__all__ = ["EXTRAS", "Finding", "installation", "self_test", "site"]

EXTRAS = {
    "viz": "viewer in the browser",
    "sim": "piles that settle by physics (MuJoCo)",
    "motion": "OMPL beside the built-in motion planner",
    "tags": "AprilTags as calibration targets",
    "cluster": "campaigns on several machines (Dask)",
    "robots": "further robots for examples and tests",
    "notebooks": "running the notebooks",
    "docs": "building the documentation",
    "bench": "peers to measure against",
    "dev": "tests, lint, types",
}
"""What each extra of the package is for."""
_OLD_CALIBRATION = 90
"""Days after which a look at the calibration is advised."""
_HEIGHTS = np.arange(0.1, 1.0, 0.1)
"""Heights of the palm that are tried over a drop-off [m]."""
_NAME = re.compile(r"[\w.-]+")
_LEAST, _BELOW = re.compile(r">=([\d.]+)"), re.compile(r"<([\d.]+)")
_EXTRA = re.compile(r"extra == ['\"]([\w-]+)['\"]")


@dataclass(frozen=True, slots=True)
class Finding:
    """One line of the doctor's report."""

    what: str
    status: str
    """``ok``; ``note`` for what may be meant; ``fault`` for what must be mended."""
    text: str


def installation() -> Iterator[Finding]:
    """Versions, the cache, and which extras are there."""
    yield Finding("python", "ok", f"{platform.python_version()} on {platform.system()}")
    try:
        requirements = requires("debrisgrasp") or []
    except PackageNotFoundError:
        text = f"{debrisgrasp.__version__}, used without being installed"
        yield Finding("debrisgrasp", "note", text)
        requirements = []
    else:
        yield Finding("debrisgrasp", "ok", debrisgrasp.__version__)
    needed: dict[str, list[str]] = {}
    for requirement in requirements:
        match = _EXTRA.search(requirement)
        needed.setdefault(match[1] if match else "", []).append(requirement)
    for requirement in needed.pop("", []):
        name, problem = _state_of(requirement)
        yield Finding(name, "fault" if problem else "ok", problem or version(name))
    yield _cache()
    for extra, use in EXTRAS.items():
        yield _extra(extra, use, needed.get(extra, []))


def _extra(extra: str, use: str, requirements: Sequence[str]) -> Finding:
    states = [_state_of(requirement) for requirement in requirements]
    missing = ", ".join(f"{name} {problem}" for name, problem in states if problem)
    if not states:
        missing = "not known to this installation"
    if not missing:
        return Finding(f"extra {extra}", "ok", use)
    text = f"{use}; {missing}: pip install 'debrisgrasp[{extra}]'"
    return Finding(f"extra {extra}", "note", text)


def _state_of(requirement: str) -> tuple[str, str]:
    """Name of a required package, and what is wrong with it; empty if nothing is."""
    wanted = requirement.partition(";")[0]
    match = _NAME.match(wanted)
    assert match is not None
    name, least, below = match[0], _LEAST.search(wanted), _BELOW.search(wanted)
    try:
        installed = version(name)
    except PackageNotFoundError:
        return name, "is missing"
    if least and _numbers(installed) < _numbers(least[1]):
        return name, f"is {installed}, at least {least[1]} is needed"
    if below and _numbers(installed) >= _numbers(below[1]):
        return name, f"is {installed}, one below {below[1]} is needed"
    return name, ""


def _numbers(text: str) -> tuple[int, ...]:
    """Leading numbers of a version: 1.26.4rc1 becomes (1, 26, 4)."""
    parts = re.match(r"\d+(?:\.\d+)*", text)
    return tuple(map(int, parts[0].split("."))) if parts else ()


def _cache() -> Finding:
    folder = cache_folder()
    if folder is None:
        return Finding("cache", "note", "no home folder; maps are built every time")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / "doctor.tmp"
        write_atomic(probe, b"")
        probe.unlink()
    except OSError as error:
        text = f"{folder}: {error.strerror or error}; everything works, but maps are "
        text += "built every time"
        return Finding("cache", "note", text)
    return Finding("cache", "ok", f"{folder} can be written")


def self_test(settings: Settings) -> Iterator[Finding]:
    """Segment and plan on the shipped capture, as the site would."""
    try:
        start = time.perf_counter()
        capture = Capture.load(data_path("captures", "pile.npz"))
        pipeline = Pipeline.from_settings(settings)
        loaded = time.perf_counter() - start
        yield Finding("loading", "ok", f"robot, hands and dictionary in {loaded:.2f} s")
        start = time.perf_counter()
        segmentation = debrisgrasp.segment(capture)
        spent, n = time.perf_counter() - start, len(segmentation.segments)
        yield Finding(
            "segment",
            "ok" if n else "fault",
            f"{counted(n, 'object')} in {spent:.2f} s",
        )
        start = time.perf_counter()
        plan = pipeline.plan(
            capture, seed=settings.seed, deadline=settings.deadline
        ).plan
        spent = time.perf_counter() - start
    except DebrisGraspError as error:
        yield Finding("self-test", "fault", str(error))
        return
    if not plan.grasps:
        why = "; ".join([*plan.notes, plan.why_empty or "no grasp"])
        if settings.path is None:
            yield Finding("plan", "fault", why)
        else:
            text = f"none, as may be for another robot than roman: {why}"
            yield Finding("plan", "note", text)
        return
    best = plan.grasps[0]
    text = f"{counted(len(plan.grasps), 'grasp')} in {spent:.2f} s; best: "
    arm = "floating hand" if best.arm is None else arm_called(best.arm)
    yield Finding("plan", "ok", f"{text}{best.prototype}, Q {best.Q:.2f}, {arm}")


def site(settings: Settings) -> Iterator[Finding]:
    """Load everything that a site's file names, and see whether it fits together.

    Raises
    ------
    DebrisGraspError
        If a file that it names can't be used.
    """
    pipeline = Pipeline.from_settings(settings)
    robot = pipeline.robot
    arms = ", ".join(f"{arm.name} ({arm.gripper})" for arm in pipeline.arms)
    name = "floating hand" if robot is None else f"{robot.name}, arms: {arms}"
    yield Finding("robot", "ok", name)
    library = pipeline.library
    faults = [
        f"{p.name}: {found}"
        for p in library
        for found in check(p, library.grippers[p.gripper])
    ]
    yield Finding(
        "prototypes",
        "fault" if faults else "ok",
        "; ".join(faults)
        or f"{len(library)} for " + ", ".join(sorted({p.gripper for p in library})),
    )
    yield from _camera(settings, robot)
    if robot is not None:
        yield from _same_joints(robot, pipeline.arms)
        yield from _watching(robot, pipeline.arms)
    if settings.camera_file is not None:
        lens = load_camera(settings.camera_file)
        text = f"fx {lens.fx:g}, fy {lens.fy:g}, cx {lens.cx:g}, cy {lens.cy:g}"
        yield Finding("camera file", "ok", text)
    arms_in_use = {arm.name: arm for arm in pipeline.arms}
    yield from _drop_offs(settings, arms_in_use)
    places = {**TaskSettings().drop_off, **settings.drop_off}
    for arm_name in (name for name in arms_in_use if name not in places):
        text = "none, which `clear` needs: give one as drop_off of the site"
        yield Finding(f"drop-off of {arm_called(arm_name)}", "note", text)
    if robot is not None:
        for arm in pipeline.arms:
            yield from _bodies(robot, arm.name)
            yield from _overlaps(arm)
            yield from _postures(robot, arm)
            yield _limits(arm, robot.limits(arm.name).controller, settings)


def _same_joints(robot: RobotModel, arms: Sequence[ArmReach]) -> Iterator[Finding]:
    """Tell of two arms that are one."""
    try:
        require_own_joints(robot, [arm.name for arm in arms])
    except InputError as error:
        text = f"{error.got}; `clear` expects {error.expected}. {error.mend}"
        yield Finding(error.what, "note", text)


def _watching(robot: RobotModel, arms: Sequence[ArmReach]) -> Iterator[Finding]:
    """Tell of a camera that `clear` can't work with, or can't check by a hand."""
    try:
        require_watching(robot, robot.arms)
    except InputError as error:
        text = f"{error.got}; `clear` expects {error.expected}. {error.mend}"
        yield Finding(f"camera of {robot.name}", "note", text.strip())
        return
    first = arms[0]
    spec = robot.arm(first.name)
    poses = [
        first.chain.fk(first.chain.vector(robot.posture(first.name, posture)))
        for posture in (spec.present, spec.idle)
    ]
    if is_held_where_it_rests(*poses):
        text = "`idle` holds the hand where `present` does: `clear` can't see by it "
        text += "whether the camera has moved. Let `present` lead it into view"
        what = f"posture {spec.present} of {arm_called(first.name)}"
        yield Finding(what, "note", text)


def _bodies(robot: RobotModel, arm: str) -> Iterator[Finding]:
    """Tell of an arm of which no link could touch anything."""
    chains = {name: set(robot.chain(name).joint_names) for name in robot.arms}
    for link, shapes in robot.tree.shapes.items():
        above = {joint.name for joint in robot.tree.joints_above(link)}
        is_of_hand = any(joints <= above for joints in chains.values())
        if shapes and chains[arm] & above and not is_of_hand:
            return
    text = "none has a solid (<collision>) in the URDF: postures and motions are not "
    yield Finding(f"links of {arm_called(arm)}", "fault", text + "tested against them")


def _overlaps(arm: ArmReach) -> Iterator[Finding]:
    """Tell of links that overlap however the arm stands, which nothing else tells."""
    body = arm.collision.body
    if not body.always_touching:
        return
    hand = {part.link for part in body.parts if part.is_hand}
    is_hand = any(hand.intersection(links) for links in body.always_touching)
    text = ", ".join(f"{link} and {other}" for link, other in body.always_touching)
    text += " overlap in every posture, and are not tested against each other: "
    text += "is the hand turned back?" if is_hand else "do the solids fit?"
    what = f"links of {arm_called(arm.name)}"
    yield Finding(what, "fault" if is_hand else "note", text)


def _postures(robot: RobotModel, arm: ArmReach) -> Iterator[Finding]:
    """Tell of postures of the task in which the robot touches itself, or the ground."""
    spec = robot.arm(arm.name)
    if beyond := robot.limits(arm.name).planner.violation(arm.q_present):
        text = f"{beyond}, of limits {LEAST_MARGIN:g} rad or m within the robot's: "
        what = f"posture {spec.present} of {arm_called(arm.name)}"
        yield Finding(what, "note", text + "`motion` can't begin there")
    for posture in dict.fromkeys((spec.present, spec.idle)):
        q = arm.chain.vector(robot.posture(arm.name, posture))
        contacts = arm.collision.self_contacts(arm.chain.clipped(q))
        if contacts:
            what = f"posture {posture} of {arm_called(arm.name)}"
            touching = (f"{link} touches {other}" for link, other in contacts)
            yield Finding(
                what, "fault", ", ".join(touching) + ": no motion begins there"
            )
    try:
        require_above_ground(robot, arm.name, spec.idle)
    except InputError as error:
        text = f"{error.got}; `clear` expects {error.expected}. {error.mend}"
        yield Finding(f"rest of {arm_called(arm.name)}", "note", text)


def _limits(arm: ArmReach, limits: LimitSet, settings: Settings) -> Finding:
    what, turns = f"limits of {arm_called(arm.name)}", arm.chain.is_revolute
    speeds = " and ".join(
        f"{limits.velocity[those].max():.2f} {unit}"
        for those, unit in ((turns, "rad/s"), (~turns, "m/s"))
        if those.any()
    )
    text = f"{limits.force:g} N, {limits.torque:g} N m, joints up to {speeds}, hand "
    text += f"{settings.limits.hand_speed:g} m/s on approach and lift"
    try:
        require_room(limits, TaskSettings().load_share)
    except InputError as error:
        # What the arm itself bears is no mistake: plans and motions need no more.
        status = "fault" if settings.limits.sets(error.what) else "note"
        return Finding(what, status, f"{text}; `clear` refuses that: {error}")
    return Finding(what, "ok", text)


def _camera(settings: Settings, robot: RobotModel | None) -> Iterator[Finding]:
    if settings.calibration is None:
        given = settings.camera_pose is not None
        text = "pose given" if given else "none: every capture must bring its pose"
        yield Finding("camera", "ok" if given else "note", text)
        return
    stored = load_calibration(settings.calibration)
    if stored.problems:
        yield Finding("camera", "fault", "refused: " + "; ".join(stored.problems))
        return
    name, links = ("none", ()) if robot is None else (robot.name, robot.tree.shapes)
    where = "" if stored.link is None else f"on link {stored.link!r} "
    is_off = robot is not None and stored.robot not in (None, name)
    if is_off or (where and stored.link not in links):
        text = f"{where}of robot {stored.robot!r}, not of this one"
        yield Finding("camera", "fault", text)
        return
    days = (datetime.now(UTC) - datetime.fromisoformat(stored.date)).days
    sigma = 1e3 * float(np.sqrt(np.trace(stored.covariance[:3, :3]) / 3))
    text = f"calibrated {days} days ago, standard deviation {sigma:.1f} mm"
    if stored.link is not None:
        text += f", on link {stored.link}: captures need --joints"
    if days > _OLD_CALIBRATION:
        yield Finding(
            "camera", "note", text + "; `debrisgrasp calibrate watch` tells if it moved"
        )
    else:
        yield Finding("camera", "ok", text)


def _drop_offs(settings: Settings, arms: Mapping[str, ArmReach]) -> Iterable[Finding]:
    """Tell of each drop-off of the site, and of one beside another arm, in one row."""
    given = settings.drop_off
    task = TaskSettings(workspace=settings.workspace or TaskSettings().workspace)
    found = [_drop_off(name, place, arms, task) for name, place in given.items()]
    rows = {finding.what: finding for finding in found}
    try:
        if given:
            require_own_sides(arms, {**TaskSettings().drop_off, **given})
    except InputError as error:
        what = error.what.replace("of the ", "of ")
        text = f"{error.got}; expected {error.expected}. {error.mend}"
        if what not in rows or rows[what].status != "fault":
            rows[what] = Finding(what, "fault", text)
    return rows.values()


def _drop_off(
    name: str,
    place: tuple[float, float],
    arms: Mapping[str, ArmReach],
    task: TaskSettings,
) -> Finding:
    """Tell whether `clear` takes it, and how high a palm that points down can be."""
    what, where = f"drop-off of {arm_called(name)}", ", ".join(f"{x:g}" for x in place)
    try:
        replace(task, drop_off={name: place})
        if name not in arms:
            return Finding(what, "note", "not looked at: that arm is not in use")
        require_drop_off(arms[name], place)
    except InputError as error:
        return Finding(what, "fault", f"{error.got}; expected {error.expected}")
    yaw, height = np.meshgrid(np.linspace(0, 2 * np.pi, 8, endpoint=False), _HEIGHTS)
    rpy = np.stack([np.full(yaw.size, np.pi), 0 * yaw.ravel(), yaw.ravel()], axis=-1)
    p = np.column_stack([np.broadcast_to(place, (yaw.size, 2)), height.ravel()])
    poses = SE3.from_parts(so3.from_rpy(rpy), p)
    solved = arms[name].solves(poses, rng=np.random.default_rng(0))
    if not solved.any():
        return Finding(what, "ok", f"{where} m, within reach of a palm that tilts")
    low, high = height.ravel()[solved].min(), height.ravel()[solved].max()
    text = f"{where} m, within reach with the palm {low:.1f} to {high:.1f} m high"
    return Finding(what, "ok", text)
