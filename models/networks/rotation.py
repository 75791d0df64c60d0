"""Rotations as the regressor writes them: six numbers, the first two columns of a matrix (Zhou 2019, eq. 15).

Six numbers rather than three angles, because no three numbers cover the rotations without a jump; a jump is what a
network cannot learn.
"""
import torch
import torch.nn.functional as F
from torch import Tensor


def matrix_of_six(six: Tensor) -> Tensor:
    """[...,6] -> rotation matrices [...,3,3], by Gram–Schmidt on the two columns.

    The six numbers are a 3×2 matrix row by row: a₁ = (x₀, x₂, x₄), a₂ = (x₁, x₃, x₅), as SPIN stores them. Then
    b₁ = a₁/‖a₁‖, b₂ = (a₂ − (b₁·a₂)b₁)/‖·‖, b₃ = b₁ × b₂, and R has the columns b₁, b₂, b₃.
    """
    a = six.unflatten(-1, (3, 2))
    b1 = F.normalize(a[..., 0], dim=-1)
    b2 = F.normalize(a[..., 1] - (b1 * a[..., 1]).sum(-1, keepdim=True) * b1, dim=-1)
    return torch.stack((b1, b2, torch.linalg.cross(b1, b2, dim=-1)), -1)


def six_of_matrix(rotation: Tensor) -> Tensor:
    """Rotation matrices [...,3,3] -> [...,6]."""
    return rotation[..., :2].flatten(-2)


def skew(axis: Tensor) -> Tensor:
    """[...,3] -> [...,3,3], the matrix of the cross product: skew(a) b = a × b."""
    x, y, z = axis.unbind(-1)
    zero = torch.zeros_like(x)
    return torch.stack((zero, -z, y, z, zero, -x, -y, x, zero), -1).unflatten(-1, (3, 3))


def rodrigues(axis_angle: Tensor) -> Tensor:
    """Axis-angle [...,3] (rad) -> rotation matrices [...,3,3]: I + sin α/α K + (1 − cos α)/α² K², K = skew(θ)."""
    angle = axis_angle.norm(dim=-1)[..., None, None]
    k = skew(axis_angle)
    # torch.sinc(x) = sin(πx)/(πx), exact at 0; (1 − cos α)/α² = ½ sinc²(α/2).
    first = torch.sinc(angle / torch.pi)
    second = 0.5 * torch.sinc(angle / (2 * torch.pi)).square()
    return torch.eye(3, dtype=k.dtype) + first * k + second * (k @ k)


def nearest_rotation(matrix: Tensor) -> Tensor:
    """[...,3,3] -> the rotations nearest in the Frobenius norm: U diag(1, 1, det UVᵀ) Vᵀ (the mean of rotations, projected)."""
    u, _, vt = torch.linalg.svd(matrix)
    flip = torch.ones(matrix.shape[:-1], dtype=matrix.dtype)
    flip[..., 2] = torch.linalg.det(u @ vt)
    return u * flip[..., None, :] @ vt


def axis_angle_of_matrix(rotation: Tensor) -> Tensor:
    """Rotation matrices [...,3,3] -> axis-angle [...,3], |θ| ≤ π; through the quaternion, which has no bad angle.

    Of the four columns of 4 q qᵀ the one with the largest diagonal entry is taken: it is never short (Shepperd 1978).
    """
    r = rotation
    xx, yy, zz = r[..., 0, 0], r[..., 1, 1], r[..., 2, 2]
    wx, wy, wz = r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]
    xy, xz, yz = r[..., 0, 1] + r[..., 1, 0], r[..., 0, 2] + r[..., 2, 0], r[..., 1, 2] + r[..., 2, 1]
    outer = torch.stack(
        (
            torch.stack((1 + xx + yy + zz, wx, wy, wz), -1),
            torch.stack((wx, 1 + xx - yy - zz, xy, xz), -1),
            torch.stack((wy, xy, 1 - xx + yy - zz, yz), -1),
            torch.stack((wz, xz, yz, 1 - xx - yy + zz), -1),
        ),
        -2,
    )
    longest = outer.diagonal(dim1=-2, dim2=-1).argmax(-1)
    quaternion = torch.take_along_dim(outer, longest[..., None, None].expand(*longest.shape, 1, 4), -2)[..., 0, :]
    quaternion = F.normalize(quaternion, dim=-1) * torch.where(quaternion[..., :1] < 0, -1.0, 1.0)
    sine = quaternion[..., 1:].norm(dim=-1, keepdim=True)
    angle = 2 * torch.atan2(sine, quaternion[..., :1])
    return quaternion[..., 1:] * torch.where(sine > 1e-7, angle / sine.clamp(min=1e-7), 2.0)
