"""Who rests on whom, the loads that are passed on, and what to take first.

A depth image shows surfaces, not forces. Whether an object bears on another is judged
from how their surfaces run where they meet, and stated as a probability. Support that
the sensor could not see is unknown, and counted as such.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import expit

from debrisgrasp._arrays import BoolArray, FloatArray, IntArray, frozen, require_range
from debrisgrasp._checked import checked, checked_fields
from debrisgrasp._physics import GRAVITY
from debrisgrasp._words import counted
from debrisgrasp.errors import ConfigError, InputError, UnknownNameError
from debrisgrasp.geometry import PointCloud

from .bearing import judged_relations
from .burden import burden_evidence, burden_features
from .contacts import Contacts
from .loads import carried_loads, removal_sequence, support_shares
from .seen import Seen
from .segmentation import Segmentation
from .surface import LabelledSurface, Shapes

__all__ = ["CLEAR", "GROUND", "SupportConfig", "SupportGraph", "support_graph"]

GROUND = 0
"""Label of the ground in relations."""

CLEAR = 0.65
"""Probability from which on a relation is spoken of as a fact: of these four in five
are true, and of objects that visibly touch nineteen in twenty."""

_GROUND_EVIDENCE = np.array([-14.7, -2.46, 4.80])
_GROUND_PRIOR = 3.13
"""What speaks for resting on the ground, a logistic model: height of the lowest part
that was seen [m], probability of another support, and their product."""
_OFF_GROUND = 0.25
"""Height from which on more makes no difference to that [m]."""
_LEAST_CONFIDENCE = 0.05
"""Relations less likely than this are left out."""
_LEANING = 0.5
"""Sine of the elevation of the face of contact below which an object leans."""


@checked_fields
@dataclass(frozen=True, slots=True, kw_only=True)
class SupportConfig:
    """How contacts are found, and what objects may weigh."""

    cell: float = 0.01
    """Edge of the cells that surfaces are thinned to [m]; larger is faster and blurs
    thin objects."""
    reach: float = 0.035
    """Largest gap between cells that may touch, without noise [m]: contacts are partly
    hidden, and what of two objects was seen may only be beside their contact."""
    noise: float = 0.0009
    """s in sigma = s z^2, the error left in the mean of a cell at distance z [1/m],
    about half that of a pixel; larger forgives larger gaps."""
    density: tuple[float, float] = (60.0, 900.0)
    """Least and greatest mass per volume that an object encloses [kg/m^3]: an empty
    bucket, and hard wood or a hollow block. Loads grow with both."""
    thickness: tuple[float, float] = (0.005, 0.05)
    """How thin an object of which only a face was seen may be, and how thick [m]. Loads
    of flat things grow with both."""
    gravity: float = GRAVITY
    """Acceleration of free fall [m/s^2]."""

    def __post_init__(self) -> None:
        require_range("cell", self.cell, 1e-3, 0.1)
        require_range("reach", self.reach, self.cell, 0.2)
        require_range("noise", self.noise, 0.0, 0.1)
        require_range("gravity", self.gravity, 1e-3, 100.0)
        for name in ("density", "thickness"):
            low, high = getattr(self, name)
            if not 0 < low <= high < np.inf:
                raise ConfigError(
                    name, got=(low, high), expected="0 < least <= greatest"
                )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SupportGraph:
    """Objects and the ground as nodes, relations of support as edges.

    Arrays of one row per object are in the order of the labels, which start at 1.
    """

    contacts: Contacts
    relations: IntArray
    """(above, below): the first label rests or leans on the second, `GROUND` included,
    shape (r, 2)."""
    confidence: FloatArray
    """Probability of each relation, in [0, 1], shape (r,)."""
    is_leaning: BoolArray
    """Whether the face of contact is steep: it leans rather than rests, shape (r,)."""
    weight: FloatArray
    """Bounds on the weight of each object [N], shape (s, 2)."""
    load: FloatArray
    """Bounds on the weight that others put on each object [N], shape (s, 2)."""
    hidden: FloatArray
    """Probability that what holds an object was not seen, shape (s,)."""
    encumbrance: FloatArray
    """Probability that something bears on each object, also where it wasn't seen to:
    what is small, low and partly hidden by others often carries them, shape (s,)."""
    occluded: FloatArray
    """Share of each object's outline at which another one is in front, shape (s,)."""
    removal_order: IntArray
    """Labels in an order in which nothing should fall, shape (s,)."""
    removal_confidence: FloatArray
    """Probability that nothing bears on each label at its turn, shape (s,)."""
    extents: FloatArray
    """Lengths of each object along its principal axes without outliers, longest first
    [m], shape (s, 3)."""

    def __repr__(self) -> str:
        order = ", ".join(map(str, self.removal_order.tolist()))
        objects = counted(len(self.hidden), "object")
        return f"<SupportGraph of {objects}, to remove in the order {order or 'none'}>"

    def resting_on(self, label: int) -> tuple[IntArray, FloatArray]:
        """Labels (m,) of what bears on an object, how likely (m,), likeliest first.

        Raises
        ------
        UnknownNameError
            If no object has that label, nor is it `GROUND`.
        """
        return self._ends(label, own=1)

    def supports_of(self, label: int) -> tuple[IntArray, FloatArray]:
        """Labels (m,) of what an object rests on, how likely (m,), likeliest first.

        Raises
        ------
        UnknownNameError
            If no object has that label, nor is it `GROUND`.
        """
        return self._ends(label, own=0)

    def _ends(self, label: int, own: int) -> tuple[IntArray, FloatArray]:
        is_count = isinstance(label, (int, np.integer))
        if not is_count or not GROUND <= label <= len(self.hidden):
            known = map(str, range(len(self.hidden) + 1))
            raise UnknownNameError("label of an object", label, known)
        index = np.flatnonzero(self.relations[:, own] == label)
        index = index[np.argsort(-self.confidence[index], kind="stable")]
        return self.relations[index, 1 - own], self.confidence[index]


@checked
def support_graph(
    segmentation: Segmentation, cloud: PointCloud, config: SupportConfig | None = None
) -> SupportGraph:
    """Judge who bears on whom.

    Parameters
    ----------
    segmentation
        Labels of the points of ``cloud``.
    cloud
        In the base frame, z up.
    config
        None takes the defaults.

    Raises
    ------
    ShapeError
        If there is not one label for each point.
    FrameMismatchError
        If the cloud is not in the base frame.

    Examples
    --------
    >>> import numpy as np
    >>> from debrisgrasp.geometry import PointCloud
    >>> from debrisgrasp.segmentation import segment_cloud
    >>> x, y = np.meshgrid(np.linspace(0, 0.2, 41), np.linspace(0, 0.1, 21))
    >>> top = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 0.05)])
    >>> up = np.broadcast_to([0.0, 0.0, 1.0], top.shape)
    >>> board = PointCloud(points=top, normals=up, viewpoint=np.array([0, 0, 1.5]))
    >>> graph = support_graph(segment_cloud(board), board)
    >>> graph.relations.tolist(), graph.load.tolist()
    ([[1, 0]], [[0.0, 0.0]])
    """
    config = config or SupportConfig()
    surface = labelled_surface(segmentation, cloud, config)
    return graph_of_surface(segmentation, cloud, surface, config)


def graph_of_surface(
    segmentation: Segmentation,
    cloud: PointCloud,
    surface: LabelledSurface,
    config: SupportConfig,
) -> SupportGraph:
    """Judge who bears on whom, given the thinned cloud; see `support_graph`."""
    seen = Seen.of(segmentation, cloud, surface, config.reach)
    shapes = seen.shapes
    relations, confidence = judged_relations(seen)
    encumbrance = burden_evidence().probability(
        burden_features(relations, confidence, seen)
    )
    relations, confidence, hidden = _with_ground(relations, confidence, shapes)
    places = np.concatenate([np.tile(seen.contacts.place, (2, 1)), shapes.foot[1:]])
    upright = np.tile(np.abs(seen.contacts.normal[:, 2]) < _LEANING, 2)
    is_leaning = np.append(upright, np.zeros(len(hidden), dtype=bool))
    kept = confidence >= _LEAST_CONFIDENCE
    relations, confidence = relations[kept], confidence[kept]
    order, certain = removal_sequence(relations, confidence, encumbrance)
    weight = _weights(shapes, config)
    shares = support_shares(
        relations, confidence, places[kept], shapes.middle, 0.2 * shapes.extents[:, 0]
    )
    return SupportGraph(
        contacts=seen.contacts,
        relations=frozen(relations, "relations", (2,), np.int64),
        confidence=frozen(confidence, "confidence", ()),
        is_leaning=frozen(is_leaning[kept], "is_leaning", (), np.bool_),
        weight=frozen(weight, "weight", (2,)),
        load=frozen(carried_loads(relations, shares, weight, order)[1:], "load", (2,)),
        hidden=frozen(hidden, "hidden", ()),
        encumbrance=frozen(encumbrance, "encumbrance", ()),
        occluded=frozen(seen.occluded, "occluded", ()),
        removal_order=frozen(order, "removal order", (), np.int64),
        removal_confidence=frozen(certain, "removal confidence", ()),
        extents=frozen(shapes.extents[1:], "extents", (3,)),
    )


def _with_ground(
    relations: IntArray, confidence: FloatArray, shapes: Shapes
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Relations to the ground too, and the probability of hidden support, (s,)."""
    n = len(shapes.lowest) - 1
    free = np.ones(n + 1)
    np.multiply.at(free, relations[:, 0], 1.0 - confidence)
    evidence = ground_features(shapes.lowest, 1.0 - free)[1:] @ _GROUND_EVIDENCE
    ground = expit(evidence + _GROUND_PRIOR)
    to_ground = np.column_stack([np.arange(1, n + 1), np.full(n, GROUND)])
    return (
        np.concatenate([relations, to_ground]),
        np.concatenate([confidence, ground]),
        free[1:] * (1.0 - ground),
    )


def ground_features(lowest: FloatArray, supported: FloatArray) -> FloatArray:
    """Gather what speaks for and against resting on the ground, shape (n, 3).

    Parameters
    ----------
    lowest
        Heights of the lowest parts that were seen [m], shape (n,).
    supported
        Probability of another support, shape (n,).
    """
    low = np.clip(lowest, 0.0, _OFF_GROUND)
    return np.column_stack([low, supported, low * supported])


def labelled_surface(
    segmentation: Segmentation, cloud: PointCloud, config: SupportConfig
) -> LabelledSurface:
    """Thin a segmented cloud; raises what `support_graph` does."""
    cloud.require_frame("base")
    segmentation.require_of(cloud)
    highest = int(segmentation.labels.max(initial=0))
    if highest > len(segmentation.segments) or segmentation.labels.min(initial=0) < 0:
        raise InputError(
            "labels",
            got=f"{int(segmentation.labels.min(initial=0))} to {highest}",
            expected=f"0 to {len(segmentation.segments)}, the number of segments",
        )
    return LabelledSurface.of(
        cloud,
        segmentation.labels,
        segmentation.ground.plane,
        size=config.cell,
        noise=config.noise,
    )


def _weights(shapes: Shapes, config: SupportConfig) -> FloatArray:
    """Bounds on the weight of each object [N], shape (s, 2).

    The hull of the seen surface is at least half of a convex body of which two sides
    are seen, and the box around it encloses the whole.
    """
    size = np.maximum(shapes.extents[1:], config.thickness[0])
    thin, thick = (size[:, 0] * size[:, 1] * value for value in config.thickness)
    least = np.maximum(shapes.hull[1:], thin)
    most = np.maximum(np.minimum(2.0 * shapes.hull[1:], size.prod(axis=1)), thick)
    volume = np.stack([least, np.maximum(most, least)], axis=1)
    weights: FloatArray = volume * np.array(config.density) * config.gravity
    return weights
