"""Write the graphs of MF-PIFu, VSR and the regressor, and a manifest that says what each is and how far it may err.

    python models/export.py --size small  --filling trained              the committed graphs
    python models/export.py --size thesis --filling widened              small weights at the thesis' cost
    python models/export.py --size thesis --filling random               every weight alive, for parity

Same checkpoint, same versions: same bytes.
"""
import argparse
import hashlib
import json
import os
import pathlib
import sys
import tomllib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field

import onnx
import onnxruntime
import onnxscript
import torch
from torch import Tensor, nn

import agreement
import filling
import graph
import widen
from networks import mf_pifu, regressor, vsr

HERE = pathlib.Path(__file__).resolve().parent
EXPORTED = HERE / "exported"


@dataclass(frozen=True)
class Weights:
    """The state of one network and where it comes from."""

    state: dict[str, Tensor]
    origin: dict[str, str | int] = field(default_factory=dict)


@dataclass(frozen=True)
class Drawing:
    """One graph to write: what to trace, what to declare, what to measure."""

    file: str
    module: nn.Module
    example: tuple[Tensor, ...]
    dynamic_shapes: tuple
    signature: graph.Signature
    metadata: dict[str, str]
    inputs: Callable[[], dict[str, Tensor]]
    fuse: bool = True


def feature_names(count: int) -> list[str]:
    """The names of the feature maps, finest first."""
    return [f"features_{k}" for k in range(1, count + 1)]


def mf_pifu_drawings(size: mf_pifu.Size, network: mf_pifu.MfPifu) -> list[Drawing]:
    """Encoder and query of MF-PIFu. The number of views and of points are free, the image size is not."""
    views, points = torch.export.Dim("N", min=1), torch.export.Dim("P", min=1)
    side = size.image_size
    maps = {name: ("N", size.out, side >> k, side >> k) for k, name in enumerate(feature_names(4), 1)}
    metadata = {
        "image_size": str(side),
        "mean": "0.5,0.5,0.5",
        "std": "0.5,0.5,0.5",
        "background": "0",
        "align_corners": "false",
        "inside": "1",
        "level": "0.5",
        "depth_center": "body_center",
        "depth_scale": "crop_half_width",
    }

    def query_inputs() -> dict[str, Tensor]:
        with torch.no_grad():
            features = network.encoder(agreement.images(side))
        uv, depth = agreement.view_points()
        return {**dict(zip(maps, features)), "uv": uv, "depth": depth}

    return [
        Drawing(
            "mf_pifu_encoder.onnx",
            mf_pifu.Encoder(size),
            (torch.zeros(2, 3, side, side),),
            ({0: views},),
            graph.Signature("mf-pifu.encoder", {"images": ("N", 3, side, side)}, maps),
            metadata,
            lambda: {"images": agreement.images(side)},
        ),
        Drawing(
            "mf_pifu_query.onnx",
            mf_pifu.Query(size),
            (*(torch.zeros(2, *shape[1:]) for shape in maps.values()), torch.zeros(2, 8, 2), torch.zeros(2, 8)),
            (*({0: views} for _ in maps), {0: views, 1: points}, {0: views, 1: points}),
            graph.Signature("mf-pifu.query", {**maps, "uv": ("N", "P", 2), "depth": ("N", "P")}, {"occupancy": ("P",)}),
            metadata,
            query_inputs,
        ),
    ]


def vsr_drawings(size: vsr.Size, network: vsr.Vsr) -> list[Drawing]:
    """Encoder and query of VSR. The number of points is free, and so is the resolution, a multiple of 16."""
    blocks, points = torch.export.Dim("blocks", min=1), torch.export.Dim("P", min=1)
    sides = [torch.export.Dim(f"side_{k}", min=1) for k in range(5)]
    axes = ("D", "D/2", "D/4", "D/8", "D/16")
    maps = {
        name: (1, channels, axis, axis, axis) for name, channels, axis in zip(feature_names(5), size.stages, axes)
    }
    metadata = {"resolution": str(size.resolution), "align_corners": "false", "inside": "1", "level": "0.5"}

    def query_inputs() -> dict[str, Tensor]:
        with torch.no_grad():
            features = network.encoder(agreement.voxels(size.resolution))
        return {**dict(zip(maps, features)), "points": agreement.volume_points()}

    return [
        Drawing(
            "vsr_encoder.onnx",
            vsr.Encoder(size),
            (torch.zeros(1, 1, 32, 32, 32),),
            ({2: 16 * blocks, 3: 16 * blocks, 4: 16 * blocks},),
            graph.Signature("vsr.encoder", {"voxels": (1, 1, "D", "D", "D")}, maps),
            metadata,
            lambda: {"voxels": agreement.voxels(size.resolution)},
        ),
        Drawing(
            "vsr_query.onnx",
            vsr.Query(size),
            (*(torch.zeros(1, c, *(32 >> k,) * 3) for k, c in enumerate(size.stages)), torch.zeros(8, 3)),
            (*({2: side, 3: side, 4: side} for side in sides), {0: points}),
            graph.Signature("vsr.query", {**maps, "points": ("P", 3)}, {"occupancy": ("P",)}),
            metadata,
            query_inputs,
        ),
    ]


def regressor_drawings(size: regressor.Size, network: regressor.Regressor) -> list[Drawing]:
    """The regressor in one graph. The number of images is free, their size is not."""
    side = size.image_size
    outputs = {"pose": ("N", regressor.POSE), "betas": ("N", regressor.BETAS), "camera": ("N", regressor.CAMERA)}
    return [
        Drawing(
            "regressor.onnx",
            regressor.Regressor(size),
            (torch.zeros(2, 3, side, side),),
            ({0: torch.export.Dim("N", min=1)},),
            graph.Signature("regressor", {"image": ("N", 3, side, side)}, outputs),
            {
                "image_size": str(side),
                "mean": ",".join(map(str, regressor.MEAN)),
                "std": ",".join(map(str, regressor.STD)),
                "background": "0",
                "focal_length": repr(size.focal_length),
            },
            lambda: {"image": agreement.images(side)},
            fuse=False,
        )
    ]


@dataclass(frozen=True)
class Network:
    """What to do with one of the networks."""

    sizes: dict
    build: Callable[..., nn.Module]
    drawings: Callable[..., list[Drawing]]
    random: Callable[..., nn.Module]
    widen: Callable[..., dict[str, Tensor]]
    graphs: dict[str, str]
    """Each of its graphs, and the prefix of that graph's parameters in the whole network."""


PARTS = ("encoder", "query")
NETWORKS = {
    "mf_pifu": Network(mf_pifu.SIZES, mf_pifu.MfPifu, mf_pifu_drawings, filling.random_mf_pifu, widen.widen_mf_pifu,
                       {f"mf_pifu_{part}.onnx": f"{part}." for part in PARTS}),
    "vsr": Network(vsr.SIZES, vsr.Vsr, vsr_drawings, filling.random_vsr, widen.widen_vsr,
                   {f"vsr_{part}.onnx": f"{part}." for part in PARTS}),
    "regressor": Network(regressor.SIZES, regressor.Regressor, regressor_drawings, filling.random_regressor,
                         widen.widen_regressor, {"regressor.onnx": ""}),
}


def weights_of(name: str, size: str, kind: str, checkpoints: pathlib.Path, seed: int) -> Weights:
    """The weights of network `name` at `size` by one of the three fillings."""
    network = NETWORKS[name]
    if kind == "random":
        return Weights(network.random(network.sizes[size], seed).state_dict(), {"seed": seed})
    if kind == "widened":
        origin = " ".join(f"models/exported/{file}" for file in network.graphs)
        return Weights(network.widen(state_of_graphs(name)), {"widened_from": origin})
    path = checkpoints / f"{name}.pt"
    checkpoint = torch.load(path, map_location="cpu", weights_only=True)
    if checkpoint["size"] != size:
        raise SystemExit(f"{path} holds a {checkpoint['size']} network, --size {size} needs {size}")
    origin = {
        "seed": checkpoint["seed"],
        "training_steps": checkpoint["steps"],
        "training_command": checkpoint["command"],
    }
    return Weights(checkpoint["state"], origin)


def state_of_graphs(name: str) -> dict[str, Tensor]:
    """The parameters of a committed small network, read back from its graphs' initialisers."""
    state = {}
    for file, prefix in NETWORKS[name].graphs.items():
        if not (EXPORTED / file).exists():
            raise SystemExit(f"{EXPORTED / file} is missing; export the small trained graph first, or another by --only")
        model = onnx.load(EXPORTED / file)
        for tensor in model.graph.initializer:
            values = onnx.numpy_helper.to_array(tensor)
            state[f"{prefix}{tensor.name}"] = torch.from_numpy(values.copy())
            if tensor.name.endswith("running_mean"):
                state[f"{prefix}{tensor.name.removesuffix('running_mean')}num_batches_tracked"] = torch.tensor(0)
    return state


def refuse_machine_paths(data: bytes, what: str) -> None:
    """A committed file that names folders of the machine it was made on is neither clean nor reproducible."""
    for folder in {str(HERE), str(HERE.parent), sys.prefix, os.path.expanduser("~"), os.getcwd()} - {"/"}:
        if folder.encode() in data:
            raise ValueError(f"{what} contains the path {folder}")


def write_whole(path: pathlib.Path, data: bytes) -> None:
    """The file appears complete or not at all."""
    beside = path.with_name(f".{path.name}.partial")
    beside.write_bytes(data)
    beside.replace(path)


def entry(drawing: Drawing, data: bytes, size: str, kind: str, seed: int, weights: Weights) -> dict[str, object]:
    """What the manifest says of one graph; measuring is part of it."""
    found = agreement.measure(data, drawing.module, drawing.inputs())
    seeded = f" --seed {seed}" if kind == "random" else ""
    return {
        "file": drawing.file,
        "sha256": hashlib.sha256(data).hexdigest(),
        "bytes": len(data),
        "kind": drawing.signature.kind,
        "size": size,
        "filling": kind,
        "parameters": sum(t.numel() for t in drawing.module.parameters()),
        "opset": graph.OPSET,
        "torch": torch.__version__.split("+")[0],
        "onnx": onnx.__version__,
        "onnxscript": onnxscript.__version__,
        "onnxruntime": onnxruntime.__version__,
        "command": f"python models/export.py --size {size} --filling {kind}{seeded}",
        **weights.origin,
        "measured_error": found.measured,
        "measured_error_unoptimised": found.unoptimised,
        "measured_error_optimised": found.optimised,
        "largest_value": found.largest_value,
        "allowed_error": agreement.ALLOWED_FACTOR * found.measured,
        "allowed_reason": agreement.ALLOWED_REASON,
    }


def toml_table(name: str, values: dict[str, object]) -> str:
    """One table of an array of tables; a JSON string is a TOML basic string."""
    lines = [f"[[{name}]]"]
    for key, value in values.items():
        text = json.dumps(value, ensure_ascii=False) if isinstance(value, str) else value
        lines.append(f"{key} = {f'{value:.3e}' if isinstance(value, float) else text}")
    return "\n".join(lines) + "\n"


MANIFEST_HEAD = """\
# The graphs of this folder: what they are, how they were made and how far they may err. Written by models/export.py.
# Errors are max |ONNX Runtime f32 (CPU, one thread) - PyTorch f64| over all outputs on seeded inputs
# (models/agreement.py), graph optimisation off and on; measured_error is the larger of the two.

"""


def draw_all(
    size: str, kind: str, checkpoints: pathlib.Path, seed: int, names: Iterable[str] = NETWORKS
) -> Iterator[tuple[Drawing, bytes, Weights]]:
    """The graphs one after another; the module of each drawing holds the exported weights in f64."""
    for name in names:
        network = NETWORKS[name]
        weights = weights_of(name, size, kind, checkpoints, seed)
        whole = network.build(network.sizes[size]).eval()
        whole.load_state_dict(weights.state)
        for drawing in network.drawings(network.sizes[size], whole):
            trained = whole.get_submodule(network.graphs[drawing.file].removesuffix("."))
            data = graph.draw(
                drawing.module,
                drawing.example,
                drawing.dynamic_shapes,
                drawing.signature,
                {**drawing.metadata, "size": size, "filling": kind},
                graph.persistent_state(trained),
                drawing.fuse,
            )
            refuse_machine_paths(data, drawing.file)
            drawing.module.double().load_state_dict(trained.state_dict())
            yield drawing, data, weights


def export(
    size: str, kind: str, checkpoints: pathlib.Path, output: pathlib.Path, seed: int, names: Iterable[str] = NETWORKS
) -> None:
    """Write the graphs and manifest.toml into `output`, measuring each against PyTorch.

    What the manifest there says of other networks' graphs, which stay, is kept.
    """
    output.mkdir(parents=True, exist_ok=True)
    path = output / "manifest.toml"
    known = {t["file"]: t for t in tomllib.loads(path.read_text())["graph"]} if path.exists() else {}
    for drawing, data, weights in draw_all(size, kind, checkpoints, seed, names):
        table = entry(drawing, data, size, kind, seed, weights)
        write_whole(output / drawing.file, data)
        known[drawing.file] = table
        print(
            f"{drawing.file}: {len(data)} bytes, error {table['measured_error_unoptimised']:.2e} unoptimised, "
            f"{table['measured_error_optimised']:.2e} optimised, values up to {table['largest_value']:.3g}",
            file=sys.stderr,
        )
    files = [file for network in NETWORKS.values() for file in network.graphs if file in known]
    manifest = (MANIFEST_HEAD + "\n".join(toml_table("graph", known[file]) for file in files)).encode()
    refuse_machine_paths(manifest, "manifest.toml")
    write_whole(path, manifest)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", choices=("small", "thesis"), default="small")
    parser.add_argument("--filling", choices=("trained", "random", "widened"), default="trained")
    parser.add_argument("--checkpoints", type=pathlib.Path, default=HERE / "runs", metavar="DIR",
                        help="folder with mf_pifu.pt, vsr.pt and regressor.pt (default: models/runs); widened reads models/exported")
    parser.add_argument("-o", "--output", type=pathlib.Path, metavar="DIR",
                        help="default: models/exported for small trained, models/exported/SIZE/FILLING otherwise")
    parser.add_argument("--seed", type=int, default=1, help="of the random filling")
    parser.add_argument("--only", choices=tuple(NETWORKS), help="one network's graphs, as while the other is trained")
    args = parser.parse_args()
    if args.size == "small" and args.filling == "widened":
        parser.error("small is what gets widened: --filling widened needs --size thesis")
    shipped = (args.size, args.filling) == ("small", "trained")
    output = args.output or (EXPORTED if shipped else EXPORTED / args.size / args.filling)
    export(args.size, args.filling, args.checkpoints, output, args.seed, [args.only] if args.only else NETWORKS)


if __name__ == "__main__":
    main()
