"""The regressor's shapes, names and counts; rotations and joints against independent arithmetic."""
import unittest

import numpy as np
import torch

import agreement
import filling
import widen
from networks import regressor
from networks.rotation import axis_angle_of_matrix, matrix_of_six, nearest_rotation, rodrigues, six_of_matrix
from networks.skeleton import MIRRORED, PARENTS, posed_joints, rest_joints
from tests import people_scenes


def random_rotations(*shape: int) -> torch.Tensor:
    torch.manual_seed(7)
    return nearest_rotation(torch.randn(*shape, 3, 3).double())


class Rotation(unittest.TestCase):
    def test_six_numbers_are_the_first_two_columns_row_by_row(self):
        six = torch.tensor([1.0, 2.0, 3.0, 4.0, 5.0, 6.0]).double()
        a1, a2 = np.array([1.0, 3.0, 5.0]), np.array([2.0, 4.0, 6.0])
        b1 = a1 / np.linalg.norm(a1)
        b2 = a2 - (b1 @ a2) * b1
        b2 /= np.linalg.norm(b2)
        wanted = np.stack((b1, b2, np.cross(b1, b2)), 1)
        np.testing.assert_allclose(matrix_of_six(six).numpy(), wanted, atol=1e-15)

    def test_six_numbers_of_a_rotation_give_it_back(self):
        rotations = random_rotations(50)
        self.assertLess(float((matrix_of_six(six_of_matrix(rotations)) - rotations).abs().max()), 1e-14)

    def test_any_six_numbers_give_a_rotation(self):
        torch.manual_seed(1)
        r = matrix_of_six(torch.randn(200, 6).double())
        self.assertLess(float((r @ r.mT - torch.eye(3)).abs().max()), 1e-12)
        self.assertLess(float((torch.linalg.det(r) - 1).abs().max()), 1e-12)

    def test_rodrigues_is_the_exponential(self):
        rng = np.random.default_rng(2)
        for scale in (0.0, 1e-9, 1e-3, 1.0, 3.1):
            axis_angle = rng.normal(size=3)
            axis_angle *= scale / np.linalg.norm(axis_angle)
            got = rodrigues(torch.from_numpy(axis_angle)).numpy()
            np.testing.assert_allclose(got, people_scenes.rodrigues(axis_angle), atol=1e-14)

    def test_axis_angle_and_matrix_close_at_every_angle(self):
        torch.manual_seed(3)
        axes = torch.nn.functional.normalize(torch.randn(40, 3).double(), dim=-1)
        for angle in (0.0, 1e-8, 1e-3, 1.0, 3.0, torch.pi - 1e-9, torch.pi):
            matrices = rodrigues(axes * angle)
            found = axis_angle_of_matrix(matrices)
            self.assertLess(float((rodrigues(found) - matrices).abs().max()), 1e-12, angle)
            self.assertLess(float((found.norm(dim=-1) - angle).abs().max()), 1e-7, angle)

    def test_nearest_rotation_is_no_reflection(self):
        torch.manual_seed(4)
        found = nearest_rotation(torch.randn(100, 3, 3).double())
        self.assertLess(float((torch.linalg.det(found) - 1).abs().max()), 1e-12)


class Skeleton(unittest.TestCase):
    def test_joints_are_those_of_chained_4x4_matrices(self):
        rng = np.random.default_rng(5)
        template, shapedirs = people_scenes.skeleton(rng)
        poses, betas = rng.normal(0, 0.7, (3, 24, 3)), rng.normal(0, 1, (3, 10))
        rotations = rodrigues(torch.from_numpy(poses))
        rest = rest_joints(
            torch.from_numpy(template).expand(3, -1, -1),
            torch.from_numpy(shapedirs).expand(3, -1, -1, -1),
            torch.from_numpy(betas),
        )
        got = posed_joints(rotations, rest).numpy()
        for k in range(3):
            wanted = people_scenes.joints_by_4x4(rotations[k].numpy(), template + shapedirs @ betas[k])
            np.testing.assert_allclose(got[k], wanted, atol=1e-14)

    def test_derivatives_by_rotations_and_rest_joints_are_right(self):
        torch.manual_seed(6)
        rotations = torch.randn(1, 24, 3, 3).double().requires_grad_()
        rest = torch.randn(1, 24, 3).double().requires_grad_()
        self.assertTrue(torch.autograd.gradcheck(posed_joints, (rotations, rest)))

    def test_mirroring_renames_in_pairs_and_keeps_the_tree(self):
        self.assertEqual([MIRRORED[k] for k in MIRRORED], list(range(24)))
        for joint in range(1, 24):
            self.assertEqual(PARENTS[MIRRORED[joint]], MIRRORED[PARENTS[joint]])


class Network(unittest.TestCase):
    def test_counts_are_those_of_resnet_50_and_spin(self):
        network = regressor.Regressor(regressor.THESIS)
        counts = {name: sum(p.numel() for p in module.parameters()) for name, module in network.named_children()}
        head = {name: counts.pop(name) for name in ("fc1", "fc2", "decpose", "decshape", "deccam")}
        self.assertEqual((head["fc1"], head["fc2"]), (2_258_944, 1_049_600))
        self.assertEqual(head["decpose"] + head["decshape"] + head["deccam"], 160_925)
        # torchvision's resnet50 has 25 557 032 parameters, 2 049 000 of them in its classifier.
        self.assertEqual(sum(counts.values()), 25_557_032 - 2_049_000)

    def test_names_are_those_of_torchvision_and_spin(self):
        names = set(regressor.Regressor(regressor.SMALL).state_dict())
        for name in (
            "conv1.weight", "bn1.running_mean", "layer1.0.conv1.weight", "layer1.0.downsample.0.weight",
            "layer1.0.downsample.1.bias", "layer3.5.bn3.running_var", "layer4.2.conv3.weight", "fc1.weight", "fc2.bias",
            "decpose.weight", "decshape.bias", "deccam.weight", "init_pose", "init_shape", "init_cam",
        ):
            self.assertIn(name, names)
        self.assertNotIn("layer1.1.downsample.0.weight", names)

    def test_the_stride_sits_on_the_3x3(self):
        block = regressor.Regressor(regressor.SMALL).layer2[0]
        strides = [c.stride[0] for c in (block.conv1, block.conv2, block.conv3, block.downsample[0])]
        self.assertEqual(strides, [1, 2, 1, 2])

    def test_an_untrained_network_answers_with_the_mean_body(self):
        torch.manual_seed(8)
        network = regressor.Regressor(regressor.SMALL).eval()
        with torch.no_grad():
            pose, betas, camera = network(agreement.images(128))
        self.assertEqual([tuple(t.shape) for t in (pose, betas, camera)], [(4, 144), (4, 10), (4, 3)])
        difference = matrix_of_six(pose.unflatten(1, (24, 6))) - regressor.upright()
        self.assertLess(float(difference.abs().max()), 0.5)
        self.assertLess(float((camera - network.init_cam).abs().max()), 0.5)

    def test_images_do_not_look_at_each_other(self):
        network = filling.random_regressor(regressor.SMALL, seed=9).double()
        images = agreement.images(128).double()
        with torch.no_grad():
            together, alone = network(images), network(images[2:3])
        for whole, part in zip(together, alone):
            self.assertLess(float((whole[2:3] - part).abs().max()), 1e-12)

    def test_gradients_reach_every_parameter(self):
        torch.manual_seed(10)
        network = regressor.Regressor(regressor.SMALL)
        sum(t.square().sum() for t in network(agreement.images(64))).backward()
        for name, parameter in network.named_parameters():
            self.assertIsNotNone(parameter.grad, name)
            self.assertGreater(float(parameter.grad.abs().max()), 0, name)


class Widened(unittest.TestCase):
    def test_a_widened_regressor_answers_the_same(self):
        small = filling.random_regressor(regressor.SMALL, seed=11).double()
        wide = regressor.Regressor(regressor.THESIS).eval().double()
        wide.load_state_dict(widen.widen_regressor(small.state_dict()))
        images = agreement.images(96).double()
        with torch.no_grad():
            for got, want in zip(wide(images), small(images)):
                self.assertLess(float((got - want).abs().max()), 1e-11)
            features = wide.features(images)
        self.assertEqual(float(features[:, regressor.SMALL.features :].abs().max()), 0.0)

    def test_padding_the_head_in_the_corner_alone_would_be_wrong(self):
        small = filling.random_regressor(regressor.SMALL, seed=11).double()
        wide = regressor.Regressor(regressor.THESIS).eval().double()
        wide.load_state_dict(widen.widen(small.state_dict(), wide.state_dict(), {}))
        images = agreement.images(96).double()
        with torch.no_grad():
            difference = max(float((a - b).abs().max()) for a, b in zip(wide(images), small(images)))
        self.assertGreater(difference, 1e-4)


if __name__ == "__main__":
    unittest.main()
