"""What a try that came to nothing tells about its object."""

from __future__ import annotations

from .context import Context
from .result import FaultFound
from .states import State

__all__ = ["remember"]


def remember(context: Context, state: State, found: FaultFound) -> None:
    """Mark the object at hand, which was tried, or to which a way was sought, in vain.

    Parameters
    ----------
    state
        In which the fault was found.
    """
    cycle, held = context.cycle, context.held
    if cycle.centroid is None:
        return
    mark = context.marks.add(
        cycle.centroid,
        found,
        context.n_changes,
        is_search=state in (State.PLAN_GRASP, State.PLAN_MOTION),
        is_same_try=cycle.is_marked,
    )
    cycle.is_marked = True
    if held is not None and held.payload.mass > 0.0:
        mark.mass = held.payload.mass
    # A grasp that held what none can carry may drag it.
    may_drag = state is State.VERIFY_HOLD and mark.is_heavy
    if cycle.motion is not None and not may_drag:
        mark.failed.append(cycle.motion.grasp)
    elif state is State.PLAN_MOTION and cycle.plan is not None:
        mark.sought(cycle.seen, cycle.plan.plan.grasps)
