"""Shapes, group sizes and parameter counts of the two networks in both sizes."""
import unittest

import torch
from torch import nn

from networks import mf_pifu, vsr


def parameters(*modules: nn.Module) -> int:
    return sum(p.numel() for module in modules for p in module.parameters())


class MfPifu(unittest.TestCase):
    def test_encoder_halves_the_side_from_map_to_map(self):
        for size in mf_pifu.SIZES.values():
            with torch.no_grad():
                maps = mf_pifu.Encoder(size).eval()(torch.zeros(2, 3, 64, 64))
            self.assertEqual([tuple(m.shape) for m in maps], [(2, size.out, s, s) for s in (32, 16, 8, 4)])

    def test_query_joins_the_views_into_one_occupancy_per_point(self):
        size = mf_pifu.SMALL
        maps = [torch.rand(3, size.out, s, s) for s in (16, 8, 4, 2)]
        with torch.no_grad():
            occupancy = mf_pifu.Query(size)(*maps, torch.rand(3, 5, 2), torch.rand(3, 5))
        self.assertEqual(tuple(occupancy.shape), (5,))
        self.assertTrue(bool(((occupancy > 0) & (occupancy < 1)).all()))

    def test_order_of_the_views_does_not_matter(self):
        size, order = mf_pifu.SMALL, torch.tensor([2, 0, 1])
        query = mf_pifu.Query(size).double()
        inputs = [torch.rand(3, size.out, s, s).double() for s in (16, 8, 4, 2)]
        inputs += [torch.rand(3, 5, 2).double(), torch.rand(3, 5).double()]
        with torch.no_grad():
            difference = query(*inputs) - query(*(t[order] for t in inputs))
        self.assertLess(float(difference.abs().max()), 1e-14)

    def test_groups_hold_as_many_channels_in_every_size(self):
        def per_group(size):
            modules = mf_pifu.Encoder(size).named_modules()
            return {n: m.num_channels // m.num_groups for n, m in modules if isinstance(m, nn.GroupNorm)}

        small, thesis = per_group(mf_pifu.SMALL), per_group(mf_pifu.THESIS)
        self.assertEqual(small, thesis)
        self.assertEqual(len(thesis), 17)
        for name, count in thesis.items():
            self.assertEqual(count, 2 if name == "stem.norm" else 4 if name.endswith("down1_norm") else 8, name)

    def test_thesis_size_has_32_groups_everywhere(self):
        groups = [m.num_groups for m in mf_pifu.Encoder(mf_pifu.THESIS).modules() if isinstance(m, nn.GroupNorm)]
        self.assertEqual(set(groups), {32})

    def test_thesis_encoder_has_10_89_million_parameters(self):
        def convolution(inputs, outputs, side):
            return inputs * outputs * side * side + outputs

        def hourglass(inputs):
            sizes = [(inputs, 128, 3), (128, 256, 3), (256, 256, 4), (128, 256, 1), (256, 256, 4), (inputs, 256, 1)]
            return sum(convolution(*s) for s in sizes) + 2 * (128 + 3 * 256)

        counted = convolution(3, 64, 7) + 2 * 64 + hourglass(64) + 3 * hourglass(256)
        self.assertEqual(parameters(mf_pifu.Encoder(mf_pifu.THESIS)), counted)
        self.assertEqual(round(counted / 1e6, 2), 10.89)

    def test_thesis_point_network_has_2_298_242_parameters(self):
        layers = mf_pifu.Query(mf_pifu.THESIS).mlp.layers
        self.assertEqual([layer.in_channels for layer in layers], [1025, 2049, 1537, 1153])
        self.assertEqual(parameters(layers), 2_298_242)


class Vsr(unittest.TestCase):
    def test_encoder_halves_the_side_from_volume_to_volume(self):
        for size in vsr.SIZES.values():
            with torch.no_grad():
                volumes = vsr.Encoder(size).eval()(torch.zeros(1, 1, 32, 32, 32))
            wanted = [(1, c, s, s, s) for c, s in zip(size.stages, (32, 16, 8, 4, 2))]
            self.assertEqual([tuple(v.shape) for v in volumes], wanted)

    def test_query_gives_one_occupancy_per_point(self):
        volumes = [torch.rand(1, c, s, s, s) for c, s in zip(vsr.SMALL.stages, (32, 16, 8, 4, 2))]
        with torch.no_grad():
            occupancy = vsr.Query(vsr.SMALL)(*volumes, torch.rand(7, 3))
        self.assertEqual(tuple(occupancy.shape), (7,))

    def test_a_cell_centre_reads_its_own_voxel(self):
        """Point (x, y, z) = cell centres of (k, j, i) reads volume[i, j, k]: x runs along the last axis."""
        volume = torch.rand(1, 1, 4, 4, 4)
        centre = (2 * torch.arange(4) + 1) / 4 - 1
        i, j, k = 3, 1, 0
        grid = torch.stack((centre[k], centre[j], centre[i]))[None, None, None, None]
        read = nn.functional.grid_sample(volume, grid, padding_mode="border", align_corners=False)
        self.assertAlmostEqual(float(read), float(volume[0, 0, i, j, k]), places=6)

    def test_thesis_convolutions_have_1_756_800_parameters(self):
        stages = vsr.Encoder(vsr.THESIS).stages
        self.assertEqual(parameters(*(stage.convs for stage in stages)), 1_756_800)
        self.assertEqual(parameters(*(stage.norm for stage in stages)), 736)

    def test_thesis_point_network_has_226_305_parameters(self):
        self.assertEqual(parameters(vsr.Query(vsr.THESIS)), 226_305)


if __name__ == "__main__":
    unittest.main()
