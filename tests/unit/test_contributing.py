"""The examples of CONTRIBUTING.md, one after the other as a reader would type them."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[2] / "CONTRIBUTING.md"


def test_the_examples_run(tmp_path: Path) -> None:
    examples = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)
    assert len(examples) == 5
    # In a process of its own: they add a kind of excitation and a method to those that the library has.
    ended = subprocess.run([sys.executable, "-c", "\n".join(examples)], cwd=tmp_path, capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")


def test_the_method_of_the_example_is_taken_by_name() -> None:
    code = "\n".join(re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), re.DOTALL | re.MULTILINE)[2:3])
    code += (
        "\nimport numpy as np\n"
        "from amb_core.identification import identify, IdentificationData\n"
        "u = np.random.default_rng(0).normal(size=(2, 3000))\n"
        "y = np.zeros_like(u)\n"
        "for k in range(1, 3000): y[:, k] = 0.8 * y[:, k - 1] + u[:, k - 1]\n"
        "data = IdentificationData.from_arrays(u.T, y.T + 1e-3 * u.T[::-1], 1e-4)\n"
        "assert identify(data, 2, 'ssarx2').model.order == 4\n"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (ended.returncode, ended.stderr) == (0, "")
