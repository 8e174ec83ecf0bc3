"""Readers of pages, and the recording of the demo that many pages start from."""

from __future__ import annotations

import itertools
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from domain_coordinator import domain_id

from tests.docs.pages import ROOT, Reader, reader

_next_domain = itertools.islice(itertools.cycle(range(1, 101)), 53 * os.getpid() % 100, None).__next__


@pytest.fixture(scope="session")
def domain() -> Iterator[int]:
    """A DDS domain that nobody else uses."""
    with domain_id(_next_domain) as domain:
        yield domain


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory, domain: int) -> Path:
    """The folder `results/demo` that `make demo` leaves."""
    folder = tmp_path_factory.mktemp("demo") / "demo"
    command = ["amb", "demo", "--out", str(folder)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=os.environ | {"ROS_DOMAIN_ID": str(domain)})
    return folder


@pytest.fixture
def page_reader(tmp_path: Path, demo: Path, domain: int, monkeypatch: pytest.MonkeyPatch) -> Iterator[Reader]:
    """Somebody in a checkout of the workbench, after `make demo`, with a bearing of their own."""
    (tmp_path / "results").mkdir()
    for there, name in ((ROOT / "src", "src"), (ROOT / "scripts", "scripts"), (demo, "results/demo")):
        (tmp_path / name).symlink_to(there)
    (tmp_path / "my_bearing.yaml").write_text((ROOT / "src/amb_bringup/config/paper.yaml").read_text())
    monkeypatch.chdir(tmp_path)
    with reader(tmp_path, domain) as page_reader:
        for name, value in page_reader.environment.items():
            monkeypatch.setenv(name, value)
        yield page_reader
