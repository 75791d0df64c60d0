"""A dump of an engine with a fault: ONNX Runtime on a graph of which one attribute was changed, under the names of the true graph.

Usage: plant.py GRAPH.onnx NODE ATTRIBUTE VALUE SHAPES DUMP.npz, SHAPES as JSON {"input": [1, 3, 64, 64]}
"""

import json
import sys

import numpy
import onnx
import onnxruntime


def main(graph, node, attribute, value, shapes, dump):
    model = onnx.load(graph)
    (found,) = [each for each in model.graph.node if each.name == node]
    kept = [each for each in found.attribute if each.name != attribute]
    del found.attribute[:]
    found.attribute.extend([*kept, onnx.helper.make_attribute(attribute, json.loads(value))])
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
