"""Hostile files through the services of a running identifier: each is refused in one line, and the node stays."""

from __future__ import annotations

from pathlib import Path

from tests.fuzz.crafted_files import CRAFTED, SECRET, make_secret
from tests.graph.conftest import Graph
from tests.graph.identifier_loop import Loop
from tests.unit.conftest import LinearBearing

TABLES = ("cells_v5.mat", "external.mat", "external_pipe.mat", "links.mat", "declared.mat", "bytes.npz", "own.csv")
BAGS = ("numbers_as_files", "aliases", "view.db3", "lz4.mcap", "compressed_file", "recursive.mcap", "deep_types.mcap")


def test_no_file_ends_the_node(graph: Graph, tmp_path: Path) -> None:
    loop = Loop(graph)
    LinearBearing().model.save(tmp_path / "model.json")
    make_secret(tmp_path)
    for name in (*TABLES, *BAGS):
        path = tmp_path / name
        CRAFTED[name](path)
        requests = [{"bag": str(path), "model": str(tmp_path / "model.json")}]
        if path.suffix == ".mat":
            requests.append({"model": str(path)})
        for request in requests:
            answer = loop.validate(**request)
            assert not answer.success, name
            assert answer.message, name
            assert SECRET.decode() not in answer.message
            assert "\n" not in answer.message
    assert loop.process.poll() is None
    assert "no model has been identified yet" in loop.get_model().message
