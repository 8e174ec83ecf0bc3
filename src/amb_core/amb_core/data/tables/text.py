"""Text tables: comma, semicolon, tab or space between columns, decimal points or commas, headings in one or two rows.

What separates columns and decimals is the choice in which most rows are numbers of one count of columns; where that
leaves a doubt, the options `separator` and `decimal` decide.
"""

from __future__ import annotations

import csv
import io
import itertools
import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from amb_core.data.tables.headings import are_fractions, counts_columns, headings_of, without_row_names
from amb_core.data.tables.table import Column, Table
from amb_core.ground.errors import IdentificationError
from amb_core.ground.files.apart import read_apart
from amb_core.ground.files.limits import LONGEST_LINE, MOST_COLUMNS
from amb_core.ground.files.regular_files import open_regular

SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "bar": "|", "space": " "}
DECIMALS = {"point": ".", "comma": ","}
MISSING = {"", "nan", "na", "n/a", "#n/a", "null", "none", "-", "--", "---", "nil", "inf", "-inf", "+inf"}
WRITTEN = "# amb_core "
"""Begins the first line of a text that this workbench has written; JSON of what its columns do not contain follows."""
_COMMENTS = ("#", "%", "//", "!")
_LOOKED_AT = 60  # rows from which the format is found

Cells = list[list[str]]


def read_text_table(path: Path, separator: str = "", decimal: str = "") -> Table:
    """Read a text table in a child process; `separator` and `decimal` are words of `SEPARATORS` and `DECIMALS`.

    Raises
    ------
    IdentificationError
        If it has no rows of numbers, rows of different lengths, or more columns or longer lines than are allowed.
    """
    columns, notes, about = read_apart(f"{__name__}:columns_of_text", path, separator, decimal)
    return Table(str(path), tuple(Column(*column) for column in columns), notes=tuple(notes), about=about)


def columns_of_text(
    path: str, separator: str, decimal: str
) -> tuple[list[tuple[str, NDArray[np.float64], str, str, bool]], list[str], dict[str, Any] | None]:
    """As `read_text_table` in this process: the attributes of the columns, the notes, and the JSON of a written one."""
    text = _read(path)
    about = text.about
    mark, point = _format(text.lines, separator, decimal) if about is None else (",", ".")
    notes = [f"columns separated by {_name(SEPARATORS, mark)}", *["decimal commas"] * (point == ",")]
    rows = _cells(text.lines, mark)
    first, count = _start(rows, point, written=about is not None)
    numbers = _numbers(rows[first:], count, point)
    if text.cut or len(numbers) < len(rows) - first:
        notes.append("the last row is cut off and was left out")
    above = _cells([text.comment], mark)[0] if text.comment and about is None else []
    headings, fewer, found = _headings(rows[:first], above, count, point)
    notes += found
    if between := sum(first < line < len(rows) for line in text.comments):
        notes.append(f"comments between the samples, left out: {between}; without times no sample is missing there")
    if not headings and counts_columns(rows[first]):
        shown = ", ".join(filter(None, rows[first]))
        if are_fractions(rows[first + 1 : first + len(numbers)], range(int(not rows[first][0]), count)):
            headings, numbers = [(name, "") for name in rows[first]], numbers[1:]
            notes.append(f"names of the columns from the first row: {shown}")
        else:
            notes.append(f"the first row, {shown}, is taken as a sample; if it has names of the columns, leave it out")
    if fewer:
        numbers, headings, count = without_row_names(numbers), headings[1:], count - 1
        notes.append("the first column has no name and those of the rows: left out")
    columns = []
    for index in range(count):
        if index < len(headings):
            name, unit = headings[index]
            columns.append((name or f"column {index}", numbers[:, index], unit, "", bool(name)))
        else:
            columns.append((f"column {index}", numbers[:, index], "", "", False))
    return columns, notes, about


def _headings(
    rows: Cells, comment: Sequence[str], count: int, point: str
) -> tuple[list[tuple[str, str]], bool, list[str]]:
    """As `headings_of` the rows above the numbers, or a comment above them; and notes."""
    notes = []
    headings, fewer = headings_of([row for row in rows if not _is_empty(row)], count)
    if not headings and _are_names(comment, count, point):
        headings, _ = headings_of([comment], count)
        notes.append("names of the columns from the comment above them")
    if empty := sum(1 for _ in itertools.takewhile(_is_empty, reversed(rows))):
        notes.append(f"rows without a number above the first sample, left out: {empty}")
    return headings, fewer, notes


class _Text(NamedTuple):
    lines: list[str]  # without comments
    cut: bool  # whether the last line was cut off and is left out
    comment: str  # the last one above all lines
    comments: list[int]  # numbers of the lines above each comment
    about: dict[str, Any] | None  # JSON of a written text


def _start(rows: Cells, point: str, written: bool) -> tuple[int, int]:
    """The first row of numbers, and the number of columns, which is that of the last rows."""
    # the one heading of a written text may be of numbers
    data = [index for index, row in enumerate(rows) if _is_data(row, point) and (not written or index)]
    if not data:
        raise IdentificationError(
            "there are no samples: no row is of numbers; name what separates them with --separator, --decimal"
        )
    count = Counter(len(rows[index]) for index in data[-_LOOKED_AT:]).most_common(1)[0][0]
    if count > MOST_COLUMNS:
        raise IdentificationError(f"has {count} columns; allowed: at most {MOST_COLUMNS}")
    # lines such as Points,700 may stand above, but no samples of fewer or more columns
    return next(index for index in data if len(rows[index]) == count or _are_numbers(rows[index], point)), count


def _are_numbers(row: Sequence[str], point: str) -> bool:
    """Whether a row has two or more numbers, and no text."""
    numbers = [_number(cell, point) for cell in row]
    return None not in numbers and sum(not _is_empty([cell]) for cell in row) > 1


def _is_empty(row: Sequence[str]) -> bool:
    """Whether all cells of a row lack a number."""
    return all(cell.lower() in MISSING for cell in row)


def _are_names(cells: Sequence[str], count: int, point: str) -> bool:
    """Whether a comment, split into cells, names all columns."""
    return len(cells) == count and all(cell.strip() and not _is_data([cell], point) for cell in cells)


def _read(path: str) -> _Text:
    """The lines of a file, and what its comments say."""
    with open_regular(path) as file:
        content = file.read()
    encoding = "utf-16" if content.startswith((b"\xff\xfe", b"\xfe\xff")) else "utf-8-sig"
    try:
        text = content.decode(encoding)
    except UnicodeDecodeError:
        text = content.decode("cp1252", errors="replace")  # as spreadsheets of older systems write
    if "\x00" in text:
        raise IdentificationError("is not a text; files of numbers end in .csv, .mat, .npz or .parquet")
    written = [line for line in text.splitlines() if line.strip()]
    lines = [line for line in written if not _is_comment(line)]
    if not lines:
        raise IdentificationError("is empty: there must be rows of numbers, below the names of the columns")
    if longest := max(map(len, lines)) // LONGEST_LINE:
        raise IdentificationError(f"has a line of {longest} MiB; allowed: rows of at most {MOST_COLUMNS} numbers")
    before = lines[-_LOOKED_AT:-1]
    cut = bool(before) and not text.endswith(("\n", "\r")) and len(lines[-1]) < min(map(len, before)) - 1
    about = json.loads(text.splitlines()[0].removeprefix(WRITTEN)) if text.startswith(WRITTEN) else None
    above = list(itertools.takewhile(_is_comment, written))
    comment = above[-1].strip().lstrip("".join(_COMMENTS)).strip() if above else ""
    places = [index for index, line in enumerate(written) if _is_comment(line)]
    comments = [index - earlier for earlier, index in enumerate(places)]
    return _Text(lines[:-1] if cut else lines, cut, comment, comments, about)


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(_COMMENTS)


def _format(lines: Sequence[str], separator: str, decimal: str) -> tuple[str, str]:
    """What separates columns and decimals: as given, or in what most rows are numbers and fewest cells are texts."""
    marks = [_of(SEPARATORS, separator, "separator")] if separator else list(SEPARATORS.values())
    points = [_of(DECIMALS, decimal, "decimal")] if decimal else list(DECIMALS.values())
    half = lines[len(lines) // 2 : -_LOOKED_AT]  # the last rows may be of whole numbers only
    sample = [*half[:: len(half) // _LOOKED_AT + 1], *lines[-_LOOKED_AT:]]
    best, choice = -1.0, (marks[0], points[0])
    for mark in marks:
        rows = _cells(sample, mark)
        for point in points:
            if mark == point and not any('"' in line for line in sample):
                continue
            good = [row for row in rows if _is_data(row, point)]
            if not good:
                continue
            width = Counter(map(len, good)).most_common(1)[0][0]
            same = [row for row in good if len(row) == width]
            # a text in a row of numbers, such as 001;1, has more than one of them if separated otherwise
            numbers = sum(_number(cell, point) is not None for row in same for cell in row)
            score = numbers / (width * len(rows)) + (0.5 if width > 1 else 0.0) + 1e-3 * width
            if score > best + 1e-9:
                best, choice = score, (mark, point)
    mark, point = choice
    if not separator and not decimal and mark == "," and best >= 0.0:
        _refuse_ambiguous(lines)
    return choice


def _refuse_ambiguous(lines: Sequence[str]) -> None:
    """Refuse commas that may separate columns or decimals: twice as many columns of numbers as names."""
    rows = _cells(lines, ",")
    first = next((index for index, row in enumerate(rows) if _is_data(row, ".")), 0)
    if first and len(rows[first - 1]) >= 2 and len(rows[first]) == 2 * len(rows[first - 1]):
        raise IdentificationError(
            f"{len(rows[first - 1])} names stand above {len(rows[first])} numbers: commas may separate columns and "
            "decimals; save the file with other separators (--separator semicolon --decimal comma), or quoted"
        )


def _cells(lines: Sequence[str], mark: str) -> Cells:
    if mark == " ":
        return [line.split() for line in lines]
    rows = csv.reader(io.StringIO("\n".join(lines)), delimiter=mark, skipinitialspace=True)
    cells = [[cell.strip() for cell in row] for row in rows]
    width = Counter(map(len, cells[len(cells) // 2 :])).most_common(1)[0][0]
    if width <= 1 or any(row[-1] for row in cells if len(row) == width):  # a last column with a name or a number
        return cells
    return [row[:-1] if len(row) > 1 and not row[-1] else row for row in cells]  # a separator ends each row


def _is_data(row: Sequence[str], point: str) -> bool:
    """Whether a row is of numbers: at least one, and no more texts than numbers."""
    numbers = sum(_number(cell, point) is not None and cell.lower() not in MISSING for cell in row)
    texts = sum(_number(cell, point) is None for cell in row)
    return numbers > 0 and texts <= numbers


def _number(cell: str, point: str, epoch: int = 0) -> float | None:
    """A number, NaN for a missing one, None for a text; of a date and time the seconds since an epoch (ns)."""
    if cell.lower() in MISSING:
        return np.nan
    if point == ",":
        if "." in cell:
            return None
        cell = cell.replace(",", ".")
    try:
        return float(cell)
    except ValueError:
        stamp = _stamp(cell)
        return None if stamp is None else 1e-9 * (stamp - epoch)


def _stamp(cell: str) -> int | None:
    """A date and time in ISO 8601 in ns since 1970; None for another text."""
    if len(cell) < 16 or not cell[:4].isdigit():
        return None
    try:
        return int(np.datetime64(cell.rstrip("Z").replace(" ", "T"), "ns").astype(np.int64))
    except ValueError:
        return None


def _numbers(rows: Cells, count: int, point: str) -> NDArray[np.float64]:
    wrong = next((index for index, row in enumerate(rows) if len(row) != count), None)
    if wrong is not None and wrong == len(rows) - 1 and len(rows) > 2:
        rows = rows[:-1]  # the record was cut off within its last row
        wrong = None
    if wrong is not None:
        raise IdentificationError(
            f"is damaged: row {wrong + 1} of the numbers has {len(rows[wrong])} columns, the last rows have {count}; "
            "correct it, or name what separates them with --separator, --decimal"
        )
    try:
        if point == ".":
            return np.array(rows, dtype=np.float64)  # all numbers, which is the rule
    except ValueError:
        pass
    numbers = np.empty((len(rows), count))
    for index in range(count):
        # a double holds no us of a date: dates and times count from the first
        epoch = next((stamp for row in rows if (stamp := _stamp(row[index])) is not None), 0)
        values = [_number(row[index], point, epoch) for row in rows]
        texts = [row[index] for row, value in zip(rows, values, strict=True) if value is None]
        if texts and 2 * len(texts) < len(rows):
            raise IdentificationError(
                f"column {index}: could not convert string {texts[0]!r} to a number; correct it, or leave it empty"
            )
        numbers[:, index] = [np.nan if value is None else value for value in values]
    return numbers


def _of(words: dict[str, str], word: str, option: str) -> str:
    if word not in words and word not in words.values():
        raise IdentificationError(f"--{option} {word} is not allowed; allowed: {', '.join(words)}")
    return words.get(word, word)


def _name(words: dict[str, str], mark: str) -> str:
    return next(name for name, known in words.items() if known == mark)
