"""Official body files become .npz, whatever objects their pickles are made of, and nothing in them is run."""
import contextlib
import io
import os
import pickle
import struct
import subprocess
import sys
import tempfile
import types
import unittest
from pathlib import Path

import numpy as np

import convert_body

REPOSITORY = Path(convert_body.__file__).resolve().parent.parent


# ---- pickles as Python 2 wrote them ---------------------------------------------------------------------------------------


class Python2Pickler(pickle._Pickler):
    """Protocol 2 with Python 2's strings, so that array data and keys are latin1 text, and with NumPy's old module names."""

    dispatch = dict(pickle._Pickler.dispatch)

    def save_string(self, text):
        data = text if isinstance(text, bytes) else text.encode("latin1")
        self.write(b"T" + struct.pack("<i", len(data)) + data)
        self.memoize(text)

    dispatch[str] = dispatch[bytes] = save_string


def python2_pickle(value) -> bytes:
    file = io.BytesIO()
    Python2Pickler(file, protocol=2).dump(value)
    return file.getvalue().replace(b"cnumpy._core.", b"cnumpy.core.")


@contextlib.contextmanager
def fake_classes(**names):
    """Classes that pickle under foreign names such as chumpy.ch.Ch; their modules are gone afterwards."""
    before = dict(sys.modules)
    classes = {}
    for alias, path in names.items():
        module, _, name = path.rpartition(".")
        cls = type(name, (object,), {"__module__": module})
        for end in range(1, module.count(".") + 2):
            parent = ".".join(module.split(".")[:end])
            sys.modules[parent] = types.ModuleType(parent)
        setattr(sys.modules[module], name, cls)
        classes[alias] = cls
    # Modules made late replace those made early: hang every class into the one that stayed.
    for cls in classes.values():
        setattr(sys.modules[cls.__module__], cls.__name__, cls)
    try:
        yield types.SimpleNamespace(**classes)
    finally:
        for name in set(sys.modules) - set(before):
            del sys.modules[name]
        sys.modules.update(before)


CLASSES = {
    "Ch": "chumpy.ch.Ch",
    "Select": "chumpy.reordering.Select",
    "Reshape": "chumpy.reordering.Reshape",
    "Concatenate": "chumpy.reordering.Concatenate",
    "add": "chumpy.ch_ops.add",
    "csc": "scipy.sparse.csc.csc_matrix",
    "csr": "scipy.sparse._csr.csr_matrix",
    "coo": "scipy.sparse.coo.coo_matrix",
    "GMM": "sklearn.mixture.gmm.GMM",
}


def made(cls, **state):
    value = cls()
    value.__dict__.update(state)
    return value


def ch(c, x):
    """What chumpy's Ch leaves in a pickle: its value and its bookkeeping."""
    return made(c.Ch, x=x, _dirty_vars=set(), _itr=None, _depends_on_deps={}, want_output=False)


def csc(c, dense):
    column, row = np.nonzero(dense.T)
    indptr = np.searchsorted(column, np.arange(dense.shape[1] + 1))
    return made(c.csc, _shape=dense.shape, maxprint=50, data=dense[row, column], indices=row.astype(np.int32),
                indptr=indptr.astype(np.int32))


def csr(c, dense):
    row, column = np.nonzero(dense)
    indptr = np.searchsorted(row, np.arange(dense.shape[0] + 1))
    return made(c.csr, _shape=dense.shape, data=dense[row, column], indices=column, indptr=indptr)


def coo(c, dense):
    row, column = np.nonzero(dense)
    # The first entry in two halves: scipy sums what stands twice.
    data, row, column = dense[row, column], np.append(row, row[0]), np.append(column, column[0])
    data[0] /= 2
    return made(c.coo, _shape=dense.shape, data=np.append(data, data[0]), row=row, col=column)


SMPL_PARENTS = [convert_body.ROOT, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21]


def random_body(joints=24, betas=10, vertices=60, seed=0) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    parents = SMPL_PARENTS[:joints] + [20 + n % 2 for n in range(joints - 24)]
    regressor = rng.random((joints, vertices)) * (rng.random((joints, vertices)) < 0.1)
    regressor[:, 0] += 0.1
    weights = rng.random((vertices, joints)) * (rng.random((vertices, joints)) < 0.15)
    weights[:, 0] += 0.1
    return {
        "v_template": rng.normal(0, 0.5, (vertices, 3)),
        "f": rng.integers(0, vertices, (2 * vertices, 3)).astype(np.uint32),
        "shapedirs": rng.normal(0, 0.02, (vertices, 3, betas)),
        "posedirs": rng.normal(0, 0.005, (vertices, 3, 9 * (joints - 1))),
        "J_regressor": regressor / regressor.sum(axis=1, keepdims=True),
        "weights": weights / weights.sum(axis=1, keepdims=True),
        "kintree_table": np.array([parents, range(joints)], dtype=np.uint32),
    }


def smpl_pickle(c, body, **changed) -> dict:
    """The dictionary of an official SMPL .pkl: chumpy shapes and template, a sparse regressor, and more than is needed."""
    flat = body["v_template"].ravel()
    order = np.random.default_rng(1).permutation(flat.size)
    shuffled = np.empty_like(flat)
    shuffled[order] = flat
    return {
        **body,
        "v_template": made(c.Select, a=ch(c, shuffled), idxs=order, preferred_shape=body["v_template"].shape),
        "shapedirs": ch(c, body["shapedirs"]),
        "posedirs": np.asfortranarray(body["posedirs"]),
        "J_regressor": csc(c, body["J_regressor"]),
        "J": body["J_regressor"] @ body["v_template"],
        "J_regressor_prior": csc(c, body["J_regressor"]),
        "bs_type": "lrotmin",
        "bs_style": "lbs",
        "pose_training_info": {"gender": "f", "ranks": (1, 2.5, None, np.float64(3))},
        "vert_sym_idxs": np.arange(len(body["v_template"])),
        **changed,
    }


class Folder(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.path = Path(self.folder.name)

    def convert(self, data: bytes, *words, name="model.pkl"):
        """Exit status, what was said, and the arrays that were written."""
        source, out = self.path / name, self.path / "out.npz"
        source.write_bytes(data)
        said = io.StringIO()
        with contextlib.redirect_stderr(said):
            status = convert_body.main([str(source), "-o", str(out), *words])
        found = None
        if out.exists():
            with np.load(out, allow_pickle=False) as arrays:
                found = dict(arrays)
            out.unlink()
        self.assertEqual(found is None, status != 0, said.getvalue())
        source.unlink()
        self.assertEqual(list(self.path.iterdir()), [], "nothing is left behind")
        return status, said.getvalue(), found

    def converted(self, data: bytes, *words, **names):
        status, said, found = self.convert(data, *words, **names)
        self.assertEqual(status, 0, said)
        return found

    def refused(self, data: bytes, *expected, words=(), **names):
        status, said, _ = self.convert(data, *words, **names)
        self.assertEqual((status, said.count("\n")), (2, 1), said)
        for text in ("model.", *expected):
            self.assertIn(text, said)

    def same(self, found, expected):
        self.assertEqual(set(found), set(convert_body.KEYS))
        for key, values in expected.items():
            np.testing.assert_array_equal(found[key], values, key)
            self.assertEqual(found[key].dtype, np.uint32 if key in ("f", "kintree_table") else np.float64)


class Bodies(Folder):
    def test_an_official_pickle_without_chumpy_and_scipy(self):
        body = random_body()
        with fake_classes(**CLASSES) as c:
            data = python2_pickle(smpl_pickle(c, body))
        for name in ("chumpy.ch\nCh", "chumpy.reordering\nSelect", "scipy.sparse.csc\ncsc_matrix", "numpy.core.multiarray"):
            self.assertIn(f"c{name}".encode(), data)
        self.assertNotIn("chumpy", sys.modules)
        self.same(self.converted(data), body)
        found = self.converted(data, "--betas", "4")
        np.testing.assert_array_equal(found["shapedirs"], body["shapedirs"][:, :, :4])
        self.refused(data, "shapedirs: has 10 betas; --betas asks for 11", words=("--betas", "11"))

    def test_every_form_of_the_regressor_is_the_same_matrix(self):
        body = random_body()
        with fake_classes(**CLASSES) as c:
            regressor = body["J_regressor"]
            forms = [regressor, csc(c, regressor), csr(c, regressor), coo(c, regressor), ch(c, regressor)]
            pickles = [python2_pickle(smpl_pickle(c, body, J_regressor=form)) for form in forms]
        for data in pickles:
            self.same(self.converted(data), body)

    def test_reordering_expressions_of_chumpy(self):
        body = random_body()
        template = body["v_template"]
        with fake_classes(**CLASSES) as c:
            reshaped = made(c.Reshape, a=ch(c, template.ravel()), newshape=(-1, 3))
            joined = made(c.Concatenate, dterms=["m0", "m1"], m0=ch(c, template[:7]), m1=ch(c, template[7:]), axis=0)
            pickles = [python2_pickle(smpl_pickle(c, body, v_template=form)) for form in (reshaped, joined)]
            summed = made(c.add, a=ch(c, template), b=ch(c, template))
            unknown = python2_pickle(smpl_pickle(c, body, v_template=summed))
            endless = ch(c, None)
            endless.x = endless
            endless = python2_pickle(smpl_pickle(c, body, v_template=endless))
            outside = made(c.Select, a=ch(c, template), idxs=np.array([10_000]))
            outside = python2_pickle(smpl_pickle(c, body, v_template=outside))
        for data in pickles:
            self.same(self.converted(data), body)
        self.refused(unknown, "v_template: is a chumpy.ch_ops.add")
        self.refused(endless, "arrays without end")
        self.refused(outside, "chumpy.reordering.Select does not fit its parts")

    def test_old_names_of_the_arrays(self):
        body = random_body()
        for alias, key in (("default_v", "v_template"), ("template_v", "v_template"), ("joint_regressor", "J_regressor"),
                           ("blendshapes", "posedirs")):
            renamed = {alias if name == key else name: values for name, values in body.items()}
            self.same(self.converted(python2_pickle(renamed)), body)

    def test_hands_faces_and_protocols_of_python_3(self):
        for joints, betas in ((52, 16), (55, 400)):
            body = random_body(joints, betas)
            source = {**body, "kintree_table": body["kintree_table"].astype(np.int64)}
            for protocol in (0, 2, 4, 5):
                self.same(self.converted(pickle.dumps(source, protocol=protocol)), body)

    def test_an_npz_with_object_arrays(self):
        body = random_body(55, 20)
        file = io.BytesIO()
        with fake_classes(**CLASSES) as c:
            boxed = {"J_regressor": np.array(csc(c, body["J_regressor"]), dtype=object),
                     "v_template": body["v_template"].astype(object), "joint2num": np.array({"Pelvis": 0}, dtype=object)}
            np.savez(file, **{**body, **boxed})
        self.same(self.converted(file.getvalue(), name="model.npz"), body)

    def test_joints_may_be_numbered_in_any_way(self):
        body = random_body()
        shifted = body["kintree_table"].astype(np.int64) + 100
        shifted[0, 0] = -1
        self.same(self.converted(python2_pickle({**body, "kintree_table": shifted})), body)


class Refusals(Folder):
    def test_nothing_is_run_and_what_was_asked_for_is_named(self):
        marker = self.path.parent / f"{self.path.name}.ran"

        class Harmful:
            def __reduce__(self):
                return os.system, (f"touch {marker}",)

        class Builtin:
            def __reduce__(self):
                return eval, ("1 + 1",)

        body = random_body()
        for harmful, name in ((Harmful(), "posix.system" if os.name == "posix" else "nt.system"), (Builtin(), "eval")):
            for protocol in (0, 2, 4):
                self.refused(pickle.dumps({**body, "J": harmful}, protocol=protocol), name, "not unpickled")
        file = io.BytesIO()
        np.savez(file, **{**body, "weights": np.array(Harmful(), dtype=object)})
        self.refused(file.getvalue(), "system", name="model.npz")
        dotted = b"\x80\x04\x8c\x05numpy\x8c\x16ndarray.__class__.mro_\x93."
        self.refused(dotted, "numpy.ndarray.__class__")
        self.refused(b"ccopy_reg\n_reconstructor\n(c__builtin__\nlist\nc__builtin__\nobject\nNtR.", "rebuilds")
        self.assertFalse(marker.exists())

    def test_files_that_are_no_bodies(self):
        body = random_body()
        data = python2_pickle(body)
        self.refused(data[: len(data) // 2], "no readable pickle")
        self.refused(b"", "no readable pickle")
        self.refused(b"PK\x03\x04 and no more", "no readable .npz", name="model.npz")
        self.refused(pickle.dumps([1, 2]), "holds a list; expected a dictionary")
        without = {key: values for key, values in body.items() if key != "weights"}
        self.refused(pickle.dumps(without), "weights: is missing; the file holds J_regressor, f,")
        hand = random_body(16)
        self.refused(pickle.dumps({**hand, "hands_components": np.eye(45)}), "is a MANO hand")

    def test_arrays_that_do_not_fit(self):
        body = random_body()
        spoiled = {
            "posedirs": (body["posedirs"][:, :, :9], "posedirs: has the shape (60, 3, 9), expected (60, 3, 207)"),
            "J_regressor": (body["J_regressor"].T, "J_regressor: has the shape (60, 24), expected (24, 60)"),
            "f": (body["f"] + 60, "f: names vertices outside 0 to 59"),
            "weights": (body["weights"] * 1.1, "weights: has a row that sums to 1 ± 0.1"),
            "v_template": (body["v_template"] * np.nan, "v_template: holds a number that is not finite"),
            "kintree_table": (body["kintree_table"][::-1], "kintree_table: "),
            "shapedirs": ("many", "shapedirs: is no array of numbers"),
            "bs_style": ("dqbs", "bs_style: is 'dqbs'; only 'lbs'"),
        }
        for key, (value, expected) in spoiled.items():
            self.refused(pickle.dumps({**body, key: value}, protocol=2), expected)

    def test_a_file_that_cannot_be_read_or_written(self):
        said = io.StringIO()
        with contextlib.redirect_stderr(said):
            status = convert_body.main([str(self.path / "absent.pkl"), "-o", str(self.path / "out.npz")])
        self.assertEqual(status, 2)
        self.assertIn("absent.pkl", said.getvalue())


class Priors(Folder):
    def mixture(self):
        rng = np.random.default_rng(2)
        factors = rng.normal(size=(8, 69, 69))
        weights = rng.random(8) + 0.1
        return {"means": rng.normal(size=(8, 69)), "covars": factors @ factors.transpose(0, 2, 1) + 0.1 * np.eye(69),
                "weights": weights / weights.sum()}

    def test_smplify_s_dictionary_and_the_old_class_are_the_same_prior(self):
        mixture = self.mixture()
        with fake_classes(**CLASSES) as c:
            old = made(c.GMM, means_=mixture["means"], covars_=mixture["covars"], weights_=mixture["weights"])
            pickles = [python2_pickle(value) for value in (mixture, old)]
        for data in pickles:
            found = self.converted(data, "--prior")
            self.assertEqual(list(found), ["means", "covariances", "weights"])
            for key, name in (("means", "means"), ("covariances", "covars"), ("weights", "weights")):
                np.testing.assert_array_equal(found[key], mixture[name])

    def test_mixtures_that_are_none(self):
        mixture = self.mixture()
        spoiled = {
            "covars": (-mixture["covars"], "not positive definite"),
            "means": (mixture["means"][:, :5], "covars: has the shape (8, 69, 69), expected (8, 5, 5)"),
            "weights": (mixture["weights"] * 2, "expected shares of 1"),
        }
        for key, (value, expected) in spoiled.items():
            self.refused(pickle.dumps({**mixture, key: value}), expected, words=("--prior",))
        lopsided = mixture["covars"] + np.triu(np.ones((69, 69)), 1)
        self.refused(pickle.dumps({**mixture, "covars": lopsided}), "covars: 0 is not symmetric", words=("--prior",))
        self.refused(pickle.dumps(random_body()), "means: is missing", words=("--prior",))


# ---- to the command -------------------------------------------------------------------------------------------------------


def rotation(v):
    angle = np.linalg.norm(v)
    if angle == 0:
        return np.eye(3)
    x, y, z = v / angle
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(angle) * k + 2 * np.sin(angle / 2) ** 2 * (k @ k)


def posed(body, pose, betas, trans):
    """The model's forward pass once more, in NumPy (Loper et al. 2015)."""
    shaped = body["v_template"] + body["shapedirs"] @ betas
    rest = body["J_regressor"] @ shaped
    turns = np.array([rotation(v) for v in pose.reshape(-1, 3)])
    corrected = shaped + body["posedirs"] @ (turns[1:] - np.eye(3)).ravel()
    world = np.tile(np.eye(4), (len(rest), 1, 1))
    for j, parent in enumerate(body["kintree_table"][0]):
        world[j, :3, :3] = turns[j]
        world[j, :3, 3] = rest[j] - (rest[parent] if j else 0)
        if j:
            world[j] = world[parent] @ world[j]
    joints = world[:, :3, 3].copy()
    world[:, :3, 3] -= np.einsum("jab,jb->ja", world[:, :3, :3], rest)
    blended = np.einsum("vj,jab->vab", body["weights"], world)
    vertices = np.einsum("vab,vb->va", blended[:, :3, :3], corrected) + blended[:, :3, 3]
    return vertices + trans, joints + trans


def command() -> Path | None:
    target = Path(os.environ.get("CARGO_TARGET_DIR", REPOSITORY / "target"))
    path = target / "release" / "vitruvian"
    return path if path.is_file() else None


class Command(Folder):
    def test_a_converted_body_is_posed_as_numpy_poses_it(self):
        binary = command()
        if binary is None:
            self.skipTest("vitruvian is not built: cargo build --release")
        for joints in (24, 52, 55):
            with self.subTest(joints=joints):
                self.judge(binary, random_body(joints, seed=joints))

    def judge(self, binary, body):
        with fake_classes(**CLASSES) as c:
            source = self.path / "model.pkl"
            source.write_bytes(python2_pickle(smpl_pickle(c, body)))
        model, params, out = (self.path / name for name in ("model.npz", "params.npz", "out.npz"))
        with contextlib.redirect_stderr(io.StringIO()):
            self.assertEqual(convert_body.main([str(source), "-o", str(model)]), 0)
        rng = np.random.default_rng(7)
        joints = body["kintree_table"].shape[1]
        sizes = np.array([0, 1e-4, 0.5, 1, 3, 1000])
        poses = sizes[:, None] * rng.normal(size=(6, 3 * joints))
        poses[3, :3] = [np.pi, 0, 0]
        betas, trans = rng.normal(size=(6, 10)), rng.normal(size=(6, 3))
        np.savez(params, poses=poses, betas=betas, trans=trans, gender="female", mocap_framerate=120.0)
        for words, bound in ((["--exact"], 1e-7), ([], 2e-5)):
            words = [str(binary), "pose", "--body", str(model), "--params", str(params), "-o", str(out), *words]
            subprocess.run(words, check=True, capture_output=True)
            with np.load(out) as found:
                for frame in range(6):
                    vertices, at = posed(body, poses[frame], betas[frame], trans[frame])
                    np.testing.assert_allclose(found["vertices"][frame], vertices, rtol=0, atol=bound)
                    np.testing.assert_allclose(found["joints"][frame], at, rtol=0, atol=1e-7)


if __name__ == "__main__":
    unittest.main()
