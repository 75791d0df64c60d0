"""The regressor of pose, shape and camera from one image (Li 2021, section 4.3.2; CVPR 2018 HMR, ICCV 2019 SPIN).

    image [N,3,S,S] --ResNet-50, mean over the map--> feature [N,F]
    (pose, betas, camera) = mean body;  three times:  += heads(fc2(fc1(feature, pose, betas, camera)))

It writes 144 + 10 + 3 numbers, rotations as six numbers each, where the thesis counts 85 (erratum E50). Modules and
parameters have SPIN's and torchvision's names, so that their weights load. There is no nonlinearity between the layers
of the head: without dropout, one iteration is affine in feature and estimate.
"""
from dataclasses import dataclass

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from networks.rotation import six_of_matrix

POSE, BETAS, CAMERA = 144, 10, 3
ITERATIONS = 3
BLOCKS = (3, 4, 6, 3)
EXPANSION = 4
# The weak-perspective camera (s, t_x, t_y) stands for a pinhole of this many pixels at 224 (HMR's choice).
FOCAL_AT_224 = 5000.0
# RGB/255 enters less this mean and over this deviation: ImageNet's, as torchvision's trunks were trained.
MEAN, STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)


@dataclass(frozen=True)
class Size:
    """Widths of one regressor: inner channels of the four stages, of the head, and the side of the image."""

    name: str
    planes: tuple[int, int, int, int]
    hidden: int
    image_size: int

    @property
    def stem(self) -> int:
        """Channels after the first convolution."""
        return self.planes[0]

    @property
    def features(self) -> int:
        """F, the length of the image's feature."""
        return EXPANSION * self.planes[3]

    @property
    def focal_length(self) -> float:
        """Focal length in pixels of the crop: 5000·S/224, one field of view at every size."""
        return FOCAL_AT_224 * self.image_size / 224


SMALL = Size("small", planes=(16, 32, 64, 128), hidden=256, image_size=128)
THESIS = Size("thesis", planes=(64, 128, 256, 512), hidden=1024, image_size=224)
SIZES = {size.name: size for size in (SMALL, THESIS)}


class Bottleneck(nn.Module):
    """1×1, 3×3, 1×1 with batch normalisation each, added to the input; the stride sits on the 3×3 (ResNet v1.5)."""

    def __init__(self, channels: int, planes: int, stride: int) -> None:
        super().__init__()
        out = EXPANSION * planes
        self.conv1 = nn.Conv2d(channels, planes, 1, bias=False)
        self.bn1 = nn.BatchNorm2d(planes)
        self.conv2 = nn.Conv2d(planes, planes, 3, stride=stride, padding=1, bias=False)
        self.bn2 = nn.BatchNorm2d(planes)
        self.conv3 = nn.Conv2d(planes, out, 1, bias=False)
        self.bn3 = nn.BatchNorm2d(out)
        changes = stride != 1 or channels != out
        self.downsample = (
            nn.Sequential(nn.Conv2d(channels, out, 1, stride=stride, bias=False), nn.BatchNorm2d(out)) if changes else None
        )

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu(self.bn1(self.conv1(x)))
        y = F.relu(self.bn2(self.conv2(y)))
        y = self.bn3(self.conv3(y))
        return F.relu(y + (x if self.downsample is None else self.downsample(x)))


class Regressor(nn.Module):
    """image [N,3,S,S] -> pose [N,144] (six numbers a joint), betas [N,10], camera [N,3] = (s, t_x, t_y)."""

    def __init__(self, size: Size) -> None:
        super().__init__()
        self.size = size
        self.conv1 = nn.Conv2d(3, size.stem, 7, stride=2, padding=3, bias=False)
        self.bn1 = nn.BatchNorm2d(size.stem)
        channels = size.stem
        for stage, (planes, blocks) in enumerate(zip(size.planes, BLOCKS), 1):
            layers = []
            for block in range(blocks):
                layers.append(Bottleneck(channels, planes, 2 if stage > 1 and block == 0 else 1))
                channels = EXPANSION * planes
            setattr(self, f"layer{stage}", nn.Sequential(*layers))
        self.fc1 = nn.Linear(size.features + POSE + BETAS + CAMERA, size.hidden)
        self.drop1 = nn.Dropout()
        self.fc2 = nn.Linear(size.hidden, size.hidden)
        self.drop2 = nn.Dropout()
        self.decpose = nn.Linear(size.hidden, POSE)
        self.decshape = nn.Linear(size.hidden, BETAS)
        self.deccam = nn.Linear(size.hidden, CAMERA)
        self.register_buffer("init_pose", six_of_matrix(upright()).flatten()[None])
        self.register_buffer("init_shape", torch.zeros(1, BETAS))
        self.register_buffer("init_cam", torch.tensor([[0.9, 0.0, 0.0]]))
        self.initialise()

    @torch.no_grad()
    def initialise(self) -> None:
        """Weights before training: convolutions N(0, √(2/(k²·out))), heads almost zero, so that the mean body comes first."""
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                taps = module.kernel_size[0] * module.kernel_size[1] * module.out_channels
                module.weight.normal_(0, math.sqrt(2 / taps))
        for head in (self.decpose, self.decshape, self.deccam):
            nn.init.xavier_uniform_(head.weight, gain=0.01)

    def middle(self, image: Tensor) -> Tensor:
        """[N,3,S,S] -> the map of the third stage [N,F/2,S/16,S/16]."""
        x = F.max_pool2d(F.relu(self.bn1(self.conv1(image))), 3, stride=2, padding=1)
        return self.layer3(self.layer2(self.layer1(x)))

    def features(self, image: Tensor) -> Tensor:
        """[N,3,S,S] -> [N,F], the mean of the last map over its places."""
        return self.layer4(self.middle(image)).mean((2, 3))

    def iterate(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """[N,F] -> pose, betas and camera after three corrections of the mean body."""
        count = features.shape[0]
        pose = self.init_pose.expand(count, -1)
        betas = self.init_shape.expand(count, -1)
        camera = self.init_cam.expand(count, -1)
        for _ in range(ITERATIONS):
            x = self.drop1(self.fc1(torch.cat((features, pose, betas, camera), 1)))
            x = self.drop2(self.fc2(x))
            pose, betas, camera = pose + self.decpose(x), betas + self.decshape(x), camera + self.deccam(x)
        return pose, betas, camera

    def forward(self, image: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        return self.iterate(self.features(image))


def upright() -> Tensor:
    """Rotations [24,3,3] of a body that stands straight and faces the camera: half a turn about x, then none."""
    rotations = torch.eye(3).repeat(24, 1, 1)
    rotations[0] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    return rotations
