"""Each fault of the table strikes a whole task, and is noticed under its own name."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import FaultClass
from debrisgrasp.executive import RunEnd, TaskSettings
from debrisgrasp.executive.simulated import injections_of
from debrisgrasp.geometry import SE3, Bounds, Box, so3
from debrisgrasp.pipeline import Pipeline
from debrisgrasp.robot import INJECTABLE, Injection
from debrisgrasp.worlds import Body, World
from tests.tasks import run_struck, trust_the_camera

STOP = ("stop", RunEnd.STOPPED)
ABORT = ("abort", RunEnd.ABORTED)
RETRY, NEXT = ("retry", RunEnd.INTERRUPTED), ("next", RunEnd.INTERRUPTED)
HOLD, SKIP = ("hold", RunEnd.INTERRUPTED), ("skip", RunEnd.INTERRUPTED)
TABLE = {
    "wrench_nan": ("driver", STOP),
    "wrench_frozen": ("driver", STOP),
    "wrench_sign": ("driver", ABORT),
    "bias_drift": ("safety", RETRY),
    "bias_jump": ("mechanical", RETRY),
    "sensor_saturated": ("safety", STOP),
    "baseline_contact": ("safety", RETRY),
    "ratchet": ("safety", STOP),
    "clock_disorder": ("driver", STOP),
    "joint_stuck": ("mechanical", STOP),
    "encoder_jump": ("mechanical", STOP),
    "connection_lost": ("driver", RETRY),
    "controller_refuses": ("driver", RETRY),
    "limit_mismatch": ("operator_parameters", ABORT),
    "start_outside_limits": ("planning", RETRY),
    "gripper_uninitialised": ("operator_gripper_init", RETRY),
    "finger_jammed": ("mechanical", RETRY),
    "calibration_off": ("calibration", ABORT),
    "calibration_poses": ("calibration", ABORT),
    "fiducial_lost": ("calibration", RETRY),
    "empty_cloud": ("perception", RETRY),
    "depth_dropout": ("perception", RETRY),
    "stale_cloud": ("driver", RETRY),
    "plane_eats_pile": ("operator_parameters", SKIP),
    "no_grasp": ("planning", NEXT),
    "unreachable": ("planning", NEXT),
    "plan_collision": ("planning", NEXT),
    "early_contact": ("bad_grasp", RETRY),
    "empty_grip": ("bad_grasp", NEXT),
    "slip": ("bad_grasp", RETRY),
    "too_heavy": ("safety", NEXT),
    "object_swings": ("safety", HOLD),
    "not_released": ("mechanical", RETRY),
    "oscillation": ("safety", RETRY),
}
"""Class, first answer, and end of a run that a person ends where it would recover."""
LATCHED = ("bias_jump", "too_heavy", "object_swings", "oscillation")
"""Also stopped at once, though the answer ends the stop of the arm again."""
EARLIER = dict.fromkeys(
    (
        "wrench_nan",
        "wrench_frozen",
        "sensor_saturated",
        "clock_disorder",
        "encoder_jump",
    ),
    "pregrasp",
)
"""Those that any motion shows strike in the first one in the pile: that is soon."""
SEVERITY = {"unreachable": 0.95, "plan_collision": 0.3}
BARRED = Bounds(np.array([0.6, -0.5, 0.01]), np.array([1.4, 0.4, 0.25]))


@pytest.fixture(scope="module")
def pipeline():
    """Plans for the arm that the task uses."""
    return Pipeline(arm="right")


def task(fault=""):
    """What is to be done; as little as shows the fault."""
    changes = {"arms": ("right",)}
    if fault == "plan_collision":  # bars are objects, too: not they are to be taken
        changes = {"region": BARRED}
    elif fault == "plane_eats_pile":
        changes["max_dropout"] = 0.98  # or that would be noticed first
    return TaskSettings(
        drive_over=0.02, max_removals=1, max_attempts=2, pushes=0, repositions=0,
        **changes,
    )  # fmt: skip


def rubble():
    """A field of blocks that hides the ground."""
    block = Box(np.full(3, 0.12))
    bodies = []
    for i, (x, y) in enumerate(np.ndindex(7, 7)):
        R = so3.from_rpy(np.array([0.5 * np.sin(7 * i), 0.6 * np.cos(5 * i), i]))
        T = SE3.from_parts(R, [0.5 + 0.22 * x, 0.22 * y - 0.7, 0.05])
        bodies.append(Body(f"block_{i}", "block", (block,), 9.0, T_base_body=T))
    return World(tuple(bodies))


def test_the_table_has_all_faults_that_can_be_injected():
    assert list(TABLE) == list(INJECTABLE)


@pytest.mark.parametrize("fault", TABLE)
def test_a_fault_is_noticed_under_its_own_name(pipeline, beam, monkeypatch, fault):
    outcome, (action, end) = TABLE[fault]
    if INJECTABLE[fault].state not in ("self_test", "calib_check"):
        trust_the_camera(monkeypatch)
    world = rubble() if fault == "plane_eats_pile" else beam
    arm = "right" if fault == "gripper_uninitialised" else None
    injection = Injection(
        fault=fault, state=EARLIER.get(fault), severity=SEVERITY.get(fault), arm=arm
    )
    done = run_struck(pipeline, world, task(fault), [injection], ends_after=(fault,))
    assert done.happened == (fault,)
    own = [event for event in done.result.faults if event.fault == fault]
    assert own[0].action.value == action
    assert done.result.end is end
    assert done.result.fault_class is FaultClass(outcome)
    assert_within_limits(done)
    assert done.was_stopped or fault not in LATCHED


@pytest.mark.parametrize(
    ("faults", "expected", "end"),
    [
        (
            ("slip@lift", "wrench_nan@recover"),
            [("lift", "slip", "retry"), ("recover", "wrench_nan", "stop")],
            RunEnd.STOPPED,
        ),
        (
            ("finger_jammed@close", "connection_lost@recover"),
            [
                ("close", "finger_jammed", "retry"),
                ("recover", "connection_lost", "retry"),
            ],
            RunEnd.INTERRUPTED,
        ),
        (
            ("depth_dropout@capture", "early_contact@approach"),
            [
                ("capture", "depth_dropout", "retry"),
                ("approach", "early_contact", "retry"),
            ],
            RunEnd.INTERRUPTED,
        ),
    ],
    ids=lambda value: "+".join(value) if isinstance(value, tuple) else "",
)
def test_of_two_faults_each_is_answered(pipeline, beam, faults, expected, end):
    # After the last one the answer is carried out, and a person ends the run then.
    until = (expected[-1][1],)
    done = run_struck(pipeline, beam, task(), injections_of(faults), ends_after=until)
    found = [(e.state.value, e.fault, e.action.value) for e in done.result.faults]
    assert found == expected
    assert done.result.end is end
    assert_within_limits(done)


def assert_within_limits(done):
    """No command and no wrench was beyond its limit, and a stop is for good."""
    truth = done.fake.truth()
    assert truth.violations == ()
    assert truth.overloads == ()
    if done.result.end in (RunEnd.STOPPED, RunEnd.INTERRUPTED):
        assert all(arm.is_stopped for arm in done.fake.arms.values())
        assert done.fake.base.is_still
