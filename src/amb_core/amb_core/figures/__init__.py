"""Figures of the paper, each twice: `..._figure` makes a matplotlib figure, `..._page` an interactive plotly one.

`save_figure` writes both. Figures are made without pyplot, so they need no display and leave no state behind.
"""

from amb_core.figures.bode import bode_figure, bode_page
from amb_core.figures.comparison import comparison_figure, comparison_page, save_validation_figures
from amb_core.figures.force import force_figure, force_page, force_speed_figure, force_speed_page
from amb_core.figures.loop import orbit_figure, orbit_page, response_figure, response_page, save_loop_figures
from amb_core.figures.order import order_figure, order_page
from amb_core.figures.overlay import overlay_figure, overlay_page
from amb_core.figures.poles import poles_figure, poles_page
from amb_core.figures.prediction import prediction_figure, prediction_page
from amb_core.figures.region_map import map_figure, map_grid_figure, map_grid_page, map_page
from amb_core.figures.residuals import residuals_figure, residuals_page
from amb_core.figures.saving import page_fragment, save_figure
from amb_core.figures.spectrum import spectrum_figure, spectrum_page
from amb_core.figures.surface import surface_figure, surface_page
from amb_core.figures.sweep import sweep_figure, sweep_page
from amb_core.figures.sweep_comparison import sweep_comparison_figure, sweep_comparison_page

__all__ = [
    "bode_figure",
    "bode_page",
    "comparison_figure",
    "comparison_page",
    "force_figure",
    "force_page",
    "force_speed_figure",
    "force_speed_page",
    "map_figure",
    "map_grid_figure",
    "map_grid_page",
    "map_page",
    "orbit_figure",
    "orbit_page",
    "order_figure",
    "order_page",
    "overlay_figure",
    "overlay_page",
    "page_fragment",
    "poles_figure",
    "poles_page",
    "prediction_figure",
    "prediction_page",
    "residuals_figure",
    "residuals_page",
    "response_figure",
    "response_page",
    "save_figure",
    "save_loop_figures",
    "save_validation_figures",
    "spectrum_figure",
    "spectrum_page",
    "surface_figure",
    "surface_page",
    "sweep_comparison_figure",
    "sweep_comparison_page",
    "sweep_figure",
    "sweep_page",
]
