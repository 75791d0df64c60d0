"""Trains the regressor as Figure 4.1 of Li 2021 draws it: regress, fit, keep the better fit, supervise.

Every step takes `--batch` scenes with all their views, one augmentation a scene. The network regresses a body and a
camera from each view; with `--fit-in-the-loop` MV-SMPLify then fits one body to all views of a scene from there, the
best fit of each scene is kept, and the valid ones supervise pose and shape beside the keypoints and joints (eq. 4.6).

As in the thesis' data, joints may be known in three dimensions for a part of the scenes only (`--measured`): those of
laboratories have them, pictures from elsewhere have keypoints. There the fit to all views is what teaches depth: a valid
fit's joints stand for the missing ones.

The thesis starts from SPIN's released weights, which were trained with SMPL's parameters as well; in this width there
are none: a first run under the scenes' true poses and shapes (`--supervised`) stands for them and is the start of both
arms of the ablation (models/train.sh). What helps a trunk that knows nothing: its features are also asked for joints
directly (`--direct`, auxiliary.py), a prior towards the mean body is let go slowly (`--first-prior`), plain backgrounds
come first (`--first-replaced`).

Departures for two processor cores: learning rates are higher, warmed up and led down along a cosine; convolutions run
in bfloat16; a scene that has a valid fit is fitted anew at a share of its visits only (`--refit`); the small network
drops a smaller share of its narrow head (`--dropout`).
"""
import argparse
import json
import math
import os
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

import losses
import people
from auxiliary import Auxiliary
from curves import write_curves
from fits import Dictionary, fit_in_the_loop, starts, supervision
from networks import regressor
from networks.rotation import matrix_of_six, nearest_rotation, six_of_matrix
from networks.skeleton import posed_joints, rest_joints
from scenes import Scenes

CURVES = ("loss", "keypoints", "joints", "direct", "pose", "betas", "pa_mpjpe_mm", "mpjpe_mm", "fit_loss")


def parse(arguments: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, nargs="+", required=True, help="folders of scenes to train on")
    parser.add_argument("--measured", type=Path, nargs="*", help="those of them whose joints are known in 3-D; default: all")
    parser.add_argument("--validation", type=Path, nargs="*", default=[], help="folders to watch, never trained on")
    parser.add_argument("-o", "--out", type=Path, required=True, help="the checkpoint to write, and to go on from")
    parser.add_argument("--start", type=Path, help="a checkpoint whose weights to start from; optimiser and schedule fresh")
    parser.add_argument("--size", default="small", choices=tuple(regressor.SIZES))
    parser.add_argument("--steps", type=int, default=8000, help="the schedule's length")
    parser.add_argument("--rate", type=float, default=1e-3, help="peak learning rate")
    parser.add_argument("--last-rate", type=float, default=0.0, help="learning rate at the end")
    parser.add_argument("--warm-up", type=int, default=100, help="steps up to the peak")
    parser.add_argument("--prior", type=float, default=0.005, help="weight of the distance from the mean body")
    parser.add_argument("--first-prior", type=float, help="the same at the first step; falls geometrically over half the steps")
    parser.add_argument("--direct", type=float, default=0.0, help="weight of the same losses on joints read directly off the feature")
    parser.add_argument("--first-replaced", type=float, help="share of scenes before another background at the first step")
    parser.add_argument("--batch", type=int, default=16, help="scenes a step")
    parser.add_argument("--dropout", type=float, default=0.5, help="share of the head's hidden units dropped in training")
    parser.add_argument("--fit-in-the-loop", action="store_true", help="fit, keep the better fit, supervise pose and shape")
    parser.add_argument("--supervised", action="store_true", help="learn from the true poses and shapes; no fits")
    parser.add_argument("--pose-prior", type=Path, help="mixture of poses for the fits (pose_prior.py)")
    parser.add_argument("--program", type=Path, default=Path("target/release/vitruvian"), help="what fits")
    parser.add_argument("--refit", type=float, default=0.25, help="share of visits at which a valid fit is tried anew")
    parser.add_argument("--every", type=int, default=500, help="steps between records of the learning curve")
    parser.add_argument("--save-every", type=int, default=500, help="steps between checkpoints")
    parser.add_argument("--stop-at", type=int, help="stop after this step, to go on later")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--threads", type=int, default=os.cpu_count())
    parser.add_argument("--full-precision", action="store_true", help="no bfloat16 (slower)")
    options = parser.parse_args(arguments)
    if options.measured is not None and not set(options.measured) <= set(options.data):
        parser.error(f"--measured names {', '.join(map(str, set(options.measured) - set(options.data)))}, which --data does not")
    if options.supervised and options.fit_in_the_loop:
        parser.error("--supervised learns from the truth, --fit-in-the-loop from fits: choose one")
    return options


def project(joints: Tensor, camera: Tensor, size: regressor.Size) -> Tensor:
    """Joints [B,24,3] through the weak camera (s, t_x, t_y) [B,3] -> keypoints [B,24,2] in −1..1, as HMR.

    t_z = 2f/(S s): a pinhole so far and so long that the perspective is weak; q = 2f/S (X + t)_xy/(X + t)_z.
    """
    focal = 2 * size.focal_length / size.image_size
    depth = focal / (camera[:, None, 0] + 1e-9)
    return focal * (joints[..., :2] + camera[:, None, 1:]) / (joints[..., 2] + depth)[..., None]


def mean_body(scenes: Scenes, limit: int = 400) -> tuple[Tensor, Tensor]:
    """The mean of the training bodies as the head's first estimate: pose [144], upright and facing the camera; camera [3].

    Rotations are averaged and projected to the nearest rotation. The cameras are those that explain the true joints
    best: q ≈ s (X + t) by least squares.
    """
    chosen = [scenes[k] for k in np.linspace(0, len(scenes) - 1, min(limit, len(scenes))).astype(int)]
    rotations, cameras = [], []
    for first in range(0, len(chosen), 16):
        part = people.truth(chosen[first : first + 16])
        rotations.append(part.rotations)
        pelvis = part.j_template[:, :1, :2]
        body = part.joints[..., :2] - part.joints[:, :1, :2] + pelvis
        seen = part.keypoints
        body_mean, seen_mean = body.mean(1, keepdim=True), seen.mean(1, keepdim=True)
        covariance = ((body - body_mean) * (seen - seen_mean)).sum((1, 2))
        scale = covariance / (body - body_mean).square().sum((1, 2))
        cameras.append(torch.cat((scale[:, None], (seen_mean / scale[:, None, None] - body_mean)[:, 0]), 1))
    mean = nearest_rotation(torch.cat(rotations).mean(0))
    mean[0] = regressor.upright()[0]
    return six_of_matrix(mean).flatten(), torch.cat(cameras).mean(0)


def mpjpe(predicted: Tensor, joints: Tensor) -> Tensor:
    """Mean distance of joints [B,24,3] relative to the root -> [B] (m)."""
    return ((predicted - predicted[:, :1]) - (joints - joints[:, :1])).norm(dim=-1).mean(-1)


def pa_mpjpe(predicted: Tensor, joints: Tensor) -> Tensor:
    """Mean distance after the similarity that fits best (Procrustes) -> [B] (m)."""
    x, y = predicted - predicted.mean(1, keepdim=True), joints - joints.mean(1, keepdim=True)
    u, s, vt = torch.linalg.svd(x.mT @ y)
    sign = torch.ones_like(s)
    sign[:, 2] = torch.linalg.det(u @ vt)
    scale = (s * sign).sum(-1) / x.square().sum((1, 2))
    return (scale[:, None, None] * x @ (u * sign[:, None] @ vt) - y).norm(dim=-1).mean(-1)


class Training:
    """A resumable run: network, optimiser, dictionary of fits, random state and record."""

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        self.size = regressor.SIZES[options.size]
        torch.set_num_threads(options.threads)
        torch.manual_seed(options.seed)
        self.rng = np.random.default_rng([options.seed, 3])
        self.scenes, self.validation = Scenes(options.data), Scenes(options.validation)
        self.network = regressor.Regressor(self.size)
        for dropout in (self.network.drop1, self.network.drop2):
            dropout.p = options.dropout
        self.auxiliary = Auxiliary(self.size)
        self.dictionary = Dictionary()
        self.steps, self.elapsed, self.history = 0, 0.0, []
        self.command = " ".join(["python", "models/train_regressor.py", *sys.argv[1:]])
        saved = torch.load(options.out, weights_only=True) if options.out.exists() else None
        if saved is None:
            self.begin()
        else:
            self.network.load_state_dict(saved["state"])
            self.auxiliary.load_state_dict(saved["auxiliary"])
        self.mean_rotations = matrix_of_six(self.network.init_pose.unflatten(1, (24, 6)))[0]
        self.network.to(memory_format=torch.channels_last)
        self.optimiser = torch.optim.Adam([*self.network.parameters(), *self.auxiliary.parameters()], lr=options.rate)
        if saved is not None:
            self.go_on(saved)

    def begin(self) -> None:
        """Weights of `--start`, or fresh ones around the mean training body."""
        if self.options.start:
            saved = torch.load(self.options.start, weights_only=True)
            self.network.load_state_dict(saved["state"])
            self.auxiliary.load_state_dict(saved["auxiliary"])
            return
        if not len(self.scenes):
            raise SystemExit(f"no scenes in {', '.join(map(str, self.options.data))}; see vitruvian dataset --for regressor")
        pose, camera = mean_body(self.scenes)
        self.network.init_pose.copy_(pose)
        self.network.init_cam.copy_(camera)

    def go_on(self, saved: dict) -> None:
        """What a checkpoint holds beside the weights."""
        self.optimiser.load_state_dict(saved["optimiser"])
        self.steps, self.elapsed, self.history = saved["steps"], saved["elapsed_s"], saved["history"]
        self.dictionary = Dictionary.of_state(saved["dictionary"])
        self.rng.bit_generator.state = json.loads(saved["rng"])
        torch.set_rng_state(saved["torch_rng"])
        print(f"going on from step {self.steps}", file=sys.stderr)

    def save(self) -> None:
        """The checkpoint, whole or not at all."""
        beside = self.options.out.with_suffix(".part")
        torch.save(
            {
                "state": self.network.state_dict(),
                "auxiliary": self.auxiliary.state_dict(),
                "optimiser": self.optimiser.state_dict(),
                "dictionary": self.dictionary.state(),
                "rng": json.dumps(self.rng.bit_generator.state),
                "torch_rng": torch.get_rng_state(),
                "size": self.options.size,
                "seed": self.options.seed,
                "steps": self.steps,
                "elapsed_s": self.elapsed,
                "history": self.history,
                "command": self.command,
            },
            beside,
        )
        os.replace(beside, self.options.out)

    def rate(self) -> float:
        """Learning rate of the next step: a linear warm-up, then half a cosine from the peak to the last rate."""
        options = self.options
        warm = min(1.0, (self.steps + 1) / max(options.warm_up, 1))
        fall = 0.5 * (1 + math.cos(math.pi * min(self.steps / options.steps, 1.0)))
        return warm * (options.last_rate + (options.rate - options.last_rate) * fall)

    def weights(self) -> losses.Weights:
        """Weights of the next step: the thesis', or those under supervision; and those of what is not the thesis'."""
        last = self.options.prior
        first = last if self.options.first_prior is None else self.options.first_prior
        share = min(2 * self.steps / self.options.steps, 1.0)
        weights = losses.SUPERVISED if self.options.supervised else losses.Weights()
        return replace(weights, prior=first ** (1 - share) * last**share, direct=self.options.direct)

    def replaced(self) -> float:
        """Share of scenes before another background: from `--first-replaced` to a third over half the steps."""
        last = 1 / 3
        first = last if self.options.first_replaced is None else self.options.first_replaced
        share = min(2 * self.steps / self.options.steps, 1.0)
        return first + (last - first) * share

    def features(self, batch: people.Batch) -> tuple[Tensor, Tensor]:
        """The map of the third stage and the feature [BN,F]; the trunk in bfloat16, the head is in f32."""
        images = batch.images.contiguous(memory_format=torch.channels_last)
        with torch.autocast("cpu", torch.bfloat16, enabled=not self.options.full_precision):
            middle = self.network.middle(images)
            return middle.float(), self.network.layer4(middle).mean((2, 3)).float()

    def regress(self, features: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Rotations [BN,24,3,3], betas [BN,10], camera [BN,3]."""
        pose, betas, camera = self.network.iterate(features)
        return matrix_of_six(pose.unflatten(1, (24, 6))), betas, camera

    def joints(self, batch: people.Batch, rotations: Tensor, betas: Tensor) -> Tensor:
        """Joints [BN,24,3] of the estimated bodies."""
        return posed_joints(rotations, rest_joints(batch.j_template, batch.j_shapedirs, betas))

    def fit(self, names: list[str], scenes: list, batch: people.Batch, estimate: tuple[Tensor, Tensor, Tensor]) -> None:
        """Fit the scenes that lack a valid fit and a share of the others, and keep the better fits."""
        kept = [self.dictionary.best.get(name) for name in names]
        again = self.rng.random(len(names)) < self.options.refit
        chosen = [k for k, fit in enumerate(kept) if again[k] or fit is None or not fit.valid]
        if chosen:
            begin = tuple(t[chosen] for t in starts(batch, scenes, estimate))
            fit_in_the_loop(
                self.options.program,
                [names[k] for k in chosen],
                [scenes[k] for k in chosen],
                begin,
                self.dictionary,
                self.options.pose_prior,
            )

    def measured(self, chosen: np.ndarray) -> list[bool] | None:
        """Of each chosen scene, whether its joints are known in three dimensions; all are where `--measured` is left out."""
        known = self.options.measured
        return None if known is None else [self.scenes.paths[k].parent in known for k in chosen]

    def step(self) -> dict[str, float]:
        """One step; the terms of its loss."""
        chosen = self.rng.choice(len(self.scenes), min(self.options.batch, len(self.scenes)), replace=False)
        names = [str(Path(*self.scenes.paths[k].parts[-2:])) for k in chosen]
        scenes = [self.scenes[k] for k in chosen]
        batch = people.batch(scenes, self.size.image_size, self.rng, self.replaced(), self.measured(chosen))
        middle, features = self.features(batch)
        rotations, betas, camera = self.regress(features)
        joints = self.joints(batch, rotations, betas)
        terms = {}
        if self.options.supervised:
            every = torch.ones(len(rotations), dtype=torch.bool)
            terms["pose"] = losses.pose_loss(rotations, batch.rotations, every)
            terms["betas"] = losses.betas_loss(betas, batch.betas, every)
        if self.options.fit_in_the_loop:
            self.fit(names, scenes, batch, (rotations.detach(), betas.detach(), camera.detach()))
            fitted_rotations, fitted_betas, valid = supervision(self.dictionary, names, batch)
            terms["pose"] = losses.pose_loss(rotations, fitted_rotations, valid)
            terms["betas"] = losses.betas_loss(betas, fitted_betas, valid)
            batch = people.completed(batch, self.joints(batch, fitted_rotations, fitted_betas), valid)
        terms |= {
            "keypoints": losses.keypoint_loss(project(joints, camera, self.size), batch.keypoints, batch.confidence),
            "joints": losses.joint_loss(joints, batch.joints, batch.measured),
            "camera": losses.camera_loss(camera),
            "prior": losses.prior_loss(rotations[:, 1:], self.mean_rotations[1:], betas),
        }
        if self.options.direct:
            terms["direct"] = self.auxiliary(middle, features, batch)
        loss = losses.total(self.weights(), **terms)
        for group in self.optimiser.param_groups:
            group["lr"] = self.rate()
        self.optimiser.zero_grad(set_to_none=True)
        loss.backward()
        norm = nn.utils.clip_grad_norm_(self.network.parameters(), 100.0)
        self.optimiser.step()
        self.steps += 1
        return {"loss": loss.item(), "gradient": norm.item(), **{name: term.item() for name, term in terms.items()}}

    @torch.no_grad()
    def validate(self) -> dict[str, float]:
        """Errors over the validation scenes, unaugmented: joints (mm), local rotations (degrees), betas."""
        self.network.eval()
        found = {"mpjpe_mm": [], "pa_mpjpe_mm": [], "rotation_deg": [], "betas_rms": []}
        for first in range(0, len(self.validation), 16):
            scenes = [self.validation[k] for k in range(first, min(first + 16, len(self.validation)))]
            batch = people.batch(scenes, self.size.image_size)
            rotations, betas, _ = self.regress(self.features(batch)[1])
            joints = self.joints(batch, rotations, betas)
            found["mpjpe_mm"].append(1000 * mpjpe(joints, batch.joints))
            found["pa_mpjpe_mm"].append(1000 * pa_mpjpe(joints, batch.joints))
            trace = (rotations * batch.rotations).sum((-2, -1))
            found["rotation_deg"].append(torch.rad2deg(torch.acos(((trace - 1) / 2).clamp(-1, 1))).mean(1))
            found["betas_rms"].append((betas - batch.betas).square().mean(1).sqrt())
        self.network.train()
        return {name: torch.cat(parts).mean().item() for name, parts in found.items() if parts}

    def record(self, figures: dict[str, float]) -> None:
        """Print and keep one line of the learning curve, and draw the curves beside the checkpoint."""
        line = {"step": self.steps, "minutes": round(self.elapsed / 60, 2), "scenes": len(self.scenes)}
        line |= {name: round(value, 5) for name, value in figures.items()}
        if self.options.fit_in_the_loop:
            line |= {"fits": len(self.dictionary.best), "valid_fits": round(self.dictionary.valid_share, 4)}
            line |= {"fit_loss": round(self.dictionary.mean_loss, 4)}
        print(json.dumps(line), file=sys.stderr, flush=True)
        self.history.append(line)
        write_curves(self.options.out.with_suffix(".svg"), self.options.out.stem, self.history, CURVES)

    def train(self) -> None:
        """Steps until the schedule ends; every `--every` steps a record, and scenes written meanwhile are taken in."""
        options = self.options
        end = options.steps if options.stop_at is None else min(options.steps, options.stop_at)
        sums, count, last = {}, 0, time.monotonic()
        self.network.train()
        while self.steps < end:
            for name, value in self.step().items():
                sums[name] = sums.get(name, 0.0) + value
            count += 1
            now = time.monotonic()
            self.elapsed, last = self.elapsed + now - last, now
            if self.steps % options.every == 0 or self.steps == end:
                self.record({name: value / count for name, value in sums.items()} | self.validate())
                sums, count = {}, 0
                self.scenes.refresh()
            if self.steps % options.save_every == 0 or self.steps == end:
                self.save()
            last = time.monotonic()


def main() -> None:
    Training(parse()).train()


if __name__ == "__main__":
    main()
