"""From a PyTorch module to an ONNX graph whose initialisers are exactly the module's state, name by name.

What PyTorch's exporter does that a weight reader cannot live with, and what is done about it here:

- it merges parameters that happen to be equal (two normalisations with bias 0 become one initialiser), so the
  shape of the graph would depend on the weights: the graph is traced once with weights that all differ, the wanted
  ones are put in afterwards, bit for bit;
- it stores index constants as initialisers called val_1: they become Constant nodes;
- it writes stack traces with the paths of the machine, module hierarchies and value shapes: they are dropped.

Nothing is folded: batch normalisation stays a node. Where it follows a ReLU the exporter has no convolution to fold it
into; where it follows a convolution, in the regressor, PyTorch's optimiser would, and is replaced by one that only
evaluates what is constant (`fuse=False`); `put_state` would notice. Group normalisation is written out, for the reason `group_normalisation.py` gives.
"""
import contextlib
import io
import logging
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import onnx
import onnxscript.optimizer
import torch
from onnx import numpy_helper
from torch import Tensor, nn

from filling import fill_randomly
from group_normalisation import write_out_group_normalisation

OPSET = 21


@dataclass(frozen=True)
class Signature:
    """The contract of a graph: its kind, and the axes of every tensor that enters or leaves; a free axis has a name."""

    kind: str
    inputs: Mapping[str, tuple[str | int, ...]]
    outputs: Mapping[str, tuple[str | int, ...]]


def persistent_state(module: nn.Module) -> dict[str, Tensor]:
    """The float tensors of a module's state; the batch counter of a batch normalisation is of no use to a graph."""
    return {name: t for name, t in module.state_dict().items() if not name.endswith("num_batches_tracked")}


def trace(module: nn.Module, example: tuple[Tensor, ...], dynamic_shapes: tuple, signature: Signature, fuse: bool):
    """The graph PyTorch's exporter draws of `module` with weights that all differ."""
    fill_randomly(module, seed=0)
    registration = logging.getLogger("torch.onnx._internal.exporter._registration")
    registration.setLevel(logging.ERROR)  # says that torchvision's operators are absent; none is used
    with warnings.catch_warnings(), contextlib.redirect_stdout(io.StringIO()):
        warnings.simplefilter("ignore")  # the exporter warns of every axis that shares its symbol with another
        program = torch.onnx.export(
            module.eval(),
            example,
            dynamo=True,
            opset_version=OPSET,
            input_names=list(signature.inputs),
            output_names=list(signature.outputs),
            dynamic_shapes=dynamic_shapes,
            optimize=fuse,
        )
    if not fuse:
        onnxscript.optimizer.fold_constants(program.model)
        onnxscript.optimizer.remove_unused_nodes(program.model)
    return program.model_proto


def declare(model: onnx.ModelProto, signature: Signature) -> None:
    """Write the contract's shapes, after checking that every size the exporter knows is the contract's."""
    declared = {**signature.inputs, **signature.outputs}
    for value in (*model.graph.input, *model.graph.output):
        dims = value.type.tensor_type.shape.dim
        wanted = declared[value.name]
        if len(dims) != len(wanted):
            raise ValueError(f"{signature.kind}: {value.name} has {len(dims)} axes, the contract {wanted}")
        for dim, want in zip(dims, wanted):
            if isinstance(want, int):
                if dim.dim_value != want:
                    raise ValueError(f"{signature.kind}: {value.name} has {dim}, the contract {wanted}")
            elif not dim.dim_param:
                raise ValueError(f"{signature.kind}: an axis of {value.name} is fixed at {dim.dim_value}, not {want}")
            else:
                dim.dim_param = want


def constants_to_nodes(model: onnx.ModelProto, state: Mapping[str, Tensor]) -> None:
    """Turn every initialiser that is no parameter into a Constant node at the head of the graph."""
    graph = model.graph
    constants = [t for t in graph.initializer if t.name not in state]
    nodes = []
    for constant in sorted(constants, key=lambda t: t.name):
        array = numpy_helper.to_array(constant)
        if array.dtype.kind == "f":
            raise ValueError(f"initialiser {constant.name} is float and no parameter: something was folded")
        nodes.append(
            onnx.helper.make_node(
                "Constant", [], [constant.name], name=f"constant_{constant.name}",
                value=numpy_helper.from_array(array, name=constant.name),
            )
        )
    others = list(graph.node)
    del graph.node[:]
    graph.node.extend([*nodes, *others])


def drop_zero_biases(model: onnx.ModelProto, state: Mapping[str, Tensor]) -> None:
    """Take away the bias of zeros that the exporter gives a convolution without one."""
    zeros = {t.name for t in model.graph.initializer if t.name not in state and not numpy_helper.to_array(t).any()}
    for node in model.graph.node:
        if node.op_type == "Conv" and len(node.input) == 3 and node.input[2] in zeros:
            del node.input[2]
    used = {name for node in model.graph.node for name in node.input}
    kept = [t for t in model.graph.initializer if t.name in used or t.name not in zeros]
    del model.graph.initializer[:]
    model.graph.initializer.extend(kept)


def put_state(model: onnx.ModelProto, state: Mapping[str, Tensor]) -> None:
    """Replace the initialisers by `state`, in its order; a name too many or too few is an error."""
    graph = model.graph
    traced = {t.name for t in graph.initializer}
    if missing := set(state) - traced:
        raise ValueError(f"the exporter dropped or renamed {sorted(missing)}")
    del graph.initializer[:]
    for name, tensor in state.items():
        array = np.ascontiguousarray(tensor.detach().cpu().numpy().astype("<f4"))
        graph.initializer.append(numpy_helper.from_array(array, name=name))


def strip(model: onnx.ModelProto) -> None:
    """Remove what says where and by what the graph was drawn, and the shapes anybody can infer again."""
    graph = model.graph
    del model.metadata_props[:], graph.metadata_props[:], graph.value_info[:]
    model.doc_string = graph.doc_string = ""
    model.producer_name, model.producer_version = "pytorch", torch.__version__.split("+")[0]
    for part in (*graph.node, *graph.input, *graph.output):
        del part.metadata_props[:]
        part.doc_string = ""


def draw(
    module: nn.Module,
    example: tuple[Tensor, ...],
    dynamic_shapes: tuple,
    signature: Signature,
    metadata: Mapping[str, str],
    state: Mapping[str, Tensor],
    fuse: bool = True,
) -> bytes:
    """The bytes of the graph of `module` with the weights `state`; same arguments, same bytes."""
    model = trace(module, example, dynamic_shapes, signature, fuse)
    declare(model, signature)
    write_out_group_normalisation(model)
    drop_zero_biases(model, state)
    constants_to_nodes(model, state)
    put_state(model, state)
    strip(model)
    model.graph.name = signature.kind
    for key, value in {"kind": signature.kind, "version": "1", **metadata}.items():
        model.metadata_props.add(key=f"vitruvian.{key}", value=value)
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString(deterministic=True)
