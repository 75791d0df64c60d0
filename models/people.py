"""Scenes of one person in several views, as `vitruvian dataset --for regressor` writes them, in batches.

A scene is one `.npz`: images u8 [N,3,M,M] (the person's box with a margin), masks u8 [N,M,M], keypoints f32 [N,24,3]
(u, v in pixels of the image from its corner, confidence), joints_camera f32 [N,24,3] (m, the camera's axes), K f32
[N,3,3] of the image, R f32 [N,3,3], t f32 [N,3], poses f32 [72], betas f32 [10], trans f32 [3], and the body's
skeleton J_template f32 [24,3], J_shapedirs f32 [24,3,10].
"""
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from torch import Tensor

from augmentation import Augmentation, backgrounds, disturb
from networks.regressor import MEAN, STD
from networks.rotation import rodrigues
from scenes import Scenes


@dataclass(frozen=True)
class Batch:
    """B scenes of N views; rows run over the views of the first scene, then of the second.

    images [BN,3,S,S] normalised; keypoints [BN,24,2] in −1..1 over the crop, y down; confidence [BN,24]; joints
    [BN,24,3] and rotations [BN,24,3,3] in the camera's axes, betas [BN,10]: all of the augmented body. The skeleton,
    j_template [BN,24,3] and j_shapedirs [BN,24,3,10], is left as it is: bodies are symmetric. measured [BN,24] is 1 where
    training may know the joint in three dimensions, 0 where it knows the keypoints alone.
    """

    images: Tensor
    keypoints: Tensor
    confidence: Tensor
    joints: Tensor
    measured: Tensor
    rotations: Tensor
    betas: Tensor
    j_template: Tensor
    j_shapedirs: Tensor
    views: int
    augmentation: Augmentation


def stacked(scenes: Sequence[dict[str, np.ndarray]], name: str) -> Tensor:
    """One array of all scenes, f32 [B,...]."""
    return torch.from_numpy(np.stack([scene[name] for scene in scenes])).float()


def batch(
    scenes: Sequence[dict[str, np.ndarray]],
    size: int,
    rng: np.random.Generator | None = None,
    replaced: float = 1 / 3,
    measured: Sequence[bool] | None = None,
) -> Batch:
    """The scenes as the network sees them in crops of `size` pixels, augmented by draws of `rng`; plain without it.

    `replaced` is the share of scenes that are put before another background, `measured` says of each scene whether its
    joints are known in three dimensions; without it all are.
    """
    views = len(scenes[0]["images"])
    draw = Augmentation.none(len(scenes)) if rng is None else Augmentation.draw(rng, len(scenes))
    crops = stacked(scenes, "images").flatten(0, 1).div_(255)
    if rng is None:
        crops = draw.for_views(views).crops(crops, size)
    else:
        crops = draw.for_views(views).crops(crops, size, "reflection" if rng.random() < 0.5 else "zeros")
        crops.mul_(draw.for_views(views).gain[:, :, None, None]).clamp_(0, 1)
        replace_backgrounds(rng, crops, scenes, draw, replaced)
        disturb(rng, crops, views)
    mean, std = torch.tensor(MEAN).view(3, 1, 1), torch.tensor(STD).view(3, 1, 1)
    return truth(scenes, draw, crops.sub_(mean).div_(std), measured)


def truth(
    scenes: Sequence[dict[str, np.ndarray]],
    draw: Augmentation | None = None,
    images: Tensor | None = None,
    measured: Sequence[bool] | None = None,
) -> Batch:
    """What is known of the scenes under an augmentation, none by default, with the images that go with it."""
    views, side = len(scenes[0]["images"]), scenes[0]["images"].shape[-1]
    rows = (draw or Augmentation.none(len(scenes))).for_views(views)
    keypoints = stacked(scenes, "keypoints").flatten(0, 1)
    known = torch.ones(len(scenes)) if measured is None else torch.tensor(measured, dtype=torch.float32)
    return Batch(
        images=torch.empty(0) if images is None else images,
        keypoints=rows.renamed(rows.points(2 * keypoints[..., :2] / side - 1)),
        confidence=rows.renamed(keypoints[..., 2]),
        joints=rows.joints(stacked(scenes, "joints_camera").flatten(0, 1)),
        measured=known.repeat_interleave(views)[:, None].expand(-1, keypoints.shape[1]),
        rotations=rows.rotations(rotations_in_cameras(scenes)),
        betas=stacked(scenes, "betas").repeat_interleave(views, 0),
        j_template=stacked(scenes, "J_template").repeat_interleave(views, 0),
        j_shapedirs=stacked(scenes, "J_shapedirs").repeat_interleave(views, 0),
        views=views,
        augmentation=rows,
    )


def completed(batch: Batch, joints: Tensor, valid: Tensor) -> Batch:
    """The batch with joints [BN,24,3] of fits in place of those that were not measured, in the rows marked in valid [BN].

    Only the joints' places relative to each other count: fits stand where they like.
    """
    fills = valid[:, None] & (batch.measured == 0)
    return replace(
        batch, joints=torch.where(fills[..., None], joints, batch.joints), measured=torch.where(fills, 1.0, batch.measured)
    )


def rotations_in_cameras(scenes: Sequence[dict[str, np.ndarray]]) -> Tensor:
    """True rotations [BN,24,3,3], the root's turned into each camera: R exp(θ₀)."""
    views = len(scenes[0]["images"])
    rotations = rodrigues(stacked(scenes, "poses").unflatten(-1, (24, 3)))[:, None].repeat(1, views, 1, 1, 1)
    rotations[:, :, 0] = stacked(scenes, "R") @ rotations[:, :, 0]
    return rotations.flatten(0, 1)


def replace_backgrounds(
    rng: np.random.Generator, crops: Tensor, scenes: Sequence[dict[str, np.ndarray]], draw: Augmentation, share: float
) -> None:
    """Put a share of the scenes before a background that no renderer drew, all that hides the person included; in place.

    A network trained on one renderer's backgrounds learns that renderer; these have none of its edges or lights.
    """
    chosen = np.flatnonzero(rng.random(len(scenes)) < share)
    if not len(chosen):
        return
    views, size = len(scenes[0]["images"]), crops.shape[-1]
    masks = stacked([scenes[k] for k in chosen], "masks").flatten(0, 1)[:, None].div_(255)
    masks = draw.chosen(chosen).for_views(views).crops(masks, size, "zeros")
    for k, scene in enumerate(chosen):
        rows, mask = crops[scene * views : (scene + 1) * views], masks[k * views : (k + 1) * views]
        rows.copy_(torch.lerp(backgrounds(rng, views, size), rows, mask))
