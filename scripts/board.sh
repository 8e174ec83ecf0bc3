#!/usr/bin/env bash
# Install the compiler for Cortex-M and QEMU, with which the port of the target to a board is tested, where that asks
# nobody: on Debian, as root. Without them those tests are skipped, so a failure is a warning.
set -uo pipefail

present() { command -v arm-none-eabi-gcc && command -v qemu-system-arm; }

if present > /dev/null; then exit 0; fi
packages="gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"
if ! command -v apt-get > /dev/null; then
    why="there is no apt-get here"
elif [ "$(id -u)" != 0 ]; then
    why="this takes root; run: sudo apt-get install $packages"
else
    echo "installing the compiler for Cortex-M and QEMU for the tests of the port to a board"
    export DEBIAN_FRONTEND=noninteractive
    # shellcheck disable=SC2086
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends $packages; } < /dev/null > /dev/null \
        || why="apt-get failed, see above"
    if present > /dev/null; then exit 0; fi
    why=${why:-"the packages brought no program arm-none-eabi-gcc or qemu-system-arm"}
fi
echo "WARNING: no cross compiler or QEMU ($why); the tests of the port to a board will be skipped" >&2
