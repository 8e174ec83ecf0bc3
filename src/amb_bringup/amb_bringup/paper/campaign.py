"""Runs the studies: those that can in parallel, finished ones from the disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from amb_bringup.paper.study import Study, StudyError, StudyResult, Workplace
from amb_core.errors import AmbError
from amb_core.tasks import Request, ResultCache, run


@dataclass(frozen=True)
class CampaignProgress:
    """How far the studies are: how many of `total` are done, `reused` of them from the disk, and the last one."""

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
    """Results of studies by name, in their order; what has been run before with the same code is not run again.

    Parameters
    ----------
    studies : sequence of Study
        With different names.
    workplace : Workplace, optional
        Its cluster, where results are kept, and where studies leave files.
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
    kept = ResultCache(workplace.cache)
    results: dict[str, StudyResult] = {}
    problems: list[str] = []
    reused = 0

    def report(last: str) -> None:
        if progress is not None:
            progress(CampaignProgress(len(results) + len(problems), len(studies), reused, last))

    def take(study: Study, result: StudyResult | AmbError, _kept: bool = False) -> tuple[()]:
        if isinstance(result, AmbError):
            problems.append(f"{study.name}: {result}")
        else:
            results[study.name] = result
        report(study.name)
        return ()

    missing = []
    for study in studies:
        known = kept.load(study.key(), study) if study.files_are_whole(workplace.folder) else None
        if known is None:
            missing.append(study)
        else:
            results[study.name] = known
            reused += 1
    report("")
    parallel = [Request(study, partial(take, study), reuse=False) for study in missing if study.parallel]
    run(parallel, kept, workplace.scheduler, workplace.workers)
    for study in missing:  # these after the others, since they have the whole machine
        if study.parallel:
            continue
        workplace.tell(study.name)
        try:
            result = study.run_at(workplace)
        except AmbError as problem:
            take(study, problem)
        else:
            kept.ensure(study.key(), study, result)
            take(study, result)
    if problems:
        raise StudyError("; ".join(problems))
    return {study.name: results[study.name] for study in studies}
