//! Graphs of a few nodes, built in memory to run one operator alone.

use prost::Message as _;

use super::element::ElementType;
use super::message::{
    AttributeKind, AttributeProto, DimensionProto, DimensionValue, GraphProto, ModelProto, NodeProto,
    OperatorSetIdProto, StringStringEntryProto, TensorProto, TensorShapeProto, TensorTypeProto, TypeProto,
    ValueInfoProto,
};

/// Container version of the graphs built: the oldest that knows every operator set up to 22.
const IR_VERSION: i64 = 10;

/// A graph under construction.
///
/// ```
/// use vitruvian_conformance::onnx::builder::{GraphBuilder, int};
///
/// let bytes = GraphBuilder::new(20)
///     .input("x", &[2, 3])
///     .constant("w", &[3, 4], &[0.5; 12])
///     .node("Gemm", &["x", "w"], &["y"], vec![int("transB", 0)])
///     .output("y")
///     .to_bytes();
/// ```
#[derive(Clone, Debug)]
pub struct GraphBuilder {
    opset: i64,
    graph: GraphProto,
    properties: Vec<StringStringEntryProto>,
}

impl GraphBuilder {
    /// An empty graph in this version of ONNX's operators.
    pub fn new(opset: i64) -> Self {
        let graph = GraphProto { name: Some("problem".into()), ..Default::default() };
        Self { opset, graph, properties: Vec::new() }
    }

    /// Adds a property of the file, such as `vitruvian.kind`.
    #[must_use]
    pub fn property(mut self, key: &str, value: &str) -> Self {
        self.properties.push(StringStringEntryProto { key: Some(key.into()), value: Some(value.into()) });
        self
    }

    /// Adds an f32 input of fixed shape.
    #[must_use]
    pub fn input(mut self, name: &str, shape: &[usize]) -> Self {
        let dim = shape
            .iter()
            .map(|&side| DimensionProto { value: Some(DimensionValue::Number(side as i64)) })
            .collect();
        let tensor = TensorTypeProto {
            elem_type: Some(ElementType::F32.number()),
            shape: Some(TensorShapeProto { dim }),
        };
        self.graph.input.push(ValueInfoProto {
            name: Some(name.into()),
            r#type: Some(TypeProto { tensor_type: Some(tensor) }),
        });
        self
    }

    /// Adds an f32 constant.
    #[must_use]
    pub fn constant(mut self, name: &str, shape: &[usize], values: &[f32]) -> Self {
        self.graph.initializer.push(TensorProto {
            dims: shape.iter().map(|&side| side as i64).collect(),
            data_type: Some(ElementType::F32.number()),
            raw_data: Some(values.iter().flat_map(|value| value.to_le_bytes()).collect()),
            name: Some(name.into()),
            ..Default::default()
        });
        self
    }

    /// Adds an i64 constant, as shapes, axes and indices are given.
    #[must_use]
    pub fn integers(mut self, name: &str, shape: &[usize], values: &[i64]) -> Self {
        self.graph.initializer.push(TensorProto {
            dims: shape.iter().map(|&side| side as i64).collect(),
            data_type: Some(ElementType::I64.number()),
            int64_data: values.to_vec(),
            name: Some(name.into()),
            ..Default::default()
        });
        self
    }

    /// Adds a constant of truths, as a choice is given.
    #[must_use]
    pub fn truths(mut self, name: &str, shape: &[usize], values: &[bool]) -> Self {
        self.graph.initializer.push(TensorProto {
            dims: shape.iter().map(|&side| side as i64).collect(),
            data_type: Some(ElementType::Bool.number()),
            raw_data: Some(values.iter().map(|&value| u8::from(value)).collect()),
            name: Some(name.into()),
            ..Default::default()
        });
        self
    }

    /// Adds a node; it may read what was added before it.
    #[must_use]
    pub fn node(
        mut self,
        operator: &str,
        inputs: &[&str],
        outputs: &[&str],
        attributes: Vec<AttributeProto>,
    ) -> Self {
        self.graph.node.push(NodeProto {
            input: inputs.iter().map(|&name| name.into()).collect(),
            output: outputs.iter().map(|&name| name.into()).collect(),
            name: Some(format!("{operator}_{}", self.graph.node.len())),
            op_type: Some(operator.into()),
            attribute: attributes,
            domain: None,
        });
        self
    }

    /// Names an output; its type is inferred by whoever runs the graph.
    #[must_use]
    pub fn output(mut self, name: &str) -> Self {
        self.graph.output.push(ValueInfoProto { name: Some(name.into()), r#type: None });
        self
    }

    /// The file's bytes.
    pub fn to_bytes(self) -> Vec<u8> {
        ModelProto {
            ir_version: Some(IR_VERSION),
            producer_name: Some("vitruvian-conformance".into()),
            graph: Some(self.graph),
            opset_import: vec![OperatorSetIdProto { domain: Some(String::new()), version: Some(self.opset) }],
            metadata_props: self.properties,
        }
        .encode_to_vec()
    }
}

fn attribute(name: &str, kind: AttributeKind) -> AttributeProto {
    AttributeProto { name: Some(name.into()), kind: Some(kind as i32), ..Default::default() }
}

/// An integer attribute.
pub fn int(name: &str, value: i64) -> AttributeProto {
    AttributeProto { i: Some(value), ..attribute(name, AttributeKind::Int) }
}

/// An attribute of several integers.
pub fn ints(name: &str, values: &[usize]) -> AttributeProto {
    AttributeProto {
        ints: values.iter().map(|&v| v as i64).collect(),
        ..attribute(name, AttributeKind::Ints)
    }
}

/// A number attribute.
pub fn float(name: &str, value: f32) -> AttributeProto {
    AttributeProto { f: Some(value), ..attribute(name, AttributeKind::Float) }
}

/// A text attribute.
pub fn text(name: &str, value: &str) -> AttributeProto {
    AttributeProto { s: Some(value.as_bytes().to_vec()), ..attribute(name, AttributeKind::String) }
}
