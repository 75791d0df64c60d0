"""VSR: voxel super-resolution of a coarse surface (Li 2021, chapter 6; CVPR 2020 IF-Net is its ancestor).

    voxels [1,1,D,D,D] --5 stages of 3×3×3 convolutions, max-pooled between--> F_1 [D] .. F_5 [D/16]
    F_k sampled at points, concatenated --MLP--> occupancy [P]

Voxels are indexed [z][y][x]; points are (x, y, z) in −1..1, edge to edge of the cube, so that cell centre i lies at
(2i+1)/D − 1 on every level. Inside is 1.
"""
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn


@dataclass(frozen=True)
class Size:
    """Channels of the five stages and of the point network."""

    name: str
    stages: tuple[int, int, int, int, int]
    hidden: tuple[int, int, int]
    resolution: int = 128

    @property
    def features(self) -> int:
        """Length of a point's feature."""
        return sum(self.stages)


SMALL = Size("small", stages=(8, 16, 32, 32, 32), hidden=(64, 64, 64))
THESIS = Size("thesis", stages=(16, 32, 64, 128, 128), hidden=(256, 256, 256))
SIZES = {size.name: size for size in (SMALL, THESIS)}


class Stage(nn.Module):
    """(3×3×3 convolution, ReLU) once or twice, then batch normalisation, as IF-Net orders them."""

    def __init__(self, channels: int, out: int, convolutions: int) -> None:
        super().__init__()
        self.convs = nn.ModuleList(
            nn.Conv3d(channels if k == 0 else out, out, 3, padding=1) for k in range(convolutions)
        )
        self.norm = nn.BatchNorm3d(out)

    def forward(self, x: Tensor) -> Tensor:
        for conv in self.convs:
            x = F.relu(conv(x))
        return self.norm(x)


class Encoder(nn.Module):
    """Voxels [B,1,D,D,D] -> five feature volumes of sides D, D/2, D/4, D/8, D/16."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        widths = (1, *size.stages)
        self.stages = nn.ModuleList(Stage(widths[k], widths[k + 1], 1 if k == 0 else 2) for k in range(5))

    def forward(self, voxels: Tensor) -> tuple[Tensor, ...]:
        x, features = voxels, []
        for k, stage in enumerate(self.stages):
            x = stage(x if k == 0 else F.max_pool3d(x, 2))
            features.append(x)
        return tuple(features)


class Mlp(nn.Module):
    """Point features [B,D,P] -> logits [B,P]."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        widths = (size.features, *size.hidden, 1)
        self.layers = nn.ModuleList(nn.Conv1d(widths[k], widths[k + 1], 1) for k in range(4))

    def forward(self, x: Tensor) -> Tensor:
        for layer in self.layers[:3]:
            x = F.relu(layer(x))
        return self.layers[3](x)[:, 0]


class Query(nn.Module):
    """Feature volumes and points [P,3] -> occupancy [P]."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.mlp = Mlp(size)

    def logits(self, features: tuple[Tensor, ...], points: Tensor) -> Tensor:
        """points [B,P,3] -> logits [B,P]."""
        grid = points[:, :, None, None, :]
        sampled = [
            F.grid_sample(f, grid, mode="bilinear", padding_mode="border", align_corners=False)[..., 0, 0]
            for f in features
        ]
        return self.mlp(torch.cat(sampled, 1))

    def forward(
        self,
        features_1: Tensor,
        features_2: Tensor,
        features_3: Tensor,
        features_4: Tensor,
        features_5: Tensor,
        points: Tensor,
    ) -> Tensor:
        features = (features_1, features_2, features_3, features_4, features_5)
        return torch.sigmoid(self.logits(features, points[None]))[0]


class Vsr(nn.Module):
    """Encoder and query; trained together, exported apart."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.size = size
        self.encoder = Encoder(size)
        self.query = Query(size)
