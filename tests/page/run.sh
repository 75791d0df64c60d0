#!/usr/bin/env bash
# Makes pages of a real audit and of a planted fault, and opens them in headless Chromium. Needs the built command, the Python of
# models/ (`make python`), npm and Chromium (Debian: apt-get install chromium; elsewhere set CHROMIUM to its path).
set -euo pipefail
cd "$(dirname "$0")/../.."
vitruvian=${VITRUVIAN:-target/release/vitruvian}
python=${PYTHON:-models/.venv/bin/python}
here=tests/page
pages=$here/out
[ -x "${CHROMIUM:-/usr/bin/chromium}" ] || { echo "no Chromium: apt-get install chromium, or set CHROMIUM to its path" >&2; exit 3; }
[ -d "$here/node_modules" ] || npm --prefix "$here" ci --no-audit --no-fund
rm -rf "$pages"
mkdir -p "$pages"

# Runs a command whose exit status is known.
ends() {
    local status=$1 found=0
    shift
    "$@" >/dev/null || found=$?
    [ "$found" -eq "$status" ] || { echo "$*: exit status $found, expected $status" >&2; exit 1; }
}

ends 0 "$vitruvian" audit models/exported/mf_pifu_encoder.onnx --dim N=1 --json $pages/clean.json --html $pages/clean.html

graph=models/exported/mf_pifu_query.onnx
shapes='{"features_1": [1, 32, 128, 128], "features_2": [1, 32, 64, 64], "features_3": [1, 32, 32, 32],
         "features_4": [1, 32, 16, 16], "uv": [1, 300, 2], "depth": [1, 300]}'
"$python" $here/plant.py $graph GridSample align_corners "$shapes" $pages/planted.npz
ends 4 "$vitruvian" audit $graph --runtime npz:$pages/planted.npz --json $pages/planted.json --html $pages/planted.html

regressor=models/exported/regressor.onnx
ends 0 "$vitruvian" audit plan $regressor --to f16 --budget-mm 1e6 --draws 1 --write $pages/f16.onnx
ends 0 "$vitruvian" audit diff $regressor $pages/f16.onnx --draws 1 --no-attribution --html $pages/diff.html

node $here/test.mjs $pages $pages/screenshots
