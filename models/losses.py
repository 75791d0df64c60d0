"""What the regressor is trained on (Li 2021, eq. 4.1 and 4.3–4.6), as the released code computes it.

The thesis writes sums of unsquared norms over the views; trained were means of squares (erratum E42), joints of the
*regressed* body rather than of the fit (4.5 as printed gives the network no gradient), and rotation matrices rather
than axis-angle (erratum E43). Its third weight, 0.001, belongs to β; the weight of the mesh was 0 (erratum E41).
Views are rows: [B] runs over every image of the batch.
"""
from dataclasses import dataclass

import torch
from torch import Tensor

from networks.skeleton import LEFT_HIP, RIGHT_HIP


def keypoint_loss(predicted: Tensor, keypoints: Tensor, confidence: Tensor) -> Tensor:
    """L_2D, eq. 4.1: mean of c (k̂ − k)² over [B,J,2], keypoints in −1..1 over the crop, confidence [B,J]."""
    return (confidence[..., None] * (predicted - keypoints).square()).mean()


def centred(joints: Tensor) -> Tensor:
    """[B,24,3] less the middle of the hips."""
    return joints - joints[:, [LEFT_HIP, RIGHT_HIP]].mean(1, keepdim=True)


def joint_loss(predicted: Tensor, joints: Tensor, confidence: Tensor) -> Tensor:
    """L_3D, eq. 4.5: mean of c (x̂ − x)² over [B,24,3] (m), both sides centred between the hips."""
    return (confidence[..., None] * (centred(predicted) - centred(joints)).square()).mean()


def valid_differences(predicted: Tensor, fitted: Tensor, valid: Tensor) -> Tensor:
    """predicted − fitted, both [B,...], of the rows marked in valid [B].

    Rows are left out before anything is squared: what an invalid fit holds, NaN too, reaches neither loss nor gradient.
    """
    return (predicted - fitted)[valid]


def mean_or_zero(values: Tensor) -> Tensor:
    """Mean of all entries; 0, with gradient 0, when there is none."""
    return values.sum() / max(values.numel(), 1)


def pose_loss(predicted: Tensor, fitted: Tensor, valid: Tensor) -> Tensor:
    """L_θ, eq. 4.3: mean square between rotation matrices [B,24,3,3], over the rows whose fit is valid."""
    return mean_or_zero(valid_differences(predicted, fitted, valid).square())


def betas_loss(predicted: Tensor, fitted: Tensor, valid: Tensor) -> Tensor:
    """L_β, eq. 4.3: mean square between betas [B,K], over the rows whose fit is valid."""
    return mean_or_zero(valid_differences(predicted, fitted, valid).square())


def vertex_loss(predicted: Tensor, fitted: Tensor, valid: Tensor) -> Tensor:
    """L_M, eq. 4.4: mean absolute difference of vertices [B,V,3] (m), over the rows whose fit is valid."""
    return mean_or_zero(valid_differences(predicted, fitted, valid).abs())


def camera_loss(camera: Tensor) -> Tensor:
    """Mean of exp(−10 s)² over cameras [B,3]: keeps the scale positive; not in the thesis."""
    return torch.exp(-10 * camera[:, 0]).square().mean()


def heatmap_loss(logits: Tensor, keypoints: Tensor, confidence: Tensor) -> Tensor:
    """Cross-entropy of where each joint is in a map [B,J,H,H] of logits, over the joints inside the crop.

    The true place is spread over the four cells around it as bilinear interpolation would read them there. Not in the
    thesis: it teaches a trunk without earlier training to find joints; a mean over a whole map says little of places.
    """
    side = logits.shape[-1]
    cells = (keypoints + 1) * side / 2 - 0.5
    inside = (keypoints.abs().amax(-1) < 1) * confidence
    axis = torch.arange(side, dtype=logits.dtype)
    along = (1 - (cells.clamp(0, side - 1)[..., None] - axis).abs()).clamp(min=0)
    target = along[..., 1, :, None] * along[..., 0, None, :]
    entropy = -(target.flatten(2) * torch.log_softmax(logits.flatten(2), -1)).sum(-1)
    return (inside * entropy).sum() / inside.sum().clamp(min=1)


def depth_loss(predicted: Tensor, joints: Tensor, confidence: Tensor) -> Tensor:
    """Mean of c times the square of depths [B,24] (m) against those of joints [B,24,3], counted from between the hips."""
    return (confidence * (predicted - centred(joints)[..., 2]).square()).mean()


def prior_loss(rotations: Tensor, mean: Tensor, betas: Tensor) -> Tensor:
    """Distance from the mean body; not in the thesis, whose training starts from SPIN's weights.

    Mean square of the local rotations [B,23,3,3] about their mean [23,3,3], plus a tenth of that of the betas [B,K].
    Joints show neither the twist of a bone nor all of the shape: where nothing else does, a network that starts from
    nothing wanders off to bodies that have the right joints and are no bodies. And as long as it cannot tell front from
    back, limbs folded to the middle have the least mean square: a strong prior that is let go lets it learn to face first.
    """
    return (rotations - mean).square().mean() + 0.1 * betas.square().mean()


@dataclass(frozen=True)
class Weights:
    """Weights of eq. 4.6; the total is multiplied by `overall`."""

    keypoints: float = 5.0
    joints: float = 5.0
    pose: float = 1.0
    betas: float = 0.001
    vertices: float = 0.0
    camera: float = 1.0
    prior: float = 0.005
    direct: float = 0.0
    overall: float = 60.0


# For the start: truth has no errors that a small weight must guard against.
SUPERVISED = Weights(betas=0.02)


def total(weights: Weights, **terms: Tensor) -> Tensor:
    """L, eq. 4.6: overall · Σ weight · term over the terms that are given, each under its weight's name."""
    return weights.overall * sum(getattr(weights, name) * term for name, term in terms.items())
