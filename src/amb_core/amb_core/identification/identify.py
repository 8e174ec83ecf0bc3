"""One call from data of the closed loop to a validated model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from amb_core.data.controller_choice import needs_controller, suits_controller
from amb_core.data.experiments import DataReport, IdentificationData, Severity, check_data
from amb_core.data.experiments.checks import check_amount, check_excitation
from amb_core.data.experiments.drift import DriftCure, DriftOption, cure_drift
from amb_core.data.experiments.tones import ToneCure, cure_tones
from amb_core.ground.errors import IdentificationError
from amb_core.ground.given_values import require_kind, require_word
from amb_core.ground.results import Result
from amb_core.identification.closed_loop import DivergenceError, closed_loop_poles
from amb_core.identification.controller_check import check_controller
from amb_core.identification.estimate.methods import METHODS, estimate, starts_for_simulation
from amb_core.identification.estimate.order_selection import OrderSelection, select_order
from amb_core.identification.estimate.scaled_data import check_order
from amb_core.identification.experiment_simulation import in_experiment, simulate_experiment
from amb_core.identification.focus.focus import focus_simulation
from amb_core.identification.given import Controller, Data, given_controller, given_loop
from amb_core.identification.progress import Cancelled, Progress, SearchEnd, Watch
from amb_core.identification.uncertainty import ModelUncertainty, uncertainty_of
from amb_core.identification.validation import Validation, Verdict, nrmse_fit, validate
from amb_core.identification.validation.overlap import fingerprint_of
from amb_core.linear.model.state_space import StateSpaceModel
from amb_core.linear.numerics import LARGEST_RADIUS
from amb_core.loop.control import ControllerParameters
from amb_core.loop.known_controller import KnownController
from amb_core.loop.records import LoopRecord

if TYPE_CHECKING:
    from amb_core.plant import PlantParameters

Focus = Literal["prediction", "simulation"]
_GOOD_FIT = 99.0  # percent, below which simulation focus searches from another start too


@dataclass(frozen=True, repr=False)
class Identification(Result):
    """An identified model and what its validation shows.

    Attributes
    ----------
    model : StateSpaceModel
        The model, with `fit` filled in.
    data : IdentificationData
        The data.
    report : DataReport
        Findings of the checks, without errors: data with errors are rejected.
    order_selection : OrderSelection or None
        How the order was chosen; None if it was given.
    uncertainty : ModelUncertainty or None
        How accurately the data determine the model, for `pem` with prediction focus. None otherwise, or if the data do
        not determine it. See `uncertainty_of` for what makes its bands wider.
    simulations : tuple of (LoopRecord or None)
        The model in closed loop with the known controller, for each experiment, to be compared with the data without
        the tones of `tones`; None where the reference is not known or the simulation diverges.
    closed_loop_poles : ndarray of complex, shape (n + c,), or None
        Poles in the z plane (-) of model and controller, largest magnitude first; None for data that do not come from
        the bearing's loop.
    search : SearchEnd or None
        How the search of `pem` or of simulation focus ended, and whether it converged; None for other methods.
    drift : DriftCure or None
        Which drift was removed from the data that the model is estimated from, and how; None if nothing was.
    tones : ToneCure or None
        Which tones that the reference lacks were removed from the data that the model is estimated from; None if none.
    controller : KnownController or None
        The controller of the closed loop; None for data that do not come from the bearing's loop.
    no_uncertainty_because : str
        Why the data do not determine the uncertainty of a model of `pem`; empty if they do, or where none is wanted.
    """

    model: StateSpaceModel
    data: IdentificationData
    report: DataReport
    order_selection: OrderSelection | None
    uncertainty: ModelUncertainty | None
    simulations: tuple[LoopRecord | None, ...]
    closed_loop_poles: NDArray[np.complex128] | None
    search: SearchEnd | None = None
    drift: DriftCure | None = None
    tones: ToneCure | None = None
    controller: KnownController | None = None
    no_uncertainty_because: str = ""

    @property
    def stable(self) -> bool:
        """Whether model and controller make a stable loop; False where there is no such loop."""
        return self.closed_loop_poles is not None and bool(np.all(np.abs(self.closed_loop_poles) < 1.0))

    @cached_property
    def verdict(self) -> Verdict:
        """On the data of the estimate, and so with reservations at best: that of `validation`."""
        return Verdict.NOT_VALIDATED if self.validation is None else self.validation.verdict

    @property
    def validation(self) -> Validation | None:
        """The validation on the data of the estimate; None where it is not possible, see `not_validated_because`."""
        return self._validation[0]

    @property
    def not_validated_because(self) -> str:
        """Why the data of the estimate allow no validation, such as too few of them; empty where there is one."""
        return self._validation[1]

    @cached_property
    def _validation(self) -> tuple[Validation | None, str]:
        try:
            return self.validated(), ""
        except IdentificationError as problem:
            return None, str(problem)

    def validated(self, plant: PlantParameters | None = None) -> Validation:
        """Validate on the data of the estimate, with all that is known of it.

        Parameters
        ----------
        plant : PlantParameters, optional
            The plant, if it is known, such as that of the simulator. None if it is not known.

        Returns
        -------
        Validation
            The validation of the model.

        Raises
        ------
        IdentificationError
            If the data are too few for the tests.
        """
        return validate(
            self.model, self.data, self.controller, uncertainty=self.uncertainty, plant=plant, search=self.search
        )

    @property
    def rows(self) -> list[tuple[str, str]]:
        """Size of model and data, and the conditions of the validation."""
        poles = ", ".join(f"{pole:.6g}" for pole in self.model.unstable_poles()) or "none"
        rows = [("order", f"{self.model.order}"), ("samples", f"{self.model.samples}"), ("unstable poles z", poles)]
        if self.validation is None:
            return [*rows, ("verdict", f"{self.verdict}: {self.not_validated_because}")]
        return [*rows, *self.validation.rows]

    @property
    def summary(self) -> str:
        """One line of text."""
        fits = zip(self.model.output_names, self.model.fit, strict=False)  # empty where not validated
        diverges = not np.isfinite(self.model.fit).all()
        if diverges:
            fit = "the simulated closed loop diverges"
        elif len(self.model.fit):
            fit = f"closed-loop fit {', '.join(f'{name} {value:.2f} %' for name, value in fits)}"
        elif self.closed_loop_poles is None:
            fit = (
                "closed loop not simulated: no controller is known, or the data are not in the units A and m of a loop"
            )
        else:
            fit = "no reference to simulate the closed loop with"
        because = f" ({self.not_validated_because})" if self.not_validated_because else ""
        parts = [
            f"{self.verdict} on the data of the estimate{because}: {self.model.method}, order {self.model.order}, "
            f"{self.model.samples} samples: {fit}",
            f"{len(self.model.unstable_poles())} unstable plant poles",
        ]
        if self.closed_loop_poles is not None:
            within = " while the control currents are within their limit" if diverges else ""
            parts.append(f"closed loop stable{within}" if self.stable else "closed loop unstable")
        if self.search is not None and not self.search.converged:
            parts.append(
                f"the search stopped after {self.search.iterations} steps and had not converged, a further step "
                f"promises {100.0 * self.search.left:.2g} % less squared error"
            )
        if self.drift is not None:
            parts.append(self.drift.summary)
        if self.tones is not None:
            parts.append(self.tones.summary)
        if self.uncertainty is not None:
            parts += [remark for remark in (self.uncertainty.widened, self.uncertainty.at_one) if remark]
        if self.no_uncertainty_because:
            parts.append(f"uncertainty not known: {self.no_uncertainty_because}")
        return "; ".join(parts)


def identify(
    data: Data,
    order: int | Literal["auto"] = 10,
    method: str = "pem",
    controller: Controller | None = None,
    source: str = "",
    *,
    orders: Sequence[int] | None = None,
    focus: Focus = "prediction",
    drift: DriftOption = "auto",
    feedthrough: bool = False,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> Identification:
    """Identify the plant from control currents and positions, and validate it in closed loop on the same data.

    If a method returns several models, the function takes one with a stable closed loop: the one with the highest fit
    of the output that fits worst; without a closed loop, the one with the smallest one-step prediction errors.

    Parameters
    ----------
    data : LoopRecord, IdentificationData or RecordedLoop
        Data of the closed loop, or of any other plant, of any number of inputs and outputs; the last is what
        `amb_core.read` returns.
    order : int or "auto", optional
        Number of states; "auto" for the choice of `select_order`.
    method : str, optional
        One of `METHODS`; `pem` starts from `ssarx`.
    controller : KnownController, LinearSystem, control.StateSpace or str, optional
        The controller of the experiment, of the PD law or any other linear one, or its name; by default that of a
        RecordedLoop, or the paper's for data that are not `foreign`.
    source : str, optional
        Where the data come from, kept in the model; by default the sources of the experiments.
    orders : sequence of int, optional
        The orders that "auto" tests; see `select_order`. None for its own choice.
    focus : str, optional
        `prediction`, or `simulation` to reduce the errors of the closed-loop simulation in a last step.
    drift : str, optional
        Whether slow drift and steps of the outputs are removed before the estimate (see `cure_drift`): `auto` where the
        checks find drift, `none`, or `prefilter` for any data. Data without drift are not changed by `auto`. Tones that
        the reference lacks are removed too (see `cure_tones`), unless it is `none`.
    feedthrough : bool, optional
        Whether outputs respond within the sample: D is then estimated, otherwise it is zero. Not for a controller that
        responds within the sample, as a bearing's does: data of such a loop cannot distinguish the two.
    progress : callable, optional
        Called with an `IdentificationProgress` at every stage and iteration. None for no calls.
    cancelled : callable, optional
        Called at every stage and iteration; returns whether the identification has been cancelled. None if it cannot be
        cancelled.

    Returns
    -------
    Identification
        The model, how it was found, and its validation in closed loop.

    Raises
    ------
    IdentificationError
        If an argument is not allowed, the checks find errors in the data, the data determine no model, or the
        identification is cancelled; the message is one line with the reason.
    ParameterError
        If the controller is made for another number of axes.
    """
    check_arguments(order, method, focus, drift)
    require_kind("source", source, str, "a text", IdentificationError)
    require_kind("feedthrough", feedthrough, (bool, np.bool_), "True or False", IdentificationError)
    loop = given_loop(data)
    data = loop.data
    source = source or "; ".join(dict.fromkeys(item.source for item in data.experiments if item.source))
    controller = _controller(data, given_controller(controller, data.sample_time, data) or loop.controller)
    _refuse_unsuitable(controller, focus, feedthrough)
    watch = Watch(progress, cancelled)
    watch.tell("checks", 0, 1)
    report = _checked(data, 1 if order == "auto" else order, controller, feedthrough)
    drifts = report.finding("drift").severity is Severity.WARNING
    tones = None if drift == "none" else cure_tones(data)
    calm = data if tones is None else tones.data
    cure = cure_drift(calm, drift) if drifts or drift == "prefilter" else None
    used = calm if cure is None else cure.data
    watch.tell("checks", 1, 1)
    selection = None
    if isinstance(order, str):
        selection = select_order(used, orders, progress, cancelled, feedthrough)
        order = selection.chosen
        report = _for_order(report, data, order)

    def validated(models: list[StateSpaceModel]) -> list[Identification]:
        if cure is not None:  # the state at the first sample of the data themselves
            models = [replace(model, initial_state=in_experiment(model, calm, 0).initial_state) for model in models]
        watch.tell("validation", 0, 1)
        return [_validate(model, calm, controller, report, selection) for model in models]

    best = max(validated(estimate(used, order, method, watch, source, feedthrough)), key=_quality)
    if focus == "simulation" and controller is not None:

        def focused(start: Identification) -> Identification:
            model = focus_simulation(start.model, calm, controller, progress, cancelled)
            return _validate(model, calm, controller, report, selection)

        found = [focused(best)] if _fades(best) else []
        if not found or np.min(found[0].model.fit) < _GOOD_FIT:
            # the best predictor need not be near the best simulator, nor even make a stable loop
            others = validated(starts_for_simulation(used, order, watch, source, feedthrough))
            other = max([best, *others], key=lambda result: (_fades(result), *_quality(result)))
            if other is not best or not found:
                found.append(focused(other))
        best = max(found, key=_quality)
    elif method == "pem":
        watch.tell("validation", 1, 1)
        watch.tell("uncertainty", 0, 1)
        uncertainty, why_not = _uncertainty(best.model, used, Watch(None, cancelled))
        best = replace(best, uncertainty=uncertainty, no_uncertainty_because=why_not, search=watch.search)
    watch.tell("uncertainty" if best.uncertainty is not None else "validation", 1, 1)
    model = replace(
        best.model,
        fingerprint=fingerprint_of(data, np.sqrt(np.diag(best.model.innovation_covariance))),
        search=best.model.search if best.search is None else best.search.values,
        undecided=() if best.uncertainty is None else (best.uncertainty.at_one,),
    )
    known = best.uncertainty and replace(best.uncertainty, model=model)
    search = SearchEnd.of(model)
    return replace(
        best, data=data, model=model, uncertainty=known, search=search, drift=cure, tones=tones, controller=controller
    )


def check_arguments(order: int | str, method: str, focus: str, drift: str = "auto") -> None:
    """Raise IdentificationError if `identify` does not take one of these arguments, whatever the data."""
    require_word("method", method, METHODS, IdentificationError)
    require_word("focus", focus, get_args(Focus), IdentificationError)
    require_word("drift", drift, get_args(DriftOption), IdentificationError)
    if isinstance(order, str):
        if order != "auto":
            raise IdentificationError(f"order {order!r} is not allowed; allowed: a number or 'auto'")
    else:
        check_order(order)


def _refuse_unsuitable(controller: KnownController | None, focus: Focus, feedthrough: bool) -> None:
    """Raise if focus or feedthrough do not suit data of this controller, None being data of no loop."""
    if focus == "simulation" and controller is None:
        raise IdentificationError("simulation focus needs data of the bearing's loop: currents in A, positions in m")
    if feedthrough and controller is not None:
        raise IdentificationError(
            "feedthrough is not allowed for data of the bearing's loop: its controller responds within the sample, and "
            "the data cannot distinguish this from a plant that does"
        )


def _checked(data: IdentificationData, order: int, controller: KnownController | None, feedthrough: bool) -> DataReport:
    """The report on the data, without errors, and whether they are of this controller."""
    sample_time = None if controller is None else 1.0 / controller.sample_rate
    report = check_data(data, order, sample_time=sample_time, feedthrough=feedthrough)
    report.refuse_errors()
    return replace(report, findings=(*report.findings, check_controller(data, controller)))


def _for_order(report: DataReport, data: IdentificationData, order: int) -> DataReport:
    """The report with new findings where they depend on the order; raises their errors."""
    anew = {finding.check: finding for finding in (check_amount(data, order), check_excitation(data, order))}
    report = replace(report, findings=tuple(anew.get(finding.check, finding) for finding in report.findings))
    report.refuse_errors()
    return report


def _uncertainty(model: StateSpaceModel, data: IdentificationData, watch: Watch) -> tuple[ModelUncertainty | None, str]:
    """The uncertainty; None and the reason if the data do not determine it."""
    try:
        return uncertainty_of(model, data, watch), ""
    except IdentificationError as problem:  # the model is valid without it
        watch.tell("uncertainty", 1, 1)  # raises where the cause is a cancellation
        return None, str(problem)


def _controller(data: IdentificationData, controller: KnownController | None) -> KnownController | None:
    """The controller of the model's closed loop; None for data that do not come from that loop."""
    if controller is None and (data.foreign or not needs_controller(data)):
        return None
    if suits_controller(data):
        controller = controller or ControllerParameters()
        controller.require_axes(len(data.output_names))
        return controller
    units = ", ".join(unit or "unknown" for unit in (*data.input_units, *data.output_units))
    raise IdentificationError(
        f"a controller from positions in m to as many currents in A does not suit data in {units}; "
        "give the data their units (--units), or no controller"
    )


def _validate(
    model: StateSpaceModel,
    data: IdentificationData,
    controller: KnownController | None,
    report: DataReport,
    selection: OrderSelection | None,
) -> Identification:
    if controller is None:
        return Identification(model, data, report, selection, None, (None,) * len(data.experiments), None)
    known = [index for index, item in enumerate(data.experiments) if item.reference is not None]
    simulations: list[LoopRecord | None] = [None] * len(data.experiments)
    fit = np.empty(0)
    try:
        for index in known:
            simulations[index] = simulate_experiment(model, data, index, controller)
        if known:
            fit = _fit(data, simulations)
    except DivergenceError:
        fit = np.full(len(model.c), -np.inf)
    model = replace(model, fit=fit)
    poles = closed_loop_poles(model, controller)
    return Identification(model, data, report, selection, None, tuple(simulations), poles)


def _fit(data: IdentificationData, simulations: list[LoopRecord | None]) -> NDArray[np.float64]:
    """NRMSE fit of all simulations together, each signal about its mean in its experiment (percent)."""
    measured, modelled = [], []
    for index, simulation in enumerate(simulations):
        if simulation is not None:
            position = data.record(index).position
            measured.append(position - position.mean(axis=0))
            modelled.append(simulation.position - position.mean(axis=0))
    return nrmse_fit(np.vstack(measured), np.vstack(modelled))


def _fades(result: Identification) -> bool:
    """Whether the loop of model and controller is stable with the margin that simulation focus needs."""
    return result.closed_loop_poles is not None and bool(np.all(np.abs(result.closed_loop_poles) < LARGEST_RADIUS))


def _quality(result: Identification) -> tuple[bool, float, float]:
    """Stability, the worst fit and, among models that diverge, the size of the one-step prediction errors.

    The data come from a bounded loop, so a model whose loop drifts away, even slowly, is worse.
    """
    size = float(np.linalg.det(result.model.innovation_covariance))
    return result.stable, float(np.min(result.model.fit, initial=np.inf)), -size
