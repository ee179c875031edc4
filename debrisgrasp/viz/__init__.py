"""Edge: what a person looks at: pictures, and pages for the browser.

Importing this package loads the plotting library; nothing below it does.
"""

from .campaign import Bar, campaign_png
from .control import LegTrace, Outline, leg_png, preview_png
from .coverage_map import coverage_png
from .html import report_html
from .motion import MotionTrack, motion_png
from .png import report_png
from .prototype_page import prototypes_html
from .reach import ReachPicture, reach_html, reach_png
from .report import Report
from .selection import selection_png
from .selection_page import selection_html
from .sheets import prototype_png, segmentation_png
from .support_layer import SelectionReport

__all__ = [
    "Bar",
    "LegTrace",
    "MotionTrack",
    "Outline",
    "ReachPicture",
    "Report",
    "SelectionReport",
    "campaign_png",
    "coverage_png",
    "leg_png",
    "motion_png",
    "preview_png",
    "prototype_png",
    "prototypes_html",
    "reach_html",
    "reach_png",
    "report_html",
    "report_png",
    "segmentation_png",
    "selection_html",
    "selection_png",
]
