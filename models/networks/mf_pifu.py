"""MF-PIFu: multi-scale features, pixel-aligned, several views (Li 2021, chapter 5; ICCV 2019 PIFu is its ancestor).

    images [N,3,S,S] --stem--> [N,c,S/2,S/2] --4 hourglasses, max-pooled between--> F_1..F_4
    F_k sampled at uv, concatenated with depth --MLP, mean over the views--> occupancy [P]

Inside is 1 (erratum E17). Every view sees the whole body; the views are joined by the mean of the last hidden layer
and of the skipped input (erratum E20), not by a vote of separate classifiers.
"""
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn


@dataclass(frozen=True)
class Size:
    """Widths of one MF-PIFu. Channels per normalisation group are those of the thesis' 32 groups at every width."""

    name: str
    stem: int
    inner: int
    out: int
    hidden: tuple[int, int, int]
    image_size: int = 256

    @property
    def features(self) -> int:
        """Length of a point's feature: four maps and the depth."""
        return 4 * self.out + 1


SMALL = Size("small", stem=16, inner=16, out=32, hidden=(128, 64, 32))
THESIS = Size("thesis", stem=64, inner=128, out=256, hidden=(1024, 512, 128))
SIZES = {size.name: size for size in (SMALL, THESIS)}

# Channels per group where the thesis' width has 32 groups: 64/32, 128/32, 256/32.
STEM_GROUP, INNER_GROUP, OUT_GROUP = 2, 4, 8


def group_norm(channels: int, per_group: int) -> nn.GroupNorm:
    """Group normalisation with a fixed number of channels per group, so that zero-padding the width changes nothing."""
    return nn.GroupNorm(channels // per_group, channels)


class Stem(nn.Module):
    """7×7 convolution, normalisation, ReLU, 2×2 max-pool: [N,3,S,S] -> [N,c,S/2,S/2] (erratum E19)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.conv = nn.Conv2d(3, channels, 7, stride=1, padding=3)
        self.norm = group_norm(channels, STEM_GROUP)

    def forward(self, images: Tensor) -> Tensor:
        return F.max_pool2d(F.relu(self.norm(self.conv(images))), 2)


class Hourglass(nn.Module):
    """Two strided convolutions down, two transposed convolutions up, 1×1 skips: [N,C,H,W] -> [N,out,H,W]."""

    def __init__(self, channels: int, inner: int, out: int) -> None:
        super().__init__()
        self.down1 = nn.Conv2d(channels, inner, 3, stride=2, padding=1)
        self.down1_norm = group_norm(inner, INNER_GROUP)
        self.down2 = nn.Conv2d(inner, out, 3, stride=2, padding=1)
        self.down2_norm = group_norm(out, OUT_GROUP)
        self.up1 = nn.ConvTranspose2d(out, out, 4, stride=2, padding=1)
        self.up1_norm = group_norm(out, OUT_GROUP)
        self.skip1 = nn.Conv2d(inner, out, 1)
        self.up2 = nn.ConvTranspose2d(out, out, 4, stride=2, padding=1)
        self.up2_norm = group_norm(out, OUT_GROUP)
        self.skip2 = nn.Conv2d(channels, out, 1)

    def forward(self, x: Tensor) -> Tensor:
        a = F.relu(self.down1_norm(self.down1(x)))
        b = F.relu(self.down2_norm(self.down2(a)))
        c = F.relu(self.up1_norm(self.up1(b)) + self.skip1(a))
        return F.relu(self.up2_norm(self.up2(c)) + self.skip2(x))


class Encoder(nn.Module):
    """Images [N,3,S,S] -> (F_1 [N,out,S/2,S/2], F_2 [.., S/4], F_3 [.., S/8], F_4 [.., S/16])."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.stem = Stem(size.stem)
        widths = [size.stem, size.out, size.out, size.out]
        self.hourglasses = nn.ModuleList(Hourglass(width, size.inner, size.out) for width in widths)

    def forward(self, images: Tensor) -> tuple[Tensor, ...]:
        x = self.stem(images)
        features = []
        for k, hourglass in enumerate(self.hourglasses):
            x = hourglass(x if k == 0 else F.max_pool2d(x, 2))
            features.append(x)
        return tuple(features)


class Mlp(nn.Module):
    """Point features [.., N, D, P] -> logits [.., P]; every layer after the first sees the input again.

    Hidden layers 1 to 3 run for each view; their result and the input are averaged over the views; layer 4 runs once.
    """

    def __init__(self, size: Size) -> None:
        super().__init__()
        d, (h1, h2, h3) = size.features, size.hidden
        self.layers = nn.ModuleList(
            nn.Conv1d(i, o, 1) for i, o in ((d, h1), (h1 + d, h2), (h2 + d, h3), (h3 + d, 1))
        )

    def forward(self, x: Tensor) -> Tensor:
        """x [N,D,P] for one scene -> logits [P]."""
        y = x
        for k, layer in enumerate(self.layers[:3]):
            y = F.leaky_relu(layer(y if k == 0 else torch.cat((y, x), 1)), 0.01)
        joined = torch.cat((y, x), 1).mean(0, keepdim=True)
        return self.layers[3](joined)[0, 0]


class Query(nn.Module):
    """Features of N views and P points in each -> occupancy [P].

    uv [N,P,2] are grid_sample coordinates of the crop (−1..1 edge to edge), depth [N,P] is relative to the body's
    centre in units of half the crop's width.
    """

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.mlp = Mlp(size)

    def logits(self, features: tuple[Tensor, ...], uv: Tensor, depth: Tensor) -> Tensor:
        grid = uv[:, :, None, :]
        sampled = [
            F.grid_sample(f, grid, mode="bilinear", padding_mode="zeros", align_corners=False)[..., 0] for f in features
        ]
        return self.mlp(torch.cat((*sampled, depth[:, None, :]), 1))

    def forward(
        self, features_1: Tensor, features_2: Tensor, features_3: Tensor, features_4: Tensor, uv: Tensor, depth: Tensor
    ) -> Tensor:
        return torch.sigmoid(self.logits((features_1, features_2, features_3, features_4), uv, depth))


class MfPifu(nn.Module):
    """Encoder and query; trained together, exported apart."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.size = size
        self.encoder = Encoder(size)
        self.query = Query(size)
