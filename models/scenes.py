"""Training scenes as `vitruvian dataset` writes them, one `.npz` a scene, kept in memory once read.

MF-PIFu scene: images u8 [N,3,S,S] ((value − 128)/127, background exactly 0), projection f32 [N,3,4] (world metres to crop
pixels, homogeneous), depth_center f32 [N], depth_scale f32 [N], points f32 [P,3] (world), occupancy u8 [P].
VSR scene: voxels u8 [D,D,D] ([x][y][z], packed to bits), points f32 [P,3] (−1..1 in the cube), occupancy u8 [P].
"""
from pathlib import Path

import numpy as np
import torch
from torch import Tensor


class Scenes:
    """The scenes of a folder; `refresh` finds those written since, so that training can start while more are made."""

    def __init__(self, folders: list[Path]) -> None:
        self.folders = folders
        self.scenes: dict[Path, dict[str, np.ndarray]] = {}
        self.refresh()

    def refresh(self) -> None:
        for folder in self.folders:
            for path in sorted(folder.glob("*.npz")):
                if path not in self.scenes:
                    with np.load(path) as arrays:
                        self.scenes[path] = {name: arrays[name] for name in arrays.files}
        self.paths = sorted(self.scenes)

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: int) -> dict[str, np.ndarray]:
        return self.scenes[self.paths[index]]


def choose(rng: np.random.Generator, scene: dict[str, np.ndarray], count: int) -> tuple[np.ndarray, Tensor]:
    """`count` of the scene's labelled points, with their labels f32 [count]."""
    index = rng.integers(0, len(scene["points"]), count)
    return scene["points"][index], torch.from_numpy(scene["occupancy"][index].astype(np.float32))


def mf_pifu_sample(
    rng: np.random.Generator, scene: dict[str, np.ndarray], count: int, mirror: bool = False
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """(images [N,3,S,S], uv [N,count,2], depth [N,count], occupancy [count]); mirrored left to right if asked.

    uv = 2u'/S − 1 for crop pixels u' counted from the crop's corner; depth = (Z − depth_center)/depth_scale.
    """
    points, occupancy = choose(rng, scene, count)
    uv, depth = project(scene, points)
    images = (torch.from_numpy(scene["images"]).float() - 128.0) / 127.0
    if mirror:
        images, uv = images.flip(-1), uv * torch.tensor([-1.0, 1.0])
    return images, uv, depth, occupancy


def project(scene: dict[str, np.ndarray], points: np.ndarray) -> tuple[Tensor, Tensor]:
    """World points [P,3] -> (uv [N,P,2], depth [N,P]) of each view."""
    homogeneous = np.concatenate((points, np.ones_like(points[:, :1])), 1).astype(np.float64)
    pixels = np.einsum("nij,pj->npi", scene["projection"].astype(np.float64), homogeneous)
    uv = 2.0 * pixels[..., :2] / pixels[..., 2:] / scene["images"].shape[-1] - 1.0
    depth = (pixels[..., 2] - scene["depth_center"][:, None]) / scene["depth_scale"][:, None]
    return torch.from_numpy(uv.astype(np.float32)), torch.from_numpy(depth.astype(np.float32))


def vsr_sample(rng: np.random.Generator, scene: dict[str, np.ndarray], count: int) -> tuple[Tensor, Tensor, Tensor]:
    """(voxels [1,1,D,D,D] indexed [z][y][x], points [1,count,3], occupancy [1,count]), with x and z mirrored and swapped at random."""
    points, occupancy = choose(rng, scene, count)
    side = round((8 * scene["voxels"].size) ** (1 / 3))
    voxels = np.unpackbits(scene["voxels"]).reshape(side, side, side)
    points = points.copy()
    for axis in (0, 2):
        if rng.random() < 0.5:
            voxels, points[:, axis] = np.flip(voxels, axis), -points[:, axis]
    if rng.random() < 0.5:
        voxels, points = voxels.transpose(2, 1, 0), points[:, ::-1]
    tensor = torch.from_numpy(np.ascontiguousarray(voxels.transpose(2, 1, 0))).float()
    return tensor[None, None], torch.from_numpy(np.ascontiguousarray(points))[None], occupancy[None]
