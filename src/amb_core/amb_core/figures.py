"""Figures of the paper: the rotor's orbit (Fig. 13) and its response over time (Fig. 14), plant and model together.

Figures are made without pyplot, so they need no display and leave no state behind; save one with `figure.savefig`.
Colours are those of Okabe and Ito, which colour-blind readers can tell apart; lines differ in dash too.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from amb_core.identification.validation import nrmse_fit
from amb_core.records import LoopRecord

PLANT: dict[str, Any] = {"color": "#0072B2", "linestyle": "-", "linewidth": 1.4}
MODEL: dict[str, Any] = {"color": "#D55E00", "linestyle": "--", "linewidth": 1.1}
REFERENCE: dict[str, Any] = {"color": "#999999", "linestyle": "-", "linewidth": 0.8}
UM = 1e6


def orbit_figure(
    measured: LoopRecord,
    modelled: LoopRecord | None = None,
    backup_bearing_radius: float | None = None,
    title: str = "Orbit of the rotor",
) -> Figure:
    """Orbit of the rotor in the bearing plane, axes in um.

    Parameters
    ----------
    measured : LoopRecord
        Record of the plant.
    modelled : LoopRecord, optional
        Record of the model under the same reference.
    backup_bearing_radius : float, optional
        Radial displacement at which the rotor touches the backup bearing (m), drawn as a circle.
    title : str
        Title of the figure.
    """
    figure = Figure(figsize=(6.4, 6.0), layout="constrained")
    axes = figure.add_subplot()
    axes.plot(*(UM * measured.position.T), **PLANT, label="plant")
    if modelled is not None:
        fit = nrmse_fit(measured.position, modelled.position)
        axes.plot(*(UM * modelled.position.T), **MODEL, label=f"model, fit x {fit[0]:.1f} %, y {fit[1]:.1f} %")
    if backup_bearing_radius is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, 361)
        radius = UM * backup_bearing_radius
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), **REFERENCE, label="backup bearing")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x (µm)")
    axes.set_ylabel("y (µm)")
    axes.set_title(title)
    axes.grid(True, alpha=0.3)
    figure.legend(loc="outside lower center", ncols=3)
    return figure


def response_figure(
    measured: LoopRecord, modelled: LoopRecord | None = None, title: str = "Response of the rotor to the reference"
) -> Figure:
    """Reference and rotor position over time, one panel per axis, axes in s and um.

    Parameters
    ----------
    measured : LoopRecord
        Record of the plant.
    modelled : LoopRecord, optional
        Record of the model under the same reference.
    title : str
        Title of the figure.
    """
    figure = Figure(figsize=(8.0, 6.0), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    fit = None if modelled is None else nrmse_fit(measured.position, modelled.position)
    for axis, (name, axes) in enumerate(zip("xy", panels, strict=True)):
        axes.plot(measured.time, UM * measured.reference[:, axis], **REFERENCE, label="reference")
        axes.plot(measured.time, UM * measured.position[:, axis], **PLANT, label="plant")
        if modelled is not None and fit is not None:
            axes.plot(modelled.time, UM * modelled.position[:, axis], **MODEL, label=f"model, fit {fit[axis]:.1f} %")
        axes.set_ylabel(f"{name} (µm)")
        axes.grid(True, alpha=0.3)
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False)
    panels[-1].set_xlabel("time (s)")
    figure.suptitle(title)
    return figure
