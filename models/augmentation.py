"""One draw of augmentation for all views of a scene, and what it does to everything that is known of the scene.

A stored image holds the person's box with a margin (`MARGIN` times its side). In coordinates −1..1 over the stored
image (p) and over the network's crop (q), y down, a draw is the map

    q = Rot(φ) F p · MARGIN/zoom − shift        F = diag(±1, 1)

Turning and mirroring the image about its centre is turning and mirroring the camera about its axis, for any principal
point: joints become Rz(φ) F₃ X, the mirrored body has its left and right exchanged, and its rotations are F₃ R F₃.
"""
from dataclasses import dataclass, fields

import numpy as np
import torch
import torch.nn.functional as F
from torch import Tensor

from networks.skeleton import MIRRORED

MARGIN = 1.25
# Reflection through the plane x = 0, of a vector and of a rotation R -> F R F.
MIRROR = torch.tensor([-1.0, 1.0, 1.0])
MIRROR_ROTATION = MIRROR[:, None] * MIRROR[None, :]


@dataclass(frozen=True)
class Augmentation:
    """Draws for B scenes: mirrored [B] (bool), angle φ [B] (rad), zoom [B] (side of the box), shift [B,2] (in q), gain [B,3]."""

    mirrored: Tensor
    angle: Tensor
    zoom: Tensor
    shift: Tensor
    gain: Tensor

    @staticmethod
    def none(count: int) -> "Augmentation":
        """The person's box as it is."""
        zero, one = torch.zeros(count), torch.ones(count)
        return Augmentation(zero.bool(), zero, one, torch.zeros(count, 2), torch.ones(count, 3))

    @staticmethod
    def draw(rng: np.random.Generator, count: int) -> "Augmentation":
        """SPIN's and the thesis' distributions, except for the zoom and the shift.

        Mirrored with probability ½; gain U(0.6, 1.4) a channel; angle N(0°, 10°) within ±20°, 0 with probability 0.6;
        zoom N(1, 0.1) within 0.75..1.25: the thesis' σ of 0.25 would put a quarter of the people on each bound, and
        boxes come from masks or detectors that err by less; shift N(0, 0.05) within ±0.12, for the same errors.
        """
        angle = np.clip(rng.normal(0, 10, count), -20, 20) * (rng.random(count) >= 0.6)

        def tensor(values: np.ndarray) -> Tensor:
            return torch.from_numpy(values.astype(np.float32))

        return Augmentation(
            torch.from_numpy(rng.random(count) < 0.5),
            tensor(np.radians(angle)),
            tensor(np.clip(rng.normal(1, 0.1, count), 0.75, 1.25)),
            tensor(np.clip(rng.normal(0, 0.05, (count, 2)), -0.12, 0.12)),
            tensor(rng.uniform(0.6, 1.4, (count, 3))),
        )

    def for_views(self, views: int) -> "Augmentation":
        """The same draw for each of a scene's views: B scenes -> B·views rows, a scene's views together."""
        return Augmentation(*(getattr(self, f.name).repeat_interleave(views, 0) for f in fields(self)))

    def chosen(self, scenes: np.ndarray) -> "Augmentation":
        """The draws of some of the scenes."""
        return Augmentation(*(getattr(self, f.name)[torch.from_numpy(scenes)] for f in fields(self)))

    @property
    def turn(self) -> Tensor:
        """Rz(φ) [B,3,3]."""
        cosine, sine = self.angle.cos(), self.angle.sin()
        zero, one = torch.zeros_like(cosine), torch.ones_like(cosine)
        return torch.stack((cosine, -sine, zero, sine, cosine, zero, zero, zero, one), -1).unflatten(-1, (3, 3))

    @property
    def flip(self) -> Tensor:
        """The diagonal of F₃ [B,3]."""
        return torch.where(self.mirrored[:, None], MIRROR, torch.ones(3))

    @property
    def enlargement(self) -> Tensor:
        """How much larger the crop shows what the stored image shows, both in −1..1: MARGIN/zoom [B]."""
        return MARGIN / self.zoom

    def crops(self, images: Tensor, size: int, padding_mode: str = "reflection") -> Tensor:
        """Stored images [B,C,M,M] -> crops [B,C,size,size]; colours as they are."""
        back = (1 / self.enlargement)[:, None, None] * self.flip[:, :2, None] * self.turn[:, :2, :2].mT
        grid = F.affine_grid(
            torch.cat((back, back @ self.shift[..., None]), -1), (len(images), 1, size, size), align_corners=False
        )
        return F.grid_sample(images, grid, mode="bilinear", padding_mode=padding_mode, align_corners=False)

    def points(self, stored: Tensor) -> Tensor:
        """Points [B,J,2] in p -> in q; joints are not renamed."""
        return self.enlargement[:, None, None] * (stored * self.flip[:, None, :2]) @ self.turn[:, :2, :2].mT - self.shift[:, None]

    def renamed(self, of_joints: Tensor) -> Tensor:
        """[B,24,...]: left and right exchanged where the scene is mirrored."""
        chosen = self.mirrored.view(-1, *[1] * (of_joints.dim() - 1))
        return torch.where(chosen, of_joints[:, list(MIRRORED)], of_joints)

    def joints(self, joints: Tensor) -> Tensor:
        """Joints [B,24,3] in the camera's axes (m) -> those of the augmented body."""
        return (self.renamed(joints) * self.flip[:, None]) @ self.turn.mT

    def rotations(self, rotations: Tensor) -> Tensor:
        """Rotations [B,24,3,3], the root's to the camera -> those of the augmented body."""
        reflection = self.flip[:, None, :, None] * self.flip[:, None, None, :]
        turned = self.renamed(rotations) * reflection
        return torch.cat((self.turn[:, None] @ turned[:, :1], turned[:, 1:]), 1)

    def restored_rotations(self, rotations: Tensor) -> Tensor:
        """The inverse of `rotations`."""
        turned = torch.cat((self.turn.mT[:, None] @ rotations[:, :1], rotations[:, 1:]), 1)
        return self.renamed(turned) * (self.flip[:, None, :, None] * self.flip[:, None, None, :])

    def restored_vectors(self, vectors: Tensor) -> Tensor:
        """Vectors [B,3] in the augmented camera's axes -> in the camera's."""
        return (vectors[:, None] @ self.turn)[:, 0] * self.flip


def backgrounds(rng: np.random.Generator, count: int, size: int) -> Tensor:
    """[count,3,size,size] in 0..1: one colour, or a random pattern of 2 to 16 cells a side."""
    cells = 1 if rng.random() < 0.5 else int(rng.integers(2, 17))
    pattern = torch.from_numpy(rng.random((count, 3, cells, cells), dtype=np.float32))
    return F.interpolate(pattern, size=(size, size), mode="bilinear", align_corners=False)


def disturb(rng: np.random.Generator, crops: Tensor, views: int) -> None:
    """Hide a rectangle of a tenth of the crops [B·views,3,S,S], add noise to a quarter of the scenes; in place."""
    count, _, size, _ = crops.shape
    for row in range(count):
        if rng.random() < 0.1:
            height, width = rng.integers(size // 12, size // 3, 2)
            y, x = rng.integers(0, size - height), rng.integers(0, size - width)
            colour = torch.from_numpy(rng.random((3, 1, 1), dtype=np.float32))
            crops[row, :, y : y + height, x : x + width] = colour
    for scene in range(count // views):
        if rng.random() < 0.25:
            rows = crops[scene * views : (scene + 1) * views]
            noise = torch.from_numpy(rng.random(rows.shape, dtype=np.float32) - 0.5)
            rows.add_(noise, alpha=0.2 * rng.random()).clamp_(0, 1)
