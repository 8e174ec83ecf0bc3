"""The Python examples of the pages in docs run as they stand there, those of a page one after another."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PAPER_MAP = Path(__file__).parent / "data" / "paper_map.json"


@pytest.mark.slow
@pytest.mark.timeout(600)  # regions: twelve sweeps of 20 s
@pytest.mark.parametrize("page", ["distortion", "excitation", "identification", "regions", "subharmonics"])
def test_the_examples_run(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "results" / "map").mkdir(parents=True)
    shutil.copy(PAPER_MAP, tmp_path / "results" / "map" / "map.json")  # what `amb map` leaves
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    examples = re.findall(r"^```python\n(.*?)^```$", (DOCS / f"{page}.md").read_text(), re.DOTALL | re.MULTILINE)
    assert examples
    for example in examples:
        exec(example, names)
