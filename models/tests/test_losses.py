"""The regressor's losses by hand-computed cases."""
import math
import unittest

import torch

import losses


class Losses(unittest.TestCase):
    def test_keypoints_are_weighted_by_confidence_and_averaged_over_all(self):
        predicted, keypoints = torch.zeros(2, 3, 2), torch.zeros(2, 3, 2)
        keypoints[0, 1] = torch.tensor([3.0, 4.0])
        keypoints[1, 2] = torch.tensor([100.0, 0.0])
        confidence = torch.ones(2, 3)
        confidence[0, 1], confidence[1, 2] = 0.5, 0.0
        self.assertAlmostEqual(float(losses.keypoint_loss(predicted, keypoints, confidence)), 0.5 * 25 / 12, places=6)

    def test_joints_are_compared_between_the_hips(self):
        torch.manual_seed(0)
        joints = torch.randn(2, 24, 3)
        moved = joints + torch.tensor([1.0, -2.0, 3.0])
        self.assertLess(float(losses.joint_loss(moved, joints, torch.ones(2, 24))), 1e-12)
        hips = torch.zeros(1, 24, 3)
        hips[0, 1, 0] = 2.0  # the middle of the hips moves by 1: the hips are ±1 off, the other 22 joints −1
        self.assertAlmostEqual(float(losses.joint_loss(hips, hips * 0, torch.ones(1, 24))), 24 / 72, places=6)

    def test_only_valid_fits_supervise(self):
        predicted, fitted = torch.zeros(3, 10), torch.ones(3, 10)
        fitted[1] = 2.0
        only = torch.tensor([False, True, False])
        self.assertEqual(float(losses.betas_loss(predicted, fitted, only)), 4.0)
        self.assertEqual(float(losses.betas_loss(predicted, fitted, ~only)), 1.0)
        predicted.requires_grad_()
        none = losses.betas_loss(predicted, fitted, torch.zeros(3, dtype=torch.bool))
        none.backward()
        self.assertEqual((float(none.detach()), float(predicted.grad.abs().max())), (0.0, 0.0))

    def test_what_an_invalid_fit_holds_reaches_neither_loss_nor_gradient(self):
        for loss, shape in (
            (losses.pose_loss, (3, 24, 3, 3)),
            (losses.betas_loss, (3, 10)),
            (losses.vertex_loss, (3, 5, 3)),
        ):
            predicted, fitted = torch.zeros(shape).requires_grad_(), torch.ones(shape)
            fitted[1], fitted[2] = math.nan, math.inf
            for valid, expected in (([False] * 3, 0.0), ([True, False, False], 1.0)):
                found = loss(predicted, fitted, torch.tensor(valid))
                (slope,) = torch.autograd.grad(found, predicted)
                self.assertEqual(float(found.detach()), expected, loss.__name__)
                self.assertTrue(bool(slope.isfinite().all()) and not slope[1:].any(), loss.__name__)
                self.assertEqual(bool(slope[0].any()), valid[0], loss.__name__)

    def test_a_half_turn_of_one_joint_costs_8_of_its_9_entries(self):
        fitted = torch.eye(3).repeat(1, 24, 1, 1)
        predicted = fitted.clone()
        predicted[0, 5] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
        valid = torch.tensor([True])
        self.assertAlmostEqual(float(losses.pose_loss(predicted, fitted, valid)), 8 / (24 * 9), places=7)

    def test_vertices_are_compared_by_absolute_difference(self):
        predicted, fitted = torch.zeros(1, 2, 3), torch.tensor([[[1.0, -2.0, 0.0], [0.0, 0.0, 3.0]]])
        self.assertEqual(float(losses.vertex_loss(predicted, fitted, torch.tensor([True]))), 1.0)

    def test_a_camera_without_scale_costs_one(self):
        self.assertEqual(float(losses.camera_loss(torch.zeros(2, 3))), 1.0)
        self.assertLess(float(losses.camera_loss(torch.ones(2, 3))), 1e-8)

    def test_a_map_that_points_at_the_joint_costs_least(self):
        keypoints = torch.tensor([[[-0.75, 0.25], [5.0, 0.0], [0.0, 0.0]]])  # cell (0, 2), outside, between four cells
        confidence = torch.ones(1, 3)
        flat = torch.zeros(1, 3, 4, 4)
        self.assertAlmostEqual(float(losses.heatmap_loss(flat, keypoints, confidence)), math.log(16), places=5)
        sharp = flat.clone()
        sharp[0, 0, 2, 0] = 50.0
        sharp[0, 2, 1:3, 1:3] = 50.0
        found = float(losses.heatmap_loss(sharp, keypoints, confidence))
        self.assertAlmostEqual(found, math.log(4) / 2, places=5)
        sharp[0, 1] = torch.randn(4, 4)
        self.assertAlmostEqual(float(losses.heatmap_loss(sharp, keypoints, confidence)), found, places=6)
        self.assertEqual(float(losses.heatmap_loss(sharp, keypoints, 0 * confidence)), 0.0)

    def test_the_mean_body_costs_nothing_of_the_prior(self):
        mean = torch.eye(3).repeat(23, 1, 1)
        self.assertEqual(float(losses.prior_loss(mean.repeat(2, 1, 1, 1), mean, torch.zeros(2, 10))), 0.0)
        self.assertAlmostEqual(float(losses.prior_loss(mean[None], mean, torch.full((1, 10), 2.0))), 0.4, places=6)

    def test_the_total_is_60_times_the_weighted_terms(self):
        one = torch.tensor(1.0)
        names = ("keypoints", "joints", "pose", "betas", "vertices", "camera")
        found = losses.total(losses.Weights(), **{name: one for name in names})
        self.assertAlmostEqual(float(found), 60 * (5 + 5 + 1 + 0.001 + 0 + 1), places=3)
        self.assertAlmostEqual(float(losses.total(losses.Weights(), joints=one)), 300, places=4)

    def test_gradients_are_right(self):
        torch.manual_seed(1)
        confidence, valid = torch.rand(2, 24).double(), torch.tensor([True, False])

        def of(value, other, loss, *rest):
            return loss(value, other, *rest)

        for loss, shape, rest in (
            (losses.keypoint_loss, (2, 24, 2), (confidence,)),
            (losses.joint_loss, (2, 24, 3), (confidence,)),
            (losses.pose_loss, (2, 24, 3, 3), (valid,)),
            (losses.betas_loss, (2, 10), (valid,)),
            (losses.vertex_loss, (2, 5, 3), (valid,)),
        ):
            value, other = torch.randn(shape).double().requires_grad_(), torch.randn(shape).double()
            self.assertTrue(torch.autograd.gradcheck(lambda v: of(v, other, loss, *rest), (value,)), loss.__name__)


if __name__ == "__main__":
    unittest.main()
