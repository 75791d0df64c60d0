"""The prior on poses: moments of the scenes' poses, one Gaussian a folder."""
import pathlib
import tempfile
import unittest

import numpy as np

import pose_prior


class Mixture(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def write(self, name, poses):
        (self.folder / name).mkdir()
        for k, pose in enumerate(poses):
            np.savez(self.folder / name / f"{k}.npz", poses=pose.astype(np.float32))
        return self.folder / name

    def test_means_covariances_and_weights_are_those_of_the_poses(self):
        rng = np.random.default_rng(5)
        a, b = rng.normal(0.3, 0.2, (300, 72)), rng.normal(-0.1, 0.5, (100, 72))
        found = pose_prior.mixture([self.write("a", a), self.write("b", b)])
        np.testing.assert_allclose(found["means"], [a[:, 3:].mean(0), b[:, 3:].mean(0)], atol=1e-6)
        np.testing.assert_allclose(found["weights"], [0.75, 0.25])
        np.testing.assert_allclose(
            found["covariances"][1], np.cov(b[:, 3:].T) + pose_prior.RIDGE * np.eye(69), atol=1e-6
        )

    def test_joints_that_never_turn_keep_a_finite_weight(self):
        found = pose_prior.mixture([self.write("still", np.zeros((3, 72)))])
        self.assertGreater(np.linalg.eigvalsh(found["covariances"][0]).min(), 0)

    def test_a_folder_without_scenes_is_named(self):
        with self.assertRaisesRegex(SystemExit, "empty: 0 scenes"):
            pose_prior.mixture([self.write("empty", [])])


if __name__ == "__main__":
    unittest.main()
