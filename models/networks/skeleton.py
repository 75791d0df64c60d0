"""Posed joints of SMPL's skeleton as a differentiable function of rotations and shape (Li 2021, eq. 4.3's J(θ, β)).

A loss on joints needs no vertex: the rest joints are affine in β, J(β) = J_template + J_shapedirs β, because they are
a linear regression of vertices that are affine in β, and the chain of rotations carries them along.
"""
import torch
from torch import Tensor

# SMPL's tree: pelvis, hips, spine1, knees, spine2, ankles, spine3, feet, neck, collars, head, shoulders, elbows, wrists, hands.
PARENTS = (-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21)
JOINTS = len(PARENTS)
LEFT_HIP, RIGHT_HIP = 1, 2
# The joint that takes a joint's place in the mirror.
MIRRORED = (0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20, 23, 22)


def levels() -> list[list[int]]:
    """The joints by their distance from the root, root excluded: one level is posed at once."""
    depth = [0] * JOINTS
    for joint in range(1, JOINTS):
        depth[joint] = depth[PARENTS[joint]] + 1
    return [[j for j in range(JOINTS) if depth[j] == d] for d in range(1, max(depth) + 1)]


LEVELS = levels()


def rest_joints(j_template: Tensor, j_shapedirs: Tensor, betas: Tensor) -> Tensor:
    """J_template [B,24,3], J_shapedirs [B,24,3,K], betas [B,K] -> rest joints [B,24,3] (m)."""
    return j_template + torch.einsum("bjck,bk->bjc", j_shapedirs, betas)


def posed_joints(rotations: Tensor, rest: Tensor) -> Tensor:
    """Rotations [B,24,3,3] relative to the parent (the root's to the camera or the world), rest [B,24,3] -> joints [B,24,3].

    G_j = G_parent R_j,  x_j = x_parent + G_parent (r_j − r_parent);  x_root = r_root: no translation is added.
    """
    turned: list[Tensor | None] = [None] * JOINTS
    placed: list[Tensor | None] = [None] * JOINTS
    turned[0], placed[0] = rotations[:, 0], rest[:, 0]
    for level in LEVELS:
        parents = [PARENTS[j] for j in level]
        carried = torch.stack([turned[p] for p in parents], 1)
        bones = rest[:, level] - rest[:, parents]
        ends = torch.stack([placed[p] for p in parents], 1) + (carried @ bones[..., None])[..., 0]
        frames = carried @ rotations[:, level]
        for k, joint in enumerate(level):
            turned[joint], placed[joint] = frames[:, k], ends[:, k]
    return torch.stack(placed, 1)
