"""Runs the code of a page as a reader would: shell commands and Python lines, from the top to the bottom.

A comment before a block says what else a reader does with it:

    <!-- run: file NAME -->              saves it under that name
    <!-- run: background until "TEXT" -->  types it in a second terminal and goes on when that shows TEXT
    <!-- run: background -->             the same, without waiting
    <!-- run: code ends N -->            the commands end with exit code N
    <!-- run: not, REASON -->            leaves it out

A block of the language `output` has lines that the commands before it show; `...`, or two
blanks or more, stand for anything.
"""

from __future__ import annotations

import ast
import os
import re
import signal
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
FENCE = re.compile(
    r"(?:^<!-- run: (?P<how>.*?) -->\n)?"
    r"^```(?P<language>bash|python|yaml|output|\{code-cell\} python)\n(?P<text>.*?)^```$",
    re.DOTALL | re.MULTILINE,
)
SIGN_OF_LIFE = 120.0  # s; longest wait for the line of a command in the background


@dataclass(frozen=True)
class Block:
    """A piece of code of a page, its language, and what a reader does with it."""

    language: str
    text: str
    how: str


def blocks(page: Path) -> list[Block]:
    """The pieces of code of a page, in their order."""
    return blocks_of(page.read_text(encoding="utf-8"))


def blocks_of(text: str) -> list[Block]:
    """The pieces of code of the text of a page, in their order."""
    return [Block(match["language"], match["text"], match["how"] or "") for match in FENCE.finditer(text)]


@dataclass
class Reader:
    """Somebody who follows a page in a folder.

    Attributes
    ----------
    folder : Path
        Where commands are typed.
    environment : dict
        Environment of the commands.
    names : dict
        What the Python lines have defined.
    shown : str
        Output of the last commands.
    """

    folder: Path
    environment: dict[str, str]
    names: dict[str, Any] = field(default_factory=dict)
    shown: str = ""
    _behind: list[subprocess.Popen[str]] = field(default_factory=list)

    def follow(self, page: Path) -> None:
        """Do all that the page says."""
        for block in blocks(page):
            self.do(block)

    def do(self, block: Block) -> None:
        """Do what a block says."""
        if block.how.startswith("not"):
            return
        if block.how.startswith("file "):
            (self.folder / block.how.removeprefix("file ")).write_text(block.text, encoding="utf-8")
        elif block.how.startswith("background"):
            self._start(block)
        elif block.language == "bash":
            self._type(block)
        elif block.language == "output":
            assert_shows(self.shown, block.text)
        elif block.language != "yaml":
            run_cell(block.text, self.names)

    def _type(self, block: Block) -> None:
        ended = subprocess.run(
            ["bash", "-ec", block.text],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
        )
        self.shown = ended.stdout
        expected = int(block.how.split()[-1]) if block.how.startswith("code ends") else 0
        assert ended.returncode == expected, f"{block.text}ended with {ended.returncode}:\n{ended.stdout[-4000:]}"
        assert "Traceback" not in ended.stdout, ended.stdout[-4000:]

    def _start(self, block: Block) -> None:
        log = self.folder / f".background-{len(self._behind)}"
        with log.open("w") as out:
            started = subprocess.Popen(
                ["bash", "-ec", block.text],
                cwd=self.folder,
                env=self.environment,
                stdout=out,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                text=True,
                start_new_session=True,
            )
        self._behind.append(started)
        awaited = re.search(r'until "(.*)"', block.how)
        deadline = time.monotonic() + SIGN_OF_LIFE
        while awaited and awaited[1] not in log.read_text():
            assert started.poll() is None, f"{block.text}ended:\n{log.read_text()[-4000:]}"
            assert time.monotonic() < deadline, f"{block.text}does not show {awaited[1]!r}:\n{log.read_text()[-4000:]}"
            time.sleep(0.1)

    def close(self) -> None:
        """Press Ctrl-C in the other terminals, last first."""
        for started in reversed(self._behind):
            if started.poll() is None:
                os.killpg(started.pid, signal.SIGINT)
            try:
                started.wait(30.0)
            except subprocess.TimeoutExpired:
                os.killpg(started.pid, signal.SIGKILL)
                started.wait()


@contextmanager
def reader(folder: Path, domain: int) -> Iterator[Reader]:
    """A reader in an empty folder, with a DDS domain and a cache of results of their own."""
    environment = os.environ | {
        "ROS_DOMAIN_ID": str(domain),
        "COLUMNS": "120",
        "XDG_CACHE_HOME": str(folder / ".cache"),
        "PYTHONWARNINGS": "ignore",
    }
    page_reader = Reader(folder, environment)
    try:
        yield page_reader
    finally:
        page_reader.close()


def run_cell(text: str, names: dict[str, Any]) -> None:
    """Run Python lines; where the last one is a chart, draw it as a notebook would."""
    tree = ast.parse(text)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "page", "exec"), names)
    if isinstance(last, ast.Expr):
        shown = eval(compile(ast.Expression(last.value), "page", "eval"), names)
        if hasattr(shown, "_repr_png_"):
            assert shown._repr_png_().startswith(b"\x89PNG")


def assert_shows(shown: str, expected: str) -> None:
    """Whether an output has the expected lines in their order, others between them; `...` or a gap is anything."""
    lines = [line for line in expected.splitlines() if line.strip(" .")]
    words = [".*?".join(map(_spaced, re.split(r"\.{3}| {2,}", line))) for line in lines]
    pattern = ".*?".join(words)
    assert re.search(pattern, shown, re.DOTALL), f"expected:\n{expected}\nshown:\n{shown[-6000:]}"


def _spaced(text: str) -> str:
    return r"\s+".join(re.escape(word) for word in text.split())
