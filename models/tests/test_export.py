"""The exported graphs keep names, bytes and answers."""
import copy
import functools
import hashlib
import pathlib
import subprocess
import sys
import tempfile
import tomllib
import unittest
from unittest import mock

import numpy as np
import onnx
import torch
from onnx import numpy_helper

import agreement
import export
import filling
import graph

MODELS = pathlib.Path(export.__file__).resolve().parent


def export_random(folder: str, seed: int) -> None:
    command = [sys.executable, str(MODELS / "export.py"), "--filling", "random", "--seed", str(seed), "-o", folder]
    subprocess.run(command, check=True, capture_output=True)


class SmallRandom(unittest.TestCase):
    """One export of all graphs, read back."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.path = pathlib.Path(cls.folder.name)
        export_random(cls.folder.name, seed=5)
        cls.models = {p.stem: onnx.load(p) for p in sorted(cls.path.glob("*.onnx"))}
        cls.tables = {t["file"]: t for t in tomllib.loads((cls.path / "manifest.toml").read_text())["graph"]}

    @staticmethod
    @functools.cache
    def network(name):
        """The PyTorch network whose weights were exported."""
        network = export.NETWORKS[name]
        return network.random(network.sizes["small"], 5)

    def answer(self, stem, **inputs):
        return agreement.run((self.path / f"{stem}.onnx").read_bytes(), inputs, optimise=True)

    def test_five_graphs_and_their_manifest(self):
        self.assertEqual(list(self.models), ["mf_pifu_encoder", "mf_pifu_query", "regressor", "vsr_encoder", "vsr_query"])
        self.assertEqual(sorted(self.tables), [f"{stem}.onnx" for stem in self.models])
        for file, table in self.tables.items():
            data = (self.path / file).read_bytes()
            self.assertEqual(table["sha256"], hashlib.sha256(data).hexdigest())
            self.assertEqual(table["bytes"], len(data))
            self.assertEqual(table["allowed_error"], float(f"{table['allowed_error']:.3e}"))
            self.assertGreater(table["measured_error"], 0)
            self.assertLess(table["measured_error"], 1e-4 * max(1.0, table["largest_value"]))

    def test_initialisers_are_the_parameters_bit_for_bit(self):
        for stem, model in self.models.items():
            name = stem if stem == "regressor" else stem.rsplit("_", 1)[0]
            part = export.NETWORKS[name].graphs[f"{stem}.onnx"].removesuffix(".")
            state = graph.persistent_state(self.network(name).get_submodule(part))
            stored = {t.name: numpy_helper.to_array(t) for t in model.graph.initializer}
            self.assertEqual(list(stored), list(state), stem)
            for key, tensor in state.items():
                np.testing.assert_array_equal(stored[key], tensor.numpy(), err_msg=key)

    def test_every_parameter_feeds_a_node(self):
        for stem, model in self.models.items():
            used = {name for node in model.graph.node for name in node.input}
            self.assertEqual({t.name for t in model.graph.initializer} - used, set(), stem)

    def test_tensors_are_named_and_shaped_as_the_contract_says(self):
        def axes(values):
            return {v.name: [d.dim_param or d.dim_value for d in v.type.tensor_type.shape.dim] for v in values}

        maps = {f"features_{k}": ["N", 32, 256 >> k, 256 >> k] for k in (1, 2, 3, 4)}
        levels = zip((8, 16, 32, 32, 32), ("D", "D/2", "D/4", "D/8", "D/16"))
        volumes = {f"features_{k}": [1, c, d, d, d] for k, (c, d) in enumerate(levels, 1)}
        wanted = {
            "mf_pifu_encoder": ({"images": ["N", 3, 256, 256]}, maps),
            "mf_pifu_query": ({**maps, "uv": ["N", "P", 2], "depth": ["N", "P"]}, {"occupancy": ["P"]}),
            "vsr_encoder": ({"voxels": [1, 1, "D", "D", "D"]}, volumes),
            "vsr_query": ({**volumes, "points": ["P", 3]}, {"occupancy": ["P"]}),
            "regressor": (
                {"image": ["N", 3, 128, 128]},
                {"pose": ["N", 144], "betas": ["N", 10], "camera": ["N", 3]},
            ),
        }
        for stem, model in self.models.items():
            self.assertEqual((axes(model.graph.input), axes(model.graph.output)), wanted[stem])

    def test_metadata_declares_the_contract(self):
        shared = {"version": "1", "size": "small", "filling": "random"}
        field = {"align_corners": "false", "inside": "1", "level": "0.5"}
        image = {"image_size": "256", "mean": "0.5,0.5,0.5", "std": "0.5,0.5,0.5", "background": "0"}
        image |= {"depth_center": "body_center", "depth_scale": "crop_half_width"}
        person = {"image_size": "128", "mean": "0.485,0.456,0.406", "std": "0.229,0.224,0.225", "background": "0"}
        person |= {"focal_length": repr(5000 * 128 / 224)}
        keys = {"mf_pifu": field | image, "vsr": field | {"resolution": "128"}, "regressor": person}
        for stem, model in self.models.items():
            kind = stem.replace("mf_pifu", "mf-pifu").replace("_", ".")
            own = keys[stem if stem == "regressor" else stem.rsplit("_", 1)[0]]
            declared = {p.key.removeprefix("vitruvian."): p.value for p in model.metadata_props}
            self.assertEqual(declared, {**shared, **own, "kind": kind})

    def test_nothing_tells_where_the_graph_was_drawn(self):
        for stem, model in self.models.items():
            data = (self.path / f"{stem}.onnx").read_bytes()
            for trace in (b".py", b"stack_trace", b"site-packages", str(MODELS).encode(), b"/home/", b"/root/"):
                self.assertNotIn(trace, data, stem)
            self.assertEqual([n.name for n in model.graph.node if n.metadata_props or n.doc_string], [])

    def test_normalisations_are_not_folded(self):
        count = [n.op_type for n in self.models["vsr_encoder"].graph.node].count("BatchNormalization")
        self.assertEqual(count, 5)
        operators = [n.op_type for n in self.models["mf_pifu_encoder"].graph.node]
        self.assertEqual(operators.count("GroupNormalization"), 0)
        self.assertEqual(operators.count("Sqrt"), 17)
        operators = [n.op_type for n in self.models["regressor"].graph.node]
        self.assertEqual((operators.count("Conv"), operators.count("BatchNormalization")), (53, 53))
        self.assertEqual({len(n.input) for n in self.models["regressor"].graph.node if n.op_type == "Conv"}, {2})

    def test_one_view_and_one_point_are_enough(self):
        images = agreement.images(256, views=1)
        maps = self.answer("mf_pifu_encoder", images=images)
        network = copy.deepcopy(self.network("mf_pifu")).double()
        with torch.no_grad():
            truth = network.encoder(images.double())
        for got, want in zip(maps, truth):
            np.testing.assert_allclose(got, want.numpy(), atol=1e-4)
        named = {f"features_{k}": torch.from_numpy(m) for k, m in enumerate(maps, 1)}
        uv, depth = torch.tensor([[[0.1, -0.2]]]), torch.tensor([[0.3]])
        with torch.no_grad():
            want = network.query(*(m.double() for m in named.values()), uv.double(), depth.double())
        (got,) = self.answer("mf_pifu_query", **named, uv=uv, depth=depth)
        np.testing.assert_allclose(got, want.numpy(), atol=1e-5)

    def test_one_image_is_enough_and_any_number_too(self):
        network = copy.deepcopy(self.network("regressor")).double()
        for count in (1, 3):
            image = agreement.images(128, views=count)
            with torch.no_grad():
                truth = network(image.double())
            for got, want in zip(self.answer("regressor", image=image), truth, strict=True):
                np.testing.assert_allclose(got, want.numpy(), atol=1e-5)

    def test_other_resolutions_are_multiples_of_16(self):
        network = copy.deepcopy(self.network("vsr")).double()
        for resolution in (16, 48):
            voxels = agreement.voxels(resolution)
            volumes = self.answer("vsr_encoder", voxels=voxels)
            with torch.no_grad():
                truth = network.encoder(voxels.double())
            for got, want in zip(volumes, truth, strict=True):
                np.testing.assert_allclose(got, want.numpy(), atol=1e-4)
            named = {f"features_{k}": torch.from_numpy(v) for k, v in enumerate(volumes, 1)}
            points = agreement.volume_points()[:1]
            (got,) = self.answer("vsr_query", **named, points=points)
            self.assertEqual(got.shape, (1,))

    def test_random_fields_take_both_sides_of_the_level(self):
        for name in ("mf_pifu", "vsr"):
            data = (self.path / f"{name}_query.onnx").read_bytes()
            network = export.NETWORKS[name]
            drawing = network.drawings(network.sizes["small"], self.network(name))[1]
            (occupancy,) = agreement.run(data, drawing.inputs(), optimise=False)
            self.assertTrue(0.2 < (occupancy > 0.5).mean() < 0.8, name)

    def test_same_seed_same_bytes_wherever_it_runs(self):
        script = (
            f"import sys, hashlib; sys.path.insert(0, {str(MODELS)!r})\nimport export\n"
            "for drawing, data, _ in export.draw_all('small', 'random', None, 5):\n"
            "    print(drawing.file, hashlib.sha256(data).hexdigest())"
        )
        with tempfile.TemporaryDirectory() as other:
            run = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True, cwd=other)
        drawn = dict(line.split() for line in run.stdout.splitlines())
        self.assertEqual(drawn, {file: table["sha256"] for file, table in self.tables.items()})


class Checkpoints(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)
        for name, network in export.NETWORKS.items():
            module = network.build(network.sizes["small"])
            filling.fill_randomly(module, seed=6)
            origin = {"size": "small", "seed": 6, "steps": 10, "command": f"python models/train_{name}.py"}
            torch.save({"state": module.state_dict(), **origin}, self.folder / f"{name}.pt")

    def test_trained_weights_and_their_origin_are_read(self):
        weights = export.weights_of("vsr", "small", "trained", self.folder, seed=0)
        stored = torch.load(self.folder / "vsr.pt", weights_only=True)["state"]
        self.assertTrue(all(torch.equal(weights.state[k], stored[k]) for k in stored))
        self.assertEqual(weights.origin["training_steps"], 10)

    def test_widened_weights_have_the_thesis_shapes(self):
        export_random(str(self.folder), seed=6)
        for name, network in export.NETWORKS.items():
            with mock.patch.object(export, "EXPORTED", self.folder):
                weights = export.weights_of(name, "thesis", "widened", self.folder, seed=0)
            network.build(network.sizes["thesis"]).load_state_dict(weights.state)

    def test_a_small_graph_that_is_not_there_cannot_be_widened(self):
        with mock.patch.object(export, "EXPORTED", self.folder):
            with self.assertRaisesRegex(SystemExit, "regressor.onnx is missing"):
                export.weights_of("regressor", "thesis", "widened", self.folder, seed=0)

    def test_a_checkpoint_of_another_size_is_refused(self):
        with self.assertRaisesRegex(SystemExit, "needs thesis"):
            export.weights_of("vsr", "thesis", "trained", self.folder, seed=0)


if __name__ == "__main__":
    unittest.main()
