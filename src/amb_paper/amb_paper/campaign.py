"""Runs the studies, in parallel where possible; finished ones are read from the disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from amb_core.ground.errors import AmbError
from amb_core.ground.tasks import Request, ResultCache, run
from amb_paper.study import Study, StudyError, StudyResult, Workplace


@dataclass(frozen=True)
class CampaignProgress:
    """Progress of the studies: how many of `total` are done, `reused` of them from the disk, and the last one."""

    done: int
    total: int
    reused: int
    last: str


def run_campaign(
    studies: Sequence[Study],
    workplace: Workplace | None = None,
    *,
    progress: Callable[[CampaignProgress], None] | None = None,
) -> dict[str, StudyResult]:
    """Results of studies by name, in their order; studies finished earlier with the same code are not run again.

    Parameters
    ----------
    studies : sequence of Study
        With different names.
    workplace : Workplace, optional
        Its cluster, and the folders for results and for files of the studies.
    progress : callable, optional
        Called at the start and after each study.

    Raises
    ------
    StudyError
        If studies fail, after the others have been run.
    TaskError
        If the scheduler does not answer, or is lost.
    """
    workplace = workplace or Workplace()
    campaign = _Campaign(studies, workplace, progress or (lambda _: None))
    missing = campaign.take_kept()
    requests = [Request(study, partial(campaign.take, study), reuse=False) for study in missing if study.parallel]
    run(requests, campaign.cache, workplace.scheduler, workplace.workers)
    for study in missing:
        if not study.parallel:  # after the others, since it uses the whole machine
            workplace.report(study.name)
            campaign.run_here(study)
    if campaign.problems:
        raise StudyError("; ".join(campaign.problems))
    return {study.name: campaign.results[study.name] for study in studies}


class _Campaign:
    """Results of studies, and the reasons of those without one."""

    def __init__(
        self, studies: Sequence[Study], workplace: Workplace, progress: Callable[[CampaignProgress], None]
    ) -> None:
        self.cache = ResultCache(workplace.cache)
        self.results: dict[str, StudyResult] = {}
        self.problems: list[str] = []
        self._studies, self._workplace, self._progress = studies, workplace, progress
        self._reused = 0

    def take_kept(self) -> list[Study]:
        """Read results from the disk. Returns the studies without one."""
        missing = []
        for study in self._studies:
            whole = study.files_are_whole(self._workplace.folder)
            known = self.cache.load(study.key(), study) if whole else None
            if known is None:
                missing.append(study)
            else:
                self.results[study.name] = known
        self._reused = len(self.results)
        self._report("")
        return missing

    def take(self, study: Study, result: StudyResult | AmbError, _kept: bool = False) -> tuple[()]:
        """Store the result of a study or its error; no further task follows from it."""
        if isinstance(result, AmbError):
            self.problems.append(f"{study.name}: {result}")
        else:
            self.results[study.name] = result
        self._report(study.name)
        return ()

    def run_here(self, study: Study) -> None:
        """Run a study in this process, and keep its result."""
        try:
            result = study.run_at(self._workplace)
        except AmbError as problem:
            self.take(study, problem)
        else:
            self.cache.ensure(study.key(), study, result)
            self.take(study, result)

    def _report(self, last: str) -> None:
        done = len(self.results) + len(self.problems)
        self._progress(CampaignProgress(done, len(self._studies), self._reused, last))
