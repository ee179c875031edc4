"""What searches share: a dictionary, its hands, and looks into scenes."""

from __future__ import annotations

from collections.abc import Sequence

from debrisgrasp._arrays import Rng
from debrisgrasp._memo import Memo
from debrisgrasp.prototypes import PrototypeLibrary

from .approach import Ways
from .config import PlannerConfig
from .load import LoadModel
from .merit import Looks
from .proposals import Anchors, GlobalMove
from .reach import Arm
from .scene import GraspScene
from .scene_search import SceneSearch, Watch
from .similarity import ShapeSimilarity
from .tools import Burden, Tools

__all__ = ["GraspSearch"]


class GraspSearch:
    """Searches with one dictionary of prototypes and the hands that carry them."""

    def __init__(self, library: PrototypeLibrary, config: PlannerConfig) -> None:
        self._anchors = Anchors.of(library.packed())
        self.tools = Tools.of(library, config)
        self._config = config
        self._looks: Memo[GraspScene, Looks] = Memo()

    def similarity(self, scene: GraspScene) -> ShapeSimilarity:
        """S of a scene, with every point that the final score uses."""
        return ShapeSimilarity(scene, self.tools.fine, self._config.similarity)

    def ways(self, scene: GraspScene) -> Ways:
        """Ways to and from grasps in a scene."""
        return self._looks_into(scene).ways

    def _looks_into(self, scene: GraspScene) -> Looks:
        """Close looks into a scene, kept as long as the scene itself."""
        kept = self._looks.get(scene)
        if kept is None:
            kept = self._looks[scene] = Looks.into(scene, self.tools)
        return kept

    def of(
        self,
        scene: GraspScene,
        load: LoadModel,
        arms: Sequence[Arm],
        watch: Watch,
        *,
        rng: Rng,
    ) -> SceneSearch:
        """Prepare to search a scene.

        Parameters
        ----------
        load
            What the object weighs.
        arms
            Poses that none of them can reach for certain are not looked at.
        """
        return SceneSearch(
            scene,
            self._looks_into(scene),
            GlobalMove(scene, self._anchors),
            Burden.on(arms, load, self.tools),
            arms,
            self.tools,
            watch,
            rng=rng,
        )
