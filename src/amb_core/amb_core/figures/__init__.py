"""Figures of the paper, each twice: `..._figure` makes a matplotlib figure, `..._page` an interactive plotly one.

`save_figure` writes both. Figures are made without pyplot, so they need no display and leave no state behind.
"""

from amb_core.figures.loop import orbit_figure, orbit_page, response_figure, response_page
from amb_core.figures.saving import save_figure

__all__ = ["orbit_figure", "orbit_page", "response_figure", "response_page", "save_figure"]
