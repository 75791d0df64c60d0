"""Joints read off maps: where a heat map is sharp, its mean is its place; the losses vanish at the truth alone."""
import unittest
from dataclasses import replace

import torch

import auxiliary
import losses
import people
from networks import regressor
from tests.test_augmentation import scenes

TINY = regressor.Size("tiny", planes=(4, 4, 4, 4), hidden=16, image_size=32)


class Integral(unittest.TestCase):
    def setUp(self):
        torch.manual_seed(0)
        self.auxiliary = auxiliary.Auxiliary(TINY)

    def test_a_sharp_map_means_its_cell_and_its_depth(self):
        side = 16
        maps = torch.zeros(1, 48, side, side)
        row, column = 3, 12
        maps[0, :24, row, column] = 100.0
        maps[0, 24:, row, column] = torch.arange(24.0)
        places, depths = self.auxiliary.integral(maps)
        expected = torch.tensor([2 * (column + 0.5) / side - 1, 2 * (row + 0.5) / side - 1])
        torch.testing.assert_close(places[0], expected.expand(24, 2))
        torch.testing.assert_close(depths[0], torch.arange(24.0))

    def test_an_even_map_means_the_middle(self):
        places, _ = self.auxiliary.integral(torch.zeros(1, 48, 16, 16))
        self.assertLess(float(places.abs().max()), 1e-6)

    def test_depth_is_counted_from_between_the_hips(self):
        joints = torch.randn(3, 24, 3)
        truth, known = losses.centred(joints)[..., 2], torch.ones(3, 24)
        self.assertEqual(float(losses.depth_loss(truth, joints, known)), 0.0)
        self.assertLess(float(losses.depth_loss(truth, joints + torch.tensor([0.0, 0.0, 8.0]), known)), 1e-10)
        self.assertGreater(float(losses.depth_loss(truth + 0.1, joints, known)), 0.009)

    def test_joints_that_were_not_measured_teach_nothing(self):
        data = scenes(2, 2)
        batch = people.batch(data, 32, measured=[True, False])
        count = len(batch.images)
        middle, features = torch.randn(count, TINY.features // 2, 2, 2), torch.randn(count, TINY.features)
        loss = self.auxiliary(middle, features, batch)
        for scene, changes in ((0, True), (1, False)):
            joints = batch.joints.clone()
            joints[batch.views * scene, 5] += 1.0
            moved = self.auxiliary(middle, features, replace(batch, joints=joints))
            self.assertEqual(not torch.equal(moved, loss), changes, scene)

    def test_a_valid_fit_completes_what_was_not_measured_and_nothing_else(self):
        batch = people.batch(scenes(2, 2), 32, measured=[True, False])
        fitted = batch.joints + 1.0
        valid = torch.ones(len(fitted), dtype=torch.bool)
        valid[-1] = False
        whole = people.completed(batch, fitted, valid)
        rows = torch.arange(len(fitted))
        filled = (rows >= batch.views) & valid
        self.assertEqual((whole.joints == fitted).all((1, 2)).tolist(), filled.tolist())
        self.assertEqual((whole.joints == batch.joints).all((1, 2)).tolist(), (~filled).tolist())
        self.assertEqual(whole.measured[:, 0].bool().tolist(), ((rows < batch.views) | filled).tolist())

    def test_all_parts_learn(self):
        batch = people.batch(scenes(2, 2), 32)
        count = len(batch.images)
        middle = torch.randn(count, TINY.features // 2, 2, 2, requires_grad=True)
        features = torch.randn(count, TINY.features, requires_grad=True)
        self.auxiliary(middle, features, batch).backward()
        for name, parameter in self.auxiliary.named_parameters():
            self.assertGreater(float(parameter.grad.abs().max()), 0.0, name)
        self.assertGreater(float(middle.grad.abs().max()), 0.0)


if __name__ == "__main__":
    unittest.main()
