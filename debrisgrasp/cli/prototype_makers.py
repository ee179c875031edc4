"""``prototype new``, ``from-mesh`` and ``record``: make prototypes."""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from debrisgrasp._files import require_folder
from debrisgrasp.errors import (
    ConfigError,
    DebrisGraspError,
    InputError,
    OutputError,
    UnknownNameError,
)
from debrisgrasp.geometry import SE3
from debrisgrasp.kinematics import RobotModel
from debrisgrasp.prototypes import (
    FURTHER_HANDS,
    Finding,
    GraspPrototype,
    GripperModel,
    HandPose,
    PrototypeDefinition,
    PrototypeLibrary,
    SurfaceShape,
    around_grip,
    duplicates,
    propose_hand_poses,
    prototype_of_shape,
    require_name,
    settled,
    soundest,
    surface_from_mesh,
    write_new_prototype,
)
from debrisgrasp.workbench import (
    parse_hand_pose,
    record,
    taught_by_joints,
)

from .capture_arguments import load_capture
from .prototype_arguments import SIZES, add_mesh, add_new, add_record
from .site_arguments import hands_of, site_of
from .tables import columns
from .values import joints_of, region_of

__all__ = ["add_makers"]

_READ = ("mesh", "capture", "camera_file", "pose", "site")
"""Arguments that may name a file, which no prototype may replace."""
_OPTIONS = tuple(f"--{name}" for name in (*SIZES, "plate", "ends"))


def add_makers(actions: Any) -> None:
    """Add the actions that write prototypes."""
    add_new(actions).set_defaults(run=run_new)
    add_mesh(actions).set_defaults(run=run_mesh)
    add_record(actions).set_defaults(run=run_record)


def run_new(arguments: argparse.Namespace) -> int:
    """Make a prototype of a shape."""
    gripper = _prepared(arguments)
    shape: dict[str, Any] = {"type": arguments.shape}
    if arguments.radius is not None:
        if arguments.diameter is not None:
            raise ConfigError(
                "size", got="both --radius and --diameter", expected="one of them"
            )
        arguments.diameter = 2 * arguments.radius
    for name in (*SIZES, "plate", "ends", "position", "rpy_deg"):
        value = getattr(arguments, name)
        if value is not None:
            shape[name] = value
    made = (
        prototype_of_shape(
            arguments.name,
            shape,
            gripper,
            preshape,
            grip=arguments.grip,
            kind=arguments.kind or "generic",
            description=arguments.description,
        )
        for preshape in _preshapes(arguments, gripper)
    )
    try:
        chosen, findings = soundest(made, gripper)
    except InputError as error:
        raise _about_option(error, arguments.shape) from None
    return _finish(arguments, chosen, findings)


def _about_option(error: InputError, shape: str) -> InputError:
    """Say of an option what an error says of the field that it would become."""
    _, is_field, name = error.what.partition(", field shape")
    if not is_field:
        return error
    got, expected = error.got, error.expected
    if isinstance(error, UnknownNameError) and not name:
        name, got = f".{error.name}", "one"
        sizes = [f"--{size.replace('_', '-')}" for size in error.known]
        expected = f"its sizes: {', '.join(s for s in sizes if s in _OPTIONS)}"
    option = f"--{name[1:].replace('_', '-')} with --shape {shape}"
    mend = "" if str(got).startswith("nothing") else error.mend
    return ConfigError(option, got=got, expected=expected, mend=mend)


def run_mesh(arguments: argparse.Namespace) -> int:
    """Make a prototype of a mesh."""
    gripper = _prepared(arguments)
    surface = surface_from_mesh(arguments.mesh, scale=arguments.scale)
    proposals: Sequence[HandPose] = ()
    whole: SurfaceShape | None = None
    if arguments.pose is None:
        proposals = propose_hand_poses(surface, gripper, preshape=arguments.preshape)
        if not proposals:
            raise InputError(
                str(arguments.mesh),
                got=f"a shape that {gripper.name} can't take along any of its axes",
                expected="something the hand can close on",
                mend="Check the scale, or give the pose of the hand (--pose).",
            )
        if not 1 <= arguments.choice <= len(proposals):
            raise ConfigError(
                "--choice", got=arguments.choice, expected=f"1 to {len(proposals)}"
            )
        chosen = proposals[arguments.choice - 1]
        T_mesh_hand, preshapes = chosen.T_surface_hand, [chosen.preshape]
    else:
        T_mesh_hand = parse_hand_pose(arguments.pose)
        preshapes = _preshapes(arguments, gripper)
        whole = surface.moved(T_mesh_hand.inverse())
    made = []
    for preshape in preshapes:
        low = gripper.preshape(preshape).widths[0]
        definition = PrototypeDefinition(
            name=arguments.name,
            gripper=gripper.name,
            preshape=preshape,
            width=low,
            opening=float(gripper.preshape(preshape).openings[0]),
            shape=around_grip(surface, T_mesh_hand, gripper, preshape),
            T_hand_shape=SE3.identity(),
            kind=arguments.kind or "object-specific",
            description=arguments.description or f"from {arguments.mesh.name}",
        )
        definition = settled(definition, gripper)
        if arguments.closed is not None:
            definition = replace(definition, width=arguments.closed)
        made.append(definition)
    return _finish(arguments, *soundest(made, gripper, whole), proposals)


def run_record(arguments: argparse.Namespace) -> int:
    """Make a prototype of a piece of a capture."""
    gripper = _prepared(arguments)
    pose = None
    if arguments.pose is not None:
        pose = parse_hand_pose(arguments.pose)
    if arguments.joints is not None:
        robot = RobotModel.load(site_of(arguments).robot)
        joints = _joints(arguments.joints)
        pose = taught_by_joints(robot, arguments.arm, joints, gripper.name)
    made = record(
        load_capture(arguments),
        arguments.name,
        gripper,
        object_label=arguments.object,
        region=region_of(arguments),
        T_base_hand=pose,
        preshape=arguments.preshape,
        width=arguments.closed,
        choice=arguments.choice,
        kind=arguments.kind or "generic",
        description=arguments.description,
    )
    return _finish(arguments, made.definition, made.findings, made.proposals)


def _prepared(arguments: argparse.Namespace) -> GripperModel:
    """Check what can be checked before any work; return the hand."""
    require_name(arguments.name, "--name")
    require_folder(arguments.out)
    target = arguments.out / f"{arguments.name}.yaml"
    read = [vars(arguments).get(name) for name in _READ]
    read = [os.path.realpath(source) for source in read if source is not None]
    for file in (target, target.with_suffix(".ply")):
        if os.path.realpath(file) in read:
            mend = "Nothing was changed; give another --name or --out."
            raise OutputError(file, "it is what is read", mend)
    if target.exists() and not arguments.force:
        raise OutputError(target, "it exists; --force replaces it")
    hands = hands_of(arguments)
    name = site_of(arguments).gripper or "robotiq_3f"
    if name not in hands:
        raise UnknownNameError("--gripper", name, hands, mend=FURTHER_HANDS)
    hand = hands[name]
    if arguments.preshape is not None:
        hand.preshape(arguments.preshape)
    return hand


def _preshapes(arguments: argparse.Namespace, gripper: GripperModel) -> list[str]:
    return [arguments.preshape] if arguments.preshape else list(gripper.preshapes)


def _joints(text: str) -> dict[str, float]:
    """Read ``name=value,name=value``."""
    pairs = []
    for word in text.split(","):
        name, _, value = word.partition("=")
        try:
            pairs.append((name.strip(), float(value)))
        except ValueError as error:
            raise ConfigError(
                "--joints", got=repr(word), expected="NAME=VALUE,NAME=VALUE [rad]"
            ) from error
    return joints_of(pairs)


def _finish(
    arguments: argparse.Namespace,
    definition: PrototypeDefinition,
    findings: Sequence[Finding | str],
    proposals: Sequence[HandPose] = (),
) -> int:
    """Write a prototype, and say what it is.

    If `check` finds something, the status is 1 and nothing is written, unless forced.
    """
    files: Sequence[Path] = ()
    if arguments.force or not findings:
        files = write_new_prototype(
            definition, arguments.out / f"{definition.name}.yaml", force=arguments.force
        )
    hands = hands_of(arguments)
    own = PrototypeLibrary.build([definition], hands)[definition.name]
    twins = _twins(own, arguments.out, hands) if files else []
    if arguments.json:
        facts = {
            "wrote": [str(file) for file in files],
            "preshape": definition.preshape,
            "width": definition.width,
            "opening": definition.opening,
            "points": len(own.points),
            "findings": [str(finding) for finding in findings],
            "duplicates": twins,
            "proposals": [_proposal(pose) for pose in proposals],
        }
        print(json.dumps(facts, indent=1))
        return 1 if findings else 0
    if proposals:
        header = ["choice", "clearance [mm]", "width [mm]", "preshape", "way"]
        rows = [
            [
                str(rank),
                f"{1e3 * pose.clearance:.0f}",
                f"{1e3 * pose.width:.0f}",
                pose.preshape,
                pose.way + "".join(f"; {finding}" for finding in pose.findings),
            ]
            for rank, pose in enumerate(proposals, start=1)
        ]
        print(columns(header, rows))
        print(f"\ntook choice {arguments.choice}")
    opening, width = 1e3 * definition.opening, 1e3 * definition.width
    print(
        f"{definition.name}: {definition.gripper} {definition.preshape}, opens "
        f"{opening:.0f} mm, closes to {width:.0f} mm, {len(own.points)} points"
    )
    for line in (*findings, *twins):
        print(f"{definition.name}: {line}")
    if files:
        print("wrote " + ", ".join(str(file) for file in files))
    else:
        print("wrote nothing; --force writes it all the same")
    return 1 if findings else 0


def _twins(
    own: GraspPrototype, folder: Path, hands: Mapping[str, GripperModel]
) -> list[str]:
    """Say which prototypes beside a new one it is like."""
    try:
        library = PrototypeLibrary.load(folder, grippers=hands)
    except DebrisGraspError as error:
        print(f"note: compared with none beside it: {error}", file=sys.stderr)
        return []
    return [str(pair) for pair in duplicates([own], library)]


def _proposal(pose: HandPose) -> dict[str, Any]:
    return {
        "pose": pose.T_surface_hand.matrix.round(6).tolist(),
        "preshape": pose.preshape,
        "width": round(pose.width, 5),
        "clearance": round(pose.clearance, 5),
        "way": pose.way,
        "findings": list(pose.findings),
    }
