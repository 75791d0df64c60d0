"""The fit's side of Figure 4.1: MV-SMPLify from the network's estimate, and the best fit of each scene so far.

The network's bodies enter the fit, one program for all scenes of a batch (`vitruvian fit BATCH.npz --method mv-smplify`),
and the fit that explains a scene's keypoints best is kept for it: training goes on with fits that only get better. Fits
are made and kept in the frame of the stored images; augmentation is undone on the way in and done again on the way out.
"""
import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from networks.rotation import axis_angle_of_matrix, rodrigues
from networks.skeleton import rest_joints
from people import Batch, stacked


@dataclass
class Fit:
    """One body for all views of a scene: poses f32 [N,72], the root's in each camera's axes, betas f32 [10], its mean loss."""

    poses: Tensor
    betas: Tensor
    loss: float
    valid: bool


@dataclass
class Dictionary:
    """The best fit of each scene by its name; a scene that was never fitted has none."""

    best: dict[str, Fit] = field(default_factory=dict)

    def offer(self, name: str, fit: Fit) -> bool:
        """Keep `fit` if its loss is a number and below that of the one that is kept; whether it was."""
        kept = self.best.get(name)
        better = np.isfinite(fit.loss) and (kept is None or fit.loss < kept.loss)
        if better:
            self.best[name] = fit
        return bool(better)

    @property
    def valid_share(self) -> float:
        """Share of valid fits among those that are kept."""
        return sum(fit.valid for fit in self.best.values()) / max(len(self.best), 1)

    @property
    def mean_loss(self) -> float:
        """Mean loss of the valid fits that are kept (px² at 224 pixels, views summed, per joint)."""
        losses = [fit.loss for fit in self.best.values() if fit.valid]
        return sum(losses) / max(len(losses), 1)

    def state(self) -> dict[str, tuple]:
        """What a checkpoint keeps."""
        return {name: (fit.poses, fit.betas, fit.loss, fit.valid) for name, fit in self.best.items()}

    @staticmethod
    def of_state(state: dict[str, tuple]) -> "Dictionary":
        return Dictionary({name: Fit(*parts) for name, parts in state.items()})


@torch.no_grad()
def starts(batch: Batch, scenes: Sequence[dict[str, np.ndarray]], estimate: tuple[Tensor, Tensor, Tensor]):
    """The network's rotations [BN,24,3,3], betas [BN,10] and cameras [BN,3] as (poses [B,N,72], betas, trans [B,N,3]).

    The crop's pinhole in −1..1 coordinates has the focal length f and the principal point c, the estimate says
    q = s (X + t)_xy: hence t_z = f/s and, for the depth of the body's origin, t_xy = (t_x, t_y) − c/s.
    Rotations about the root leave it where it is: the pelvis moves with the camera, J₀ + t, not t alone.
    """
    rotations, betas, camera = estimate
    draw, side = batch.augmentation, scenes[0]["images"].shape[-1]
    intrinsics = stacked(scenes, "K").flatten(0, 1)
    centre = draw.points((2 * intrinsics[:, None, :2, 2] / side - 1))[:, 0]
    focal = intrinsics[:, 0, 0] * 2 / side * draw.enlargement
    scale = camera[:, :1].clamp(min=0.1)
    translation = torch.cat((camera[:, 1:] - centre / scale, focal[:, None] / scale), 1)
    pelvis = rest_joints(batch.j_template, batch.j_shapedirs, betas)[:, 0]
    translation = draw.restored_vectors(pelvis + translation) - pelvis
    poses = axis_angle_of_matrix(draw.restored_rotations(rotations)).flatten(1)
    return tuple(t.unflatten(0, (-1, batch.views)) for t in (poses, betas, translation))


def fit_in_the_loop(
    program: Path,
    names: Sequence[str],
    scenes: Sequence[dict[str, np.ndarray]],
    starts: tuple[Tensor, Tensor, Tensor],
    dictionary: Dictionary,
    pose_prior: Path | None = None,
) -> int:
    """Fit all scenes from their starts and offer the fits; how many were better than what was kept."""
    poses, betas, trans = starts
    arrays = {"poses": poses.numpy(), "betas": betas.numpy(), "trans": trans.numpy()}
    for name in ("keypoints", "K", "J_template", "J_shapedirs"):
        arrays[name] = np.stack([scene[name] for scene in scenes])
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "batch.npz", Path(folder) / "fits.npz"
        np.savez(given, **arrays)
        command = [str(program), "fit", str(given), "--method", "mv-smplify", "-o", str(found)]
        if pose_prior:
            command += ["--prior", str(pose_prior)]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0 or not found.exists():
            raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr.strip()}")
        with np.load(found) as fits:
            fitted = {name: fits[name] for name in ("poses", "betas", "loss", "valid")}
    kept = 0
    for k, name in enumerate(names):
        fit = Fit(
            torch.from_numpy(fitted["poses"][k].astype(np.float32)),
            torch.from_numpy(fitted["betas"][k].astype(np.float32)),
            float(fitted["loss"][k].mean()),
            bool(fitted["valid"][k]),
        )
        kept += dictionary.offer(name, fit)
    return kept


def supervision(dictionary: Dictionary, names: Sequence[str], batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
    """Rotations [BN,24,3,3] and betas [BN,10] of the kept fits under the batch's augmentation, and which are valid [BN]."""
    fits = [dictionary.best.get(name) for name in names]
    valid = torch.tensor([fit is not None and fit.valid for fit in fits])
    none = Fit(torch.zeros(batch.views, 72), torch.zeros(batch.betas.shape[-1]), np.inf, False)
    poses = torch.cat([(fit or none).poses for fit in fits])
    betas = torch.stack([(fit or none).betas for fit in fits])
    rotations = batch.augmentation.rotations(rodrigues(poses.unflatten(-1, (24, 3))))
    return rotations, betas.repeat_interleave(batch.views, 0), valid.repeat_interleave(batch.views)
