#!/usr/bin/env bash
# Everything from seeds to graphs: data, MF-PIFu, its coarse surfaces, VSR, the regressor, export. Usage: models/train.sh [BODY.npz]
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

# The regressor: a start under true poses and shapes (simple backgrounds first), then Figure 4.1's loop from there.
# Without --fit-in-the-loop and what follows it the last command is the other arm of Table 4.7.
people() { # FOLDER COUNT SEED [dataset options]
  local folder=$1 count=$2 seed=$3
  shift 3
  "$vitruvian" dataset --for regressor -o "$data/regressor/$folder" --count "$count" --seed "$seed" "$@"
}
people mannequin 1200 2
people validation 48 3 ${body:+--body "$body"}
mkdir -p "$data/regressor/body"
[ -z "$body" ] || people body 6000 1 --body "$body"
regressor() { # CHECKPOINT [options]
  local checkpoint=$1
  shift
  "$python" models/train_regressor.py --data "$data/regressor/body" "$data/regressor/mannequin" \
    --validation "$data/regressor/validation" -o "$runs/$checkpoint.pt" --batch 8 --direct 5 --dropout 0 "$@"
}
regressor regressor_start --supervised --steps 40000 --rate 1e-3 --last-rate 1e-4 --warm-up 200 --first-replaced 0.9
"$python" models/pose_prior.py "$data/regressor/body" "$data/regressor/mannequin" -o "$runs/pose_prior.npz"
regressor regressor --start "$runs/regressor_start.pt" --steps 3500 --rate 4e-4 --measured "$data/regressor/mannequin" \
  --fit-in-the-loop --pose-prior "$runs/pose_prior.npz" --program "$vitruvian"

"$python" models/export.py --size small --filling trained --checkpoints "$runs" -o models/exported
