"""Figures of the paper and of results: each `..._chart` function makes a `Chart`, `plot` the chart of any result.

`chart.figure()` is a matplotlib figure, `chart.page()` an interactive plotly one, `chart.save()` writes both.
"""

from amb_core.ground.results import Result
from amb_core.report.figures.bode import bode_chart
from amb_core.report.figures.campbell import campbell_chart
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.coherence import coherence_chart
from amb_core.report.figures.comparison import comparison_chart, save_validation_figures
from amb_core.report.figures.distortion import distortion_chart
from amb_core.report.figures.force import force_chart, force_speed_chart
from amb_core.report.figures.loop import orbit_chart, response_chart, save_loop_figures
from amb_core.report.figures.order import order_chart
from amb_core.report.figures.overlay import overlay_chart
from amb_core.report.figures.plot import plot
from amb_core.report.figures.poles import poles_chart
from amb_core.report.figures.prediction import prediction_chart
from amb_core.report.figures.region_map import map_chart, map_grid_chart
from amb_core.report.figures.residuals import residuals_chart
from amb_core.report.figures.saving import page_fragment
from amb_core.report.figures.spectrum import spectrum_chart
from amb_core.report.figures.stability import stability_figure
from amb_core.report.figures.surface import surface_chart
from amb_core.report.figures.sweep import sweep_chart
from amb_core.report.figures.sweep_comparison import sweep_comparison_chart
from amb_core.report.figures.sweep_error import sweep_error_chart
from amb_core.report.figures.trial import trial_chart

__all__ = [
    "Chart",
    "bode_chart",
    "campbell_chart",
    "coherence_chart",
    "comparison_chart",
    "distortion_chart",
    "force_chart",
    "force_speed_chart",
    "map_chart",
    "map_grid_chart",
    "orbit_chart",
    "order_chart",
    "overlay_chart",
    "page_fragment",
    "plot",
    "poles_chart",
    "prediction_chart",
    "residuals_chart",
    "response_chart",
    "save_loop_figures",
    "save_validation_figures",
    "spectrum_chart",
    "stability_figure",
    "surface_chart",
    "sweep_chart",
    "sweep_comparison_chart",
    "sweep_error_chart",
    "trial_chart",
]

Result.draw_with(plot)
