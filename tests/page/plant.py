"""A dump of an engine with a fault: ONNX Runtime on a graph with one switch turned over, under the names of the true graph.

Usage: plant.py GRAPH.onnx OPERATOR ATTRIBUTE SHAPES DUMP.npz: in the last node of the operator, the attribute (0 or 1) is turned over.
SHAPES is JSON: {"input": [1, 3, 64, 64]}; inputs are normal numbers.
"""

import json
import sys

import numpy
import onnx
import onnxruntime


def main(graph, operator, attribute, shapes, dump):
    model = onnx.load(graph)
    node = [each for each in model.graph.node if each.op_type == operator][-1]
    (switch,) = [each for each in node.attribute if each.name == attribute]
    switch.i = 1 - switch.i
    known = {each.name for each in model.graph.output}
    names = [name for each in model.graph.node for name in each.output if name and name not in known]
    model.graph.output.extend(onnx.ValueInfoProto(name=name) for name in names)
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
    session = onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    random = numpy.random.default_rng(0)
    inputs = {name: random.standard_normal(shape, numpy.float32) for name, shape in json.loads(shapes).items()}
    outputs = [each.name for each in session.get_outputs()]
    numpy.savez(dump, **inputs, **dict(zip(outputs, session.run(outputs, inputs))))


if __name__ == "__main__":
    main(*sys.argv[1:])
