"""Layer 10: the viewer in the browser, behind the extra ``viz`` (viser)."""

from .contents import PlanContent, RunContent, ViewContent
from .files import content_of
from .touching import Touch, touches
from .window import Viewer, show

__all__ = [
    "PlanContent",
    "RunContent",
    "Touch",
    "ViewContent",
    "Viewer",
    "content_of",
    "show",
    "touches",
]
