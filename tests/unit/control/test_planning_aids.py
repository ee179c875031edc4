"""Which way to pull, what a compliance means, and where contact begins to swing."""

from __future__ import annotations

import numpy as np
import pytest

from debrisgrasp.control import (
    ArmResponse,
    Compliance,
    Contact,
    ContactGuard,
    PullConfig,
    StabilityBound,
    TaskFrame,
    WrenchFilter,
    choose_pull,
    press,
    preview,
)
from debrisgrasp.errors import ConfigError, InputError, ShapeError
from debrisgrasp.geometry import SE3

from .rigs import CHAIN, LIMITS, READY, rpy

T = CHAIN.fk(READY)


def block(center, size, n=1500, seed=0) -> np.ndarray:
    """Points all through a box."""
    rng = np.random.default_rng(seed)
    return np.array(center) + rng.uniform(-0.5, 0.5, (n, 3)) * size


OBJECT = block((1.0, 0.0, 0.1), (0.3, 0.1, 0.1))
FREE = np.zeros((0, 3))


def test_a_free_object_is_pulled_the_default_way():
    choice = choose_pull(OBJECT, FREE)
    expected = np.array([-1.0, 0.0, 0.8]) / np.hypot(1.0, 0.8)
    np.testing.assert_allclose(choice.direction, expected)
    assert choice.overlap == 0.0


def test_a_lid_on_top_and_a_wall_in_front_send_the_pull_sideways():
    lid = block((1.0, 0.0, 0.2), (0.4, 0.12, 0.05), seed=1)
    wall = block((0.8, 0.0, 0.15), (0.05, 0.12, 0.3), seed=2)
    back = block((1.25, 0.0, 0.15), (0.05, 0.12, 0.3), seed=3)
    choice = choose_pull(OBJECT, np.concatenate([lid, wall, back]))
    assert abs(choice.direction[1]) > 0.7
    assert choice.overlap < 0.5 * choice.overlaps[0]
    assert "the default" in choice.reason


def test_a_lid_makes_the_pull_flat():
    lid = block((1.0, 0.0, 0.2), (0.4, 0.2, 0.05), seed=1)
    choice = choose_pull(OBJECT, lid)
    assert choice.direction[2] < 0.25
    assert choice.direction[0] < -0.7


def test_what_lies_behind_is_not_in_the_way():
    behind = block((1.3, 0.0, 0.1), (0.1, 0.1, 0.1))
    assert choose_pull(OBJECT, behind).overlap == 0.0


def test_turning_the_scene_turns_the_pull():
    lid = block((1.0, 0.1, 0.2), (0.4, 0.1, 0.05), seed=1)
    ways = np.array([[-1.0, 0, 0.5], [0, -1, 0.2], [0, 1, 0.2], [0, 0, 1]])
    R = rpy(0.0, 0.0, 0.9)
    here = choose_pull(OBJECT, lid, candidates=ways)
    there = choose_pull(OBJECT @ R.T, lid @ R.T, candidates=ways @ R.T)
    np.testing.assert_allclose(there.direction, R @ here.direction, atol=1e-9)


def test_pulls_are_checked():
    with pytest.raises(InputError, match="points of the object"):
        choose_pull(FREE, OBJECT)
    with pytest.raises(InputError, match="NaN"):
        choose_pull(OBJECT, np.full((3, 3), np.nan))
    with pytest.raises(InputError, match="candidates"):
        choose_pull(OBJECT, FREE, candidates=[[0.0, 0, 0]])
    with pytest.raises(InputError, match="candidates"):
        choose_pull(OBJECT, FREE, candidates=[[np.inf, 0, 0]])
    with pytest.raises(InputError, match="default pull"):
        choose_pull(OBJECT, FREE, PullConfig(along_road=(0, 0, 0), rise=0.0))
    with pytest.raises(ConfigError):
        PullConfig(distance=-1.0)


@pytest.mark.parametrize("scales", [(1.0, 1000.0), (1000.0, 1.0), (1000.0, 1000.0)])
def test_a_pull_in_millimetres_is_refused(scales):
    """No neighbour is in the way of what is a kilometre off."""
    lid = block((1.0, 0.0, 0.2), (0.3, 0.3, 0.05), seed=1)
    with pytest.raises(ConfigError, match=r"points of the .*millimetres"):
        choose_pull(scales[0] * OBJECT, scales[1] * lid)


def test_a_few_neighbours_far_off_are_in_nobodys_way():
    far = np.array([[50.0, 0.0, 0.0], [1.3, 0.0, 0.1]])
    assert choose_pull(OBJECT, far).overlap == 0.0


def test_a_pull_is_of_one_object():
    with pytest.raises(ShapeError, match="points of the object"):
        choose_pull(np.stack([OBJECT, OBJECT]), FREE)
    with pytest.raises(ShapeError, match="candidates"):
        choose_pull(OBJECT, FREE, candidates=np.ones((2, 2, 3)))


BOUND = StabilityBound(ArmResponse(frequency=8.0, damping=0.7, delay=2), WrenchFilter())


def test_preview_says_what_a_push_does():
    shown = preview(
        Compliance.diagonal(4.08e-4, 0.014),
        T,
        bound=BOUND,
        contact=Contact(stiffness=1e3),
    )
    assert "30 N along x moves the hand 12 mm." in shown.lines
    assert "5 N m about z turns it 4 degrees." in shown.lines
    assert "95 % after 1.2 s" in shown.text
    assert "up to 20,400 N/m it stays calm" in shown.text
    assert not shown.verdict.refusals


def test_preview_names_a_distant_pivot_and_the_clamp():
    frame = TaskFrame.about_line(T.p + np.array([0.5, 0, 0]), [0, 1, 0])
    shown = preview(
        Compliance.diagonal(0.0, [0.1, 0, 0], frame=frame),
        T,
        bound=BOUND,
        contact=Contact(stiffness=1e4),
    )
    assert "pivot 500 mm away" in shown.lines[0]
    assert "x (0, 1, 0)" in shown.lines[0]
    assert "100 mm" in shown.text
    assert "(as far as it may)" in shown.text
    assert "is refused" in shown.text
    assert "moves nothing" in shown.text


def test_preview_of_a_rigid_hand():
    shown = preview(Compliance.diagonal(0.0, 0.0), T, bound=BOUND)
    assert "It is rigid" in shown.text


@pytest.mark.parametrize(
    "tensor",
    [
        np.diag([1e-4] * 5 + [-1e-4]),
        np.triu(np.full((6, 6), 1e-4)),
        np.full((6, 6), np.nan),
    ],
)
def test_a_tensor_that_pushes_back_is_refused(tensor):
    with pytest.raises((ConfigError, InputError), match="compliance tensor"):
        Compliance(tensor)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"mode": "se3"}, "mode: got 'se3' .*expected a DeflectionMode"),
        ({"frame": np.eye(4)}, "frame: got ndarray, expected a TaskFrame"),
        ({"translation": [1e-4, 2e-4]}, r"translation.*\(2,\).*one number or three"),
        ({"rotation": np.full((3, 1), 1e-3)}, r"rotation.*\(3, 1\)"),
        ({"rotation": "soft"}, "rotation of a compliance: got str"),
    ],
)
def test_a_compliance_of_other_things_is_refused(given, words):
    """A mode in words was taken for the other one."""
    with pytest.raises(InputError, match=words):
        Compliance.diagonal(**{"translation": 1e-4, "rotation": 1e-3, **given})


def test_a_compliance_has_one_tensor():
    with pytest.raises(ShapeError, match=r"got \(2, 6, 6\)"):
        Compliance(np.zeros((2, 6, 6)))


@pytest.mark.parametrize("direction", [[0, 0, 0], [0, 0, 0, 1], "up"])
def test_a_line_needs_a_direction(direction):
    with pytest.raises(InputError, match="direction"):
        TaskFrame.about_line([0, 0, 0], direction)


def test_hand_and_base_frames_agree_where_they_coincide():
    T_ee_task = SE3.from_parts(rpy(0.3, 0.4, -0.2), [0.1, 0.2, 0.3])
    tensor = np.diag([1e-3, 2e-3, 5e-4, 0.01, 0.02, 0.005])
    wrench = np.array([10.0, -5, 3, 1, 0.5, -0.2])
    on_hand = Compliance(tensor, TaskFrame.on_hand(T_ee_task)).twist(wrench, T)
    in_base = Compliance(tensor, TaskFrame.fixed_in_base(T @ T_ee_task))
    np.testing.assert_allclose(on_hand, in_base.twist(wrench, T), atol=1e-12)


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5])
@pytest.mark.parametrize(
    ("a", "frequency", "damping", "delay"),
    [(0.01, 8, 0.7, 2), (0.01, 4, 0.5, 5), (0.2, 8, 0.7, 2)],
)
def test_the_bound_is_calm_and_the_limit_not_far(
    stiffness, a, frequency, damping, delay
):
    arm = ArmResponse(frequency=frequency, damping=damping, delay=delay)
    smoothing = WrenchFilter(tau=float(-0.004 / np.log(1 - a)))
    bound = StabilityBound(arm, smoothing)
    assert press(bound.gain_safe / stiffness, stiffness, arm, smoothing).is_calm
    over = 2.5 * bound.gain_safe / stiffness
    assert not press(over, stiffness, arm, smoothing).is_calm


@pytest.mark.parametrize(
    "wrong",
    [
        {"compliance": float("nan")},
        {"stiffness": -1e4},
        {"stiffness": 0.0},
        {"speed": 0.0},
        {"depth": 10.0},
        {"duration": 0.0},
    ],
)
def test_a_press_that_none_can_make_is_refused(wrong):
    usual = {"compliance": 1e-5, "stiffness": 1e4}
    with pytest.raises(ConfigError, match=next(iter(wrong))):
        press(arm=ArmResponse(), smoothing=WrenchFilter(), **{**usual, **wrong})


def test_a_press_that_never_touches_is_not_calm():
    late = ArmResponse(delay=20)
    assert not press(1e-5, 1e4, late, WrenchFilter(), duration=0.05).is_calm


@pytest.mark.parametrize("speed", [float("nan"), -0.01])
def test_a_guarded_approach_has_a_speed(speed):
    with pytest.raises(ConfigError, match="guarded approach"):
        ContactGuard().require_speed(speed, LIMITS)


@pytest.mark.parametrize("share", [1.0, 2.0, -0.5, np.nan, "a"])
def test_a_filter_never_lets_all_of_a_step_pass(share):
    with pytest.raises(ConfigError, match="share of a step"):
        WrenchFilter().settling_time(share)
