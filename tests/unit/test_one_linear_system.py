"""One place solves with z I - A: no other module computes a frequency response or a peak of state-space matrices.

A new response, peak or loop belongs in `amb_core.linear`, where units, poles on the unit circle and balanced states are
handled once.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("src", "amb_sim_node", "amb_controller_node", "amb_ident_node")
ROOM = "src/amb_core/amb_core/linear/"
OTHERS = {  # modules with z I - A in them that compute no response
    "src/amb_core/amb_core/identification/estimate/filter_bank.py": "adjugates of blocks of two states",
    "src/amb_core/amb_core/identification/uncertainty/poles.py": "how far an eigenvalue is from a value",
}
CALLS = {"ab13dd", "ab05md", "tb05ad", "freqresp", "dfreqresp", "frequency_response", "StateSpace", "linfnorm"}


def calls(node: ast.AST, names: set[str]) -> bool:
    """Whether it is a call of a function or method with one of these names."""
    if not isinstance(node, ast.Call):
        return False
    return getattr(node.func, "attr", getattr(node.func, "id", "")) in names


def is_resolvent(node: ast.AST) -> bool:
    """z * eye(n) - A, or the reciprocal of z[:, newaxis] - poles in the coordinates of the eigenvectors."""
    if not isinstance(node, ast.BinOp):
        return False
    if isinstance(node.op, ast.Sub) and isinstance(node.left, ast.BinOp) and isinstance(node.left.op, ast.Mult):
        return any(calls(side, {"eye", "identity"}) for side in (node.left.left, node.left.right))
    if isinstance(node.op, ast.Div) and isinstance(node.right, ast.BinOp) and isinstance(node.right.op, ast.Sub):
        return isinstance(node.right.left, ast.Subscript) and "newaxis" in ast.dump(node.right.left.slice)
    return False


def found_in(code: str) -> Iterator[int]:
    """Lines that solve with z I - A themselves, or ask another package for a response or a norm."""
    for node in ast.walk(ast.parse(code)):
        if is_resolvent(node) or calls(node, CALLS):
            yield node.lineno


def test_no_other_module_computes_a_response_or_a_norm() -> None:
    places = []
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = str(path.relative_to(ROOT))
            if not name.startswith(ROOM) and name not in OTHERS:
                places += [f"{name}:{line}" for line in found_in(path.read_text())]
    assert not places, f"these belong in {ROOM}: {', '.join(places)}"


@pytest.mark.parametrize(
    "code",
    [
        "c @ np.linalg.solve(z * np.eye(n) - a, b) + d",
        "np.linalg.inv(z[:, np.newaxis, np.newaxis] * np.identity(len(a)) - a)",
        "np.einsum('pn,fn,nm->fpm', left, 1.0 / (z[:, np.newaxis] - poles), right)",
        "control.StateSpace(a, b, c, d, 1e-4)(z)",
        "ctrlsys.ab13dd('D', 'I', 'S', 'D')",
    ],
)
def test_a_response_that_is_written_anew_is_found(code: str) -> None:
    assert list(found_in(code)) == [1]


@pytest.mark.parametrize("module", OTHERS)
def test_every_exception_is_one(module: str) -> None:
    assert list(found_in((ROOT / module).read_text()))
