"""The rotor's orbit (the paper's Fig. 13) and its response over time (Fig. 14 and 15), plant and model together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from amb_core.ground.errors import AmbError
from amb_core.ground.units import UM
from amb_core.identification.fit import fit_text
from amb_core.identification.validation import nrmse_fit
from amb_core.loop.machine import radial_bearings
from amb_core.loop.records import LoopRecord
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Curve, Panel
from amb_core.report.figures.style import MODEL, PLANT, REFERENCE, Stroke
from amb_core.report.figures.thinning import extremes, thinned_path

HIDDEN = 2e-3  # of the size of an orbit; such a movement is narrower than its line


def orbit_chart(
    measured: LoopRecord,
    modelled: LoopRecord | None = None,
    backup_bearing_radius: float | None = None,
    title: str = "Orbit of the rotor",
) -> Chart:
    """Orbit of the rotor in the plane of each radial bearing, axes in um.

    Parameters
    ----------
    measured : LoopRecord
        Record of the plant.
    modelled : LoopRecord, optional
        Record of the model under the same reference. None to show the plant alone.
    backup_bearing_radius : float, optional
        Radial displacement at which the rotor touches the backup bearing (m), drawn as a circle. None for no circle.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.

    Raises
    ------
    AmbError
        If the machine has one axis only, which has no orbit.
    """
    planes = radial_bearings(measured)
    if not planes:
        raise AmbError(f"a machine of the axis {listed(measured.axes)} has no orbit; allowed: two axes or more")
    models = [None] * len(planes) if modelled is None else radial_bearings(modelled)
    panels, texts = [], []
    for plane, model in zip(planes, models, strict=True):
        x, y = plane.axes
        reach = UM * np.nanmax(np.abs(plane.position), axis=0)
        text = "Orbit of the rotor in the bearing plane: "
        text += f"it reaches {reach[0]:.0f} µm on {x} and {reach[1]:.0f} µm on {y}."
        curves = [_path(plane, "plant", PLANT)]
        if model is not None:
            fit = nrmse_fit(plane.position, model.position)
            label = f"model, fit {x} {fit_text(fit[0], 1)}, {y} {fit_text(fit[1], 1)}"
            curves.append(_path(model, label, MODEL))
            fits = f"{fit_text(fit[0], 1)} on {x} and {fit_text(fit[1], 1)} on {y}"
            text += f" The identified model follows it with a fit of {fits}."
        if backup_bearing_radius is not None:
            angle = np.linspace(0.0, 2.0 * np.pi, 361)
            radius = UM * backup_bearing_radius
            curves.append(Curve(radius * np.cos(angle), radius * np.sin(angle), "backup bearing", REFERENCE))
        panels.append(Panel(Axis(f"{x} (µm)"), Axis(f"{y} (µm)"), tuple(curves), equal=True))
        texts.append(text)
    return Chart(title, " ".join(texts), tuple(panels), columns=len(panels), size=(6.4 * len(panels), 6.0))


def listed(words: Sequence[str]) -> str:
    """Words as a list in a sentence: `x, y and z`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _path(record: LoopRecord, label: str, stroke: Stroke) -> Curve:
    size = np.nanmax(record.position, axis=0) - np.nanmin(record.position, axis=0)
    path = UM * thinned_path(record.position, HIDDEN * float(size.max()))
    return Curve(path[:, 0], path[:, 1], label, stroke)


def response_chart(
    measured: LoopRecord, modelled: LoopRecord | None = None, title: str = "Response of the rotor to the reference"
) -> Chart:
    """Reference and rotor position over time, one panel per axis, axes in s and um.

    Parameters
    ----------
    measured : LoopRecord
        Record of the plant.
    modelled : LoopRecord, optional
        Record of the model under the same reference. None to show the plant alone.
    title : str, optional
        Title of the figure.

    Returns
    -------
    Chart
        The chart, ready to save.
    """
    fit = None if modelled is None else nrmse_fit(measured.position, modelled.position)
    panels = []
    for axis, name in enumerate(measured.axes):
        curves = [
            Curve(*extremes(measured.time, UM * measured.reference[:, axis]), "reference", REFERENCE),
            Curve(*extremes(measured.time, UM * measured.position[:, axis]), "plant", PLANT),
        ]
        if modelled is not None:
            curves.append(Curve(*extremes(modelled.time, UM * modelled.position[:, axis]), "model", MODEL))
        heading = "" if fit is None else f"{name}: fit of the model {fit_text(fit[axis], 1)}"
        panels.append(Panel(Axis("time (s)"), Axis(f"{name} (µm)"), tuple(curves), heading))
    names = listed(measured.axes)
    alt = f"Reference and position of the rotor on {names} from {measured.time[0]:.2f} s to {measured.time[-1]:.2f} s."
    if fit is not None:
        fits = [f"{fit_text(value, 1)} on {name}" for name, value in zip(measured.axes, fit, strict=True)]
        alt += f" The identified model fits to {listed(fits)}."
    return Chart(title, alt, tuple(panels), shared_x=True, size=(8.0, 3.0 * len(panels)))


def save_loop_figures(folder: str | Path, measured: LoopRecord, modelled: LoopRecord | None = None) -> tuple[str, ...]:
    """Write response and, of a machine with a radial bearing, orbit as PNG and as page.

    Parameters
    ----------
    folder : str or Path
        Made if it does not exist.
    measured : LoopRecord
        Record of the plant.
    modelled : LoopRecord, optional
        Record of the model under the same reference; None to show the plant alone.

    Returns
    -------
    tuple of str
        Names of the figures.

    Raises
    ------
    AmbError
        If a file cannot be written.
    """
    charts = {"response": response_chart(measured, modelled)}
    if radial_bearings(measured):
        charts["orbit"] = orbit_chart(measured, modelled)
    for name, chart in charts.items():
        chart.save(folder, name)
    return tuple(charts)
