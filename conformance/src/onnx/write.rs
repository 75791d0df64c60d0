//! Graphs written: nodes with the constants that they read as a file of their own.

use prost::Message as _;

use super::element::ElementType;
use super::message::{
    DimensionProto, DimensionValue, GraphProto, ModelProto, NodeProto, OperatorSetIdProto, TensorProto,
    TensorShapeProto, TensorTypeProto, TypeProto, ValueInfoProto,
};
use super::typed_tensor::TypedTensor;

/// Container version of the files written: the oldest that knows every element type that is read here.
pub const IR_VERSION: i64 = 10;

/// An ONNX file of these nodes, each after those that it reads.
///
/// The nodes are written with all that they were read with. Of the constants, those made by [`constant`] lie in the file;
/// one that was read from a file with external data goes on to name that data, relative to where the new file will lie.
/// `opsets` are the versions of the operators by domain.
pub fn model_of(
    nodes: Vec<NodeProto>,
    constants: Vec<TensorProto>,
    inputs: Vec<ValueInfoProto>,
    outputs: Vec<ValueInfoProto>,
    opsets: &[(String, i64)],
) -> Vec<u8> {
    let opset = |(domain, version): &(String, i64)| OperatorSetIdProto {
        domain: Some(domain.clone()),
        version: Some(*version),
    };
    ModelProto {
        ir_version: Some(IR_VERSION),
        producer_name: Some("vitruvian-conformance".into()),
        graph: Some(GraphProto {
            name: Some("part".into()),
            node: nodes,
            initializer: constants,
            input: inputs,
            output: outputs,
            ..Default::default()
        }),
        opset_import: opsets.iter().map(opset).collect(),
        ..Default::default()
    }
    .encode_to_vec()
}

/// A constant with its elements inside.
pub fn constant(name: &str, tensor: &TypedTensor) -> TensorProto {
    TensorProto {
        dims: tensor.shape.iter().map(|&side| side as i64).collect(),
        data_type: Some(tensor.element().number()),
        raw_data: Some(tensor.elements.to_bytes().into()),
        name: Some(name.into()),
        ..Default::default()
    }
}

/// An input or an output of this type and shape.
pub fn declaration(name: &str, element: ElementType, shape: &[usize]) -> ValueInfoProto {
    let side = |&side: &usize| DimensionProto {
        value: Some(DimensionValue::Number(side as i64)),
        ..Default::default()
    };
    let tensor = TensorTypeProto {
        elem_type: Some(element.number()),
        shape: Some(TensorShapeProto { dim: shape.iter().map(side).collect() }),
    };
    ValueInfoProto {
        r#type: Some(TypeProto { tensor_type: Some(tensor), ..Default::default() }),
        ..undeclared(name)
    }
}

/// An output whose type is inferred by whoever runs the graph.
pub fn undeclared(name: &str) -> ValueInfoProto {
    ValueInfoProto { name: Some(name.into()), ..Default::default() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::model::Model;
    use crate::onnx::typed_tensor::Elements;

    #[test]
    fn a_file_of_real_exports_is_written_as_it_was_read() {
        for bytes in [
            &include_bytes!("../../tests/foreign/axis_angle_dynamo.onnx")[..],
            include_bytes!("../../tests/foreign/matrix_torchscript.onnx"),
        ] {
            let model = ModelProto::decode(bytes).expect("a model");
            assert!(model.encode_to_vec() == bytes, "byte for byte");
        }
    }

    #[test]
    fn what_is_written_is_read_again() {
        let weights = TypedTensor::new(&[2], Elements::I64(vec![3, -4])).expect("a tensor");
        let node = NodeProto {
            input: vec!["x".into(), "w".into()],
            output: vec!["y".into()],
            op_type: Some("Add".into()),
            doc_string: Some("here".into()),
            ..Default::default()
        };
        let bytes = model_of(
            vec![node.clone()],
            vec![constant("w", &weights)],
            vec![declaration("x", ElementType::I64, &[2])],
            vec![undeclared("y")],
            &[(String::new(), 17)],
        );
        let model = Model::from_bytes("written", bytes).expect("a model");
        assert_eq!(model.nodes(), [node]);
        assert_eq!(model.constants().expect("constants")["w"], weights);
        assert_eq!((model.opset(), model.inputs(), model.outputs()), (17, vec!["x"], vec!["y"]));
    }
}
