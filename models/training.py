"""What both training scripts share: the schedule, the checkpoints and the log.

The learning rate falls from its peak to zero along a half cosine over the *time* budget, after a short warm-up, so a
run fits the minutes that it is given on any machine. A run stopped at any moment goes on from its checkpoint.
"""
import argparse
import json
import math
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import torch
from torch import nn

from scenes import Scenes


def parse(description: str, minutes: float, rate: float, points: int) -> argparse.Namespace:
    """The options that both scripts take."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="folders that `vitruvian dataset` wrote")
    parser.add_argument("--validation", type=Path, nargs="*", default=[], help="folders to watch, never trained on")
    parser.add_argument("-o", "--out", type=Path, required=True, help="the checkpoint to write, and to go on from")
    parser.add_argument("--size", default="small", choices=("small", "thesis"))
    parser.add_argument("--minutes", type=float, default=minutes, help="training time, the schedule's length")
    parser.add_argument("--rate", type=float, default=rate, help="peak learning rate")
    parser.add_argument("--points", type=int, default=points, help="labelled points a scene and step")
    parser.add_argument("--batch", type=int, default=2, help="scenes a step")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--full-precision", action="store_true", help="no bfloat16 (slower)")
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    torch.manual_seed(options.seed)
    return options


class Run:
    """A resumable training run of `model` against a time budget."""

    def __init__(self, model: nn.Module, optimiser: torch.optim.Optimizer, options: argparse.Namespace) -> None:
        self.model, self.optimiser, self.options = model, optimiser, options
        self.steps, self.elapsed, self.history = 0, 0.0, []
        if options.out.exists():
            saved = torch.load(options.out, weights_only=True)
            model.load_state_dict(saved["state"])
            optimiser.load_state_dict(saved["optimiser"])
            self.steps, self.elapsed, self.history = saved["steps"], saved["elapsed_s"], saved["history"]
            print(f"going on from step {self.steps}, {self.elapsed / 60:.1f} min", file=sys.stderr)
        self.last = time.monotonic()

    @property
    def progress(self) -> float:
        """Share of the time budget that is spent."""
        return self.elapsed / (60 * self.options.minutes)

    def step(self, loss: torch.Tensor) -> None:
        """One step down the gradient of `loss` at the schedule's rate, the gradient's norm clipped to 1."""
        fall = 0.5 * (1 + math.cos(math.pi * min(self.progress, 1.0)))
        for group in self.optimiser.param_groups:
            group["lr"] = self.options.rate * min(1.0, (self.steps + 1) / 50) * fall
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        nn.utils.clip_grad_norm_(self.model.parameters(), 1.0)
        self.optimiser.step()
        self.steps += 1
        now = time.monotonic()
        self.elapsed, self.last = self.elapsed + now - self.last, now

    def pause(self) -> None:
        """Leaves what was done since the last step (validation, saving) out of the budget."""
        self.last = time.monotonic()

    def record(self, **figures: float) -> None:
        """Prints and keeps one line of the learning curve, and saves the checkpoint whole or not at all."""
        line = {"step": self.steps, "minutes": round(self.elapsed / 60, 2), **{k: round(v, 5) for k, v in figures.items()}}
        print(json.dumps(line), file=sys.stderr, flush=True)
        self.history.append(line)
        beside = self.options.out.with_suffix(".part")
        torch.save(
            {
                "state": self.model.state_dict(),
                "optimiser": self.optimiser.state_dict(),
                "size": self.options.size,
                "seed": self.options.seed,
                "steps": self.steps,
                "elapsed_s": self.elapsed,
                "history": self.history,
                "command": " ".join(["python", *sys.argv]),
            },
            beside,
        )
        os.replace(beside, self.options.out)
        self.pause()

    def train(
        self,
        scenes: Scenes,
        draw_loss: Callable[[], tuple[torch.Tensor, float]],
        validate: Callable[[], dict[str, float]],
        every: int,
    ) -> None:
        """Steps down `draw_loss` (loss, share of wrong points) until the budget is spent.

        Every `every` steps a line of the learning curve is recorded and scenes written meanwhile are taken in.
        """
        loss_sum, wrong_sum, count = 0.0, 0.0, 0
        self.pause()
        while self.progress < 1.0:
            loss, wrong = draw_loss()
            self.step(loss)
            loss_sum, wrong_sum, count = loss_sum + loss.item(), wrong_sum + wrong, count + 1
            if self.steps % every == 0 or self.progress >= 1.0:
                self.record(loss=loss_sum / count, wrong=wrong_sum / count, scenes=len(scenes), **validate())
                loss_sum, wrong_sum, count = 0.0, 0.0, 0
                scenes.refresh()
                self.pause()
