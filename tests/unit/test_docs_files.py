"""A user who follows the README from top to bottom has every file that is named when it is named."""

from __future__ import annotations

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()
FILE = re.compile(r"(?<![\w./-])(?:[\w-]+/)*[\w-]+(?:_bag|/bag|\.yaml|\.json|\.npz)(?![\w/])")
MADE_BY_DEMO = {"results/demo/bag"}  # `make demo`, in the quick start
OUTPUT = re.compile(r"(?:--out|--figures|cp \S+|amb new|start_recording\(|>)\s*\"?([\w./-]+)")


def test_every_file_is_made_before_it_is_used() -> None:
    usage = README[README.index("## Using it") : README.index("## Regions")]
    blocks = re.findall(r"^```(?:bash|python)\n(.*?)^```$", usage, re.DOTALL | re.MULTILINE)
    there = set(MADE_BY_DEMO)
    named = 0
    for line in "\n".join(blocks).splitlines():
        code = re.split(r"\s#\s|  # ", line)[0]
        made = set(OUTPUT.findall(code))
        for name in FILE.findall(code):
            named += 1
            assert name in there | made or (ROOT / name).exists(), f"{name} is not there yet: {line}"
        there |= made
    assert named > 10


def test_the_demo_is_run_before_its_bag_is_used() -> None:
    assert README.index("make demo") < README.index("results/demo/bag")
