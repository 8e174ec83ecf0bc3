"""Hostile files through the services of a running identifier: each is refused in one line, and the node stays."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from amb_bringup.client import AmbClient
from amb_bringup.client.errors import ClientError
from tests.fuzz.crafted_files import CRAFTED, SECRET, make_secret
from tests.graph.conftest import Graph
from tests.graph.identifier_loop import Loop, linear_loop
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


def identifier(graph: Graph) -> Loop:
    return Loop(graph)


@pytest.fixture
def loop(share: Any) -> Loop:
    return share(identifier)


@pytest.fixture
def table(tmp_path: Path) -> Path:
    """A file of others with the signals u and y."""
    path = tmp_path / "own.csv"
    path.write_text("t [s],u [A],y [um]\n" + "".join(f"{k / 8000:.7f},{k % 7},{k % 5}\n" for k in range(50)))
    return path


DESCRIPTIONS = (
    'inputs: u\noutputs: y\nunits: ["\\ud800", "q"]\n',
    'inputs: "\\ud800"\noutputs: y\n',
    'inputs: "\\0=u"\noutputs: "\\ud800=y"\n',
)
"""With texts that are no Unicode, or have a NUL, by escapes of YAML."""


@pytest.mark.parametrize("description", DESCRIPTIONS)
def test_a_text_that_ros_does_not_carry_is_answered(loop: Loop, table: Path, description: str) -> None:
    request = {"bag": str(table), "description": description}
    for answer in (loop.identify(**request), loop.validate(**request), loop.certify(controller="none", **request)):
        assert not answer.success
        assert answer.message
        assert "internal error" not in answer.message
    _, result = loop.graph.result_of(loop.send(**request)[0])
    assert not result.success
    assert result.message
    assert "internal error" not in result.message
    assert loop.process.poll() is None


def test_a_model_with_names_that_ros_does_not_carry_is_answered(loop: Loop, tmp_path: Path) -> None:
    model = replace(LinearBearing().model, source="\ud800", input_names=("\ud800", "a\0b"))
    model.save(tmp_path / "model.json")
    loop.publish(linear_loop(3_000))
    answer = loop.validate(model=str(tmp_path / "model.json"))
    assert answer.message
    assert "internal error" not in answer.message
    assert loop.process.poll() is None


def test_a_file_name_that_is_no_unicode_is_answered(loop: Loop, tmp_path: Path) -> None:
    bag = tmp_path / "bag dir"
    bag.mkdir()
    (bag / os.fsdecode(b"\xff.mcap")).write_bytes(b"no bag")
    for answer in (loop.identify(bag=str(bag)), loop.validate(bag=str(bag)), loop.certify(bag=str(bag))):
        assert not answer.success
        assert answer.message
        assert "internal error" not in answer.message
    _, result = loop.graph.result_of(loop.send(bag=str(bag))[0])
    assert not result.success
    assert r"\udcff.mcap" in result.message
    assert loop.process.poll() is None


def test_the_client_refuses_a_text_that_ros_does_not_carry(loop: Loop) -> None:
    with AmbClient(domain_id=loop.graph.domain, nodes=("identifier",)) as client:
        for text in ("\ud800", os.fsdecode(b"/bags/\xff.mcap"), "a\0b"):
            with pytest.raises(ClientError, match=r"bag = .* has a NUL character or is no Unicode"):
                client.identify(text)
            with pytest.raises(ClientError, match=r"model = .* has a NUL character or is no Unicode"):
                client.validate(model=text)
