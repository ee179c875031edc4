"""Search the modes of Q-hat by annealing, then rank them by reachability (Eq. 2-4)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

from debrisgrasp._arrays import FloatArray, Rng
from debrisgrasp._memo import Memo
from debrisgrasp.prototypes import PrototypeLibrary

from .advice import Advice, Advisor, Situation
from .config import PlannerConfig
from .ledger import Ledger
from .load import LoadModel
from .mass import ObjectMass, likely_objects
from .plan import Grasp
from .ranking import Ranking
from .reach import Arm, Distance
from .scene import GraspScene
from .scene_search import SceneSearch, Watch
from .search import GraspSearch
from .search_result import SearchResult
from .states import Modes

__all__ = ["GraspPlanner"]


class GraspPlanner:
    """Plans with one dictionary of prototypes and the hands that carry them."""

    def __init__(self, library: PrototypeLibrary, config: PlannerConfig) -> None:
        self.prototypes = tuple(library)
        self._search = GraspSearch(library, config)
        self._advisor = Advisor(library, self._search.tools.hands, config)
        self._ranking = Ranking(library, self._search, config)
        self._config = config
        self._likely: Memo[GraspScene, tuple[ObjectMass, ...]] = Memo()

    def plan(
        self,
        scene: GraspScene,
        arms: Sequence[Arm],
        distance: Distance,
        *,
        rng: Rng,
        watch: Watch,
        mass: float | None = None,
        beyond: float = 0.0,
    ) -> SearchResult:
        """Search the scene, and search on where what comes of that is doubtful.

        The parameters are those of `first_look`.
        """
        found = self.first_look(
            scene, arms, distance, rng=rng, watch=watch, mass=mass, beyond=beyond
        )
        if found.further is None or found.promise < beyond or watch.is_late():
            return found
        return found.further(beyond)

    def first_look(
        self,
        scene: GraspScene,
        arms: Sequence[Arm],
        distance: Distance,
        *,
        rng: Rng,
        watch: Watch,
        mass: float | None = None,
        beyond: float = 0.0,
    ) -> SearchResult:
        """Search the scene as long as most objects need.

        Parameters
        ----------
        scene
            What to grip, and what is around it.
        arms
            Which arms may take a grasp; none plans for a floating hand (R = 1).
        distance
            Obstacles for the links of the arms, in the base frame.
        rng
            The same generator state gives the same result.
        watch
            Told of the progress, and asked whether the search has to end early.
        mass
            What the object weighs [kg], if that is known.
        beyond
            Where no grasp scores more than this, none is of use.
        """
        if not len(scene.target):
            return SearchResult((), {"the object's surface has no normals": 1})
        search_rng, *rngs = rng.spawn(4)
        model = LoadModel(self._weighed(scene, mass), self._config.load)
        search = self._search.of(scene, model, arms, watch, rng=search_rng)

        def rank(found: Modes, ledger: Ledger) -> SearchResult:
            with watch.stage("reachability"):
                return self._ranking(
                    found, scene, model, arms, distance, ledger, rngs=rngs
                )

        return _looked(search, search.first, rank, beyond)

    def advise(self, situation: Situation, *, rng: Rng) -> tuple[Advice, ...]:
        """Find what would have to change for the poses that a search ruled out."""
        similarity = self._search.similarity(situation.scene)
        return self._advisor(situation, similarity, rng=rng)

    def _weighed(self, scene: GraspScene, mass: float | None) -> tuple[ObjectMass, ...]:
        """Estimate what the object may weigh, and where its middle may be."""
        config, kept = self._config, self._likely.get(scene)
        if kept is None or mass is not None:
            kept = likely_objects(
                scene.surface,
                scene.cloud.viewpoint,
                config.load,
                spacing=config.scene.spacing,
                mass=mass,
            )
            if mass is None:
                self._likely[scene] = kept
        return kept

    def retreats(
        self,
        scene: GraspScene,
        grasps: Sequence[Grasp],
        directions: FloatArray,
        distance: float,
    ) -> FloatArray:
        """How far each hand gets along directions before it touches a neighbour.

        Parameters
        ----------
        directions
            Unit vectors in base, shape (d, 3).
        distance
            How far to look [m].

        Returns
        -------
        FloatArray
            [m], shape (k, d) for k grasps.
        """
        Ts, which = self._ranking.placed(grasps)
        return self._search.ways(scene).retreats(Ts, which, directions, distance)


def _looked(
    search: SceneSearch,
    sought: Callable[[float, Ledger], Modes],
    rank: Callable[[Modes, Ledger], SearchResult],
    beyond: float,
) -> SearchResult:
    """Rank what a search finds; with how it goes on, unless it is over."""
    ledger = Ledger()
    found = sought(beyond, ledger)
    if not (found.score > beyond).any():
        found = Modes.none()
    result = rank(found, ledger)
    if search.is_over:
        return result
    further = partial(_looked, search, search.further, rank)
    return replace(result, promise=search.promise, further=further)
