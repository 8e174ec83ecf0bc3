#!/usr/bin/env bash
# Sets the workspace up: .venv with ROS 2 Jazzy and everything that requirements.txt pins, then `colcon build`.
# A package whose file has another hash than requirements.hashes names is not installed.
# Does only what is out of date; a set-up that was interrupted is repaired by the next call.
# EXTRAS="NAME ..." adds what requirements-NAME.txt pins; it stays, and stays up to date, as long as .venv exists.
set -euo pipefail
root=$(CDPATH='' cd -- "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
cd "$root"
venv=$root/.venv
venv_root=$venv/.root    # checkout folder for which the environment was made
venv_stamp=$venv/.complete     # the same and checksum of requirements.txt; exists only if the install finished
build_stamp=$root/install/.complete    # checksum of everything that the build depends on; only if the build finished
kernel_stamp=$root/install/.kernels    # checksum of what is compiled into numba's cache; only if that finished

target_library=$root/build/target/libamb_target.so

say() { printf '\033[1m[setup]\033[0m %s\n' "$*"; }
fail() { printf '[setup] error: %s\n' "$*" >&2; exit 1; }

# A ROS installation or another workspace in the environment must not leak into this one.
unset PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH COLCON_CURRENT_PREFIX LD_LIBRARY_PATH \
    ROS_DISTRO _ROS_WHEELS_BOOTSTRAP_COMPLETE VIRTUAL_ENV

# A CPython 3.11 or 3.12 that can make environments and compile extensions. That of the distribution comes first: it is
# built with profile-guided optimisation, without which (as version managers build theirs) the loop is a fifth slower.
find_python() {
    local candidate problems=""
    for candidate in ${AMB_PYTHON:-/usr/bin/python3.11 /usr/bin/python3.12 python3.11 python3.12 python3}; do
        local missing
        missing=$("$candidate" - 2>/dev/null <<'PY'
import importlib.util, os, platform, sys, sysconfig
lacks = []
if platform.python_implementation() != "CPython" or sys.version_info[:2] not in ((3, 11), (3, 12)):
    lacks.append("is not CPython 3.11 or 3.12")
if any(importlib.util.find_spec(name) is None for name in ("venv", "ensurepip")):
    lacks.append("lacks the module venv or ensurepip (Debian: python3-venv)")
if not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")):
    lacks.append("lacks its C headers (Debian: python3-dev)")
print(", ".join(lacks))
PY
        ) || continue
        if [ -z "$missing" ]; then
            command -v "$candidate"
            return
        fi
        problems+="; $candidate $missing"
    done
    fail "needs CPython 3.11 or 3.12 with venv and C headers${problems:-; none found} (AMB_PYTHON names another one)"
}

# An environment keeps its Python: one that is named later is not passed over in silence.
check_python() {
    local origin='import os, sys; print(os.path.realpath(sys._base_executable))' candidate present
    [ -n "${AMB_PYTHON:-}" ] && [ "$(cat "$venv_root" 2>/dev/null)" = "$root" ] || return 0
    present=$("$venv/bin/python" -c "$origin" 2>/dev/null) || return 0
    for candidate in $AMB_PYTHON; do
        [ "$("$candidate" -c "$origin" 2>/dev/null)" != "$present" ] || return 0
    done
    fail "AMB_PYTHON is $AMB_PYTHON, but .venv was made from $present; to change it: rm -r .venv"
}

checksum() { sha256sum | cut -d ' ' -f 1; }

venv_state() { printf '%s\n%s\n' "$root" "$(cat requirements.txt requirements.hashes 2>/dev/null | checksum)"; }

extras() { find . -maxdepth 1 -name 'requirements-*.txt' | sed -E 's|^./requirements-(.*)\.txt$|\1|' | LC_ALL=C sort | xargs; }

extra_state() { cat requirements.txt "requirements-$1.txt" "requirements-$1.hashes" | checksum; }

build_state() {  # Python sources count by name only: the build links to them
    local packages=(amb_* src)
    find "${packages[@]}" \( -name __pycache__ -o -name build \) -prune -o -type f ! -name '*.pyc' -print | LC_ALL=C sort
    find "${packages[@]}" \( -name __pycache__ -o -name build \) -prune -o -type f \( -name 'package.xml' -o -name 'setup.*' \
        -o -name CMakeLists.txt -o -name '*.msg' -o -name '*.srv' -o -name '*.action' -o -name '*.yaml' \) -print0 |
        LC_ALL=C sort -z | xargs -0 sha256sum
    cat "$venv_stamp"
}

kernel_state() {
    { find src/amb_core/amb_core/plant/kernel -name '*.py'; grep -rl --include='*.py' njit src/amb_core/amb_core; } |
        LC_ALL=C sort -u | xargs cat
    cat "$venv_stamp"
}

# Every package is pinned. With dependencies, pip may look at a version that came out after the pins, and refuse it.
install_pins() {
    PIP_USER=0 "$venv/bin/python" -m pip install -qq --no-input --disable-pip-version-check --no-deps "$@"
}

make_venv() {
    [ "$(uname -sm)" = "Linux x86_64" ] || fail "the ROS 2 wheels exist for x86-64 Linux only, this is $(uname -sm)"
    # Moved to another folder, or its Python removed: nothing to build upon. Otherwise pip adds what is missing, and needs
    # no network for what is there.
    if [ "$(cat "$venv_root" 2>/dev/null)" != "$root" ] || ! "$venv/bin/python" -m pip --version > /dev/null 2>&1; then
        local python
        python=$(find_python)
        say "new environment .venv from $python"
        rm -rf "$venv" build install
        "$python" -m venv "$venv"
        echo "$root" > "$venv_root"
    fi
    rm -f "$venv_stamp"
    say "installing the packages that requirements.txt pins (a few minutes the first time)"
    # The hashes of the same pins; floor.sh has none for its own. Setuptools comes first: it builds empy, the only source.
    local pins=requirements.txt hashes=()
    [ ! -f requirements.hashes ] || pins=requirements.hashes hashes=(--require-hashes)
    install_pins "${hashes[@]}" -r <(sed -nE '/^setuptools==/{:a;p;/\\$/{n;ba}}' "$pins")
    install_pins "${hashes[@]}" --no-build-isolation -r "$pins"
    mend_cmake_files
    venv_state > "$venv_stamp"
}

# A stamp in .venv names each extra that is there. Packages that it shares with requirements.txt keep their pins.
add_extras() {
    local name stamp
    for name in ${EXTRAS:-} $(cd "$venv" && find . -maxdepth 1 -name '.extra-*' | sed 's|^./.extra-||'); do
        stamp=$venv/.extra-$name
        [ -f "requirements-$name.txt" ] || continue    # of another branch
        [ "$(cat "$stamp" 2>/dev/null)" != "$(extra_state "$name")" ] || continue
        say "adding the extra $name (some minutes)"
        install_pins --require-hashes -r requirements.hashes -r "requirements-$name.hashes"
        extra_state "$name" > "$stamp"
    done
}

# The CMake files of the message packages name include folders of the machine on which the wheels were built.
mend_cmake_files() {
    local python_include numpy_include
    python_include=$("$venv/bin/python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
    numpy_include=$("$venv/bin/python" -c 'import numpy; print(numpy.get_include())')
    { grep -rlZ --include='*.cmake' /opt/python/ "$venv/share" || true; } | xargs -0 --no-run-if-empty sed -Ei \
        -e "s|/opt/python/cp3[0-9]+-cp3[0-9]+/include/python3\.[0-9]+|$python_include|g" \
        -e "s|/opt/python/cp3[0-9]+-cp3[0-9]+/lib/python3\.[0-9]+/site-packages/numpy/_core/include|$numpy_include|g"
}

build() {
    say "building the ROS packages"
    rm -f "$build_stamp"
    local built    # the state before: what changes meanwhile is built the next time
    built=$(build_state | checksum)
    # PYTHONWARNINGS: `colcon build --symlink-install` relies on what setuptools warns about.
    # MAKEFLAGS: without a number of jobs, colcon lets ninja wait until the load of the machine falls, maybe for ever.
    if ! PATH=$venv/bin:$PATH AMENT_PREFIX_PATH=$venv CMAKE_PREFIX_PATH=$venv PYTHONWARNINGS=ignore \
        MAKEFLAGS=-j"$(nproc)" \
        colcon --log-level error build --symlink-install --executor parallel \
        --event-handlers console_direct- console_cohesion- status- console_stderr- summary- \
        --cmake-args -G Ninja -DPython3_EXECUTABLE="$venv/bin/python" -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=ON; then
        cat log/latest_build/*/stderr.log >&2
        fail "the build failed; full logs are in log/latest_build"
    fi
    echo "$built" > "$build_stamp"
}

# numba notices a change of the file that a compiled function stands in, not of what that function calls.
# The kernels need nothing that is built, so they are compiled meanwhile: those of the plant take as long as all others.
start_kernels() {
    say "compiling the numerical kernels (some minutes)"
    rm -f "$kernel_stamp"
    compiled=$(kernel_state | checksum)    # before, as in build
    find src/amb_core/amb_core -name '*.nb[ic]' -delete
    local part
    for part in plant estimates; do
        PYTHONPATH=src/amb_core "$venv/bin/python" -m amb_core.warm_up "$part" 9<&- &
        compiling+=($!)
    done
    trap 'kill "${compiling[@]}" 2> /dev/null' EXIT    # whatever ends the set-up ends them too
}

finish_kernels() {
    local process
    for process in "${compiling[@]}"; do wait "$process" || fail "the kernels could not be compiled"; done
    trap - EXIT
    echo "$compiled" > "$kernel_stamp"
}

# For the target emulator. It builds the library by itself when that is missing, so set-up continues without gcc.
build_target() {
    ( source scripts/env.sh; python -c 'import amb_core.rig.emulation.library as library; exit(library.main())' ) ||
        say "warning: without it the target emulator does not start; the rest works"
}

# Corrects a fault of the ROS wheels; a node builds it by itself when it is missing.
correction() {
    printf '%s/amb/corrected_calls-%.16s.so' "${XDG_CACHE_HOME:-${HOME:-}/.cache}" \
        "$(checksum < src/amb_ros/amb_ros/corrected_calls.c)"
}

build_correction() {
    local problem
    problem=$( (source scripts/env.sh; python -c 'import amb_ros.corrected_calls as correction; correction.build()') 2>&1 ) ||
        say "warning: a node can hang when it ends or miss an answer, as its corrections could not be built: ${problem##*$'\n'}"
}

case $root in *[[:space:]]*)
    fail "the folder '$root' has a space in its name, with which the executables of ROS packages cannot start; move it" ;;
esac
exec 9< "${BASH_SOURCE[0]}"
# Two calls at the same time: the second waits, then finds everything done.
flock --nonblock 9 || { say "waiting for another set-up of this folder"; flock 9; }
missing=()
for tool in git make g++; do command -v "$tool" > /dev/null || missing+=("$tool"); done
[ ${#missing[@]} -eq 0 ] || fail "not installed: ${missing[*]} (Debian or Ubuntu: apt install git make g++)"
for name in ${EXTRAS:-}; do
    [ -f "requirements-$name.txt" ] || fail "EXTRAS: there is no extra '$name'; allowed: $(extras)"
done
check_python
if [ "$(cat "$venv_stamp" 2>/dev/null)" != "$(venv_state)" ] || [ ! -x "$venv/bin/python" ]; then make_venv; fi
add_extras
compiling=()
if [ "$(cat "$kernel_stamp" 2>/dev/null)" != "$(kernel_state | checksum)" ]; then start_kernels; fi
if [ ! -d build ] || [ "$(cat "$build_stamp" 2>/dev/null)" != "$(build_state | checksum)" ]; then build; fi
if [ ! -f "$target_library" ] || [ -n "$(find target -name '*.[ch]' -newer "$target_library")" ]; then build_target; fi
[ -f "$(correction)" ] || build_correction
if [ ${#compiling[@]} -gt 0 ]; then finish_kernels; fi
