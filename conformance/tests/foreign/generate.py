"""Write regressors as others export them: HMR- and SPIN-like, with rotations computed inside the graph.

    models/.venv/bin/python conformance/tests/foreign/generate.py

One small network (random weights, a short trunk) in two forms of its pose, by both exporters of PyTorch:

    matrix_*       [N,24,3,3], six numbers to matrices as in SPIN (normalise, inner product, cross product, stack)
    axis_angle_*   [N,72], from these matrices by way of quaternions, as torchgeometry does it
    *_torchscript  the older exporter, opset 17        *_dynamo  the newer one, opset 21

Same versions: same bytes. Needs PyTorch and onnx as pinned in models/requirements.txt.
"""
import pathlib

import onnx
import torch
import torch.nn.functional as F
from torch import Tensor, nn

HERE = pathlib.Path(__file__).resolve().parent


class Bottleneck(nn.Module):
    """1×1, 3×3, 1×1 and a projected shortcut."""

    def __init__(self, channels: int, planes: int) -> None:
        super().__init__()
        self.conv1, self.bn1 = nn.Conv2d(channels, planes, 1, bias=False), nn.BatchNorm2d(planes)
        self.conv2, self.bn2 = nn.Conv2d(planes, planes, 3, 2, 1, bias=False), nn.BatchNorm2d(planes)
        self.conv3, self.bn3 = nn.Conv2d(planes, 4 * planes, 1, bias=False), nn.BatchNorm2d(4 * planes)
        self.downsample = nn.Sequential(nn.Conv2d(channels, 4 * planes, 1, 2, bias=False), nn.BatchNorm2d(4 * planes))
        self.relu = nn.ReLU(inplace=True)

    def forward(self, x: Tensor) -> Tensor:
        y = self.relu(self.bn1(self.conv1(x)))
        y = self.bn3(self.conv3(self.relu(self.bn2(self.conv2(y)))))
        y += self.downsample(x)
        return self.relu(y)


def matrices_of_six(x: Tensor) -> Tensor:
    """[N,144] -> [24N,3,3], in SPIN's words."""
    x = x.view(-1, 3, 2)
    a1, a2 = x[:, :, 0], x[:, :, 1]
    b1 = F.normalize(a1)
    b2 = F.normalize(a2 - torch.einsum("bi,bi->b", b1, a2).unsqueeze(-1) * b1)
    return torch.stack((b1, b2, torch.cross(b1, b2, dim=-1)), dim=-1)


def quaternions_of_matrices(rotation: Tensor) -> Tensor:
    """[K,3,3] -> [K,4] (w, x, y, z), by the largest of four traces."""
    m = rotation.transpose(1, 2)
    low, first, opposite = m[:, 2, 2] < 1e-6, m[:, 0, 0] > m[:, 1, 1], m[:, 0, 0] < -m[:, 1, 1]
    t = [1 + a * m[:, 0, 0] + b * m[:, 1, 1] + c * m[:, 2, 2] for a, b, c in ((1, -1, -1), (-1, 1, -1), (-1, -1, 1), (1, 1, 1))]
    d = [m[:, 1, 2] - m[:, 2, 1], m[:, 2, 0] - m[:, 0, 2], m[:, 0, 1] - m[:, 1, 0]]
    s = [m[:, 0, 1] + m[:, 1, 0], m[:, 2, 0] + m[:, 0, 2], m[:, 1, 2] + m[:, 2, 1]]
    q = [
        torch.stack((d[0], t[0], s[0], s[1]), -1),
        torch.stack((d[1], s[0], t[1], s[2]), -1),
        torch.stack((d[2], s[1], s[2], t[2]), -1),
        torch.stack((t[3], d[0], d[1], d[2]), -1),
    ]
    masks = [low * first, low * ~first, ~low * opposite, ~low * ~opposite]
    masks = [mask.view(-1, 1).type_as(m) for mask in masks]
    trace = sum(t[k].repeat(4, 1).t() * masks[k] for k in range(4))
    return 0.5 * sum(q[k] * masks[k] for k in range(4)) / torch.sqrt(trace)


def axis_angles_of_matrices(rotation: Tensor) -> Tensor:
    """[K,3,3] -> [K,3], in torchgeometry's words; what is not a number becomes 0."""
    q = quaternions_of_matrices(rotation)
    squared = q[..., 1] * q[..., 1] + q[..., 2] * q[..., 2] + q[..., 3] * q[..., 3]
    sine, cosine = torch.sqrt(squared), q[..., 0]
    angle = 2.0 * torch.where(cosine < 0.0, torch.atan2(-sine, -cosine), torch.atan2(sine, cosine))
    factor = torch.where(squared > 0.0, angle / sine, 2.0 * torch.ones_like(sine))
    v = torch.zeros_like(q)[..., :3]
    for axis in range(3):
        v[..., axis] += q[..., axis + 1] * factor
    v[torch.isnan(v)] = 0.0
    return v


class Regressor(nn.Module):
    """image [N,3,32,32] -> pose, betas [N,10], camera [N,3]."""

    def __init__(self, form: str) -> None:
        super().__init__()
        self.form = form
        self.conv1, self.bn1 = nn.Conv2d(3, 4, 7, 2, 3, bias=False), nn.BatchNorm2d(4)
        self.relu, self.maxpool = nn.ReLU(inplace=True), nn.MaxPool2d(3, 2, 1)
        self.layer1 = nn.Sequential(Bottleneck(4, 3))
        self.avgpool = nn.AvgPool2d(4, stride=1)
        self.fc1, self.fc2, self.drop = nn.Linear(12 + 157, 8), nn.Linear(8, 8), nn.Dropout()
        self.decpose, self.decshape, self.deccam = nn.Linear(8, 144), nn.Linear(8, 10), nn.Linear(8, 3)
        self.register_buffer("init_pose", torch.randn(1, 144))
        self.register_buffer("init_shape", torch.zeros(1, 10))
        self.register_buffer("init_cam", torch.tensor([[0.9, 0.0, 0.0]]))
        for module in self.modules():
            if isinstance(module, nn.BatchNorm2d):
                module.running_mean.normal_(0, 0.1)
                module.running_var.uniform_(0.5, 1.5)

    def forward(self, x: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        count = x.shape[0]
        pose, betas, camera = (y.expand(count, -1) for y in (self.init_pose, self.init_shape, self.init_cam))
        x = self.layer1(self.maxpool(self.relu(self.bn1(self.conv1(x)))))
        feature = self.avgpool(x)
        feature = feature.view(feature.size(0), -1)
        for _ in range(3):
            y = self.drop(self.fc1(torch.cat([feature, pose, betas, camera], 1)))
            y = self.drop(self.fc2(y))
            pose, betas, camera = self.decpose(y) + pose, self.decshape(y) + betas, self.deccam(y) + camera
        rotation = matrices_of_six(pose)
        if self.form == "axis_angle":
            return axis_angles_of_matrices(rotation).reshape(count, 72), betas, camera
        return rotation.view(count, 24, 3, 3), betas, camera


def bare(model: onnx.ModelProto) -> onnx.ModelProto:
    """Without the exporter's notes on where each node comes from, which are most of the file."""
    del model.metadata_props[:]
    del model.graph.value_info[:]
    for item in (model.graph, *model.graph.node, *model.graph.initializer, *model.graph.input, *model.graph.output):
        item.doc_string = ""
        del item.metadata_props[:]
    return model


def main() -> None:
    names = {"input_names": ["image"], "output_names": ["pose", "betas", "camera"]}
    for form in ("matrix", "axis_angle"):
        torch.manual_seed(1)
        network, image = Regressor(form).eval(), torch.zeros(2, 3, 32, 32)
        path = HERE / f"{form}_torchscript.onnx"
        torch.onnx.export(network, (image,), path, dynamo=False, opset_version=17, dynamic_axes={"image": {0: "N"}}, **names)
        onnx.save(bare(onnx.load(path)), path)
        path = HERE / f"{form}_dynamo.onnx"
        shapes = ({0: torch.export.Dim("N", min=1)},)
        torch.onnx.export(
            network, (image,), path, dynamo=True, opset_version=21, dynamic_shapes=shapes, external_data=False, **names
        )
        onnx.save(bare(onnx.load(path)), path)


if __name__ == "__main__":
    main()
