"""Layer 3: debris, piles of it, and what a depth camera sees of them."""

from .body import Body, Part, volume_and_centroid
from .cameras import draw_intrinsics, draw_view, look_at
from .ground import Ground
from .hull import Hull, frustum, prism, staves
from .kinds import KINDS, Kind, draw_body, make_body
from .noise import Measured, StereoNoise
from .piles import ARRANGEMENTS, PileConfig, generate_pile
from .raycast import corners_around, first_hits
from .render import Rendered, body_around, render
from .rest import RestConfig, Rested, come_to_rest, let_down
from .scenes import SCENES, named_scene
from .world import World

__all__ = [
    "ARRANGEMENTS",
    "KINDS",
    "SCENES",
    "Body",
    "Ground",
    "Hull",
    "Kind",
    "Measured",
    "Part",
    "PileConfig",
    "Rendered",
    "RestConfig",
    "Rested",
    "StereoNoise",
    "World",
    "body_around",
    "come_to_rest",
    "corners_around",
    "draw_body",
    "draw_intrinsics",
    "draw_view",
    "first_hits",
    "frustum",
    "generate_pile",
    "let_down",
    "look_at",
    "make_body",
    "named_scene",
    "prism",
    "render",
    "staves",
    "volume_and_centroid",
]
