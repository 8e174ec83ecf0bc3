"""Nodes must not hide what rclpy keeps in their base class: it fails only much later, and elsewhere."""

import ast
import inspect
from pathlib import Path

import pytest
from rclpy.node import Node

ROOT = Path(__file__).parents[2]
NODE_FILES = sorted(ROOT.glob("amb_*_node/amb_*_node/*.py"))


def assigned_attributes(source: str) -> set[str]:
    return {
        node.attr
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.Attribute)
        and isinstance(node.ctx, ast.Store)
        and isinstance(node.value, ast.Name)
        and node.value.id == "self"
    }


@pytest.mark.parametrize("file", NODE_FILES, ids=lambda file: file.stem)
def test_node_does_not_hide_attributes_of_rclpy(file: Path):
    hidden = assigned_attributes(file.read_text()) & assigned_attributes(inspect.getsource(inspect.getmodule(Node)))
    assert not hidden
