"""Runs the studies: those that can in parallel, finished ones from the disk."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from amb_bringup.paper.study import Study, StudyError, StudyResult, Workplace
from amb_core.errors import AmbError
from amb_core.tasks import ResultCache

POLL = 1.0  # s; how long workers that have failed may go unnoticed, no more depends on it


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
    RegionError
        If the scheduler does not answer, or is lost.
    """
    from amb_core.tasks.pool import TaskPool  # dask takes half a second to import

    workplace = workplace or Workplace()
    kept = ResultCache(workplace.cache)
    results: dict[str, StudyResult] = {}
    problems: list[str] = []
    waiting: dict[str, Study] = {}
    reused = 0

    def report(last: str) -> None:
        if progress is not None:
            progress(CampaignProgress(len(results) + len(problems), len(studies), reused, last))

    def take(study: Study, key: str, result: StudyResult | AmbError) -> None:
        if isinstance(result, AmbError):
            problems.append(f"{study.name}: {result}")
        else:
            results[study.name] = result
            kept.ensure(key, study, result)
        report(study.name)

    with TaskPool[StudyResult](workplace.scheduler, workplace.workers) as pool:
        own: dict[str, Study] = {}
        for study in studies:
            key = study.key()
            known = kept.load(key, study) if study.files_are_whole(workplace.folder) else None
            if known is not None:
                results[study.name] = known
                reused += 1
            elif study.parallel:
                pool.submit(study, key, kept.folder)
                waiting[key] = study
            else:
                own[key] = study
        report("")
        while waiting:
            finished = pool.next_finished(POLL)
            if finished is not None:
                take(waiting.pop(finished[0]), *finished)
    for key, study in own.items():  # after the others, since these have the whole machine
        workplace.tell(study.name)
        try:
            take(study, key, study.run_at(workplace))
        except AmbError as problem:
            take(study, key, problem)
    if problems:
        raise StudyError("; ".join(problems))
    return {study.name: results[study.name] for study in studies}
