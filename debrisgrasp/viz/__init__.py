"""Edge: what a person looks at: pictures, and pages for the browser.

Importing this package loads the plotting library; nothing below it does.
"""

from .html import report_html
from .png import report_png
from .report import Report
from .sheets import prototype_png, segmentation_png

__all__ = ["Report", "prototype_png", "report_html", "report_png", "segmentation_png"]
