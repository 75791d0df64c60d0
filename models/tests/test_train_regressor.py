"""The loop of Figure 4.1: it goes on where it stopped, fits start from the estimate, the better fit is kept."""
import contextlib
import io
import pathlib
import stat
import sys
import tempfile
import unittest
from unittest import mock

import numpy as np
import torch

import curves
import people
import train_regressor
from augmentation import Augmentation
from fits import Dictionary, Fit, fit_in_the_loop, starts, supervision
from networks import regressor
from tests import people_scenes
from tests.test_augmentation import drawn, scenes

TINY = regressor.Size("tiny", planes=(4, 4, 4, 4), hidden=16, image_size=32)

# Stands for `vitruvian fit BATCH.npz --method mv-smplify -o FITS.npz`: it answers with what it was given.
PROGRAM = """#!{python}
import sys
import numpy as np
batch = np.load(sys.argv[2])
assert sys.argv[1] == "fit" and sys.argv[3:5] == ["--method", "mv-smplify"], sys.argv
count = len(batch["poses"])
loss = np.repeat(np.abs(batch["trans"]).sum((1, 2))[:, None], 24, 1)
np.savez(sys.argv[6], poses=batch["poses"], betas=batch["betas"].mean(1), trans=batch["trans"], loss=loss,
         valid=np.ones(count, bool))
"""


class Folder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        self.program = self.folder / "vitruvian"
        self.program.write_text(PROGRAM.format(python=sys.executable))
        self.program.chmod(self.program.stat().st_mode | stat.S_IXUSR)


class Loop(Folder):
    def setUp(self):
        super().setUp()
        (self.folder / "data").mkdir()
        people_scenes.write(self.folder / "data", 6)

    def train(self, name, *more):
        """One run of the loop at a tiny size -> its checkpoint."""
        out = self.folder / name
        with mock.patch.dict(regressor.SIZES, {"tiny": TINY}), contextlib.redirect_stderr(io.StringIO()):
            self.begin(out, *more).train()
        return torch.load(out, weights_only=True)

    def begin(self, out, *more):
        """A run before its first step."""
        arguments = ["--data", self.folder / "data", "--validation", self.folder / "data", "-o", out, "--size", "tiny",
                     "--batch", 2, "--steps", 6, "--every", 3, "--save-every", 3, "--warm-up", 2, "--threads", 1,
                     "--program", self.program, *more]
        return train_regressor.Training(train_regressor.parse([str(a) for a in arguments]))

    def assert_same_weights(self, a, b):
        self.assertEqual(a["steps"], b["steps"])
        for name, tensor in a["state"].items():
            self.assertTrue(torch.equal(tensor, b["state"][name]), name)

    def test_a_run_that_was_stopped_ends_with_the_same_weights(self):
        for loop in ((), ("--fit-in-the-loop",)):
            whole = self.train(f"whole{len(loop)}.pt", *loop)
            self.train(f"parts{len(loop)}.pt", *loop, "--stop-at", 3)
            parts = self.train(f"parts{len(loop)}.pt", *loop)
            self.assert_same_weights(whole, parts)
            self.assertEqual([line["step"] for line in parts["history"]], [3, 6])

    def test_the_fit_in_the_loop_changes_what_is_learned_and_fills_the_dictionary(self):
        without, with_fit = self.train("without.pt"), self.train("with.pt", "--fit-in-the-loop")
        self.assertEqual(len(without["dictionary"]), 0)
        self.assertGreaterEqual(len(with_fit["dictionary"]), 4)
        moved = max(float((t - with_fit["state"][n]).abs().max()) for n, t in without["state"].items())
        self.assertGreater(moved, 0)
        self.assertGreater(with_fit["history"][-1]["valid_fits"], 0.99)

    def test_supervision_brings_poses_nearer_to_the_truth_than_joints_alone_do(self):
        """Twists that no joint shows are learned only where the pose is told."""
        more = ("--steps", 40, "--every", 40, "--rate", 3e-3, "--dropout", 0, "--validation", self.folder / "data")
        joints, supervised = (self.train(f"{len(how)}.pt", *more, *how)["history"][-1] for how in ((), ("--supervised",)))
        self.assertIn("pose", supervised)
        self.assertNotIn("pose", joints)
        self.assertLess(supervised["rotation_deg"], joints["rotation_deg"])

    def test_joints_are_known_of_the_measured_folders_alone(self):
        (self.folder / "laboratory").mkdir()
        people_scenes.write(self.folder / "laboratory", 2)
        folders = ["--data", str(self.folder / "data"), str(self.folder / "laboratory"), "-o", str(self.folder / "x.pt")]
        with mock.patch.dict(regressor.SIZES, {"tiny": TINY}):
            run = train_regressor.Training(
                train_regressor.parse([*folders, "--size", "tiny", "--measured", str(self.folder / "laboratory")])
            )
        known = run.measured(np.arange(len(run.scenes)))
        self.assertEqual(known, ["laboratory" in str(path) for path in run.scenes.paths])
        self.assertEqual(sum(known), 2)
        with self.assertRaises(SystemExit), contextlib.redirect_stderr(io.StringIO()) as said:
            train_regressor.parse([*folders, "--measured", "elsewhere"])
        self.assertIn("elsewhere", said.getvalue())

    def test_truth_and_fits_do_not_supervise_at_once(self):
        arguments = ["--data", "data", "-o", "x.pt", "--supervised", "--fit-in-the-loop"]
        with self.assertRaises(SystemExit), contextlib.redirect_stderr(io.StringIO()) as said:
            train_regressor.parse(arguments)
        self.assertIn("choose one", said.getvalue())

    def test_both_arms_of_the_ablation_start_from_the_same_weights_and_draw_the_same_scenes(self):
        start = self.train("start.pt")["state"]
        with mock.patch.dict(regressor.SIZES, {"tiny": TINY}):
            arms = [
                self.begin(self.folder / f"arm{len(loop)}.pt", "--start", self.folder / "start.pt", *loop)
                for loop in ((), ("--fit-in-the-loop",))
            ]
        draws = [[arm.rng.random() for _ in range(3)] for arm in arms]
        self.assertEqual(draws[0], draws[1])
        for arm in arms:
            self.assertEqual(arm.steps, 0)
            for name, tensor in arm.network.state_dict().items():
                self.assertTrue(torch.equal(tensor, start[name]), name)

    def test_the_rate_warms_up_and_falls_and_the_prior_is_let_go(self):
        with mock.patch.dict(regressor.SIZES, {"tiny": TINY}):
            run = self.begin(self.folder / "x.pt", "--steps", 100, "--warm-up", 10, "--rate", 1.0, "--last-rate", 0.1,
                             "--first-prior", 1, "--prior", 0.01)
        found = {}
        for run.steps in (0, 9, 25, 50, 100):
            found[run.steps] = (run.rate(), run.weights().prior)
        self.assertAlmostEqual(found[0][0], 0.1)
        self.assertGreater(found[9][0], 0.97)
        self.assertAlmostEqual(found[50][0], 0.55)
        self.assertAlmostEqual(found[100][0], 0.1)
        for step, prior in ((0, 1.0), (25, 0.1), (50, 0.01), (100, 0.01)):
            self.assertAlmostEqual(found[step][1], prior)

    def test_curves_are_drawn_beside_the_checkpoint(self):
        self.train("drawn.pt")
        picture = (self.folder / "drawn.svg").read_text()
        self.assertIn("pa_mpjpe_mm", picture)
        self.assertIn("</svg>", picture)

    def test_an_empty_folder_is_refused(self):
        (self.folder / "none").mkdir()
        with self.assertRaisesRegex(SystemExit, "no scenes in"):
            self.train("x.pt", "--data", self.folder / "none")


class Fits(Folder):
    def test_the_better_fit_is_kept(self):
        def fit(loss, valid=True):
            return Fit(torch.full((4, 72), loss), torch.zeros(10), loss, valid)

        dictionary = Dictionary()
        self.assertTrue(dictionary.offer("a", fit(50.0)))
        self.assertFalse(dictionary.offer("a", fit(60.0)))
        self.assertFalse(dictionary.offer("a", fit(float("nan"))))
        self.assertTrue(dictionary.offer("a", fit(40.0)))
        self.assertEqual(float(dictionary.best["a"].poses[0, 0]), 40.0)
        self.assertTrue(dictionary.offer("b", fit(500.0, valid=False)))
        self.assertEqual((dictionary.valid_share, dictionary.mean_loss), (0.5, 40.0))

    def test_a_fit_of_infinite_loss_is_never_kept(self):
        dictionary = Dictionary()
        self.assertFalse(dictionary.offer("a", Fit(torch.zeros(4, 72), torch.zeros(10), float("inf"), False)))
        self.assertEqual(dictionary.best, {})

    def test_true_parameters_start_the_fit_at_the_truth_whatever_the_augmentation(self):
        chosen = scenes(count=6, seed=11)
        for draw in (Augmentation.none(6), drawn(6)):
            batch = people.truth(chosen, draw)
            camera = self.cameras_of_truth(batch, chosen)
            poses, betas, trans = starts(batch, chosen, (batch.rotations, batch.betas, camera))
            for k, scene in enumerate(chosen):
                for view in range(4):
                    rest = scene["J_template"] + scene["J_shapedirs"] @ scene["betas"]
                    rotations = [people_scenes.rodrigues(p) for p in poses[k, view].reshape(24, 3).numpy()]
                    joints = people_scenes.joints_by_4x4(rotations, rest) + trans[k, view].numpy()
                    np.testing.assert_allclose(joints, scene["joints_camera"][view], atol=3e-5)

    @staticmethod
    def cameras_of_truth(batch, chosen):
        """(s, t_x, t_y) that stand for the true translation of each augmented body: s = f/t_z, t + c/s."""
        side = people_scenes.SIDE
        rows = batch.augmentation
        intrinsics = people.stacked(chosen, "K").flatten(0, 1)
        centre = rows.points(2 * intrinsics[:, None, :2, 2] / side - 1)[:, 0]
        focal = intrinsics[:, 0, 0] * 2 / side * rows.enlargement
        rest = batch.j_template + torch.einsum("bjck,bk->bjc", batch.j_shapedirs, batch.betas)
        translation = batch.joints[:, 0] - rest[:, 0]
        scale = focal / translation[:, 2]
        return torch.cat((scale[:, None], translation[:, :2] + centre / scale[:, None]), 1)

    def test_kept_fits_supervise_under_the_augmentation_of_the_moment(self):
        chosen = scenes(count=6, seed=12)
        names = [str(k) for k in range(6)]
        plain = people.truth(chosen)
        dictionary = Dictionary()
        camera = self.cameras_of_truth(plain, chosen)
        begin = starts(plain, chosen, (plain.rotations, plain.betas, camera))
        kept = fit_in_the_loop(self.program, names[:5], chosen[:5], tuple(t[:5] for t in begin), dictionary)
        self.assertEqual(kept, 5)
        augmented = people.truth(chosen, drawn(6))
        rotations, betas, valid = supervision(dictionary, names, augmented)
        self.assertEqual(valid.tolist(), [True] * 20 + [False] * 4)
        self.assertLess(float((rotations - augmented.rotations)[valid].abs().max()), 1e-5)
        self.assertLess(float((betas - augmented.betas)[valid].abs().max()), 1e-6)

    def test_the_prior_on_the_pose_is_handed_to_the_fit(self):
        data = scenes(2, 2)
        batch = people.batch(data, 32)
        begin = starts(batch, data, (batch.rotations, batch.betas, torch.ones(len(batch.images), 3)))
        for prior, expected in ((None, False), (self.folder / "prior.npz", True)):
            with mock.patch("fits.subprocess.run", side_effect=OSError("stop")) as run, self.assertRaises(OSError):
                fit_in_the_loop(self.program, ["a", "b"], data, begin, Dictionary(), prior)
            self.assertEqual(str(self.folder / "prior.npz") in run.call_args.args[0], expected)

    def test_a_program_that_fails_is_named_with_what_it_said(self):
        self.program.write_text("#!/bin/sh\necho no such body >&2\nexit 2\n")
        chosen = scenes(count=1)
        begin = (torch.zeros(1, 4, 72), torch.zeros(1, 4, 10), torch.zeros(1, 4, 3))
        with self.assertRaisesRegex(RuntimeError, "ended with 2: no such body"):
            fit_in_the_loop(self.program, ["a"], chosen, begin, Dictionary())


class Metrics(unittest.TestCase):
    def test_errors_forget_what_they_should(self):
        torch.manual_seed(0)
        joints = torch.randn(3, 24, 3)
        turn = torch.linalg.qr(torch.randn(3, 3)).Q
        turn = turn * torch.det(turn).sign()
        similar = 1.7 * joints @ turn.T + torch.tensor([1.0, 2.0, 3.0])
        self.assertLess(float(train_regressor.pa_mpjpe(similar, joints).max()), 1e-5)
        self.assertLess(float(train_regressor.mpjpe(joints + 5, joints).max()), 1e-5)
        self.assertGreater(float(train_regressor.mpjpe(similar, joints).min()), 0.5)
        mirrored = joints * torch.tensor([-1.0, 1.0, 1.0])
        self.assertGreater(float(train_regressor.pa_mpjpe(mirrored, joints).min()), 0.1)

    def test_the_weak_camera_is_nearly_orthographic(self):
        joints = torch.randn(2, 24, 3) * 0.3
        camera = torch.tensor([[0.9, 0.1, -0.2], [1.1, 0.0, 0.3]])
        found = train_regressor.project(joints, camera, regressor.SMALL)
        wanted = camera[:, None, :1] * (joints[..., :2] + camera[:, None, 1:])
        self.assertLess(float((found - wanted).abs().max()), 0.06)
        centre = train_regressor.project(torch.zeros(2, 24, 3), camera, regressor.SMALL)
        self.assertLess(float((centre - camera[:, None, :1] * camera[:, None, 1:]).abs().max()), 1e-5)

    def test_curves_pass_over_what_they_cannot_show(self):
        with tempfile.TemporaryDirectory() as folder:
            path = pathlib.Path(folder) / "curves.svg"
            curves.write_curves(path, "nothing", [{"step": 1, "loss": 0.0}], ["loss"])
            self.assertFalse(path.exists())
            curves.write_curves(path, "one", [{"step": 1, "loss": 2.0}, {"step": 2}], ["loss", "other"])
            self.assertEqual(path.read_text().count("stroke-width"), 1)


if __name__ == "__main__":
    unittest.main()
