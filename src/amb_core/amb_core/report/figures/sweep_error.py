"""Error of a model over the frequency of a sweep."""

from __future__ import annotations

from amb_core.ground.units import UM
from amb_core.identification.focus.sweep_error import SweepError
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel, Table
from amb_core.report.figures.style import BLUE, VERMILION, Stroke

LOOKS = (Stroke(BLUE, "solid"), Stroke(VERMILION, "dash"))


def sweep_error_chart(errors: SweepError, title: str = "Error of the model over the frequency of the sweep") -> Chart:
    """Error relative to the movement of the rotor, and the bias that the model misses, over the input frequency.

    Parameters
    ----------
    errors : SweepError
        What `amb_core.identification.focus.sweep_error` found.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    x = errors.middles
    relative = [Curve(x, 100.0 * errors.relative[:, axis], name, LOOKS[axis]) for axis, name in enumerate("xy")]
    bias = [Curve(x, UM * errors.mean[:, axis], name, LOOKS[axis]) for axis, name in enumerate("xy")]
    frequency = Axis("input frequency (Hz)", log=True, limits=(float(errors.edges[0]), float(errors.edges[-1])))
    first, last = 100.0 * errors.relative[0], 100.0 * errors.relative[-1]
    alt = (
        f"The error of the model, relative to the movement of the rotor, is {first[0]:.1f} % on x and {first[1]:.1f} % "
        f"on y at {x[0]:.0f} Hz, and {last[0]:.0f} % on x and {last[1]:.0f} % on y at {x[-1]:.0f} Hz."
    )
    rows = tuple(
        (
            f"{low:.1f} to {high:.1f}",
            *(f"{100.0 * value:.1f}" for value in errors.relative[number]),
            *(f"{UM * value:.2f}" for value in errors.mean[number]),
            *(f"{UM * value:.2f}" for value in errors.movement[number]),
        )
        for number, (low, high) in enumerate(zip(errors.edges[:-1], errors.edges[1:], strict=True))
    )
    header = (
        "frequency (Hz)",
        "error x (%)",
        "error y (%)",
        "bias x (µm)",
        "bias y (µm)",
        "movement x (µm)",
        "movement y (µm)",
    )
    panels = (
        Panel(frequency, Axis("rms error / rms movement (%)", log=True), tuple(relative)),
        Panel(frequency, Axis("mean error (µm)"), tuple(bias)),
    )
    return Chart(title, alt, panels, shared_x=True, size=(8.0, 6.0), table=Table(header, rows))
