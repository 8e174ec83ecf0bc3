#!/usr/bin/env bash
# Runs the unit tests with the oldest versions that the packages allow: those of a stock ROS 2 Jazzy on Ubuntu 24.04.
# A copy of the checkout in .floor is set up as the checkout itself, with the pins of stock-jazzy-*.txt.
# Python is 3.12 if there is one, else 3.11; AMB_PYTHON names another. Arguments are passed on to pytest.
set -euo pipefail
root=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
copy=$root/.floor
cd "$root"
mkdir -p "$copy"
find "$copy" -mindepth 1 -maxdepth 1 ! -name .venv ! -name build ! -name install -exec rm -rf {} +
rm -f "$copy/install/.kernels"  # their cache was beside the sources
git ls-files -z --cached --others --exclude-standard --deduplicate |
    { while IFS= read -rd '' file; do [ ! -e "$file" ] || printf '%s\0' "$file"; done; } | xargs -0 cp --no-dereference --preserve --parents -t "$copy"
cd "$copy"
pins=(scripts/stock-jazzy-apt.txt scripts/stock-jazzy-pip.txt)
names=$(sed -nE 's/^([A-Za-z0-9_.-]+)==.*/\1/p' "${pins[@]}" | sort -u | paste -sd '|')
rm requirements.hashes
{ grep -viE "^($names)==" "$root/requirements.txt"; cat "${pins[@]}"; } > requirements.txt
AMB_PYTHON=${AMB_PYTHON:-/usr/bin/python3.12 python3.12 /usr/bin/python3.11 python3.11} \
    EXTRAS="" bash scripts/setup.sh
source scripts/env.sh
python -c 'import sys, numpy, scipy, numba; print("Python", sys.version.split()[0], *(f"{one.__name__} {one.__version__}" for one in (numpy, scipy, numba)))'
exec python -m pytest -m "not slow" tests/unit --numprocesses 2 --dist worksteal "$@"
