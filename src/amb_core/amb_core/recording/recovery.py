"""Makes a whole bag from what is left of one whose recorder was killed, or whose disk was full or damaged.

The bag is read twice, message by message: to find out what is there, and to copy it. Memory use does not depend on its
length, except for the index of the file in progress. The bag itself is never changed.
"""

from __future__ import annotations

import shutil
import stat
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from amb_core.ground.errors import BagError
from amb_core.ground.files.regular_files import is_folder
from amb_core.ground.given_values import path_of, require_kind
from amb_core.ground.progress import Progress, unseen
from amb_core.recording.bag_metadata import METADATA, write_metadata
from amb_core.recording.bag_reader import BagApart
from amb_core.recording.mcap_file import FileContent, McapFile, StoredTopic
from amb_core.recording.mcap_scan import McapScan, NotMcapError
from amb_core.recording.messages.loop_samples import LOOP_SAMPLES, block_from_message
from amb_core.recording.step_audit import StepAudit
from amb_core.recording.storage import description_of, files_by_number, listed_files, mode_of
from amb_core.recording.topic_info import TopicInfo

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
REPORTED = 1 << 20  # bytes between two calls


@dataclass(frozen=True)
class BagState:
    """What a bag holds, as far as it can be read.

    Attributes
    ----------
    path : Path
        The bag.
    files : list of Path
        Its files, in order.
    described : list of StoredTopic
        Its topics as stored.
    topics : list of TopicInfo
        Its topics with the numbers of messages, by name.
    runs : dict of (str, int) to StepAudit
        The samples of the loop, by topic and run.
    damage : list of str
        What cannot be read or is missing, one text each; empty for a whole bag.
    """

    path: Path
    files: list[Path]
    described: list[StoredTopic]
    topics: list[TopicInfo]
    runs: dict[tuple[str, int], StepAudit]
    damage: list[str]

    @property
    def messages(self) -> int:
        """Number of messages."""
        return sum(topic.messages for topic in self.topics)


def inspect_bag(path: str | Path, progress: Progress | None = None) -> BagState:
    """Read a bag of MCAP files to its end, and report what it holds and what it lacks.

    Parameters
    ----------
    path : str or Path
        A folder or an `.mcap` file.
    progress : callable, optional
        Called with the bytes read so far and in all, see `amb_core.ground.progress.Progress`. None for no calls.

    Returns
    -------
    BagState
        Topics, counts and damage.

    Raises
    ------
    BagError
        If there is no such bag.
    """
    path = path_of("path", path, BagError)
    files, damage = _files_of(path)
    report = _Reporter("reading", files, progress)
    topics: dict[tuple[str, str], StoredTopic] = {}
    counts: Counter[tuple[str, str]] = Counter()
    for file in list(files):
        scan = McapScan(file)
        try:
            for topic, message in scan.messages():
                _refuse_compressed(path, message.data)
                counts[topic.key] += 1
                report(scan)
        except NotMcapError as problem:
            files.remove(file)
            damage.append(str(problem))
        topics = scan.topics | topics
        damage += scan.damage
        report.finished(scan)
    damage += _contradictions(path, counts.total())
    described = [TopicInfo(name, kind, counts[name, kind]) for name, kind in sorted(topics)]
    runs = _audited(files) if any(topic.type == LOOP_SAMPLES for topic in described) else {}
    return BagState(path, files, list(topics.values()), described, runs, damage)


def recover_bag(state: BagState, out: str | Path, progress: Progress | None = None) -> Path:
    """Copy everything that can be read into a new bag, with index and `metadata.yaml`.

    Parameters
    ----------
    state : BagState
        The bag, from `inspect_bag`.
    out : str or Path
        Folder of the new bag; must not exist. It is removed again if the copy does not come to its end.
    progress : callable, optional
        Called with the bytes read so far and in all, see `amb_core.ground.progress.Progress`. None for no calls.

    Returns
    -------
    Path
        The new bag.

    Raises
    ------
    BagError
        If nothing can be read, or the new bag cannot be written.
    """
    require_kind("state", state, BagState, "what inspect_bag returns", BagError)
    folder = path_of("out", out, BagError).absolute()
    if not state.messages:
        raise BagError(f"bag {state.path}: no message can be read: {'; '.join(state.damage) or 'it is empty'}")
    try:
        folder.mkdir(parents=True)
    except FileExistsError:
        raise BagError(f"bag {folder}: exists already; name a folder that does not") from None
    except OSError as problem:
        raise BagError(f"bag {folder}: cannot be made: {problem.strerror}") from None
    try:
        report = _Reporter("copying", state.files, progress)
        contents = [_copy(file, folder, number, state.described, report) for number, file in enumerate(state.files)]
        write_metadata(folder, state.described, contents, ros_distro="")
    except BaseException as problem:
        shutil.rmtree(folder, ignore_errors=True)
        if isinstance(problem, OSError):
            raise BagError(f"bag {folder}: cannot be written: {problem.strerror}") from None
        raise
    return folder


def _copy(file: Path, folder: Path, number: int, topics: Sequence[StoredTopic], report: _Reporter) -> FileContent:
    copy = McapFile(folder / f"{folder.name}_{number}.mcap")
    try:
        for topic in topics:
            copy.add_topic(topic)
        scan = McapScan(file)
        for topic, message in scan.messages():
            copy.write(topic, message.data, message.log_time, message.publish_time, message.sequence)
            report(scan)
        report.finished(scan)
    finally:
        copy.close()
    return copy.content


def _files_of(path: Path) -> tuple[list[Path], list[str]]:
    """The files of a bag, and what is missing of them."""
    if not stat.S_ISDIR(mode_of(path)):
        if path.suffix != ".mcap":
            raise BagError(f"bag {path}: not a folder or an .mcap file")
        return [path], []
    if compressed := [file.name for file in files_by_number(path.glob("*.mcap.zstd"))]:
        raise BagError(f"bag {path}: has compressed files; decompress them first: zstd -d {' '.join(compressed)}")
    files = files_by_number(path.glob("*.mcap"))
    if not files:
        raise BagError(f"bag {path}: the folder holds no .mcap file; other bags cannot be recovered")
    listed = listed_files(path, description_of(path))
    missing = {file.name for file in listed} - {file.name for file in files}
    return files, [f"{name} is missing" for name in sorted(missing)]


def _refuse_compressed(path: Path, data: bytes) -> None:
    if data.startswith(ZSTD_MAGIC):
        raise BagError(f"bag {path}: its messages were compressed by ros2 bag record; such a bag cannot be recovered")


def _contradictions(path: Path, messages: int) -> list[str]:
    if not is_folder(path):
        return []
    description = description_of(path)
    if not description:
        return [f"{METADATA} is missing or cannot be read"]
    listed = description.get("message_count")
    if not isinstance(listed, int):
        return [f"{METADATA} has no number of messages"]
    return [] if listed == messages else [f"{METADATA} lists {listed} messages, and {messages} can be read"]


def _audited(files: Sequence[Path]) -> dict[tuple[str, int], StepAudit]:
    """The samples of the loop, by topic and run; telemetry that cannot be decoded is copied, but has no steps."""
    runs: dict[tuple[str, int], StepAudit] = {}
    for file in files:
        for message in BagApart(file).messages(types=[LOOP_SAMPLES], lenient=True):
            try:
                block = block_from_message(message.content)
            except BagError:
                continue
            runs.setdefault((message.topic, int(message.content.run)), StepAudit()).add(block.first_step, block.steps)
    return runs


class _Reporter:
    """Reports how far the files were read."""

    def __init__(self, stage: str, files: Sequence[Path], progress: Progress | None) -> None:
        self._stage = stage
        self._total = sum(file.stat().st_size for file in files)
        self._progress = progress or unseen
        self._before = 0
        self._next = REPORTED

    def __call__(self, scan: McapScan) -> None:
        if self._before + scan.position >= self._next:
            self._next = self._before + scan.position + REPORTED
            self._progress(self._stage, self._before + scan.position, self._total)

    def finished(self, scan: McapScan) -> None:
        self._before += scan.size
        self._progress(self._stage, self._before, self._total)
