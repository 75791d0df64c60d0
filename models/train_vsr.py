"""Trains VSR: binary cross-entropy, Adam (Li 2021, chapter 6, section 3.4; eq. 6.10).

Of a scene's 22 000 points 6000 lie σ_max = 15 cm and 8000 σ_min = 1.5 cm around the coarse surface (erratum E23; the
thesis halves them), and 8000 σ_min around the true one, so that a lost limb is seen (erratum E35). Departures, for two
processor cores: `--points` a scene and step, one cosine, bfloat16, the cube mirrored at random.
"""
import numpy as np
import torch
import torch.nn.functional as F

from networks import vsr
from scenes import Scenes, vsr_sample
from training import Run, parse


def loss_of(model: vsr.Vsr, sample: tuple, full_precision: bool) -> tuple[torch.Tensor, float]:
    """Cross-entropy over the sample's points, and the share of points on the wrong side of ½."""
    voxels, points, occupancy = sample
    with torch.autocast("cpu", torch.bfloat16, enabled=not full_precision):
        logits = model.query.logits(model.encoder(voxels), points).float()
    wrong = ((logits > 0) != (occupancy > 0.5)).float().mean().item()
    return F.binary_cross_entropy_with_logits(logits, occupancy), wrong


@torch.no_grad()
def validate(model: vsr.Vsr, scenes: Scenes) -> dict[str, float]:
    """Loss and share of wrong points over the validation scenes, batch normalisation as deployed."""
    if not len(scenes):
        return {}
    model.eval()
    rng = np.random.default_rng(0)
    count = min(len(scenes), 12)
    figures = [loss_of(model, vsr_sample(rng, scenes[k], 8000), full_precision=True) for k in range(count)]
    model.train()
    return {
        "validation_loss": sum(l.item() for l, _ in figures) / count,
        "validation_wrong": sum(w for _, w in figures) / count,
    }


def main() -> None:
    options = parse(__doc__.splitlines()[0], minutes=38, rate=2e-3, points=16_000)
    rng = np.random.default_rng([options.seed, 2])
    model = vsr.Vsr(vsr.SIZES[options.size])
    run = Run(model, torch.optim.Adam(model.parameters(), lr=options.rate), options)
    scenes, validation = Scenes(options.data), Scenes(options.validation)

    def draw_loss() -> tuple[torch.Tensor, float]:
        batch = [vsr_sample(rng, scenes[rng.integers(len(scenes))], options.points) for _ in range(options.batch)]
        return loss_of(model, tuple(torch.cat(parts) for parts in zip(*batch)), options.full_precision)

    run.train(scenes, draw_loss, lambda: validate(model, validation), every=100)


if __name__ == "__main__":
    main()
