r"""The formulas of inverse kinematics, recorded for one chain.

Levenberg-Marquardt makes the step

.. math:: \Delta q = J^T (J J^T + \lambda \lVert e \rVert^2 I)^{-1} e

with the columns of joints that stand at a limit and are pulled outwards set to zero.
The damping fades with the error (Sugihara 2011), so that the last steps converge
quadratically. The rotation error has the length :math:`2 \tan(\theta/2)`.

Where the first and the last joint turn, they need not take part: they can be set in
closed form once the joints between them are right, the first by the azimuth of the
target, the last by the turn that is left about its axis. Of the six equations four
remain, in the radial frame, which turns with the last joint's origin: its radius and
height, and two components of the last axis across the wanted one. A step on these costs
half of a step on all six.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np

from debrisgrasp._arrays import FloatArray, IntArray

from .ik_types import Freedom
from .program import FloatCode, LaneCode, Number, Program, Value
from .serial import Lanes, SerialForm
from .walk import Vector, Walk, cross, dot, minus, mixed, plus, solved, triples, turned

__all__ = ["AxisGoals", "ChainFormulas"]

_LEAST_RADIUS = 0.02
"""Radius [m] below which the azimuth's rate is held, since it tends to infinity."""
_LEAST_DAMPING = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class AxisGoals:
    """What the joints between first and last have to reach, for many targets.

    All in the radial frame of the target: turned about the first axis until the wanted
    origin of the last joint lies above the frame's x axis.
    """

    rows: Lanes
    """Radius and height of the origin [m], outward, sideways and upward component of
    the last axis; shape (5, targets)."""
    azimuth: Lanes
    """By how much the radial frame is turned [rad], shape (targets,)."""
    turn: Lanes
    """Turn of the last frame about its axis [rad], shape (targets,)."""

    @classmethod
    def from_columns(cls, columns: Lanes) -> AxisGoals:
        """Take them from rotation columns x, y, z and translation, (4, 3, targets)."""
        x, _, z, p = columns
        azimuth = np.arctan2(p[1], p[0])
        c, s = np.cos(azimuth), np.sin(azimuth)
        x_out, x_side, x_up = c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]
        out, side, up = c * z[0] + s * z[1], c * z[1] - s * z[0], z[2]
        # Counted from the frame that the shortest turn from "outwards" to the axis
        # makes of the radial frame: continuous but where the axis points inwards.
        share = x_out + (side * x_side + up * x_up) / np.maximum(1.0 + out, 1e-6)
        turn = np.arctan2(x_up - up * share, x_side - side * share)
        rows = np.array([c * p[0] + s * p[1], p[2], out, side, up])
        return cls(rows, azimuth, turn)

    def picked(self, index: IntArray) -> AxisGoals:
        """Pick some of the targets."""
        return AxisGoals(self.rows[:, index], self.azimuth[index], self.turn[index])

    @staticmethod
    def of_one(goal: Sequence[float]) -> tuple[list[float], float, float]:
        """Rows, azimuth and turn of one target of twelve numbers."""
        x, _, z, p = (goal[k : k + 3] for k in range(0, 12, 3))
        azimuth = math.atan2(p[1], p[0])
        c, s = math.cos(azimuth), math.sin(azimuth)
        out, side, up = c * z[0] + s * z[1], c * z[1] - s * z[0], z[2]
        x_out, x_side, x_up = c * x[0] + s * x[1], c * x[1] - s * x[0], x[2]
        share = x_out + (side * x_side + up * x_up) / max(1.0 + out, 1e-6)
        turn = math.atan2(x_up - up * share, x_side - side * share)
        return [c * p[0] + s * p[1], p[2], out, side, up], azimuth, turn


@dataclass(frozen=True, eq=False)
class ChainFormulas:
    """Compiled formulas of one chain, each made when it is first used.

    Those on floats take and return numbers; those on lanes, rows of them. A target is
    given by the twelve numbers of its `Goals` columns.
    """

    form: SerialForm
    lower: FloatArray
    """Limits [rad or m], shape (d,); -inf where a joint may turn freely."""
    upper: FloatArray
    freedom: Freedom = Freedom()

    def __getstate__(self) -> dict[str, object]:
        # Compiled functions stay behind; they are made anew where they are needed.
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @cached_property
    def step_of_one(self) -> FloatCode:
        """As `step_of_lanes`, on floats."""
        return self._step(self.form).for_floats()

    @cached_property
    def step_of_lanes(self) -> LaneCode:
        """One iteration with all joints.

        From d joint values, the target, the rotation weight [m] and the damping, to the
        squared weighted error [m^2] before the step and d joint values after it.
        """
        return self._step(self.form.in_single_precision()).for_lanes()

    @cached_property
    def exact_step_of_lanes(self) -> LaneCode:
        """As `step_of_lanes`, for lanes of double precision."""
        return self._step(self.form).for_lanes()

    @cached_property
    def middle_step_of_one(self) -> FloatCode:
        """As `middle_step_of_lanes`, on floats."""
        return self._middle_step(self.form).for_floats()

    @cached_property
    def middle_step_of_lanes(self) -> LaneCode:
        """One iteration with the joints between first and last.

        As `step_of_lanes`, with d - 2 joint values and the five rows of `AxisGoals`.
        """
        return self._middle_step(self.form.in_single_precision()).for_lanes()

    @cached_property
    def ends_of_one(self) -> FloatCode:
        """As `ends_of_lanes`, on floats."""
        return self._ends(self.form).for_floats()

    @cached_property
    def ends_of_lanes(self) -> LaneCode:
        """Directions of the outer joints.

        From d - 2 joint values and the target to sine and cosine of the first joint's
        angle and of the last's, times some factor.
        """
        return self._ends(self.form.in_single_precision()).for_lanes()

    @cached_property
    def proof_of_one(self) -> FloatCode:
        """As `proof_of_lanes`, on floats."""
        return self._proof(self.form).for_floats()

    @cached_property
    def proof_of_lanes(self) -> LaneCode:
        """What is left at the tip, of errors that the freedom does not forgive.

        From d joint values and the target to squared distance [m^2], and the squared
        sine and the cosine of the angle, times some factor.
        """
        return self._proof(self.form).for_lanes()

    @cached_property
    def boxed_step_of_lanes(self) -> LaneCode:
        """As `step_of_lanes`, with limits of each target's own.

        After the target come d lower and d upper limits.
        """
        return self._step(self.form.in_single_precision(), is_boxed=True).for_lanes()

    @cached_property
    def exact_boxed_step_of_lanes(self) -> LaneCode:
        """As `boxed_step_of_lanes`, for lanes of double precision."""
        return self._step(self.form, is_boxed=True).for_lanes()

    def _step(self, form: SerialForm, *, is_boxed: bool = False) -> Program:
        d = len(self.lower)
        program = Program(d + 14 + (2 * d if is_boxed else 0))
        given = program.inputs()
        q, goal = given[:d], triples(given[d : d + 12])
        weight, damping = given[-2:]
        limits = self._limits(0, d)
        if is_boxed:
            limits = list(zip(given[d + 12 : -d - 2], given[-d - 2 : -2], strict=True))
        chain = Walk(form, program, q)
        have = (chain.x, chain.y, chain.z)
        p, p_goal = chain.p, goal[3]
        if self.freedom.n_axes:
            # The tip, not the last joint, is what must come to its place.
            lever = form.T_last_tip[:3, 3].tolist()
            p = plus(p, mixed(have, lever))
            p_goal = plus(p_goal, mixed(goal[:3], lever))
        sine, cosine, across = self._turn_left(form, have, goal[:3])
        # 2 tan(angle / 2), bounded near half a turn.
        beside = program.call("maximum", 1.0 + cosine, 0.05)
        scale = program.call("divide", 2.0 * weight, beside)
        error = [*minus(p_goal, p), *(scale * entry for entry in sine)]
        columns = []
        for i in range(d):
            v, omega = chain.twist(i, p)
            turning = [dot(direction, omega) for direction in across]
            columns.append([*v, *(weight * entry for entry in turning)])
        return _iterated(program, q, limits, columns, error, damping)

    def _turn_left(
        self, form: SerialForm, have: Sequence[Vector], want: Sequence[Vector]
    ) -> tuple[Vector, Number, Sequence[Vector]]:
        """Sine vector and cosine of the turn left, and the directions it is along."""
        if self.freedom.n_axes == 3:
            return [], 1.0, []
        if self.freedom.n_axes == 1:
            # Directions of the tip frame, two across the free axis and itself.
            R = form.T_last_tip[:3, :3] @ self.freedom.frame
            first, second, axis = (mixed(have, column) for column in R.T.tolist())
            wanted = mixed(want, R[:, 2].tolist())
            sine = [-dot(second, wanted), dot(first, wanted)]
            return sine, dot(axis, wanted), [first, second]
        twice: Vector = [0.0, 0.0, 0.0]
        trace: Number = 0.0
        for a, b in zip(have, want, strict=True):
            twice, trace = plus(twice, cross(a, b)), trace + dot(a, b)
        sine = [0.5 * entry for entry in twice]
        return sine, 0.5 * trace - 0.5, np.eye(3).tolist()

    def _middle_step(self, form: SerialForm) -> Program:
        m = len(self.lower) - 2
        program = Program(m + 7)
        given = program.inputs()
        q, (radius, height, *aim), (weight, damping) = (
            given[:m],
            given[m:-2],
            given[-2:],
        )
        chain = Walk(form, program, [0.0, *q])
        x, y, z, p = chain.x, chain.y, chain.z, chain.p
        have = program.call("sqrt", dot(p[:2], p[:2]) + 1e-12)
        inverse = program.call("divide", 1.0, have)
        c, s = p[0] * inverse, p[1] * inverse
        wanted = turned(aim, c, s)
        beside = program.call("maximum", 1.0 + dot(z, wanted), 0.05)
        scale = program.call("divide", 2.0 * weight, beside)
        error = [
            radius - have,
            height - p[2],
            -(dot(y, wanted) * scale),
            dot(x, wanted) * scale,
        ]
        rate = program.call("divide", 1.0, program.call("maximum", have, _LEAST_RADIUS))
        columns = []
        for i in range(1, m + 1):
            v, omega = chain.twist(i, p)
            azimuth_rate = (c * v[1] - s * v[0]) * rate
            # Seen from the radial frame, which the joint turns as well.
            columns.append(
                [
                    c * v[0] + s * v[1],
                    v[2],
                    (dot(x, omega) - azimuth_rate * x[2]) * weight,
                    (dot(y, omega) - azimuth_rate * y[2]) * weight,
                ]
            )
        limits = self._limits(1, m + 1)
        return _iterated(program, q, limits, columns, error, damping)

    def _limits(self, first: int, end: int) -> list[tuple[Number, Number] | None]:
        """Limits of the joints from first to before end, None where there are none."""
        return [
            (float(self.lower[i]), float(self.upper[i]))
            if np.isfinite(self.upper[i] - self.lower[i])
            else None
            for i in range(first, end)
        ]

    def _ends(self, form: SerialForm) -> Program:
        m = len(self.lower) - 2
        program = Program(m + 12)
        given = program.inputs()
        x_goal, y_goal, _, p_goal = triples(given[m:])
        chain = Walk(form, program, [0.0, *given[:m]])
        sine = chain.p[0] * p_goal[1] - chain.p[1] * p_goal[0]
        cosine = dot(chain.p[:2], p_goal[:2])
        length = program.call("sqrt", sine * sine + cosine * cosine + 1e-24)
        c = program.call("divide", cosine, length)
        s = program.call("divide", sine, length)
        x_goal, y_goal = turned(x_goal, c, -s), turned(y_goal, c, -s)
        program.outputs = [
            sine,
            cosine,
            dot(x_goal, chain.y) - dot(y_goal, chain.x),
            dot(x_goal, chain.x) + dot(y_goal, chain.y),
        ]
        return program

    def _proof(self, form: SerialForm) -> Program:
        d = len(self.lower)
        program = Program(d + 12)
        given = program.inputs()
        goal = triples(given[d:])
        chain = Walk(form, program, given[:d])
        have = (chain.x, chain.y, chain.z)
        lever = form.T_last_tip[:3, 3].tolist()
        gap = [minus(want, reached) for want, reached in zip(goal, have, strict=False)]
        offset = plus(minus(goal[3], chain.p), mixed(gap, lever))
        sine, cosine, _ = self._turn_left(form, have, goal[:3])
        program.outputs = [dot(offset, offset), dot(sine, sine), cosine]
        return program


def _iterated(
    program: Program,
    q: Sequence[Value],
    limits: Sequence[tuple[Number, Number] | None],
    columns: Sequence[Vector],
    error: Vector,
    damping: Number,
) -> Program:
    """Finish an iteration: hold joints at their limits, solve, and step within them."""
    free_columns: list[Vector] = []
    for value, column, ends in zip(q, columns, limits, strict=True):
        if ends is None:
            free_columns.append(column)
        else:
            is_free = program.call("is_free", value, *ends, dot(column, error))
            free_columns.append([is_free * entry for entry in column])
    size = dot(error, error)
    y = solved(program, free_columns, size * damping + _LEAST_DAMPING, error)
    after: list[Number] = []
    for value, column, ends in zip(q, free_columns, limits, strict=True):
        moved = value + dot(column, y)
        if ends is not None:
            moved = program.call("maximum", moved, ends[0])
            moved = program.call("minimum", moved, ends[1])
        after.append(moved)
    program.outputs = [size, *after]
    return program
