#!/usr/bin/env bash
# Builds the wheel of this machine into target/wheels, installs it into a fresh environment, and runs the tests there.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=target/python-tools fresh=target/python-fresh

[ -x "$tools/bin/maturin" ] || { python3 -m venv "$tools" && "$tools/bin/pip" install -q "maturin>=1.9,<2"; }
rm -rf target/wheels "$fresh"
python3 python/licences.py
CARGO_TARGET_DIR=$PWD/target "$tools/bin/maturin" build --release -q -m python/Cargo.toml -o target/wheels

python3 -m venv "$fresh"
"$fresh/bin/pip" install -q target/wheels/*.whl pytest mypy
# Outside of the sources, so that what is installed is tested.
cd "$fresh"
bin/python -m pytest -q -p no:cacheprovider ../../python/tests
