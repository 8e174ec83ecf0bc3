"""Section 4: models from a multisine on both axes at once, over orders and methods, in region A and beyond."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from amb_core.designs.excitation import Trial
from amb_core.excitation import Multisine, Sweep, generate
from amb_core.ground.units import UM
from amb_core.identification import METHODS
from amb_core.loop.control import ControllerParameters
from amb_core.regions import Region
from amb_core.report.figures.chart import Chart
from amb_core.report.figures.drawing import Axis, Item, Panel, Points, Table
from amb_core.report.figures.style import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, Marker
from amb_paper.model_trials import DataSet, ModelTask, ModelTrial, run_trials
from amb_paper.study import LINEAR_IRON, Claim, DrawnFigure, Setting, Study, StudyResult, Workplace

ORDERS = range(4, 17)
PAPER = Multisine(amplitude=50e-6, frequency_start=11.0, frequency_end=400.0, duration=2.0, axes="both")
SAMPLES = 10_000  # of the multisines; then all trials take a few minutes


def _multisine(amplitude: float) -> DataSet:
    return DataSet(f"multisine {UM * amplitude:.0f} µm", PAPER.model_copy(update={"amplitude": amplitude}), SAMPLES)


CONTROL, PAPERS, LARGER = _multisine(25e-6), _multisine(PAPER.amplitude), _multisine(75e-6)
SWEPT = DataSet("sweep 50 µm", Sweep(amplitude=50e-6, duration=2.0, axes="both"), 15_000)  # short, not as in Fig. 15
DATA = (CONTROL, PAPERS, LARGER, SWEPT)
ACCURATE = 90.0  # percent, fit of the worse axis

LOOKS: dict[str, tuple[str, Marker]] = {
    "pem": (BLUE, "circle"),
    "ssarx": (VERMILION, "square"),
    "pbsid": (GREEN, "diamond"),
    "cva": (ORANGE, "triangle"),
    "n4sid": (PURPLE, "circle"),
    "moesp": (SKY, "square"),
}
UNSTABLE = -8.0  # percent; where the figure shows models without a stable closed loop


class MultisineModels(Study):
    """Every method and order on each data set."""

    name = "multisine"
    heading = "Section 4: models from data beyond region A"
    against = LINEAR_IRON
    parallel = False

    def run(self) -> StudyResult:
        """Run in the usual workplace."""
        return self.run_at(Workplace())

    def run_at(self, workplace: Workplace) -> StudyResult:
        """Identify on the cluster, and meanwhile determine the regions."""
        tasks = [ModelTask(data, method, order) for data in DATA for method in METHODS for order in ORDERS]
        as_rms = _as_rms()
        runs: dict[str, Trial] = {}

        def judge_regions() -> None:
            runs.update({data.name: data.trial() for data in (*DATA, as_rms)})

        trials = run_trials(tasks, workplace, judge_regions)
        regions = {data.name: runs[data.name].region for data in DATA}
        return self.result(
            [DrawnFigure.of("multisine-models", _chart(trials, regions))],
            [region_claim(runs, as_rms), beyond_claim(trials, regions), control_claim(trials, regions)],
            {
                "multisine": Setting(
                    f"random phases, {UM * PAPER.amplitude:g} µm, {PAPER.frequency_start:g} Hz to "
                    f"{PAPER.frequency_end:g} Hz on x and y at once",
                    "stated: section 4",
                ),
                "amplitude": Setting("taken as peak value; others: " + ", ".join(data.name for data in DATA[:3])),
                "duration": Setting(f"{PAPER.duration:g} s, of which the last {SAMPLES:,} samples are used"),
                "sweep": Setting(f"as in Fig. 15, but {SWEPT.excitation.duration:g} s long, until the rotor falls"),
                "orders and methods": Setting(f"{ORDERS[0]} to {ORDERS[-1]}; {', '.join(METHODS)}"),
            },
            [
                "A model counts as stable if all poles of its closed loop with the known controller are stable, and "
                "its simulation under the reference of the data stays bounded, with the controller's current limit. "
                "The data have no noise, as in the paper's simulation. A band-limited signal in region A may then "
                "determine fewer states than requested, and the method fails because the excitation is insufficient.",
            ],
        )


def region_claim(runs: Mapping[str, Trial], as_rms: DataSet) -> Claim:
    """Whether the paper's multisine leads through B and C; trials by name of the data, also with 50 um as rms value."""
    region = runs[PAPERS.name].region
    both = {Region.B, Region.C} <= runs[PAPERS.name].onsets.keys()
    reached = "; ".join(
        f"{data.name}: region {runs[data.name].region.name}, bias of y shifted by "
        f"{UM * runs[data.name].bias_shift[1]:.1f} µm"
        for data in (CONTROL, PAPERS, LARGER)
    )
    fallen = runs[as_rms.name]
    excited = float(np.count_nonzero(np.any(fallen.record.reference != 0.0, axis=1)) * fallen.record.sample_time)
    return Claim(
        id="multisine-region",
        paper_figure="Section 4",
        statement="A random-phase multisine of 50 µm, 11 Hz to 400 Hz, on both axes at once drives the bearing into "
        "regions B and C.",
        finding=f"{reached}; with 50 µm as its rms value (peak {UM * _amplitude(as_rms):.0f} µm): region "
        f"{fallen.region.name}, {excited:.2f} s after its start",
        verdict="agrees" if both else "agrees in part" if region > Region.A else "does not agree",
        reason=""
        if both
        else "The paper does not state whether 50 µm is the peak or the rms value; its regions come from an "
        "algorithm that is not public, and from iron whose data it does not state.",
        figure="multisine-models",
    )


def beyond_claim(trials: Sequence[ModelTrial], regions: Mapping[str, Region]) -> Claim:
    """Whether data beyond region A give no stable model; `regions` of the data sets by name."""
    beyond = [trial for trial in trials if regions[trial.data] > Region.A]
    stable = [trial for trial in beyond if trial.stable]
    sets = {trial.data for trial in beyond}
    barren = sets - {trial.data for trial in stable}
    within = [trial for trial in trials if regions[trial.data] is Region.A]
    counts = "; ".join(_counts(trials, name, region) for name, region in regions.items())
    return Claim(
        id="multisine-no-stable-model",
        paper_figure="Section 4",
        statement="From data with behaviour of regions B and C no model with a stable closed loop could be found.",
        finding=counts,
        verdict="does not agree" if not barren else "agrees" if barren == sets else "agrees in part",
        reason=""
        if beyond and barren == sets
        else "None of the data sets left region A."
        if not beyond
        else f"{len(stable)} of {len(beyond)} models from data beyond region A have a stable closed loop, and "
        f"{sum(trial.stable for trial in within)} of {len(within)} of those from region A: the region alone does "
        "not decide. The authors' toolbox, data and settings are not public.",
        figure="multisine-models",
    )


def control_claim(trials: Sequence[ModelTrial], regions: Mapping[str, Region]) -> Claim:
    """Whether region A gives accurate models, and data beyond it worse ones."""
    best = {name: _best(trials, name) for name in regions}
    control = best[CONTROL.name]
    linear = regions[CONTROL.name] is Region.A
    accurate = control is not None and control >= ACCURATE
    within = [-np.inf if fit is None else fit for name, fit in best.items() if regions[name] is Region.A]
    others = [fit for name, fit in best.items() if fit is not None and regions[name] > Region.A]
    beyond = any(region > Region.A for region in regions.values())
    leads = accurate and beyond and min(within) >= ACCURATE and all(min(within) > fit for fit in others)
    fits = "; ".join(f"{name}: {'no stable model' if fit is None else f'{fit:.1f} %'}" for name, fit in best.items())
    return Claim(
        id="multisine-control",
        paper_figure="Sections 4, 5",
        statement="Accurate linear models can be identified, provided that the excitation keeps the bearing in "
        "region A.",
        finding=f"best fit of the worse axis among stable models: {fits}",
        verdict="agrees" if linear and leads else "agrees in part" if linear and accurate else "does not agree",
        reason=""
        if linear and leads
        else "The fit does not separate region A from the other regions: models from data in region A may not be more "
        "accurate. Each model is evaluated on the data from which it was identified."
        if linear and accurate
        else f"The control runs in region {regions[CONTROL.name].name}, and its best model is not accurate enough.",
        figure="multisine-models",
    )


def _counts(trials: Sequence[ModelTrial], name: str, region: Region) -> str:
    mine = [trial for trial in trials if trial.data == name]
    return f"{name}, region {region.name}: {sum(trial.stable for trial in mine)} of {len(mine)} stable"


def _best(trials: Sequence[ModelTrial], name: str) -> float | None:
    fits = [trial.fit for trial in trials if trial.data == name and trial.stable and trial.fit is not None]
    return max(fits, default=None)


def _as_rms() -> DataSet:
    """The multisine whose rms value on its weaker axis is the paper's amplitude."""
    samples = generate(PAPER, ControllerParameters().sample_rate).samples
    rms = float(np.sqrt((samples**2).mean(axis=0)).min())
    return _multisine(PAPER.amplitude**2 / rms)


def _amplitude(data: DataSet) -> float:
    return float(data.excitation.model_dump()["amplitude"])


def _chart(trials: Sequence[ModelTrial], regions: Mapping[str, Region]) -> Chart:
    panels = []
    for name, region in regions.items():
        items: list[Item] = []
        for number, (method, (colour, marker)) in enumerate(LOOKS.items()):
            mine = [trial for trial in trials if (trial.data, trial.method) == (name, method)]
            # Side by side, since several methods give nearly the same model.
            x = np.array([trial.order for trial in mine]) + 0.12 * (number - 2.5)
            stable = np.array([trial.stable for trial in mine])
            fits = [max(trial.fit or 0.0, 0.0) if trial.stable else UNSTABLE for trial in mine]
            hover = tuple(_hover(trial) for trial in mine)
            for chosen, filled in ((stable, True), (~stable, False)):
                if chosen.any():
                    texts = tuple(text for text, shown in zip(hover, chosen, strict=True) if shown)
                    items.append(Points(x[chosen], np.array(fits)[chosen], method, colour, marker, filled, texts))
        axis = Axis("fit of the worse axis (%)", limits=(2.0 * UNSTABLE, 105.0))
        panels.append(Panel(Axis("order"), axis, tuple(items), _counts(trials, name, region)))
    rows = tuple(
        (name, regions[name].name, method, _orders(trials, name, method)) for name in regions for method in LOOKS
    )
    alt = (
        "Fit of the closed loop of models over their order, for each method and data set, those without a "
        f"stable closed loop hollow and below zero. {'; '.join(panel.title for panel in panels)}."
    )
    table = Table(("data", "region", "method", "orders with a stable closed loop"), rows)
    return Chart(
        "Models over orders and methods; hollow: no stable closed loop",
        alt,
        tuple(panels),
        columns=2,
        size=(12.0, 8.4),
        table=table,
    )


def _hover(trial: ModelTrial) -> str:
    if trial.radius is None:
        return f"{trial.method}, order {trial.order}: no model ({trial.problem})"
    fit = "diverges" if trial.fit is None else f"fit {trial.fit:.1f} %"
    return f"{trial.method}, order {trial.order}: largest pole {trial.radius:.4f}, {fit}"


def _orders(trials: Sequence[ModelTrial], name: str, method: str) -> str:
    orders = [trial.order for trial in trials if (trial.data, trial.method) == (name, method) and trial.stable]
    return "all" if len(orders) == len(ORDERS) else ", ".join(map(str, orders)) or "none"
