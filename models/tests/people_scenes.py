"""Fabricated scenes in the format of `vitruvian dataset --for regressor`: a symmetric stick body before four pinholes."""
import pathlib

import numpy as np

from networks.skeleton import MIRRORED, PARENTS

SIDE = 160


def rodrigues(axis_angle):
    """exp of one axis-angle vector, through the matrix exponential's series: slow and independent of the network's."""
    x, y, z = axis_angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    term, total = np.eye(3), np.eye(3)
    for n in range(1, 40):
        term = term @ k / n
        total = total + term
    return total


def skeleton(rng):
    """J_template [24,3] and J_shapedirs [24,3,10] of a body that is its own mirror image."""
    mirror = np.array([-1.0, 1.0, 1.0])
    template = rng.normal(0, 0.3, (24, 3))
    shapedirs = rng.normal(0, 0.02, (24, 3, 10))
    template = (template + (template * mirror)[list(MIRRORED)]) / 2
    shapedirs = (shapedirs + (shapedirs * mirror[:, None])[list(MIRRORED)]) / 2
    return template, shapedirs


def joints_by_4x4(rotations, rest):
    """Posed joints by chained 4×4 matrices, as SMPL's linear blend skinning chains them."""
    chain = []
    for joint, parent in enumerate(PARENTS):
        local = np.eye(4)
        local[:3, :3] = rotations[joint]
        local[:3, 3] = rest[joint] - (rest[parent] if parent >= 0 else 0)
        chain.append(local if parent < 0 else chain[parent] @ local)
    return np.stack([g[:3, 3] for g in chain])


def scene(rng, body, views=4):
    """One scene of `body` = skeleton(rng) in `views` cameras."""
    template, shapedirs = body
    poses, betas = rng.normal(0, 0.4, 72), rng.normal(0, 1, 10)
    poses[:3], trans = rng.normal(0, 0.2, 3), rng.normal(0, 0.1, 3)
    rest = template + shapedirs @ betas
    world = joints_by_4x4([rodrigues(p) for p in poses.reshape(24, 3)], rest) + trans
    yaw = rng.uniform(0, 2 * np.pi) + np.arange(views) * np.pi / 2
    rotations, translations, intrinsics, joints, keypoints = [], [], [], [], []
    for angle in yaw:
        turned = np.diag([1.0, -1.0, -1.0]) @ rodrigues([0, angle, 0])
        t = np.array([*rng.normal(0, 0.2, 2), 4.0])
        k = np.array([[200.0, 0, 80 + rng.normal(0, 8)], [0, 200.0, 80 + rng.normal(0, 8)], [0, 0, 1]])
        seen = world @ turned.T + t
        pixels = seen @ k.T
        rotations.append(turned), translations.append(t), intrinsics.append(k), joints.append(seen)
        keypoints.append(np.concatenate((pixels[:, :2] / pixels[:, 2:], np.ones((24, 1))), 1))
    floats = {
        "keypoints": keypoints, "joints_camera": joints, "K": intrinsics, "R": rotations, "t": translations,
        "poses": poses, "betas": betas, "trans": trans, "J_template": template, "J_shapedirs": shapedirs,
    }
    return {
        "images": rng.integers(0, 256, (views, 3, SIDE, SIDE), dtype=np.uint8),
        "masks": rng.integers(0, 2, (views, SIDE, SIDE), dtype=np.uint8) * 255,
        **{name: np.asarray(values, np.float32) for name, values in floats.items()},
    }


def write(folder: pathlib.Path, count, seed=0):
    """`count` scenes as files in `folder`."""
    rng = np.random.default_rng(seed)
    body = skeleton(rng)
    for k in range(count):
        np.savez(folder / f"scene_{k:06}.npz", **scene(rng, body))
