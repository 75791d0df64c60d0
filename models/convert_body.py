"""From the official files of a body model to the .npz that Vitruvian reads, without chumpy or scipy installed.

    python convert_body.py basicModel_f_lbs_10_207_0_v1.0.0.pkl -o smpl_female.npz
    python convert_body.py SMPLX_NEUTRAL.npz -o smplx.npz --betas 10
    python convert_body.py --prior gmm_08.pkl -o prior.npz

Reads SMPL, SMPL-H and SMPL-X (any number of vertices, joints and betas) as .pkl or .npz: pickles of Python 2 (latin1) with
chumpy arrays and a sparse J_regressor, plain ones, and .npz with object arrays. Writes f64 and u32 arrays under SMPL's names:

    v_template [V,3]  f [F,3]  shapedirs [V,3,B]  posedirs [V,3,9(J-1)]  J_regressor [J,V]  weights [V,J]  kintree_table [2,J]

and of a Gaussian-mixture pose prior means [K,D], covariances [K,D,D] and weights [K].

Unpickling runs whatever a file asks for, so these files are unpickled by a reader that admits a few classes by name and puts
stand-ins in the place of chumpy's and scipy's; a file that asks for anything else is refused. What NumPy does with the bytes
of an array is trusted.
"""
import argparse
import io
import os
import pickle
import sys
import zipfile
from collections import OrderedDict
from pathlib import Path

import numpy as np

ROOT = 0xFFFFFFFF  # the root's parent, as SMPL writes it
ALIASES = {
    "v_template": ("default_v", "template_v"),
    "J_regressor": ("joint_regressor",),
    "posedirs": ("blendshapes",),
}
KEYS = ("v_template", "f", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table")
WEIGHT_TOLERANCE = 1e-3  # how far a row of weights may sum from 1: the runtime's reader has the same


class Refusal(Exception):
    """A file that is not converted, and why."""


# ---- unpickling ---------------------------------------------------------------------------------------------------------


class StandIn:
    """Keeps the state of an object whose class is not wanted."""

    name = "?"

    def __init__(self, *args):
        self.args = args

    def __setstate__(self, state):
        # Objects with __slots__ give a pair of dictionaries.
        parts = state if isinstance(state, tuple) else (state,)
        for part in parts:
            if part is not None:
                self.__dict__.update(part)


def stand_in(module: str, name: str) -> type:
    return type(name, (StandIn,), {"name": f"{module}.{name}"})


def is_stand_in(module: str, name: str) -> bool:
    """Classes of which only the state is looked at; nothing of theirs is ever run."""
    if "." in name:
        return False
    if module == "chumpy" or module.startswith("chumpy."):
        return True
    if module == "scipy.sparse" or module.startswith("scipy.sparse."):
        return name.endswith(("_matrix", "_array"))
    return (module, name) in {("sklearn.mixture.gmm", "GMM"), ("sklearn.mixture", "GMM")}


def reconstructor(cls, base, state):
    """copy_reg._reconstructor, for stand-ins alone."""
    if not (isinstance(cls, type) and issubclass(cls, StandIn)):
        raise Refusal(f"rebuilds a {cls!r}, which is not admitted")
    return cls()


def admitted() -> dict[tuple[str, str], object]:
    """What a file may ask for by name: containers, and the functions with which NumPy stores its arrays."""
    empty_array = np.array([], dtype=object)
    reconstruct = empty_array.__reduce__()[0]
    scalar = np.float64(0).__reduce__()[0]
    frombuffer = np.arange(1.0).__reduce_ex__(5)[0]
    table: dict[tuple[str, str], object] = {("_codecs", "encode"): latin1}
    for core in ("numpy.core", "numpy._core"):
        table[f"{core}.multiarray", "_reconstruct"] = reconstruct
        table[f"{core}.multiarray", "scalar"] = scalar
        table[f"{core}.numeric", "_frombuffer"] = frombuffer
    table["numpy", "ndarray"] = np.ndarray
    table["numpy", "dtype"] = np.dtype
    for module in ("__builtin__", "builtins"):
        for cls in (set, frozenset, list, dict, tuple, object, bytearray, complex):
            table[module, cls.__name__] = cls
    table["collections", "OrderedDict"] = OrderedDict
    for module in ("copy_reg", "copyreg"):
        table[module, "_reconstructor"] = reconstructor
    return table


def latin1(text: str, encoding: str = "latin1") -> bytes:
    """How Python 3 writes bytes for Python 2."""
    if encoding != "latin1":
        raise Refusal(f"encodes a text as {encoding!r}, which is not admitted")
    return text.encode("latin1")


class Reader(pickle.Unpickler):
    """An unpickler that knows these names and no others."""

    def __init__(self, file):
        super().__init__(file, encoding="latin1")
        self.admitted = admitted()

    def find_class(self, module, name):
        if (module, name) in self.admitted:
            return self.admitted[module, name]
        if is_stand_in(module, name):
            return stand_in(module, name)
        raise Refusal(f"asks for {module}.{name}, which a body model does not need: it is not unpickled")


def unpickled(file) -> object:
    try:
        return Reader(file).load()
    except Refusal:
        raise
    except Exception as error:  # a damaged pickle can raise almost anything
        raise Refusal(f"is no readable pickle ({type(error).__name__}: {error})") from error


# ---- what stands in the pickles -----------------------------------------------------------------------------------------


def array(value, key: str) -> np.ndarray:
    """The numbers of a NumPy array, a chumpy array or a sparse matrix."""
    if isinstance(value, StandIn):
        value = sparse(value, key) if value.name.startswith("scipy.") else chumpy(value, key)
    if isinstance(value, np.ndarray) and value.dtype == object:
        if value.ndim == 0:
            return array(value.item(), key)
        value = [array(row, key) for row in value]
    try:
        found = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise Refusal(f"{key}: is no array of numbers ({error})") from error
    return found


def part(value: StandIn, name: str, key: str):
    if name not in value.__dict__:
        raise Refusal(f"{key}: the {value.name} has no {name}")
    return value.__dict__[name]


def chumpy(value: StandIn, key: str) -> np.ndarray:
    """The value of a chumpy expression: an array, or one that only picks and reorders another's elements."""
    kind = value.name.rpartition(".")[2]
    try:
        if kind == "Ch":
            return array(part(value, "x", key), key)
        if kind == "Concatenate":
            return np.concatenate([array(part(value, term, key), key) for term in value.dterms], value.axis)
        if kind not in ("Select", "Reshape", "transpose"):
            raise Refusal(f"{key}: is a {value.name}; Ch, Select, Reshape, transpose and Concatenate are understood")
        inner = array(part(value, "a", key), key)
        if kind == "Reshape":
            return inner.reshape(part(value, "newshape", key))
        if kind == "transpose":
            return np.transpose(inner, getattr(value, "axes", None))
        picked = inner.ravel()[np.asarray(part(value, "idxs", key))]
        return picked.reshape(getattr(value, "preferred_shape", picked.shape))
    except (TypeError, ValueError, IndexError, AttributeError) as error:
        raise Refusal(f"{key}: the {value.name} does not fit its parts ({error})") from error


def sparse(value: StandIn, key: str) -> np.ndarray:
    """A sparse matrix, dense. Entries that occur twice are summed, as scipy does."""
    kind = value.name.rpartition(".")[2].partition("_")[0]
    shape = value.__dict__.get("_shape", value.__dict__.get("shape"))
    if shape is None:
        raise Refusal(f"{key}: the {value.name} has no shape")
    try:
        rows, columns = (int(n) for n in shape)
        data = array(part(value, "data", key), key)
        if kind == "coo":
            at = value.__dict__.get("coords") or (part(value, "row", key), part(value, "col", key))
            row, column = (np.asarray(n) for n in at)
        elif kind in ("csr", "csc"):
            starts, minor = np.asarray(part(value, "indptr", key)), np.asarray(part(value, "indices", key))
            if len(starts) != (rows if kind == "csr" else columns) + 1 or starts[-1] != len(minor):
                raise Refusal(f"{key}: the {value.name} of shape {shape} has {len(starts)} row or column starts")
            major = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
            row, column = (major, minor) if kind == "csr" else (minor, major)
        else:
            raise Refusal(f"{key}: is a {value.name}; csc, csr and coo matrices are understood")
        if row.size and (min(row.min(), column.min()) < 0 or row.max() >= rows or column.max() >= columns):
            raise Refusal(f"{key}: the {value.name} of shape {shape} has entries outside")
        dense = np.zeros((rows, columns))
        np.add.at(dense, (row, column), data)
    except (TypeError, ValueError, IndexError) as error:
        raise Refusal(f"{key}: the {value.name} does not fit its parts ({error})") from error
    return dense


# ---- files --------------------------------------------------------------------------------------------------------------


class NpzEntries(dict):
    """The arrays of an .npz, object arrays through the same unpickler; each read when asked for."""

    def __init__(self, path: Path):
        self.archive = zipfile.ZipFile(path)
        super().__init__({Path(name).stem: name for name in self.archive.namelist() if name.endswith(".npy")})

    def __getitem__(self, key):
        try:
            file = io.BytesIO(self.archive.read(super().__getitem__(key)))
            major, _ = np.lib.format.read_magic(file)
            read_header = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
            _, _, dtype = read_header(file)
            if dtype.hasobject:
                return unpickled(file)
            file.seek(0)
            return np.lib.format.read_array(file, allow_pickle=False)
        except Refusal:
            raise
        except Exception as error:  # NumPy's header parser raises several kinds
            raise Refusal(f"{key}: is no readable array ({error})") from error


def read(path: Path):
    """The dictionary of a .pkl, or the arrays of an .npz."""
    with open(path, "rb") as file:
        is_zip = file.read(2) == b"PK"
        file.seek(0)
        if not is_zip:
            return unpickled(file)
    try:
        return NpzEntries(path)
    except zipfile.BadZipFile as error:
        raise Refusal(f"is no readable .npz ({error})") from error


def write(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """The whole file or none."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with open(beside, "wb") as file:
            np.savez(file, **arrays)
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)


# ---- body models --------------------------------------------------------------------------------------------------------


def expect(condition: bool, key: str, message: str) -> None:
    if not condition:
        raise Refusal(f"{key}: {message}")


def indices(values: np.ndarray, key: str) -> np.ndarray:
    whole = np.all(values == np.floor(values)) and np.all(np.abs(values) <= ROOT)
    expect(bool(whole), key, "holds something other than whole numbers of 32 bits")
    return values.astype(np.int64)


def kintree(table: np.ndarray) -> np.ndarray:
    """Parents and numbers, u32 [2,J]; joints may be numbered in any way, parents must come before their children."""
    key = "kintree_table"
    expect(table.ndim == 2 and table.shape[0] == 2 and table.shape[1] > 0, key, f"has the shape {table.shape}, expected (2, J)")
    parents, numbers = indices(table, key)
    column = {number: j for j, number in enumerate(numbers.tolist())}
    expect(len(column) == len(numbers), key, "gives two joints the same number")
    expect(parents[0] in (-1, ROOT), key, f"gives its first joint the parent {parents[0]}; the root must come first")
    found = [ROOT]
    for j, parent in enumerate(parents[1:].tolist(), start=1):
        expect(column.get(parent, j) < j, key, f"gives joint {j} the parent {parent}; parents come before their children")
        found.append(column[parent])
    return np.array([found, range(len(found))], dtype=np.uint32)


def body(source, betas: int | None = None) -> dict[str, np.ndarray]:
    """SMPL's arrays, checked, from the dictionary of a model file."""
    if not isinstance(source, dict):
        raise Refusal(f"holds a {getattr(source, 'name', type(source).__name__)}; expected a dictionary of SMPL's arrays")
    name_of = {}
    for key in KEYS:
        name_of[key] = next((name for name in (key, *ALIASES.get(key, ())) if name in source), None)
        if name_of[key] is None:
            raise Refusal(f"{key}: is missing; the file holds {', '.join(sorted(map(str, source)))}")
    for key, known in (("bs_style", "lbs"), ("bs_type", "lrotmin")):
        if key in source:
            value = source[key]
            value = value.item() if isinstance(value, np.ndarray) and value.ndim == 0 else value
            value = value.decode("latin1") if isinstance(value, bytes) else value
            expect(value == known, key, f"is {value!r}; only {known!r} is understood")
    numbers = {key: array(source[name], key) for key, name in name_of.items()}
    for key, values in numbers.items():
        expect(bool(np.all(np.isfinite(values))), key, "holds a number that is not finite")

    tree = kintree(numbers["kintree_table"])
    v, j = len(numbers["v_template"]), tree.shape[1]
    if "hands_components" in source and j == 16:
        raise Refusal("is a MANO hand; hands without a body are not converted")
    shaped = {"v_template": (v, 3), "J_regressor": (j, v), "weights": (v, j), "posedirs": (v, 3, 9 * (j - 1))}
    for key, shape in shaped.items():
        expect(numbers[key].shape == shape, key, f"has the shape {numbers[key].shape}, expected {shape} for {v} vertices and {j} joints")
    shapedirs, faces = numbers["shapedirs"], indices(numbers["f"], "f")
    expect(shapedirs.ndim == 3 and shapedirs.shape[:2] == (v, 3), "shapedirs", f"has the shape {shapedirs.shape}, expected ({v}, 3, B)")
    expect(faces.ndim == 2 and faces.shape[1] == 3, "f", f"has the shape {faces.shape}, expected (F, 3)")
    expect(faces.size == 0 or (faces.min() >= 0 and faces.max() < v), "f", f"names vertices outside 0 to {v - 1}")
    worst = np.abs(numbers["weights"].sum(axis=1) - 1).max(initial=0)
    expect(worst <= WEIGHT_TOLERANCE, "weights", f"has a row that sums to 1 ± {worst:.2g}; every row must sum to 1")
    if betas is not None:
        expect(betas <= shapedirs.shape[2], "shapedirs", f"has {shapedirs.shape[2]} betas; --betas asks for {betas}")
        shapedirs = shapedirs[:, :, :betas]
    return {
        "v_template": numbers["v_template"],
        "f": faces.astype(np.uint32),
        "shapedirs": np.ascontiguousarray(shapedirs),
        "posedirs": numbers["posedirs"],
        "J_regressor": numbers["J_regressor"],
        "weights": numbers["weights"],
        "kintree_table": tree,
    }


# ---- priors -------------------------------------------------------------------------------------------------------------


def prior(source) -> dict[str, np.ndarray]:
    """A Gaussian mixture over poses, checked, from SMPLify's dictionary or scikit-learn's old GMM."""
    if isinstance(source, StandIn):
        source = {name.rstrip("_"): value for name, value in source.__dict__.items()}
    if not isinstance(source, dict):
        raise Refusal(f"holds a {type(source).__name__}; expected a dictionary with means, covars and weights")
    covariances = "covars" if "covars" in source else "covariances"
    for key in ("means", covariances, "weights"):
        if key not in source:
            raise Refusal(f"{key}: is missing; the file holds {', '.join(sorted(map(str, source)))}")
    means, covars, weights = (array(source[key], key) for key in ("means", covariances, "weights"))
    weights = weights.ravel()
    expect(means.ndim == 2 and means.size > 0, "means", f"has the shape {means.shape}, expected (K, 69)")
    k, d = means.shape
    expect(covars.shape == (k, d, d), covariances, f"has the shape {covars.shape}, expected {(k, d, d)}")
    expect(weights.shape == (k,), "weights", f"has the shape {weights.shape}, expected ({k},)")
    for key, values in (("means", means), (covariances, covars), ("weights", weights)):
        expect(bool(np.all(np.isfinite(values))), key, "holds a number that is not finite")
    expect(weights.min() > 0 and abs(weights.sum() - 1) < WEIGHT_TOLERANCE, "weights", f"are {weights.tolist()}; expected shares of 1")
    for n, matrix in enumerate(covars):
        scale = np.abs(matrix).max()
        expect(np.abs(matrix - matrix.T).max() <= 1e-9 * scale, covariances, f"{n} is not symmetric")
        expect(np.linalg.eigvalsh(matrix)[0] > 0, covariances, f"{n} is not positive definite")
    return {"means": means, "covariances": covars, "weights": weights}


def main(words: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", type=Path, help="the official file: .pkl or .npz")
    parser.add_argument("-o", "--out", type=Path, required=True, help="the .npz to write")
    parser.add_argument("--betas", type=int, metavar="B", help="keep the first B shape directions (default: all)")
    parser.add_argument("--prior", action="store_true", help="the file is a Gaussian mixture over poses (gmm_08.pkl)")
    arguments = parser.parse_args(words)
    if arguments.betas is not None and arguments.betas < 0:
        parser.error("--betas: expected 0 or more")
    if arguments.out.suffix != ".npz":
        parser.error("--out: expected a name that ends in .npz")
    try:
        source = read(arguments.source)
        arrays = prior(source) if arguments.prior else body(source, arguments.betas)
        write(arguments.out, arrays)
    except Refusal as refusal:
        print(f"error: {arguments.source}: {refusal}", file=sys.stderr)
        return 2
    except (RecursionError, MemoryError) as error:
        print(f"error: {arguments.source}: holds arrays without end ({type(error).__name__})", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"error: {error.filename or arguments.out}: {error.strerror or error}", file=sys.stderr)
        return 2
    print(f"{arguments.out}: {', '.join(f'{key} {list(values.shape)}' for key, values in arrays.items())}", file=sys.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
