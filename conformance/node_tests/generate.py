"""Writes the official ONNX backend tests as files: a model, its inputs and the outputs that are expected of it.

The cases are made by the scripts of the package `onnx`, whose seeds are fixed; the older models that were converted from
PyTorch lie in the package ready-made. The layout is the one in which ONNX published them:

    generated/KIND/CASE/model.onnx
    generated/KIND/CASE/test_data_set_K/{input,output}_J.pb

The version is pinned, because the table in docs/node_tests.md names its cases one by one.
"""

import argparse
import pathlib
import shutil
import sys
import warnings

import numpy
import onnx
import onnx.backend.test
from onnx import numpy_helper
from onnx.backend.test.case import model, node

ONNX = "1.23.2"
COUNTS = {"node": 1884, "pytorch-converted": 82, "pytorch-operator": 35, "simple": 26}


def message(value, info) -> bytes:
    """A value as the protocol buffer that its declared type asks for."""
    kind = info.type.WhichOneof("value")
    if kind == "tensor_type":
        made = value if isinstance(value, onnx.TensorProto) else numpy_helper.from_array(value, info.name)
    else:
        make = {
            "sequence_type": numpy_helper.from_list,
            "optional_type": numpy_helper.from_optional,
            "map_type": numpy_helper.from_dict,
        }
        made = make[kind](value, info.name)
    return made.SerializeToString()


def write(case, folder: pathlib.Path) -> None:
    folder.mkdir(parents=True)
    (folder / "model.onnx").write_bytes(case.model.SerializeToString())
    for k, (inputs, outputs) in enumerate(case.data_sets):
        data = folder / f"test_data_set_{k}"
        data.mkdir()
        graph = case.model.graph
        for name, values, infos in (("input", inputs, graph.input), ("output", outputs, graph.output)):
            # A graph may declare more inputs than are given: those that an initializer fills.
            for j, (value, info) in enumerate(zip(values, infos, strict=False)):
                (data / f"{name}_{j}.pb").write_bytes(message(value, info))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    default = pathlib.Path(__file__).parent / "generated"
    parser.add_argument("-o", "--output", type=pathlib.Path, default=default, help="folder (default: %(default)s)")
    output = parser.parse_args().output
    if onnx.__version__ != ONNX:
        sys.exit(f"onnx {onnx.__version__} is installed, {ONNX} was expected: pip install -r models/requirements.txt")
    if output.exists():
        shutil.rmtree(output)
    with warnings.catch_warnings():
        # The cases overflow, and divide by zero, on purpose.
        warnings.simplefilter("ignore")
        cases = node.collect_testcases(None) + model.collect_testcases()
    for case in cases:
        # The kind "real" names networks to be downloaded.
        if case.model is not None:
            write(case, output / case.kind / case.name)
    ready = pathlib.Path(onnx.backend.test.__file__).parent / "data"
    for kind in ("pytorch-converted", "pytorch-operator"):
        shutil.copytree(ready / kind, output / kind)
    found = {folder.name: sum(1 for _ in folder.iterdir()) for folder in output.iterdir()}
    if found != COUNTS:
        sys.exit(f"{output}: {found} cases, {COUNTS} were expected")
    (output / "VERSION").write_text(f"onnx {onnx.__version__}, numpy {numpy.__version__}\n")
    print(f"{output}: {sum(found.values())} cases of onnx {onnx.__version__}")


if __name__ == "__main__":
    main()
