#!/usr/bin/env bash
# Install Chromium, in which the tests of reports run, where that asks nobody: on Debian, as root. Without it those tests
# are skipped, so a failure is a warning.
set -uo pipefail

present() { command -v chromium || command -v chromium-browser; }

if present > /dev/null; then exit 0; fi
if ! command -v apt-get > /dev/null; then
    why="there is no apt-get here"
elif [ "$(id -u)" != 0 ]; then
    why="this takes root; run: sudo apt-get install chromium"
else
    echo "installing Chromium for the tests of reports in a browser"
    export DEBIAN_FRONTEND=noninteractive
    { apt-get update -qq && apt-get install -y -qq --no-install-recommends chromium; } < /dev/null > /dev/null \
        || why="apt-get failed, see above"
    if present > /dev/null; then exit 0; fi
    why=${why:-"the package brought no program chromium"}
fi
echo "WARNING: Chromium is not installed ($why); the tests of reports in a browser will be skipped" >&2
