"""What a trunk without earlier training learns its features by. Used in training, never exported.

A pooled feature that must answer through a chain of rotations says little about where in the image a joint is. So the
joints are also asked for twice without that chain: off the pooled feature, by a linear map, and off the third stage's
map, by one heat map and one depth map a joint and the mean over the heat map's softmax (integral regression: Sun, Xiao,
Wei, Liang, Wei 2018). Not in the thesis, whose trunk begins with SPIN's weights.
"""
import torch
from torch import Tensor, nn

import losses
from networks.regressor import Size
from people import Batch

JOINTS = 24
HIDDEN = 64
# Of the cross-entropy of a joint's place, and of the mean places and depths, beside the linear map's losses.
HEAT, INTEGRAL = 0.02, 2.0


class Auxiliary(nn.Module):
    """The third stage's map [B,4·P₃,H,H] and the pooled feature [B,F] to a loss."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.joints = nn.Linear(size.features, JOINTS * 5)
        self.up = nn.ConvTranspose2d(size.features // 2, HIDDEN, 4, stride=2, padding=1)
        self.places = nn.Conv2d(HIDDEN, 2 * JOINTS, 1)
        nn.init.zeros_(self.joints.weight)

    def integral(self, maps: Tensor) -> tuple[Tensor, Tensor]:
        """Maps [B,48,H,H], places then depths -> mean places [B,24,2] in −1..1 over the crop, mean depths [B,24] (m)."""
        side = maps.shape[-1]
        share = maps[:, :JOINTS].flatten(2).softmax(-1)
        centres = (torch.arange(side, dtype=maps.dtype) + 0.5) * 2 / side - 1
        places = torch.stack((share @ centres.repeat(side), share @ centres.repeat_interleave(side)), -1)
        return places, (share * maps[:, JOINTS:].flatten(2)).sum(-1)

    def forward(self, middle: Tensor, features: Tensor, batch: Batch) -> Tensor:
        """Losses of keypoints (eq. 4.1) and joints (eq. 4.5) of both readings, and of the heat maps."""
        read = self.joints(features).unflatten(1, (JOINTS, 5))
        maps = self.places(torch.relu(self.up(middle)))
        places, depths = self.integral(maps)
        linear = losses.keypoint_loss(read[..., :2], batch.keypoints, batch.confidence) + losses.joint_loss(
            read[..., 2:], batch.joints, batch.measured
        )
        integral = losses.keypoint_loss(places, batch.keypoints, batch.confidence) + losses.depth_loss(
            depths, batch.joints, batch.measured
        )
        heat = losses.heatmap_loss(maps[:, :JOINTS], batch.keypoints, batch.confidence)
        return linear + INTEGRAL * integral + HEAT * heat
