"""Seeded weights for a network nobody trained: exercise every operator, keep activations near one, hide nothing.

A fresh PyTorch module is a poor test case. Its uniform weights shrink the signal layer by layer, its normalisations
are the identity (weight 1, bias 0, mean 0, variance 1), so a reader that forgets one of them passes. Here every
parameter differs from its neutral value, and the result does not depend on the order in which modules are built.
"""
import math

import torch
from torch import Tensor, nn

import agreement
from networks import mf_pifu, regressor, vsr

CONVOLUTIONS = (nn.Conv1d, nn.Conv2d, nn.Conv3d, nn.ConvTranspose2d)
BATCH_NORMALISATIONS = (nn.BatchNorm2d, nn.BatchNorm3d)
NORMALISATIONS = (nn.GroupNorm, *BATCH_NORMALISATIONS)


def fan_in(module: nn.Module) -> int:
    """Products summed per output value: C·k.. for a convolution, C·k../stride.. for a transposed one."""
    taps = math.prod(module.kernel_size)
    if isinstance(module, nn.ConvTranspose2d):
        return module.in_channels * taps // math.prod(module.stride)
    return module.in_channels * taps


@torch.no_grad()
def fill_randomly(network: nn.Module, seed: int) -> None:
    """Give every parameter and every running statistic of `network` a seeded value, in place.

    Convolutions w ~ U(−√(6/n), √(6/n)), n = fan in: PyTorch's default U(−1/√n, 1/√n) times √6, which keeps the mean
    square through a rectifier (He 2015, eq. 10). Linear layers, of which none is rectified, w ~ U(−√(3/n), √(3/n)).
    Biases ~ U(−0.1, 0.1). Normalisations: weight ~ U(0.5, 1.5), bias ~ U(−0.5, 0.5), running mean ~ U(−0.5, 0.5),
    running variance ~ U(0.5, 1.5). The regressor's mean body moves by U(−0.2, 0.2).
    """
    generator = torch.Generator().manual_seed(seed)

    def uniform(target: Tensor, low: float, high: float) -> None:
        target.copy_(torch.rand(target.shape, generator=generator) * (high - low) + low)

    for name, module in sorted(network.named_modules()):
        if isinstance(module, CONVOLUTIONS):
            bound = math.sqrt(6 / fan_in(module))
            uniform(module.weight, -bound, bound)
            if module.bias is not None:
                uniform(module.bias, -0.1, 0.1)
        elif isinstance(module, nn.Linear):
            bound = math.sqrt(3 / module.in_features)
            uniform(module.weight, -bound, bound)
            uniform(module.bias, -0.1, 0.1)
        elif isinstance(module, NORMALISATIONS):
            uniform(module.weight, 0.5, 1.5)
            uniform(module.bias, -0.5, 0.5)
            if isinstance(module, BATCH_NORMALISATIONS):
                uniform(module.running_mean, -0.5, 0.5)
                uniform(module.running_var, 0.5, 1.5)
        elif isinstance(module, regressor.Regressor):
            for mean in (module.init_pose, module.init_shape, module.init_cam):
                mean.add_(torch.rand(mean.shape, generator=generator) * 0.4 - 0.2)
        elif next(module.parameters(recurse=False), None) is not None:
            raise TypeError(f"no rule to fill {name}, a {type(module).__name__}")


@torch.no_grad()
def centre(network: nn.Module, logits: Tensor) -> None:
    """Move the last bias so that about half the points are inside; the logits of rectified inputs share a sign.

    The shift is rounded to 1/8, far above the rounding of the logits: it is the same number on every machine.
    """
    network.query.mlp.layers[-1].bias.sub_(torch.round(logits.median() * 8) / 8)


@torch.no_grad()
def random_mf_pifu(size: mf_pifu.Size, seed: int) -> mf_pifu.MfPifu:
    """MF-PIFu with seeded weights whose field takes both sides of the level."""
    network = mf_pifu.MfPifu(size).eval()
    fill_randomly(network, seed)
    uv, depth = agreement.view_points()
    centre(network, network.query.logits(network.encoder(agreement.images(size.image_size)), uv, depth))
    return network


@torch.no_grad()
def random_vsr(size: vsr.Size, seed: int) -> vsr.Vsr:
    """VSR with seeded weights whose field takes both sides of the level."""
    network = vsr.Vsr(size).eval()
    fill_randomly(network, seed)
    voxels = agreement.voxels(size.resolution)
    centre(network, network.query.logits(network.encoder(voxels), agreement.volume_points()[None]))
    return network


@torch.no_grad()
def random_regressor(size: regressor.Size, seed: int) -> regressor.Regressor:
    """A regressor with seeded weights whose answers are bodies: joints turn, the camera stands before the person.

    Each of the sixteen blocks adds to its input, which would double the mean square sixteen times: the last
    normalisation of a block is halved. The heads are divided by 100, so that the mean body is corrected, not replaced.
    """
    network = regressor.Regressor(size).eval()
    fill_randomly(network, seed)
    for module in network.modules():
        if isinstance(module, regressor.Bottleneck):
            module.bn3.weight.mul_(0.5)
    for head in (network.decpose, network.decshape, network.deccam):
        head.weight.mul_(0.01)
        head.bias.mul_(0.01)
    return network
