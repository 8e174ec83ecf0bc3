"""A study: reproduces one figure or claim of the paper; and its results."""

from __future__ import annotations

import base64
import hashlib
import io
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, ClassVar

from amb_bringup.graph.packages import share_folder
from amb_core.ground.errors import AmbError
from amb_core.ground.tasks import Task, cache_folder
from amb_core.ground.tasks.provenance import code_version
from amb_core.report.figures.chart import Chart
from amb_core.report.pages import Answer


class StudyError(AmbError):
    """A study is unknown or has failed, or its results cannot be written."""


@dataclass(frozen=True)
class Claim:
    """A statement of the paper compared with the simulator.

    Attributes
    ----------
    id : str
        Short name, of letters, digits and hyphens.
    paper_figure : str
        Figure, equation or section of the paper.
    statement : str
        Statement of the paper, in our words.
    finding : str
        Our result, with numbers of this run.
    verdict : Answer
        Whether both agree.
    reason : str
        Why they do not, or only in part; empty if they agree and no comment is needed.
    figure : str
        Name of our figure that shows it.
    """

    id: str
    paper_figure: str
    statement: str
    finding: str
    verdict: Answer
    reason: str = ""
    figure: str = ""


def judged(as_stated: Sequence[bool], changed: Sequence[bool] = ()) -> Answer:
    """The verdict on a claim: it agrees only where it holds with everything that the paper states.

    Parameters
    ----------
    as_stated : sequence of bool
        Whether its parts hold for bearings that keep to what the paper states; what it does not state is assumed.
    changed : sequence of bool, optional
        Whether it holds for bearings with another value than the paper states: then it agrees in part at most.
    """
    if as_stated and all(as_stated):
        return "agrees"
    return "agrees in part" if any((*as_stated, *changed)) else "does not agree"


def with_another_value(claim: Claim, *values: str) -> Claim:
    """A claim that was evaluated on a bearing with other values than the paper states: it agrees in part at most."""
    verdict: Answer = "agrees in part" if claim.verdict == "agrees" else claim.verdict
    reason = f"This experiment has {' and '.join(values)}, against the paper. {claim.reason}".strip()
    return replace(claim, verdict=verdict, reason=reason)


@dataclass(frozen=True)
class Setting:
    """A setting of an experiment: its value with unit, and its source.

    The source is the place where the paper states the value *of the figure or claim that the study is about*
    (`stated: table 1`), or where it states another one (`against table 1`); all else is `assumed`.
    """

    value: str
    source: str = "assumed"


LINEAR_IRON: Mapping[str, Setting] = {"iron": Setting("iron without saturation and hysteresis", "against section 2.4")}
"""Of the default bearing. Section 2.4 has both in the simulation of Fig. 9, taken here for all of the paper's."""


@dataclass(frozen=True)
class DrawnFigure:
    """A figure, drawn: as PNG, and as the JSON of a plotly figure."""

    name: str
    title: str
    png: bytes
    page: str

    @classmethod
    def of(cls, name: str, chart: Chart) -> DrawnFigure:
        """Draw a chart both ways."""
        image = io.BytesIO()
        chart.figure().savefig(
            image,
            format="png",
            metadata={"Title": chart.title, "Description": chart.alt},
            pil_kwargs={"optimize": True},
        )
        return cls(name, chart.title, image.getvalue(), chart.page().to_json())


@dataclass(frozen=True)
class StudyResult:
    """Results of a study.

    Attributes
    ----------
    figures : sequence of DrawnFigure
        In the order in which the report shows them.
    claims : sequence of Claim
        Likewise.
    parameters : mapping of str to Setting
        Settings of the experiment, by name.
    notes : sequence of str
        Paragraphs for the report that explain the figures.
    """

    figures: Sequence[DrawnFigure]
    claims: Sequence[Claim]
    parameters: Mapping[str, Setting] = field(default_factory=dict)
    notes: Sequence[str] = ()


def _report_nowhere(doing: str) -> None:
    pass


@dataclass(frozen=True)
class Workplace:
    """Resources of a study that is not parallel, in addition to its own process.

    Attributes
    ----------
    folder : Path
        For files that belong to its result, such as bags.
    cache : Path
        For results of its own tasks.
    scheduler, workers : optional
        Of a cluster, as for `amb_core.ground.tasks.cluster.open_cluster`.
    report : callable
        Called with the present activity, such as `sweep 3 of 23`.
    """

    folder: Path = Path("results/paper")
    cache: Path = field(default_factory=lambda: cache_folder("paper"))
    scheduler: str | None = None
    workers: int | None = None
    report: Callable[[str], None] = _report_nowhere


class Study(Task[StudyResult]):
    """Reproduces a figure or claim of the paper. Studies have no parameters: those of the paper are in their code.

    Attributes
    ----------
    name : str
        Short name, of letters, digits and hyphens; different for each study.
    heading : str
        Heading of its section in the report.
    parallel : bool
        Whether it runs on a worker of the cluster; otherwise it runs in the program itself and may use cluster or ROS.
    against : mapping of str to Setting
        Settings of all its bearings that the paper states otherwise: its claims agree in part at most.
    """

    name: ClassVar[str]
    heading: ClassVar[str]
    parallel: ClassVar[bool] = True
    against: ClassVar[Mapping[str, Setting]] = {}

    @abstractmethod
    def run(self) -> StudyResult:
        """Run the experiments, draw the figures, evaluate the claims."""

    def run_at(self, workplace: Workplace) -> StudyResult:
        """As `run`, for a study that is not parallel and writes files or uses the cluster."""
        return self.run()

    def result(
        self,
        figures: Sequence[DrawnFigure],
        claims: Sequence[Claim],
        parameters: Mapping[str, Setting],
        notes: Sequence[str],
        ours: Sequence[Claim] = (),
    ) -> StudyResult:
        """Its result, with the settings `against` the paper; they limit the verdicts on `claims`, not those on `ours`.

        Parameters
        ----------
        figures, claims, parameters, notes
            As in `StudyResult`.
        ours : sequence of Claim, optional
            Our own statements, which the paper does not make.
        """
        if self.against:
            values = [setting.value for setting in self.against.values()]
            claims = [with_another_value(claim, *values) for claim in claims]
        return StudyResult(figures, [*claims, *ours], {**parameters, **self.against}, notes)

    def files_are_whole(self, folder: Path) -> bool:
        """Whether its files in the folder of a workplace are complete; otherwise it is run again."""
        return True

    def describe(self) -> dict[str, Any]:
        """Name and versions: of the library, of the studies, and of the bearing."""
        bearing = share_folder("amb_bringup") / "config" / "paper.yaml"
        return {
            "study": self.name,
            "library": code_version(),
            "studies": code_version("amb_paper"),
            "graph": code_version("amb_bringup"),
            "bearing": hashlib.sha256(bearing.read_bytes()).hexdigest(),
        }

    @staticmethod
    def to_json(result: StudyResult, /) -> dict[str, Any]:
        """A result as JSON values."""
        figures = [
            {"name": one.name, "title": one.title, "png": base64.b64encode(one.png).decode(), "page": one.page}
            for one in result.figures
        ]
        return {
            "figures": figures,
            "claims": [asdict(claim) for claim in result.claims],
            "parameters": {name: asdict(setting) for name, setting in result.parameters.items()},
            "notes": list(result.notes),
        }

    @staticmethod
    def from_json(entry: dict[str, Any], /) -> StudyResult:
        """The result that `to_json` wrote."""
        figures = [
            DrawnFigure(one["name"], one["title"], base64.b64decode(one["png"]), one["page"])
            for one in entry["figures"]
        ]
        claims = [Claim(**claim) for claim in entry["claims"]]
        parameters = {name: Setting(**setting) for name, setting in entry["parameters"].items()}
        return StudyResult(figures, claims, parameters, entry["notes"])
