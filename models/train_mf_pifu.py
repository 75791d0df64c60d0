"""Trains MF-PIFu: mean squared error of the occupancy, RMSprop (Li 2021, chapter 5, section 4; eq. 5.4).

Departures from the thesis, for two processor cores: a step takes `--points` of a scene's 24 000 points rather than
10 000, the rate falls along a cosine rather than by 0.1 after ten epochs, forward passes run in bfloat16, a third of the
points lie closer (σ = 1.5 cm) and a quarter anywhere in the query cube, and scenes are mirrored at random.
"""
import numpy as np
import torch
import torch.nn.functional as F

from networks import mf_pifu
from scenes import Scenes, mf_pifu_sample
from training import Run, parse


def loss_of(model: mf_pifu.MfPifu, samples: list[tuple], full_precision: bool) -> tuple[torch.Tensor, float]:
    """Mean squared error over the samples' points, and the share of points on the wrong side of ½."""
    with torch.autocast("cpu", torch.bfloat16, enabled=not full_precision):
        features = model.encoder(torch.cat([images for images, *_ in samples]))
        loss, wrong, first = 0.0, 0.0, 0
        for images, uv, depth, occupancy in samples:
            views = slice(first, first + len(images))
            first += len(images)
            logits = model.query.logits(tuple(f[views] for f in features), uv, depth).float()
            loss = loss + F.mse_loss(torch.sigmoid(logits), occupancy)
            wrong += ((logits > 0) != (occupancy > 0.5)).float().mean().item()
    return loss / len(samples), wrong / len(samples)


@torch.no_grad()
def validate(model: mf_pifu.MfPifu, scenes: Scenes) -> dict[str, float]:
    """Loss and share of wrong points over the validation scenes."""
    if not len(scenes):
        return {}
    loss, wrong = 0.0, 0.0
    rng = np.random.default_rng(0)
    count = min(len(scenes), 16)
    for index in range(count):
        sample = mf_pifu_sample(rng, scenes[index], 4000)
        l, w = loss_of(model, [sample], full_precision=True)
        loss, wrong = loss + l.item() / count, wrong + w / count
    return {"validation_loss": loss, "validation_wrong": wrong}


def main() -> None:
    options = parse(__doc__.splitlines()[0], minutes=40, rate=1e-3, points=1200)
    rng = np.random.default_rng([options.seed, 1])
    model = mf_pifu.MfPifu(mf_pifu.SIZES[options.size])
    run = Run(model, torch.optim.RMSprop(model.parameters(), lr=options.rate), options)
    scenes, validation = Scenes(options.data), Scenes(options.validation)

    def draw_loss() -> tuple[torch.Tensor, float]:
        samples = [
            mf_pifu_sample(rng, scenes[rng.integers(len(scenes))], options.points, mirror=rng.random() < 0.5)
            for _ in range(options.batch)
        ]
        return loss_of(model, samples, options.full_precision)

    run.train(scenes, draw_loss, lambda: validate(model, validation), every=250)


if __name__ == "__main__":
    main()
