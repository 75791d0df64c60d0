"""Write the golden answers of PyTorch that the tests of `reference` compare with.

    models/.venv/bin/python reference/goldens/generate.py

Everything is computed in float64 from inputs that the Rust tests make by the same rule (`pattern`), so that only answers
are stored: `reference/src/nn/goldens/operators.rs`, `reference/src/network/goldens.rs` and `reference/src/loss/goldens.rs`.
"""
import sys
import textwrap
from pathlib import Path

import torch
import torch.nn.functional as F
from torch import Tensor

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "models"))
import losses  # noqa: E402
from networks import mf_pifu, regressor, vsr  # noqa: E402

HEAD = """// Written by reference/goldens/generate.py with PyTorch {version} in float64; regenerate with
// models/.venv/bin/python reference/goldens/generate.py

use {module}::Golden;
"""


def pattern(shape: tuple[int, ...], seed: int) -> Tensor:
    """The twin of `pattern` in reference/src/nn/goldens/mod.rs."""
    i = torch.arange(torch.Size(shape).numel())
    return (((31 * i * i + 7919 * i + 104729 * seed) % 1009).double() / 504.5 - 1).reshape(shape)


def golden(y: Tensor) -> str:
    shape = ", ".join(map(str, y.shape))
    data = ", ".join(f"{v:.13e}" for v in y.detach().flatten().tolist())
    lines = textwrap.wrap(data, 106, break_on_hyphens=False, initial_indent="    ", subsequent_indent="    ")
    return f"Golden {{ shape: &[{shape}], data: &[\n" + "\n".join(lines) + "\n] }"


def write(path: str, module: str, goldens: dict[str, Tensor | list[Tensor]]) -> None:
    text = HEAD.format(version=torch.__version__.split("+")[0], module=module)
    for name, y in goldens.items():
        many = isinstance(y, list)
        kind, body = (f"[Golden; {len(y)}]", f"[{', '.join(map(golden, y))}]") if many else ("Golden", golden(y))
        text += f"\n#[rustfmt::skip]\npub(crate) static {name}: {kind} = {body};\n"
    (ROOT / path).write_text(text)


def operators() -> dict[str, Tensor | list[Tensor]]:
    """In the order and with the seeds of the tests beside each operator."""
    p = pattern
    out: dict[str, Tensor | list[Tensor]] = {}
    out["CONV_1D"] = F.conv1d(p((2, 3, 7), 1), p((4, 3, 3), 2), p((4,), 3), stride=2, padding=1)
    out["CONV_2D"] = F.conv2d(
        p((1, 4, 6, 5), 4), p((6, 2, 3, 2), 5), p((6,), 6), stride=(2, 1), padding=(2, 1), dilation=(2, 1), groups=2
    )
    out["CONV_3D"] = F.conv3d(p((1, 2, 3, 4, 5), 7), p((2, 2, 3, 3, 3), 8), padding=1)
    out["CONV_TRANSPOSE_2D"] = F.conv_transpose2d(
        p((1, 4, 3, 4), 1), p((4, 2, 3, 4), 2), p((4,), 3),
        stride=(2, 3), padding=(1, 2), dilation=(1, 2), groups=2, output_padding=(1, 2),
    )  # fmt: skip
    out["CONV_TRANSPOSE_3D"] = F.conv_transpose3d(p((1, 2, 2, 3, 2), 4), p((2, 1, 4, 4, 4), 5), stride=2, padding=1)
    x = p((1, 2, 7, 6), 1)
    out["MAX_POOL_2D"] = F.max_pool2d(x, (3, 2), 2, padding=1, ceil_mode=True)
    out["AVERAGE_POOL_2D_PADDED"] = F.avg_pool2d(x, (3, 2), 2, padding=1, ceil_mode=True, count_include_pad=True)
    out["AVERAGE_POOL_2D"] = F.avg_pool2d(x, (3, 2), 2, padding=1, ceil_mode=True, count_include_pad=False)
    out["MAX_POOL_3D"] = F.max_pool3d(p((1, 1, 5, 4, 6), 2), 2, 2, dilation=(2, 1, 3))
    out["GLOBAL_AVERAGE_POOL"] = F.adaptive_avg_pool2d(p((2, 3, 4, 5), 3), 1)
    out["MATMUL"] = p((2, 1, 3, 4), 1) @ p((3, 4, 2), 2)
    out["GEMM"] = 0.5 * p((4, 3), 3).T @ p((2, 4), 4).T + 2 * p((2,), 5)
    out["EINSUM"] = torch.einsum("bij,bjk,k->bik", p((2, 3, 4), 1), p((2, 4, 3), 2), p((3,), 3))
    places = torch.tensor([[[3, 0, 1], [2, 1, 0]], [[0, 3, 2], [1, 2, 3]]])
    out["SCATTER_ELEMENTS"] = p((2, 4, 3), 1).scatter(1, places, p((2, 2, 3), 2))
    x = p((12,), 1)
    out["TRANSCENDENTAL"] = [x.exp(), x.abs().log(), x.sin(), x.cos(), x.acos(), x.atan(), x.abs().pow(1.5)]
    x, s, b = p((2, 6, 3, 2), 1), p((6,), 2), p((6,), 3)
    out["GROUP_NORM"] = F.group_norm(x, 3, s, b)
    out["INSTANCE_NORM"] = F.instance_norm(x, weight=s, bias=b)
    out["BATCH_NORM"] = F.batch_norm(x, p((6,), 4), p((6,), 5) ** 2, s, b)
    out["LAYER_NORM"] = F.layer_norm(x, (3, 2), p((3, 2), 6), p((3, 2), 7))
    modes = [(m, a) for a in (False, True) for m in ("zeros", "border", "reflection")]
    image, grid = p((2, 2, 3, 4), 1), 1.6 * p((2, 3, 2, 2), 2)
    volume, points = p((1, 2, 2, 3, 4), 3), 1.6 * p((1, 1, 1, 5, 3), 4)
    out["GRID_SAMPLE_2D"] = [F.grid_sample(image, grid, padding_mode=m, align_corners=a) for m, a in modes]
    out["GRID_SAMPLE_3D"] = [F.grid_sample(volume, points, padding_mode=m, align_corners=a) for m, a in modes]
    for name, mode, x, at in [
        ("NEAREST_2D", "nearest", image, grid), ("NEAREST_3D", "nearest", volume, points), ("CUBIC_2D", "bicubic", image, grid)
    ]:
        out[f"GRID_SAMPLE_{name}"] = [F.grid_sample(x, at, mode, padding_mode=m, align_corners=a) for m, a in modes]

    image, volume, line = p((1, 2, 5, 4), 1), p((1, 1, 3, 4, 2), 2), p((2, 1, 6), 3)
    for name, x, size, mode in [
        ("LINEAR_1D", line, 9, "linear"),
        ("LINEAR_2D", image, (8, 7), "bilinear"),
        ("CUBIC_2D", image, (8, 7), "bicubic"),
        ("CUBIC_2D_SMALLER", image, (3, 2), "bicubic"),
        ("LINEAR_3D", volume, (5, 3, 4), "trilinear"),
    ]:
        out[f"RESIZE_{name}"] = [F.interpolate(x, size=size, mode=mode, align_corners=a) for a in (False, True)]
    image = p((1, 1, 9, 7), 4)
    for name, mode in [("LINEAR", "bilinear"), ("CUBIC", "bicubic")]:
        out[f"RESIZE_ANTIALIASED_{name}"] = F.interpolate(image, size=(4, 3), mode=mode, antialias=True)
    return out


def fill(module: torch.nn.Module) -> None:
    """Weights by the rule of `Weights::pattern` in reference/src/network: tensor k of the names in order has seed k + 1.

    Convolutions are scaled by 1/√(inputs), a variance is 1 + pattern², a norm's weight 1 + pattern/2.
    """
    state = {k: v for k, v in module.double().eval().state_dict().items() if "num_batches" not in k}
    for seed, name in enumerate(sorted(state), 1):
        value = pattern(tuple(state[name].shape), seed)
        if value.dim() > 1:
            value = value / (value[0].numel() ** 0.5)
        elif "var" in name:
            value = 1 + value**2
        elif name.endswith("weight"):
            value = 1 + value / 2
        state[name].copy_(value)


@torch.no_grad()
def networks() -> dict[str, Tensor | list[Tensor]]:
    """Whole networks, narrower than the small ones and with the same channels per group."""
    out: dict[str, Tensor | list[Tensor]] = {}
    net = mf_pifu.MfPifu(mf_pifu.Size("golden", stem=4, inner=4, out=8, hidden=(6, 5, 4), image_size=64))
    fill(net.encoder)
    fill(net.query)
    images = pattern((2, 3, 64, 64), 1)
    features = net.encoder(images)
    out["MF_PIFU_FEATURES"] = [f[:, ::3, ::5, ::7] for f in features]
    uv, depth = 1.2 * pattern((2, 9, 2), 2), pattern((2, 9), 3)
    out["MF_PIFU_OCCUPANCY"] = net.query(*features, uv, depth)
    net = vsr.Vsr(vsr.Size("golden", stages=(2, 3, 4, 5, 5), hidden=(6, 5, 4), resolution=16))
    fill(net.encoder)
    fill(net.query)
    voxels = (pattern((1, 1, 16, 16, 16), 1) > 0).double()
    features = net.encoder(voxels)
    out["VSR_FEATURES"] = [f[:, :, ::3, ::3, ::5] for f in features]
    out["VSR_OCCUPANCY"] = net.query(*features, 1.2 * pattern((9, 3), 2))
    net = regressor.Regressor(regressor.Size("golden", planes=(2, 3, 4, 5), hidden=7, image_size=64))
    fill(net)
    images, layers = pattern((2, 3, 64, 64), 1), []
    for layer in (net.layer1, net.layer2, net.layer3, net.layer4):
        layer.register_forward_hook(lambda _module, _inputs, y: layers.append(y[:, ::3, ::3, ::2]))
    out["REGRESSOR_OUTPUTS"] = list(net(images))
    out["REGRESSOR_LAYERS"] = layers[:4]
    out["REGRESSOR_FEATURE"] = net.features(images)
    return out


def regressor_losses() -> dict[str, Tensor | list[Tensor]]:
    """The value and gradient of each loss that models/losses.py trains the regressor on, and of the printed norms."""
    out: dict[str, Tensor | list[Tensor]] = {}
    everyone = torch.ones(2, dtype=torch.bool)

    def inputs(*shape: int) -> tuple[Tensor, Tensor]:
        return pattern(shape, 1).requires_grad_(), pattern(shape, 2)

    def slope(name: str, loss: Tensor, *predicted: Tensor) -> None:
        out[name] = [loss, *torch.autograd.grad(loss, predicted)]

    keypoints, joints, pose = inputs(2, 24, 2), inputs(2, 24, 3), inputs(2, 24, 3, 3)
    betas, vertices = inputs(2, 10), inputs(2, 7, 3)
    confidence = pattern((48,), 3).abs().reshape(2, 24)
    slope("KEYPOINT_LOSS", losses.keypoint_loss(*keypoints, confidence), keypoints[0])
    slope("JOINT_LOSS", losses.joint_loss(*joints, confidence), joints[0])
    slope("POSE_LOSS", losses.pose_loss(*pose, everyone), pose[0])
    slope("BETAS_LOSS", losses.betas_loss(*betas, everyone), betas[0])
    slope("VERTEX_LOSS", losses.vertex_loss(*vertices, everyone), vertices[0])
    slope("SUM_OF_NORMS", (keypoints[0] - keypoints[1]).norm(dim=-1).sum(), keypoints[0])
    scales = (pattern((5,), 1) / 4).requires_grad_()
    slope("CAMERA_LOSS", losses.camera_loss(scales[:, None]), scales)
    scales = torch.tensor([0.1, 0.9], dtype=torch.float64, requires_grad=True)
    ones = torch.ones(2, 24, dtype=torch.float64)
    loss = losses.total(
        losses.Weights(),
        keypoints=losses.keypoint_loss(*keypoints, ones),
        joints=losses.joint_loss(*joints, ones),
        pose=losses.pose_loss(*pose, everyone),
        betas=losses.betas_loss(*betas, everyone),
        vertices=losses.vertex_loss(*vertices, everyone),
        camera=losses.camera_loss(scales[:, None]),
    )
    slope("REGRESSOR_LOSS", loss, *(pair[0] for pair in (keypoints, joints, pose, betas, vertices)), scales)
    return out


if __name__ == "__main__":
    write("reference/src/nn/goldens/operators.rs", "super", operators())
    write("reference/src/network/goldens.rs", "crate::nn::goldens", networks())
    write("reference/src/loss/goldens.rs", "crate::nn::goldens", regressor_losses())
