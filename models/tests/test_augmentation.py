"""What augmentation does to the image it does to everything else."""
import unittest

import numpy as np
import torch

import people
from augmentation import MARGIN, Augmentation
from networks.rotation import rodrigues
from networks.skeleton import posed_joints, rest_joints
from tests import people_scenes


def scenes(count=6, seed=0):
    rng = np.random.default_rng(seed)
    body = people_scenes.skeleton(rng)
    return [people_scenes.scene(rng, body) for _ in range(count)]


def drawn(count, seed=1):
    """A draw in which every scene is turned and moved, half of them mirrored."""
    draw = Augmentation.draw(np.random.default_rng(seed), count)
    return Augmentation(
        torch.arange(count) % 2 == 0, torch.linspace(-0.3, 0.3, count) + 0.02, draw.zoom, draw.shift, draw.gain
    )


class Geometry(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scenes = scenes()
        cls.draw = drawn(len(cls.scenes))
        cls.rows = cls.draw.for_views(4)
        cls.truth = people.truth(cls.scenes, cls.draw)

    def test_a_scene_of_one_colour_spot_shows_it_at_the_augmented_point(self):
        rng = np.random.default_rng(3)
        points = torch.from_numpy(rng.uniform(-0.4, 0.4, (6, 1, 2)).astype(np.float32))
        images = torch.zeros(6, 1, 160, 160)
        grid = (2 * torch.arange(160) + 1) / 160 - 1
        for k in range(6):
            x, y = points[k, 0]
            images[k, 0] = torch.exp(-((grid[None, :] - x) ** 2 + (grid[:, None] - y) ** 2) / (2 * 0.04**2))
        crops = self.draw.crops(images, 128)[:, 0]
        at = (2 * torch.arange(128) + 1) / 128 - 1
        total = crops.sum((1, 2))
        found = torch.stack(((crops.sum(1) * at).sum(1) / total, (crops.sum(2) * at).sum(1) / total), 1)
        self.assertLess(float((found - self.draw.points(points)[:, 0]).abs().max()), 2e-3)

    def test_without_augmentation_the_crop_is_the_middle_of_the_image(self):
        image = torch.rand(1, 3, 160, 160)
        crop = Augmentation.none(1).crops(image, 128)
        self.assertLess(float((crop - image[:, :, 16:144, 16:144]).abs().max()), 1e-4)
        self.assertEqual(160 / MARGIN, 128)

    def test_augmented_joints_project_onto_augmented_keypoints(self):
        side = people_scenes.SIDE
        intrinsics = people.stacked(self.scenes, "K").flatten(0, 1)
        centre = self.rows.points(2 * intrinsics[:, None, :2, 2] / side - 1)
        focal = intrinsics[:, 0, 0] * 2 / side * self.rows.enlargement
        joints = self.truth.joints
        projected = focal[:, None, None] * joints[..., :2] / joints[..., 2:] + centre
        self.assertLess(float((projected - self.truth.keypoints).abs().max()), 1e-5)

    def test_augmented_rotations_pose_the_augmented_joints(self):
        truth = self.truth
        posed = posed_joints(truth.rotations, rest_joints(truth.j_template, truth.j_shapedirs, truth.betas))
        difference = (posed - posed[:, :1]) - (truth.joints - truth.joints[:, :1])
        self.assertLess(float(difference.abs().max()), 1e-5)

    def test_without_renaming_a_mirrored_body_would_be_wrong(self):
        plain = people.truth(self.scenes)
        wrong = (plain.joints * self.rows.flip[:, None]) @ self.rows.turn.mT
        self.assertGreater(float((wrong - self.truth.joints).abs().max()), 0.05)

    def test_restored_rotations_and_vectors_are_the_original_ones(self):
        plain = people.truth(self.scenes)
        restored = self.rows.restored_rotations(self.truth.rotations)
        self.assertLess(float((restored - plain.rotations).abs().max()), 1e-6)
        vectors = torch.randn(24, 3)
        there = ((vectors * self.rows.flip)[:, None] @ self.rows.turn.mT)[:, 0]
        self.assertLess(float((self.rows.restored_vectors(there) - vectors).abs().max()), 1e-6)

    def test_all_views_of_a_scene_share_one_draw(self):
        self.assertEqual(self.rows.angle.unflatten(0, (6, 4)).std(1).abs().max(), 0)
        self.assertEqual(list(self.rows.mirrored[:8]), [True] * 4 + [False] * 4)

    def test_draws_keep_their_bounds(self):
        draw = Augmentation.draw(np.random.default_rng(5), 4000)
        self.assertLessEqual(float(torch.rad2deg(draw.angle).abs().max()), 20.0001)
        self.assertTrue(0.57 < float((draw.angle == 0).float().mean()) < 0.63)
        self.assertTrue(0.47 < float(draw.mirrored.float().mean()) < 0.53)
        self.assertTrue(0.75 <= float(draw.zoom.min()) and float(draw.zoom.max()) <= 1.25)
        self.assertTrue(0.6 <= float(draw.gain.min()) and float(draw.gain.max()) <= 1.4)


class Colours(unittest.TestCase):
    def test_replaced_backgrounds_keep_the_person(self):
        chosen = scenes(count=8, seed=6)
        for scene in chosen:
            scene["images"][:] = 200
            scene["masks"][:] = 0
            scene["masks"][:, 60:100, 60:100] = 255
        draw = Augmentation.none(8)
        crops = torch.full((32, 3, 128, 128), 200 / 255)
        people.replace_backgrounds(np.random.default_rng(7), crops, chosen, draw, 0.5)
        self.assertLess(float((crops[:, :, 50:78, 50:78] - 200 / 255).abs().max()), 1e-6)
        changed = (crops[:, :, :30] - 200 / 255).abs().amax((1, 2, 3)) > 0.02
        self.assertTrue(0 < int(changed.sum()) < 32)

    def test_a_batch_is_normalised_and_the_same_seed_gives_it_again(self):
        chosen = scenes(count=4)
        first, second = (people.batch(chosen, 128, np.random.default_rng(8)) for _ in range(2))
        self.assertTrue(torch.equal(first.images, second.images))
        self.assertEqual(tuple(first.images.shape), (16, 3, 128, 128))
        mean, std = torch.tensor(people.MEAN).view(3, 1, 1), torch.tensor(people.STD).view(3, 1, 1)
        colours = first.images * std + mean
        self.assertTrue(-1e-5 < float(colours.min()) and float(colours.max()) < 1 + 1e-5)


class Truth(unittest.TestCase):
    def test_rotations_are_in_each_cameras_axes(self):
        chosen = scenes(count=1, seed=9)
        found = people.rotations_in_cameras(chosen)
        root = rodrigues(torch.from_numpy(chosen[0]["poses"][:3]))
        for view in range(4):
            wanted = torch.from_numpy(chosen[0]["R"][view]) @ root
            self.assertLess(float((found[view, 0] - wanted).abs().max()), 1e-6)


if __name__ == "__main__":
    unittest.main()
