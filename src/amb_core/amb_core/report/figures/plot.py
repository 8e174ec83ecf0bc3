"""The chart of a result, whatever it is."""

from __future__ import annotations

from functools import singledispatch

from amb_core.ground.errors import AmbError
from amb_core.identification.estimate.order_selection import OrderSelection
from amb_core.identification.frequency_response import FrequencyResponse
from amb_core.identification.identify import Identification
from amb_core.identification.validation import Validation
from amb_core.loop.records import LoopRecord
from amb_core.plant.campbell import Campbell
from amb_core.regions.distortion import Coherence, Distortion
from amb_core.regions.region_map import RegionMap
from amb_core.regions.subharmonics import SubharmonicSpectrum, SubharmonicSurface
from amb_core.report.figures.bode import bode_chart
from amb_core.report.figures.campbell import campbell_chart
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.coherence import coherence_chart
from amb_core.report.figures.distortion import distortion_chart
from amb_core.report.figures.loop import response_chart
from amb_core.report.figures.order import order_chart
from amb_core.report.figures.poles import poles_chart
from amb_core.report.figures.region_map import map_chart
from amb_core.report.figures.residuals import residuals_chart
from amb_core.report.figures.spectrum import spectrum_chart
from amb_core.report.figures.surface import surface_chart


@singledispatch
def plot(result: object) -> Chart:
    """The chart that shows a result best; `plot(result).save("results", "name")` writes it.

    The `..._chart` functions of `amb_core.report.figures` have more of them, with options.

    Parameters
    ----------
    result : LoopRecord, Identification, Validation, FrequencyResponse, OrderSelection, RegionMap, Distortion, \
Coherence, SubharmonicSpectrum, SubharmonicSurface or Campbell
        Drawn are the response, the poles, the residuals, the Bode diagram, the criterion over the order, the map, the
        lines, the coherence, the spectrum, the surface and the Campbell diagram.

    Returns
    -------
    Chart
        The chart, ready to save.

    Raises
    ------
    AmbError
        If there is no chart of such a result.
    """
    kinds = ", ".join(sorted(kind.__name__ for kind in plot.registry if kind is not object))
    raise AmbError(f"there is no chart of a {type(result).__name__}; allowed: {kinds}")


@plot.register
def _(result: LoopRecord) -> Chart:
    return response_chart(result)


@plot.register
def _(result: Identification) -> Chart:
    return poles_chart(result)


@plot.register
def _(result: Validation) -> Chart:
    return residuals_chart(result.residuals, result.model.input_names, result.model.output_names)


@plot.register
def _(result: FrequencyResponse) -> Chart:
    return bode_chart([result])


@plot.register
def _(result: OrderSelection) -> Chart:
    return order_chart(result)


@plot.register
def _(result: RegionMap) -> Chart:
    return map_chart(result)


@plot.register
def _(result: Distortion) -> Chart:
    return distortion_chart(result)


@plot.register
def _(result: Coherence) -> Chart:
    return coherence_chart(result)


@plot.register
def _(result: SubharmonicSpectrum) -> Chart:
    return spectrum_chart({"response": result})


@plot.register
def _(result: SubharmonicSurface) -> Chart:
    return surface_chart(result)


@plot.register
def _(result: Campbell) -> Chart:
    return campbell_chart(result)
