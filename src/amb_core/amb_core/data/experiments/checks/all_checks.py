"""All checks of a data set at once."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from amb_core.data.experiments.checks.distortion import check_distortion
from amb_core.data.experiments.checks.drift import check_drift
from amb_core.data.experiments.checks.dynamics import check_delay, check_feedback
from amb_core.data.experiments.checks.excitation import check_amount, check_excitation, check_inputs
from amb_core.data.experiments.checks.faults import check_faults
from amb_core.data.experiments.checks.plausible import check_quantisation, check_roles
from amb_core.data.experiments.checks.region import check_region
from amb_core.data.experiments.checks.report import DataReport, Finding, Severity
from amb_core.data.experiments.checks.samples import (
    check_clipping,
    check_finite,
    check_gaps,
    check_offsets,
    check_sample_time,
)
from amb_core.data.experiments.conditioning import split_at_invalid
from amb_core.data.experiments.dataset import IdentificationData, require_data
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import number, require_kind, whole_number
from amb_core.linear.numerics import one_blas_thread

if TYPE_CHECKING:
    from amb_core.regions import RegionParameters


def check_data(
    data: IdentificationData,
    order: int = 10,
    *,
    sample_time: float | None = None,
    limits: Mapping[str, float] | None = None,
    regions: RegionParameters | None = None,
    feedthrough: bool = False,
) -> DataReport:
    """Check whether data can determine a model of an order, and what makes it less accurate; bad data raise no error.

    Parameters
    ----------
    data : IdentificationData
        The data.
    order : int, optional
        Number of states of the model.
    sample_time : float, optional
        Expected sample time, such as the controller's (s). None if there is none.
    limits : mapping of str to float, optional
        Known limits on the magnitude of signals by name, in the units of the signals, such as the controller's current
        limit for i_x and i_y. None if there are none.
    regions : RegionParameters, optional
        Thresholds of the classifier of regions. None for the defaults.
    feedthrough : bool, optional
        Whether the model is to have direct feedthrough.

    Returns
    -------
    DataReport
        The finding of each check that ran.

    Raises
    ------
    IdentificationError
        If the order is below 1, or a limit has a name that no signal of the data has.
    """
    require_data(data)
    order = whole_number("order", order, IdentificationError)
    if sample_time is not None:
        sample_time = number("sample_time", sample_time, IdentificationError)
    require_kind("limits", limits, (Mapping, type(None)), "limits by name of the signal, or None", IdentificationError)
    if order < 1:
        raise IdentificationError(f"order {order} is not allowed; it must be 1 or more")
    findings = [check_finite(data), check_gaps(data), check_sample_time(data, sample_time), check_roles(data)]
    if findings[0].severity is Severity.ERROR:
        try:
            data = split_at_invalid(data)  # the other checks use the remaining data
        except IdentificationError:
            return DataReport(_title(data), tuple(findings))
    # The matrices are small: more BLAS threads cost time, and take cores from the control loop.
    with one_blas_thread(), np.errstate(over="ignore", invalid="ignore"):
        findings += [
            check_amount(data, order),
            check_inputs(data),
            check_excitation(data, order),
            check_clipping(data, limits),
            check_quantisation(data),
            *(check_faults(data) if _plain(findings) else []),
            check_offsets(data),
            check_drift(data),
        ]
        feedback = check_feedback(data)
        controlled = bool(feedback.where) or all(item.reference is not None for item in data.experiments)
        findings += [feedback, check_delay(data, controlled, feedthrough), check_region(data, regions)]
        findings.append(check_distortion(data))
    return DataReport(_title(data), tuple(findings))


def check_recording(data: IdentificationData) -> list[Finding]:
    """The checks of the samples alone, for data that a model is validated on.

    Parameters
    ----------
    data : IdentificationData
        Data of any plant.

    Returns
    -------
    list of Finding
        One finding for each check that ran.
    """
    with one_blas_thread(), np.errstate(over="ignore", invalid="ignore"):
        findings = [check_gaps(data), check_sample_time(data), check_roles(data)]
        faults = check_faults(data) if _plain(findings) else []
        return [*findings, check_clipping(data), check_quantisation(data), *faults]


def _plain(findings: list[Finding]) -> bool:
    """Whether the signals are what they are called, at their own rate: else every row would look wrong."""
    return all(item.severity is Severity.INFO for item in findings if item.check in ("sample time", "roles"))


def _title(data: IdentificationData) -> str:
    count = len(data.experiments)
    return (
        f"{count} experiment{'s' if count > 1 else ''}, {data.samples} samples of {data.sample_time:g} s; "
        f"inputs {', '.join(data.input_names)}; outputs {', '.join(data.output_names)}"
    )
