"""The search of OMPL in place of ours, behind the same call.

Needs the extra ``motion``. Edges are tested by the same arrays of spheres.
"""

from __future__ import annotations

import importlib
from typing import Any

import numpy as np

from debrisgrasp._arrays import FloatArray, Rng
from debrisgrasp.errors import MissingExtraError

from .rrt import PathQuery, PathSearch

__all__ = ["connect_by_ompl"]

_MOTIONS = 32
"""Tested in one round of ours: sixteen branches, and their ways to the other tree."""


def connect_by_ompl(query: PathQuery, *, rng: Rng) -> PathSearch:
    """Search by OMPL's RRT-Connect.

    OMPL draws from a generator of its own for the whole process; it is seeded from
    ``rng``, which OMPL heeds only before its first use. So a path may differ from run
    to run where ours does not. A round is 32 motions tested.

    Raises
    ------
    MissingExtraError
        If OMPL is not installed.
    """
    try:
        base: Any = importlib.import_module("ompl.base")
        geometric: Any = importlib.import_module("ompl.geometric")
        util: Any = importlib.import_module("ompl.util")
    except ImportError as error:
        raise MissingExtraError("the OMPL engine", "motion") from error
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(int(rng.integers(1, 2**31)))
    d = len(query.q_start)
    space = base.RealVectorStateSpace(d)
    bounds = base.RealVectorBounds(d)
    for i in range(d):
        bounds.setLow(i, float(query.lower[i]))
        bounds.setHigh(i, float(query.upper[i]))
    space.setBounds(bounds)
    info = base.SpaceInformation(space)
    tested = [0]

    def posture(state: Any) -> FloatArray:
        return np.array([state[i] for i in range(d)])

    class Edges(base.MotionValidator):  # type: ignore[misc]
        def checkMotion(self, one: Any, other: Any) -> bool:
            tested[0] += 1
            ends = posture(one)[None], posture(other)[None]
            return bool(query.edges.are_free(*ends)[0])

    def state(q: FloatArray) -> Any:
        made = info.allocState()
        for i, value in enumerate(q.tolist()):
            made[i] = value
        return made

    info.setStateValidityChecker(
        lambda s: bool(query.edges.is_free(posture(s)[None])[0])
    )
    info.setMotionValidator(Edges(info))
    info.setup()
    problem = base.ProblemDefinition(info)
    problem.addStartState(state(query.q_start))
    goals = base.GoalStates(info)
    for goal in query.q_goals:
        goals.addState(state(goal))
    problem.setGoal(goals)
    planner = geometric.RRTConnect(info)
    planner.setProblemDefinition(problem)
    planner.setup()
    most = query.max_rounds * _MOTIONS

    def is_over() -> bool:
        return tested[0] >= most or query.is_late()

    status = planner.solve(base.PlannerTerminationCondition(is_over))
    if not status or not problem.hasExactSolution():
        return PathSearch(None, -(-tested[0] // _MOTIONS), 0)
    found = problem.getSolutionPath()
    states = (found.getState(i) for i in range(found.getStateCount()))
    path = np.array([posture(each) for each in states])
    return PathSearch(path, -(-tested[0] // _MOTIONS), 0)
