"""What the workbench uses of rclpy: public names, and in one module what rclpy does not promise."""

from __future__ import annotations

import ast
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from amb_ros import rclpy_inside

ROOT = Path(__file__).parents[2]
PUBLIC = {"_exit", "_asdict", "_replace", "_fields"}  # documented names of os and of named tuples
CHANGED = {"callback", "send_response", "read_only"}
SOURCES = [
    file for folder in ("src", "amb_*_node") for file in ROOT.glob(f"{folder}/**/*.py") if "build" not in file.parts
]


def private_names(tree: ast.AST) -> tuple[set[str], set[str]]:
    """Private attributes that a module reads, and private names that it defines."""
    read, defined = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute):
            (read if isinstance(node.ctx, ast.Load) else defined).add(node.attr)
        elif isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
            defined.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            defined.add(node.id)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):  # __slots__
            defined.add(node.value)
    private = {name for name in read if name.startswith("_") and not name.endswith("__")}
    return private, defined


def test_no_private_attribute_of_a_library_is_used() -> None:
    modules = {file: private_names(ast.parse(file.read_text())) for file in SOURCES}
    own = set().union(*(defined for _, defined in modules.values()))
    foreign = {
        str(file.relative_to(ROOT)): names for file, (read, _) in modules.items() if (names := read - own - PUBLIC)
    }
    assert not foreign


def test_no_method_of_a_class_of_rclpy_is_replaced_by_its_mangled_name() -> None:
    for file in SOURCES:
        for node in ast.walk(ast.parse(file.read_text())):
            if isinstance(node, ast.FunctionDef) and node.name.startswith("_"):
                assert "__" not in node.name.strip("_"), f"{file.relative_to(ROOT)}: {node.name}"


def test_one_module_changes_objects_of_rclpy() -> None:
    changing = {
        file.name
        for file in SOURCES
        for node in ast.walk(ast.parse(file.read_text()))
        if isinstance(node, ast.Attribute) and node.attr in CHANGED and isinstance(node.ctx, ast.Store)
        if "amb_ros" in file.parts or file.parent.name.endswith("_node")
    }
    assert changing == {"rclpy_inside.py"}


def test_what_rclpy_does_not_promise_was_seen_with_this_minor_version() -> None:
    """After an update of rclpy: run the graph tests, then change `SEEN_WITH`."""
    try:
        installed = version("ros-jazzy-rclpy")  # of the wheels
    except PackageNotFoundError:
        installed = version("rclpy")  # of a ROS 2 installation
    assert installed.rpartition(".")[0] == rclpy_inside.SEEN_WITH.rpartition(".")[0]
