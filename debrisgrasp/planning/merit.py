"""What grasps are ranked by, for many poses at once, and what rules poses out.

The search climbs on a quick stand-in for it, `GraspQuality`, and then on this itself:
what is sought is what the list is sorted by.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace

import numpy as np
from scipy.special import expit, log_expit, logit

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray

from .approach import Ways
from .borders import missing
from .clearance import HandClearance
from .contacts import PadContacts
from .inspection import Inspection, Inspector
from .ledger import Ledger
from .quality import GraspQuality, Reach
from .scene import GraspScene
from .similarity import ShapeSimilarity
from .states import Modes
from .success import success_terms
from .tools import Burden, Preference, Tools, blurred

__all__ = ["Looks", "Merit"]

_FLAWED = 5.0
"""What a pose that an inspection would rule out loses [log-odds], as does one where no
arm can give way: a search may pass through it, but mostly stays on the other side."""
_GUESS = "the object may be thicker than what was seen of it"
_WIDE = "the object is expected to be wider than the fingers open"
_SLIPS = (
    "the faces are too slanted for the fingers",
    "a finger would miss the object",
)
"""By the causes of `PadLook`."""
_POOR = "the shape fits too poorly"
_CHANCE = 3.6
"""The stand-in may be off by so much [log-odds]."""
_AMISS = 2.0
"""It promises too little by 0.7 at most; the rest is for the second best [log-odds]."""
_FAINT = 1e-3
"""S below this adds nothing to a mean, so that C is not asked."""


@dataclass(frozen=True, slots=True, eq=False)
class Looks:
    """Close looks into a scene that many searches share; they don't hold the scene."""

    ways: Ways
    inspector: Inspector
    contacts: PadContacts
    missing: float
    """See `missing` [m]."""

    @classmethod
    def into(cls, scene: GraspScene, tools: Tools) -> Looks:
        """Prepare them."""
        config = tools.config
        return cls(
            Ways(scene, tools.hands, config.approach, config.inspection),
            Inspector(scene, tools.hands),
            PadContacts(scene, tools.zones, config.contact),
            missing(scene),
        )


class Merit:
    """Probability that a grasp holds, in one scene.

    Parameters
    ----------
    burden
        Load over limit of poses.
    looks
        Into the same scene.
    reach
        See `Reach`.
    """

    def __init__(
        self,
        scene: GraspScene,
        tools: Tools,
        burden: Burden,
        looks: Looks,
        reach: Reach,
    ) -> None:
        config = tools.config
        self._tools, self._config = tools, config
        self._burden, self._reach = burden, reach
        self.fine = ShapeSimilarity(scene, tools.fine, config.similarity)
        self.clearance = HandClearance(scene, tools.hands, config.clearance)
        self.contacts = looks.contacts
        self._coarse = ShapeSimilarity(scene, tools.coarse, config.similarity)
        self._inspector, self._ways = looks.inspector, looks.ways
        self._missing = np.full(1, looks.missing)
        self._few_offsets = config.uncertainty.few_offsets().matrix
        self._offsets = config.uncertainty.offsets().matrix
        self.preference = Preference.of(burden, tools)
        wide, soft = blurred(config)
        self.quick = GraspQuality(
            ShapeSimilarity(scene, tools.coarse, wide),
            HandClearance(scene, tools.hands, soft),
            reach,
            self.preference,
        )
        """A stand-in that takes one look at each pose."""

    @property
    def worth(self) -> float:
        """Share of the best quick value below which a pose has little chance."""
        return float(np.exp(-_CHANCE / self.preference.steepness))

    def least(self, beyond: float) -> float:
        """Quick value below which a pose has little chance to hold likelier than that.

        Above 1 where none in this scene has.
        """
        if beyond <= 0.0:
            return 0.0
        zero = np.zeros(1)
        none = np.zeros(1, dtype=np.int64)
        best = float(self._odds(_Known(none, zero, none, zero, zero)).max())
        odds = float(logit(beyond)) - best - _AMISS
        return float(np.exp(odds / self.preference.steepness))

    def inspection(self, Ts_base_hand: FloatArray, prototype: IntArray) -> Inspection:
        """Close look at poses; what has another free way in isn't blocked."""
        look = self._inspector(Ts_base_hand, prototype)
        return self._ways.relieved(look, Ts_base_hand, prototype)

    def sight(
        self, Ts_base_hand: FloatArray, prototype: IntArray, is_seen: BoolArray
    ) -> tuple[FloatArray, BoolArray]:
        """How much tells that the object lies between the fingers, and no farther.

        Parameters
        ----------
        is_seen
            Whether faces were seen that both sides come to lie on, shape (k,).

        Returns
        -------
        sight, is_guess
            In [0, 1]; and whether it is short of 1 although a finger ends in space that
            was never seen; shape (k,) each.
        """
        sight = np.ones(len(prototype))
        is_blind = self.clearance.is_blind(Ts_base_hand, prototype)
        rows = np.flatnonzero(is_blind | ~is_seen)
        seen = self.fine.evidence_of_thickness(Ts_base_hand[rows], prototype[rows])
        enough = self._config.minimum_evidence
        sight[rows] = np.where(seen < enough, seen / max(enough, 1e-9), 1.0)
        return sight, is_blind & (sight < 1.0)

    def expected(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """Mean of S C over the errors of the pose, shape (k,)."""
        S = self._around(Ts_base_hand, prototype, self._offsets)
        return self._cleared(S, Ts_base_hand, prototype, self._offsets)

    def __call__(
        self, Ts_base_hand: FloatArray, prototype: IntArray, needed: FloatArray
    ) -> FloatArray:
        """Log of the probability that a grasp holds, shape (k,).

        Parameters
        ----------
        Ts_base_hand, prototype
            Poses (k, 4, 4), and what each places (k,).
        needed
            Least value that matters (k,): what is provably below it may come out as
            minus infinity.
        """
        few = self._few_offsets
        reach = self._reach(Ts_base_hand, prototype)
        rows = np.flatnonzero(reach)
        burden = self._burden(Ts_base_hand[rows], prototype[rows])
        known = _Known(rows, Ts_base_hand[rows], prototype[rows], *burden)
        known = replace(known, stiffness=np.where(reach[rows] < 1.0, _FLAWED, 0.0))
        # Cheapest first; what is not known yet is taken to be as good as can be.
        known = self._left(known, needed)
        S = self._around(known.Ts, known.prototype, few)
        known = self._left(replace(known, S=S, expected=S.mean(axis=1)), needed)
        pads = self.contacts.look(known.Ts, known.prototype)
        known = replace(known, contact=pads.probability, is_seen=pads.is_seen)
        known = self._left(known, needed)
        look = self._inspector(known.Ts, known.prototype)
        flaw = np.where(look.is_stuck(self._config.inspection), _FLAWED, 0.0)
        known = replace(known, margin=look.margin)
        kept = self._may_matter(known, needed, flaw)
        known, look = known[kept], look[kept]
        expected = self._cleared(known.S, known.Ts, known.prototype, few)
        known = replace(known, expected=expected)
        kept = self._may_matter(known, needed, flaw[kept])
        known = known[kept]
        look = self._ways.relieved(look[kept], known.Ts, known.prototype)
        passes, known = self._passes(look, known)
        odds = self._odds(known) - known.stiffness
        odds[~passes] -= _FLAWED
        value = np.full(len(prototype), -np.inf)
        value[known.rows] = log_expit(odds)
        return value

    def judged(
        self, Ts: FloatArray, prototype: IntArray, ledger: Ledger
    ) -> tuple[Modes, BoolArray]:
        """Look at poses with every point and the exact solids.

        Parameters
        ----------
        ledger
            Takes those that are ruled out, each for the first reason that applies.

        Returns
        -------
        modes, is_left
            What was found of each, and which are not ruled out, (k,).
        """
        config = self._config
        S, coverage = (term.astype(np.float64) for term in self.fine(Ts, prototype))
        unseen = self.clearance.unseen(Ts, prototype)
        C = 1.0 - config.clearance.unknown_cost * unseen
        pads = self.contacts.look(Ts, prototype)
        sight, is_guess = self.sight(Ts, prototype, pads.is_seen)
        look = self.inspection(Ts, prototype)
        quality, ok = S * C, np.ones(len(S), dtype=bool)
        causes: dict[str, tuple[BoolArray, FloatArray | IntArray | None]] = {
            reason: (applies, look.amount(reason))
            for reason, applies in look.reasons(config.inspection).items()
        }
        slips, weakest = pads.probability < config.contact.least, pads.causes.argmin(1)
        causes |= {_GUESS: (is_guess, None), _WIDE: (pads.is_too_wide, None)}
        causes |= {
            reason: (slips & (weakest == i), None) for i, reason in enumerate(_SLIPS)
        }
        causes[_POOR] = quality < config.minimum_score, quality
        for reason, (applies, by) in causes.items():
            ledger.add(reason, Ts, prototype, applies & ok, by)
            ok &= ~applies
        expected = np.zeros(len(S))
        expected[ok] = self.expected(Ts[ok], prototype[ok])
        known = _Known(
            np.arange(len(S)),
            Ts,
            prototype,
            *self._burden(Ts, prototype),
            expected=expected,
            contact=pads.probability,
            margin=look.margin,
            sight=sight,
            unseen=unseen,
        )
        modes = Modes(
            Ts=Ts,
            prototype=prototype,
            S=S,
            C=C,
            coverage=coverage,
            expected=expected,
            contact=pads.probability,
            squeezed=pads.squeezed,
            margin=look.margin,
            sight=sight,
            unseen=unseen,
            missing=np.repeat(self._missing, len(S)),
            score=expit(self._odds(known)),
            support=np.zeros(len(S), dtype=np.int64),
            joints=np.zeros((len(S), 0)),
        )
        return modes, ok

    def aligned(self, Ts_base_hand: FloatArray, prototype: IntArray) -> FloatArray:
        """See `ShapeSimilarity.aligned`."""
        return self._coarse.aligned(Ts_base_hand, prototype)

    def _left(self, known: _Known, needed: FloatArray) -> _Known:
        """Go on with the poses that may still come up to what is needed."""
        return known[self._may_matter(known, needed)]

    def _may_matter(
        self, known: _Known, needed: FloatArray, flaw: FloatArray | float = 0.0
    ) -> BoolArray:
        """Which poses may still come up to what is needed, less some log-odds."""
        odds = self._odds(known) - known.stiffness - flaw
        return np.asarray(log_expit(odds) > needed[known.rows])

    def _odds(self, known: _Known) -> FloatArray:
        terms = success_terms(
            expected=known.expected,
            contact=known.contact,
            demand=known.demand,
            lever=known.lever,
            margin=known.margin,
            slack=self._tools.hands.slack[known.prototype],
            sight=known.sight,
            unseen=known.unseen,
            missing=self._missing,
        )
        return self._tools.success.log_odds(terms)

    def _passes(self, look: Inspection, known: _Known) -> tuple[BoolArray, _Known]:
        """Which poses nothing rules out, shape (k,), and what they see, too."""
        config = self._config
        ok = known.contact >= config.contact.least
        for applies in look.reasons(config.inspection).values():
            ok &= ~applies
        rows = np.flatnonzero(ok)
        Ts, prototype = known.Ts[rows], known.prototype[rows]
        S, _ = self.fine(Ts, prototype)
        sight, unseen = np.ones(len(ok)), np.zeros(len(ok))
        unseen[rows] = self.clearance.unseen(Ts, prototype)
        C = 1.0 - config.clearance.unknown_cost * unseen[rows]
        ok[rows] = config.minimum_score <= S * C
        sight[rows], is_guess = self.sight(Ts, prototype, known.is_seen[rows])
        ok[rows] &= ~is_guess
        return ok, replace(known, sight=sight, unseen=unseen)

    def _around(
        self, Ts: FloatArray, prototype: IntArray, offsets: FloatArray
    ) -> FloatArray:
        """S of poses around each of (k, 4, 4), shape (k, n)."""
        moved = (Ts[:, None] @ offsets).reshape(-1, 4, 4)
        S, _ = self._coarse(moved, np.repeat(prototype, len(offsets)))
        return S.reshape(len(Ts), len(offsets)).astype(np.float64)

    def _cleared(
        self, S: FloatArray, Ts: FloatArray, prototype: IntArray, offsets: FloatArray
    ) -> FloatArray:
        """Mean of S (k, n) times C over the poses around each, shape (k,)."""
        row, column = np.nonzero(S > _FAINT)
        moved, value = Ts[row] @ offsets[column], S.copy()
        clear = self.clearance(moved, prototype[row], np.zeros(len(row)))
        value[row, column] *= clear
        mean: FloatArray = value.mean(axis=1)
        return mean


@dataclass(frozen=True, slots=True, eq=False)
class _Known:
    """Poses that may still matter, and what is known of them; one row each."""

    rows: IntArray
    Ts: FloatArray
    prototype: IntArray
    demand: FloatArray
    lever: FloatArray
    S: FloatArray = field(default_factory=lambda: np.ones((1, 1)))
    expected: FloatArray = field(default_factory=lambda: np.ones(1))
    contact: FloatArray = field(default_factory=lambda: np.ones(1))
    margin: FloatArray = field(default_factory=lambda: np.ones(1))
    sight: FloatArray = field(default_factory=lambda: np.ones(1))
    unseen: FloatArray = field(default_factory=lambda: np.zeros(1))
    is_seen: BoolArray = field(default_factory=lambda: np.ones(1, dtype=bool))
    stiffness: FloatArray = field(default_factory=lambda: np.zeros(1))
    """What they lose because the arm can't give way [log-odds]."""

    def __getitem__(self, kept: BoolArray) -> _Known:
        columns = {item.name: getattr(self, item.name) for item in fields(self)}
        return _Known(
            **{
                name: column if len(column) == 1 != len(kept) else column[kept]
                for name, column in columns.items()
            }
        )
