"""What would have to change for the poses that were ruled out: tried, not guessed.

Every line of advice is a counterfactual. The poses that were ruled out for a reason are
looked at again under one changed condition: the base elsewhere, the hand opened wider,
a neighbour gone, a lighter object, unseen space ignored. What then passes all tests is
counted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, Rng
from debrisgrasp._words import arm_called, in_kilograms
from debrisgrasp.geometry import SE3, Bounds
from debrisgrasp.prototypes import GraspPrototype, GripperModel, PrototypeLibrary

from .config import PlannerConfig
from .hands import PackedHands
from .inspection import Inspector
from .ledger import Rejections
from .placement import MOVES, is_blocked, move_words, placed
from .reach import Arm, Distance
from .scene import GraspScene
from .similarity import ShapeSimilarity

__all__ = ["Advice", "Advisor", "Situation"]

_FEW = 60
"""Poses looked at again for each reason; the ledger has the most promising first."""
_PROVEN, _TRIED = 3, 24
"""Moves, and poses, that are tried on the arms after the quick bound has chosen."""
_OPENINGS = (0.02, 0.04, -0.02, -0.04)
"""Changes of the opening [m]."""
_HANDS = 3
"""Prototypes whose hand is looked at with other openings, the most frequent ones."""
_NEIGHBORS = 5
"""Neighbours that are taken away in thought, one after the other."""
_MOST = 5
"""Lines of advice."""

_REACH = ("no arm gets", "out of reach", "joint limit", "no posture", "arm hits")
_HANDS_HIT = ("finger would hit", "fingers would be stopped")
_CROWDED = (
    "would hit something",
    "approach is blocked",
    "would be stopped",
    "else too",
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Advice:
    """One change, and how many of the poses ruled out it frees."""

    kind: str
    """``base``, ``arm``, ``opening``, ``neighbour``, ``view``, or ``mass``."""
    text: str
    """In words."""
    freed: int
    """How many poses would pass."""
    of: int
    """How many were ruled out for reasons that the change is about."""
    change: Mapping[str, float] = field(default_factory=dict)
    """The change in numbers: base ``x``, ``y`` [m] and ``yaw`` [rad], ``opening`` [m]
    added, ``object`` by label, ``mass`` [kg]."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Situation:
    """One search that ended, and what it searched."""

    scene: GraspScene
    ruled_out: Rejections
    arms: Sequence[Arm]
    distance: Distance
    """Obstacles for the links of the arms, base frame."""
    owners: IntArray
    """Label of the object that each point of the scene belongs to, shape (n,)."""
    footprint: Bounds | None
    """Box around what stands still of the robot, base frame; None if its base does not
    drive, and for a floating hand."""
    least_mass: float
    """Lower bound on the mass of the object [kg]."""
    idle: Sequence[Arm] = ()
    """Arms that the robot has, but that were not to be used."""
    is_late: Callable[[], bool] = lambda: False
    """Tells when there is no time for further questions."""


class Advisor:
    """Advises on searches with one dictionary."""

    def __init__(
        self,
        library: PrototypeLibrary,
        hands: PackedHands,
        config: PlannerConfig,
    ) -> None:
        self._prototypes: Sequence[GraspPrototype] = tuple(library)
        self._grippers: Mapping[str, GripperModel] = library.grippers
        self._hands, self._config = hands, config

    def __call__(
        self, situation: Situation, similarity: ShapeSimilarity, *, rng: Rng
    ) -> tuple[Advice, ...]:
        """Find changes that free poses, those that free most first.

        Parameters
        ----------
        similarity
            S of the scene.
        """
        questions = (
            self._base(situation, similarity, rng),
            self._arm(situation, similarity, rng),
            self._opening(situation),
            self._neighbours(situation),
            self._view(situation, similarity),
            _mass(situation),
        )
        found: list[Advice] = []
        for question in questions:
            if situation.is_late():
                break
            found += question
        found.sort(key=lambda advice: -advice.freed)
        return tuple(found[:_MOST])

    def _base(
        self, situation: Situation, similarity: ShapeSimilarity, rng: Rng
    ) -> Iterator[Advice]:
        """Move the base: the poses stay, the arms come from elsewhere."""
        if not situation.arms or situation.footprint is None:
            return
        Ts, prototype = self._out_of_reach(situation, similarity)
        promising = []
        for order, move in enumerate(MOVES):
            if is_blocked(situation.footprint, situation.distance, placed(move)):
                continue
            seen_from_there = (placed(move).inverse() @ SE3(Ts)).matrix
            n = int(self._may_reach(situation, seen_from_there, prototype).sum())
            promising.append((-n, order, move))
        best: dict[tuple[float, ...], tuple[int, int]] = {}
        for bound, order, move in sorted(promising)[:_PROVEN]:
            if bound:
                n = self._n_taken(situation, placed(move), Ts, prototype, rng)
                # Of two moves along one line the better one is enough.
                line = tuple(np.sign(move))
                best[line] = min(best.get(line, (0, 0)), (-n, order))
        for n, order in sorted(best.values())[:2]:
            if n:
                x, y, turn = MOVES[order]
                yield Advice(
                    kind="base",
                    text=f"{-n} of {len(Ts)} out of the arms' reach free up if the "
                    f"base {move_words(MOVES[order])}",
                    freed=-n,
                    of=len(Ts),
                    change={"x": x, "y": y, "yaw": float(np.deg2rad(turn))},
                )

    def _arm(
        self, situation: Situation, similarity: ShapeSimilarity, rng: Rng
    ) -> Iterator[Advice]:
        """Let another arm do it, with the hand of the first if need be."""
        if not situation.arms:
            return
        Ts, prototype = self._out_of_reach(situation, similarity)
        carried = self._grippers_of(prototype)
        for arm in (*situation.arms, *situation.idle):
            is_idle = arm in situation.idle
            mine = np.flatnonzero((carried != arm.gripper) | is_idle)
            mine = mine[arm.may_reach(SE3(Ts[mine]))]
            if not len(mine):
                continue
            answer = arm.reach(SE3(Ts[mine]), situation.distance, rng=rng)
            taken = mine[answer.is_reached]
            hands = sorted(set(carried[taken]) - {arm.gripper})
            if len(taken):
                with_hand = f" with {' or '.join(hands)}" if hands else ""
                yield Advice(
                    kind="arm",
                    text=f"{len(taken)} of {len(Ts)} out of reach free up for the "
                    f"{arm_called(arm.name)}{with_hand}",
                    freed=len(taken),
                    of=len(Ts),
                )

    def _out_of_reach(
        self, situation: Situation, similarity: ShapeSimilarity
    ) -> tuple[FloatArray, IntArray]:
        """Poses that are good but for the arms, the most promising few."""
        rows = situation.ruled_out.rows_with(*_REACH)[:_FEW]
        Ts, prototype = _unique(situation.ruled_out, rows)
        # Poses that no arm could reach were never looked at closely.
        fits = self._is_free(situation.scene, self._hands, Ts, prototype)
        S, _ = similarity(Ts, prototype)
        fits &= self._config.minimum_score <= S
        return Ts[fits][:_TRIED], prototype[fits][:_TRIED]

    def _grippers_of(self, prototype: IntArray) -> np.ndarray:
        return np.array([self._prototypes[i].gripper for i in prototype], dtype=object)

    def _may_reach(
        self, situation: Situation, Ts: FloatArray, prototype: IntArray
    ) -> BoolArray:
        found, carried = np.zeros(len(Ts), dtype=bool), self._grippers_of(prototype)
        for arm in situation.arms:
            mine = np.flatnonzero(carried == arm.gripper)
            if len(mine):
                found[mine] |= arm.may_reach(SE3(Ts[mine]))
        return found

    def _n_taken(
        self,
        situation: Situation,
        T_base_placed: SE3,
        Ts: FloatArray,
        prototype: IntArray,
        rng: Rng,
    ) -> int:
        """How many poses an arm takes without collision from another place."""
        to_placed = T_base_placed.inverse()
        is_taken, carried = np.zeros(len(Ts), dtype=bool), self._grippers_of(prototype)
        for arm in situation.arms:
            mine = np.flatnonzero((carried == arm.gripper) & ~is_taken)
            mine = mine[arm.may_reach(to_placed @ SE3(Ts[mine]))]
            if len(mine):
                answer = arm.reach(
                    to_placed @ SE3(Ts[mine]),
                    lambda points: situation.distance(T_base_placed.apply(points)),
                    rng=rng,
                )
                is_taken[mine] |= answer.is_reached
        return int(is_taken.sum())

    def _opening(self, situation: Situation) -> Iterator[Advice]:
        """Open the hand more, or less."""
        Ts, prototype = _picked(situation.ruled_out, *_HANDS_HIT)
        used = np.argsort(-np.bincount(prototype, minlength=1), kind="stable")[:_HANDS]
        kept = np.isin(prototype, used)
        Ts, prototype = Ts[kept], prototype[kept]
        if not len(Ts):
            return
        used, index = np.unique(prototype, return_inverse=True)
        best: tuple[int, float, set[float]] = (0, 0.0, set())
        for change in _OPENINGS:
            hands = self._reopened(used, change)
            can = np.array([hand is not None for hand in hands])
            rows = np.flatnonzero(can[index])
            if not len(rows):
                continue
            packed = PackedHands.pack(
                PrototypeLibrary(
                    tuple(h for h in hands if h is not None), self._grippers
                ),
                approach=self._config.clearance.approach,
                tolerance=self._config.inspection.tolerance,
            )
            place = (np.cumsum(can) - 1)[index[rows]]
            free = self._is_free(situation.scene, packed, Ts[rows], place)
            openings = {
                hand.opening
                for i, hand in enumerate(hands)
                if hand is not None and (index[rows][free] == i).any()
            }
            if free.sum() > best[0]:
                best = int(free.sum()), change, openings
        freed, change, openings = best
        if freed:
            word = "wider" if change > 0 else "less wide"
            to = f" (to {1000 * min(openings):.0f} mm)" if len(openings) == 1 else ""
            yield Advice(
                kind="opening",
                text=f"{freed} of {len(Ts)} free up if the hand opens "
                f"{1000 * abs(change):.0f} mm {word}{to}",
                freed=freed,
                of=len(Ts),
                change={"opening": change},
            )

    def _reopened(self, which: IntArray, change: float) -> list[GraspPrototype | None]:
        """Prototypes with another opening; None where the hand can't."""
        found: list[GraspPrototype | None] = []
        for i in which:
            prototype = self._prototypes[i]
            hand = self._grippers[prototype.gripper]
            widest = float(hand.preshape(prototype.preshape).openings[0])
            opening = prototype.opening + change
            can = prototype.width + 0.005 <= opening <= widest
            definition = replace(prototype.definition, opening=opening)
            found.append(replace(prototype, definition=definition) if can else None)
        return found

    def _neighbours(self, situation: Situation) -> Iterator[Advice]:
        """Take a neighbour away first."""
        scene, owners = situation.scene, situation.owners
        Ts, prototype = _picked(situation.ruled_out, *_CROWDED)
        labels, counts = np.unique(
            owners[~scene.is_own & (owners > 0)], return_counts=True
        )
        labels = labels[np.argsort(-counts, kind="stable")][:_NEIGHBORS]
        for label in labels.tolist() if len(Ts) else []:
            kept = scene.is_own | (owners != label)
            without = replace(
                scene,
                cloud=scene.cloud.selected(kept),
                is_target=scene.is_target[kept],
                is_own=scene.is_own[kept],
            )
            freed = int(self._is_free(without, self._hands, Ts, prototype).sum())
            if freed:
                yield Advice(
                    kind="neighbour",
                    text=f"{freed} of {len(Ts)} free up once object {label} is gone",
                    freed=freed,
                    of=len(Ts),
                    change={"object": label},
                )

    def _view(
        self, situation: Situation, similarity: ShapeSimilarity
    ) -> Iterator[Advice]:
        """Trust what was not seen."""
        thick = situation.ruled_out.rows_with("may be thicker")
        Ts, prototype = _unique(situation.ruled_out, thick)
        poor = situation.ruled_out.rows_with("fits too poorly")
        Ts_poor, prototype_poor = _unique(situation.ruled_out, poor)
        S, _ = similarity(
            np.concatenate([Ts, Ts_poor]), np.concatenate([prototype, prototype_poor])
        )
        least = self._config.minimum_score
        freed, of = int((least <= S).sum()), len(S)
        if freed:
            yield Advice(
                kind="view",
                text=f"{freed} of {of} free up if the far side turns out as the "
                "prototype has it: look from another side, or, in Python, plan with "
                "PlannerConfig(minimum_evidence=0, "
                "clearance=ClearanceConfig(unknown_cost=0))",
                freed=freed,
                of=of,
            )

    def _is_free(
        self,
        scene: GraspScene,
        hands: PackedHands,
        Ts: FloatArray,
        prototype: IntArray,
    ) -> BoolArray:
        """Which poses pass the close look, shape (k,)."""
        free = np.ones(len(Ts), dtype=bool)
        if len(Ts):
            look = Inspector(scene, hands)(Ts, prototype)
            for applies in look.reasons(self._config.inspection).values():
                free &= ~applies
        return free


def _mass(situation: Situation) -> Iterator[Advice]:
    """Lift something lighter: loads are proportional to the mass."""
    heavy = situation.ruled_out.rows_with("too heavy")
    if not len(heavy):
        return
    over = np.sort(situation.ruled_out.amount[heavy])
    half = (len(over) + 1) // 2
    mass = situation.least_mass / float(over[half - 1])
    yield Advice(
        kind="mass",
        text=f"{half} of {len(over)} hold an object of {in_kilograms(mass)} or less; "
        f"this one weighs at least {in_kilograms(situation.least_mass)}",
        freed=half,
        of=len(over),
        change={"mass": mass},
    )


def _picked(ruled_out: Rejections, *words: str) -> tuple[FloatArray, IntArray]:
    """Return a few poses (k, 4, 4) and their prototypes (k,) by their reasons."""
    return _unique(ruled_out, ruled_out.rows_with(*words)[:_FEW])


def _unique(ruled_out: Rejections, rows: IntArray) -> tuple[FloatArray, IntArray]:
    """Leave out what several arms were asked for."""
    flat = ruled_out.Ts[rows].reshape(-1, 16)
    _, first = np.unique(flat, axis=0, return_index=True)
    rows = rows[np.sort(first)]
    return ruled_out.Ts[rows], ruled_out.prototype[rows]
