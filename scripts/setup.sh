#!/bin/sh
# Makes .venv with the pinned versions. Needs Python 3.11 or newer; on Debian as root it installs python3-venv itself.
set -eu
cd "$(dirname "$0")/.."
PYTHON="${PYTHON:-python3}"

if ! command -v "$PYTHON" >/dev/null 2>&1; then
    echo "setup: $PYTHON was not found; install Python 3.11 or newer, or run: make setup PYTHON=/path/to/python3" >&2
    exit 2
fi
if ! "$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then
    echo "setup: $("$PYTHON" --version) is too old; tipforce needs Python 3.11 or newer (make setup PYTHON=python3.12)" >&2
    exit 2
fi

# Debian packs ensurepip apart from Python.
if ! "$PYTHON" -c 'import ensurepip, venv' >/dev/null 2>&1; then
    package="python$("$PYTHON" -c 'import sys; print("%d.%d" % sys.version_info[:2])')-venv"
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then
        echo "setup: installing $package"
        apt-get update -qq >/dev/null
        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$package" >/dev/null
    else
        echo "setup: this Python has no venv module; install it with: sudo apt-get install $package" >&2
        exit 2
    fi
fi

echo "setup: making .venv with $("$PYTHON" --version)"
[ -x .venv/bin/python ] || "$PYTHON" -m venv .venv
.venv/bin/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt -e '.[dev]'
echo "setup: compiling for this processor (once)"
.venv/bin/python -m tipforce.pipelines._precompile
touch .venv/.ready
echo "setup: done"
