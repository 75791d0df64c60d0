"""How far ONNX Runtime's answers of an exported graph lie from PyTorch's in double precision, on seeded inputs."""
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import onnxruntime
import torch
from torch import Tensor, nn

INPUT_SEED = 20210
VIEWS, POINTS = 4, 4096

# Room above the measured error for what a measurement on one machine cannot see: another processor (no FMA, other
# vector widths) sums in another order, and other inputs round otherwise. Both move the error by small factors, a
# wrong weight, axis or padding by orders of magnitude.
ALLOWED_FACTOR = 4
ALLOWED_REASON = (
    f"{ALLOWED_FACTOR} x measured: other processors sum in another order and other inputs round otherwise; "
    "a wrong weight, axis or padding errs by orders of magnitude more"
)


@dataclass(frozen=True)
class Agreement:
    """Largest |ONNX Runtime f32 − PyTorch f64| over all outputs, and the largest |value| it was found among."""

    unoptimised: float
    optimised: float
    largest_value: float

    @property
    def measured(self) -> float:
        return max(self.unoptimised, self.optimised)


def balls(shape: tuple[int, ...], generator: torch.Generator, count: int = 12) -> Tensor:
    """A union of balls in a box of cells or pixels −1..1: 1 inside, 0 outside; what masks and bodies look like."""
    axes = [(2 * torch.arange(n) + 1) / n - 1 for n in shape]
    cells = torch.stack(torch.meshgrid(*axes, indexing="ij"), -1)
    inside = torch.zeros(shape, dtype=torch.bool)
    for _ in range(count):
        centre = torch.rand(len(shape), generator=generator) * 1.4 - 0.7
        radius = 0.1 + 0.25 * torch.rand(1, generator=generator)
        inside |= (cells - centre).square().sum(-1) < radius.square()
    return inside.float()


def images(size: int, views: int = VIEWS) -> Tensor:
    """[views,3,size,size]: textures −1..1 inside a mask, exactly 0 outside, as the contract's input."""
    generator = torch.Generator().manual_seed(INPUT_SEED)
    texture = torch.rand((views, 3, size, size), generator=generator) * 2 - 1
    masks = torch.stack([balls((size, size), generator) for _ in range(views)])
    return texture * masks[:, None]


def voxels(resolution: int) -> Tensor:
    """[1,1,D,D,D] of zeros and ones."""
    generator = torch.Generator().manual_seed(INPUT_SEED)
    return balls((resolution,) * 3, generator)[None, None]


def uniform(shape: tuple[int, ...], reach: float) -> Tensor:
    """Seeded values in −reach..reach."""
    generator = torch.Generator().manual_seed(INPUT_SEED + 1)
    return (torch.rand(shape, generator=generator) * 2 - 1) * reach


def view_points() -> tuple[Tensor, Tensor]:
    """uv [N,P,2] and depth [N,P]; the uv beyond 1 leave the maps and show how padding is treated."""
    return uniform((VIEWS, POINTS, 2), 1.1), uniform((VIEWS, POINTS), 1.0)


def volume_points() -> Tensor:
    """[P,3], some outside the cube."""
    return uniform((POINTS, 3), 1.1)


def run(graph: bytes, inputs: Mapping[str, Tensor], optimise: bool, threads: int = 1) -> list[np.ndarray]:
    """The outputs of ONNX Runtime's CPU provider, all optimisations on or all off."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    levels = onnxruntime.GraphOptimizationLevel
    options.graph_optimization_level = levels.ORT_ENABLE_ALL if optimise else levels.ORT_DISABLE_ALL
    session = onnxruntime.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    return session.run(None, {name: tensor.numpy() for name, tensor in inputs.items()})


@torch.no_grad()
def measure(graph: bytes, module: nn.Module, inputs: Mapping[str, Tensor]) -> Agreement:
    """Compare `graph` with `module`, whose parameters are f64, on f32 `inputs` in the order of its arguments."""
    answer = module(*(tensor.double() for tensor in inputs.values()))
    truth = [t.numpy() for t in (answer if isinstance(answer, tuple) else (answer,))]

    def error(outputs: list[np.ndarray]) -> float:
        if [o.shape for o in outputs] != [t.shape for t in truth]:
            raise ValueError(f"shapes {[o.shape for o in outputs]}, PyTorch has {[t.shape for t in truth]}")
        worst = max(float(np.abs(o - t).max()) for o, t in zip(outputs, truth))
        if not np.isfinite(worst):
            raise ValueError("ONNX Runtime answered with values that are not finite")
        return worst

    return Agreement(
        unoptimised=error(run(graph, inputs, optimise=False)),
        optimised=error(run(graph, inputs, optimise=True)),
        largest_value=max(float(np.abs(t).max()) for t in truth),
    )
