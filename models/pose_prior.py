"""Write a Gaussian mixture of the body poses in folders of training scenes, one Gaussian a folder, as a prior for fits.

    python models/pose_prior.py data/regressor/body data/regressor/mannequin -o runs/pose_prior.npz

MV-SMPLify takes it by `vitruvian fit --prior`. Keypoints at joints show no twist of a bone; without a prior on the pose a
fit keeps the twist that it starts from, and a network that learns from such fits wanders. The thesis has SMPLify's mixture
of captured poses there, whose data are not free; a folder holds one body, and a body's rest pose is what its poses are
counted from: hence one Gaussian each.
"""
import argparse
import os
from pathlib import Path

import numpy as np

BODY = slice(3, 72)  # θ without the root's rotation
RIDGE = 1e-4  # rad²: joints that the scenes hardly turn keep a finite weight


def mixture(folders: list[Path]) -> dict[str, np.ndarray]:
    """means [K,69], covariances [K,69,69] (rad, rad²) and weights [K] of the scenes' poses."""
    poses = []
    for folder in folders:
        scenes = sorted(folder.glob("*.npz"))
        if len(scenes) < 2:
            raise SystemExit(f"{folder}: {len(scenes)} scenes, expected at least 2: see vitruvian dataset --for regressor")
        drawn = []
        for path in scenes:
            with np.load(path) as scene:
                drawn.append(scene["poses"][BODY].astype(np.float64))
        poses.append(np.stack(drawn))
    count = np.array([len(p) for p in poses], dtype=np.float64)
    return {
        "means": np.stack([p.mean(0) for p in poses]),
        "covariances": np.stack([np.cov(p.T) + RIDGE * np.eye(p.shape[1]) for p in poses]),
        "weights": count / count.sum(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folders", type=Path, nargs="+", help="folders that `vitruvian dataset --for regressor` wrote")
    parser.add_argument("-o", "--out", type=Path, required=True, help="the .npz to write")
    options = parser.parse_args()
    beside = options.out.with_suffix(".part.npz")
    np.savez(beside, **mixture(options.folders))
    os.replace(beside, options.out)


if __name__ == "__main__":
    main()
