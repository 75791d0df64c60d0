#!/usr/bin/env bash
# Proves the arrows of ARCHITECTURE.md from cargo's own resolution: reference → nothing, runtime never → reference.
set -euo pipefail
cd "$(dirname "$0")/.."
lines=$(cargo tree -p vitruvian-reference -e all --prefix none | sort -u | wc -l)
if [ "$lines" -ne 1 ]; then
  echo "vitruvian-reference must depend on nothing; cargo tree prints $lines lines:" >&2
  cargo tree -p vitruvian-reference -e all >&2
  exit 1
fi
if cargo tree -p vitruvian-runtime -e all --prefix none | grep -q '^vitruvian-reference'; then
  echo "vitruvian-runtime must not reach vitruvian-reference: an oracle used by its subject cannot judge it" >&2
  exit 1
fi
echo "arrows: reference depends on nothing, runtime never reaches reference"
