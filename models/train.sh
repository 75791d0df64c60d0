#!/usr/bin/env bash
# Everything from seeds to graphs: data, MF-PIFu, its coarse surfaces, VSR, export. Usage: models/train.sh [BODY.npz]
# Every step goes on where it was stopped. Seeds: 1 and 2 train, 3 is watched; tests use 1000 and above.
set -euo pipefail
cd "$(dirname "$0")/.."
body=${1:-}
vitruvian=target/release/vitruvian
python=models/.venv/bin/python
data=models/data
runs=models/runs
mkdir -p "$runs"

# Scenes of the second body where one is given, else of the mannequin alone.
scenes() { # FOLDER MANNEQUIN_COUNT BODY_COUNT [dataset options]
  local folder=$1 mannequin=$2 other=$3
  shift 3
  "$vitruvian" dataset -o "$folder/mannequin" --count "$mannequin" --seed 2 "$@"
  "$vitruvian" dataset -o "$folder/validation" --count 16 --seed 3 ${body:+--body "$body"} "$@"
  mkdir -p "$folder/body"
  [ -z "$body" ] || "$vitruvian" dataset -o "$folder/body" --count "$other" --seed 1 --body "$body" "$@"
}

scenes "$data/mf_pifu" 1000 2000
"$python" models/train_mf_pifu.py --data "$data/mf_pifu/body" "$data/mf_pifu/mannequin" \
  --validation "$data/mf_pifu/validation" -o "$runs/mf_pifu.pt" --minutes 38
"$python" models/export.py --size small --filling trained --only mf_pifu --checkpoints "$runs" -o "$runs/coarse"

scenes "$data/vsr" 150 300 --coarse "$runs/coarse"
"$python" models/train_vsr.py --data "$data/vsr/body" "$data/vsr/mannequin" \
  --validation "$data/vsr/validation" -o "$runs/vsr.pt" --minutes 38
"$python" models/export.py --size small --filling trained --checkpoints "$runs" -o models/exported

# The regressor's scenes have surroundings; it watches both bodies.
regressor=$data/regressor
"$vitruvian" dataset --for regressor -o "$regressor/mannequin" --count 2500 --seed 2
"$vitruvian" dataset --for regressor -o "$regressor/validation" --count 48 --seed 3 ${body:+--body "$body"}
"$vitruvian" dataset --for regressor -o "$regressor/validation_mannequin" --count 48 --seed 3
mkdir -p "$regressor/body"
[ -z "$body" ] || "$vitruvian" dataset --for regressor -o "$regressor/body" --count 9000 --seed 1 --body "$body"
