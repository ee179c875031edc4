"""A dictionary from recorded grasps: one prototype for each kind of surface that held.

What was inside the hand is compared by the distance between surfaces, grasps on like
surfaces are clustered, and each cluster that held often enough gives one prototype: the
measured surface in its middle. After the idea of R. Detry, C. H. Ek, M. Madry and
D. Kragic, "Learning a dictionary of prototypical grasp-predicting parts from grasping
experience", ICRA 2013.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import cKDTree
from scipy.spatial.distance import squareform

from debrisgrasp._arrays import FloatArray, IntArray, require_range
from debrisgrasp._checked import checked_fields
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError, UnknownNameError
from debrisgrasp.geometry import SE3
from debrisgrasp.prototypes import (
    GripperModel,
    PrototypeDefinition,
    PrototypeLibrary,
    SurfaceShape,
)
from debrisgrasp.prototypes.likeness import mean_distance, surface_points

from .experience import GraspRecord

__all__ = ["Cluster", "LearnConfig", "Learned", "learn"]

_COMPARED = 150
"""Points of a surface that are sought in another one, which keeps all of its own."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class LearnConfig:
    """When surfaces count as alike, and which kinds are kept."""

    radius: float = 0.012
    """Average distance within which surfaces are of one kind [m]; a larger one gives
    fewer prototypes. Looks at one thing, gripped a few millimetres apart, are 4 to
    8 mm apart, pipes that differ by 2 cm in diameter 14 mm."""
    least: int = 2
    """Grasps that a kind needs; fewer are chance."""
    least_rate: float = 0.3
    """Share of them that must have held."""

    def __post_init__(self) -> None:
        require_range("LearnConfig.radius [m]", self.radius, 1e-3, 0.1)
        require_range("LearnConfig.least", self.least, 1)
        require_range("LearnConfig.least_rate", self.least_rate, 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Cluster:
    """Grasps on one kind of surface."""

    gripper: str
    preshape: str
    members: IntArray
    """Places of the grasps in the records, ascending, shape (n,)."""
    held: int
    """How many of them held."""
    medoid: int
    """The held grasp whose surface is nearest to those of all others; -1 if none."""
    name: str = ""
    """Of the prototype that it gave; empty if it gave none."""

    @property
    def rate(self) -> float:
        """Share that held."""
        return self.held / len(self.members)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Learned:
    """A learned dictionary, and how it came about."""

    library: PrototypeLibrary
    """One prototype for each cluster that was kept."""
    clusters: tuple[Cluster, ...]
    """All of them, largest first."""

    @property
    def covered(self) -> float:
        """Share of the held grasps that are in a kept cluster."""
        held = sum(cluster.held for cluster in self.clusters)
        kept = sum(cluster.held for cluster in self.clusters if cluster.name)
        return kept / held if held else 0.0


def learn(
    records: Sequence[GraspRecord],
    grippers: Mapping[str, GripperModel],
    config: LearnConfig | None = None,
) -> Learned:
    """Learn a dictionary from grasps and their outcomes.

    Grasps of one hand and preshape are clustered by average linkage of
    `shape_distance`, cut at ``radius``. A kept cluster's prototype has the surface of
    its medoid, and the median width and opening of its held grasps.

    Parameters
    ----------
    records
        Held and failed grasps; without failures every kind looks good.

    Raises
    ------
    UnknownNameError
        If a record names a hand or preshape that isn't known.
    ConfigError
        If there are no records, or no kind of surface held often enough.
    """
    config = config or LearnConfig()
    if not records:
        raise ConfigError("recorded grasps", got="none", expected="at least one")
    groups: dict[tuple[str, str], list[int]] = {}
    for index, record in enumerate(records):
        if record.gripper not in grippers:
            raise UnknownNameError("gripper of a record", record.gripper, grippers)
        grippers[record.gripper].preshape(record.preshape)
        groups.setdefault((record.gripper, record.preshape), []).append(index)
    clusters = [
        cluster
        for members in groups.values()
        for cluster in _clusters(records, np.array(members), config)
    ]
    clusters.sort(key=lambda c: (-len(c.members), c.gripper, c.preshape, c.members[0]))
    kept: list[Cluster] = []
    definitions: list[PrototypeDefinition] = []
    for cluster in clusters:
        is_kept = cluster.held and len(cluster.members) >= config.least
        if is_kept and cluster.rate >= config.least_rate:
            name = f"learned_{len(definitions) + 1:02d}"
            cluster = replace(cluster, name=name)
            definitions.append(_definition(records, cluster, grippers))
        kept.append(cluster)
    if not definitions:
        best = max(clusters, key=lambda c: (c.held, c.rate))
        raise ConfigError(
            "recorded grasps",
            got=f"{len(records)} in {counted(len(clusters), 'kind')}, "
            f"at best {best.held} of {len(best.members)} held",
            expected=f"a kind of at least {config.least}, {config.least_rate:.0%} held",
            mend="Record more grasps, or widen the radius (--radius).",
        )
    library = PrototypeLibrary.build(definitions, grippers)
    return Learned(library=library, clusters=tuple(kept))


def _clusters(
    records: Sequence[GraspRecord], members: IntArray, config: LearnConfig
) -> list[Cluster]:
    """Cluster grasps of one hand and preshape."""
    distances = _distances([records[i].surface for i in members])
    labels = np.ones(1, dtype=int)
    if len(members) > 1:
        tree = linkage(squareform(distances, checks=False), method="average")
        labels = fcluster(tree, config.radius, criterion="distance")
    found = []
    for label in np.unique(labels):
        own = np.flatnonzero(labels == label)
        held = own[[records[members[i]].held for i in own]]
        medoid = -1
        if len(held):
            total = distances[np.ix_(held, own)].sum(axis=1)
            medoid = int(members[held[int(np.argmin(total))]])
        first = records[members[own[0]]]
        found.append(
            Cluster(
                gripper=first.gripper,
                preshape=first.preshape,
                members=members[own],
                held=len(held),
                medoid=medoid,
            )
        )
    return found


def _distances(surfaces: Sequence[SurfaceShape]) -> FloatArray:
    """Distances between all surfaces [m], shape (n, n); see `shape_distance`."""
    clouds = [surface_points(s.points, s.normals) for s in surfaces]
    trees = [cKDTree(cloud) for cloud in clouds]
    thinned = [cloud[:: max(1, len(cloud) // _COMPARED)] for cloud in clouds]
    one_way = np.array(
        [[mean_distance(cloud, tree) for tree in trees] for cloud in thinned]
    )
    distances: FloatArray = (one_way + one_way.T) / 2
    np.fill_diagonal(distances, 0.0)
    return distances


def _definition(
    records: Sequence[GraspRecord],
    cluster: Cluster,
    grippers: Mapping[str, GripperModel],
) -> PrototypeDefinition:
    held = [records[i] for i in cluster.members if records[i].held]
    widest = float(grippers[cluster.gripper].preshape(cluster.preshape).openings[0])
    width = float(np.median([record.width for record in held]))
    opening = float(np.median([record.opening for record in held]))
    n, rate = len(cluster.members), f"{cluster.rate:.0%}"
    return PrototypeDefinition(
        name=cluster.name,
        gripper=cluster.gripper,
        preshape=cluster.preshape,
        width=round(width, 4),
        opening=float(np.floor(1e4 * min(opening, widest)) / 1e4),
        shape=records[cluster.medoid].surface,
        T_hand_shape=SE3.identity(),
        tags=("learned",),
        description=f"learned from {n} grasps, {cluster.held} held ({rate})",
    )
