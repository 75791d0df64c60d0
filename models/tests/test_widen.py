"""A widened network computes what the small one computes."""
import unittest

import torch

import agreement
import filling
import widen
from networks import mf_pifu, vsr

# Rounding of sums of a few thousand f64 products of size one.
EXACT = 1e-11
# The same in f32; what a widened graph may differ from a small one by.
SINGLE = 1e-5


def difference(a, b) -> float:
    """Largest |a − b| over tensors or tuples of tensors; maps are compared over the channels both have."""
    if isinstance(a, tuple):
        return max(difference(x, y) for x, y in zip(a, b, strict=True))
    return float((a - b).abs().max())


class MfPifu(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.small = filling.random_mf_pifu(mf_pifu.SMALL, seed=3)
        cls.wide = mf_pifu.MfPifu(mf_pifu.THESIS).eval()
        cls.wide.load_state_dict(widen.widen_mf_pifu(cls.small.state_dict()))
        cls.images = agreement.images(64)
        cls.uv, cls.depth = agreement.view_points()

    def answers(self, network, dtype):
        network.to(dtype)
        with torch.no_grad():
            maps = network.encoder(self.images.to(dtype))
            return maps, network.query(*maps, self.uv.to(dtype), self.depth.to(dtype))

    def test_maps_and_occupancy_agree(self):
        for dtype, bound in ((torch.float64, EXACT), (torch.float32, SINGLE)):
            small_maps, small = self.answers(self.small, dtype)
            wide_maps, wide = self.answers(self.wide, dtype)
            shared = tuple(m[:, : mf_pifu.SMALL.out] for m in wide_maps)
            scale = max(float(m.abs().max()) for m in small_maps)
            self.assertLess(difference(shared, small_maps) / scale, bound)
            self.assertLess(difference(wide, small), bound)

    def test_padded_channels_are_zero(self):
        maps, _ = self.answers(self.wide, torch.float32)
        self.assertEqual([float(m[:, mf_pifu.SMALL.out :].abs().max()) for m in maps], [0.0] * 4)

    def test_depth_moves_to_the_last_column(self):
        columns = widen.mf_pifu_columns(mf_pifu.SMALL, mf_pifu.THESIS)
        self.assertEqual([int(c[-1]) for c in columns], [1024, 2048, 1536, 1152])
        self.assertEqual([int(columns[0][k * 32 + 5]) for k in range(4)], [k * 256 + 5 for k in range(4)])
        self.assertEqual(int(columns[1][128]), 1024)

    def test_padding_the_corner_alone_would_be_wrong(self):
        state = widen.widen(self.small.state_dict(), self.wide.state_dict(), {})
        wrong = mf_pifu.MfPifu(mf_pifu.THESIS).eval()
        wrong.load_state_dict(state)
        (_, got), (_, want) = self.answers(wrong, torch.float64), self.answers(self.small, torch.float64)
        self.assertGreater(difference(got, want), 1e-3)


class Vsr(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.small = filling.random_vsr(vsr.SMALL, seed=3)
        cls.wide = vsr.Vsr(vsr.THESIS).eval()
        cls.wide.load_state_dict(widen.widen_vsr(cls.small.state_dict()))
        cls.voxels, cls.points = agreement.voxels(32), agreement.volume_points()

    def answers(self, network, dtype):
        network.to(dtype)
        with torch.no_grad():
            volumes = network.encoder(self.voxels.to(dtype))
            return volumes, network.query(*volumes, self.points.to(dtype))

    def test_volumes_and_occupancy_agree(self):
        for dtype, bound in ((torch.float64, EXACT), (torch.float32, SINGLE)):
            small_volumes, small = self.answers(self.small, dtype)
            wide_volumes, wide = self.answers(self.wide, dtype)
            shared = tuple(w[:, : s.shape[1]] for w, s in zip(wide_volumes, small_volumes))
            scale = max(float(v.abs().max()) for v in small_volumes)
            self.assertLess(difference(shared, small_volumes) / scale, bound)
            self.assertLess(difference(wide, small), bound)

    def test_padded_channels_are_zero(self):
        volumes, _ = self.answers(self.wide, torch.float32)
        padded = [v[:, channels:] for v, channels in zip(volumes, vsr.SMALL.stages)]
        self.assertEqual([float(p.abs().max()) for p in padded], [0.0] * 5)


class Refusals(unittest.TestCase):
    def test_a_wider_tensor_does_not_fit(self):
        with self.assertRaisesRegex(ValueError, r"\(4, 3\) does not fit into \(3, 3\)"):
            widen.padded(torch.zeros(4, 3), torch.Size((3, 3)))

    def test_a_foreign_name_is_named(self):
        state = dict(filling.random_vsr(vsr.SMALL, seed=3).state_dict())
        state["stages.9.weight"] = torch.zeros(1)
        with self.assertRaisesRegex(ValueError, "stages.9.weight"):
            widen.widen_vsr(state)


if __name__ == "__main__":
    unittest.main()
