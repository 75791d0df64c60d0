//! Graphs of a few nodes, built in memory to run one operator alone.

use prost::Message as _;

use super::element::ElementType;
use super::message::{
    AttributeKind, AttributeProto, GraphProto, ModelProto, NodeProto, OperatorSetIdProto,
    StringStringEntryProto,
};
use super::typed_tensor::{Elements, TypedTensor};
use super::write::{IR_VERSION, constant, declaration, undeclared};

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
    opsets: Vec<OperatorSetIdProto>,
    graph: GraphProto,
    properties: Vec<StringStringEntryProto>,
}

impl GraphBuilder {
    /// An empty graph in this version of ONNX's operators.
    pub fn new(opset: i64) -> Self {
        let graph = GraphProto { name: Some("problem".into()), ..Default::default() };
        let own = OperatorSetIdProto { domain: Some(String::new()), version: Some(opset) };
        Self { opsets: vec![own], graph, properties: Vec::new() }
    }

    /// Adds a property of the file, such as `vitruvian.kind`.
    #[must_use]
    pub fn property(mut self, key: &str, value: &str) -> Self {
        self.properties.push(StringStringEntryProto { key: Some(key.into()), value: Some(value.into()) });
        self
    }

    /// Adds an f32 input of fixed shape.
    #[must_use]
    pub fn input(self, name: &str, shape: &[usize]) -> Self {
        self.input_of(name, ElementType::F32, shape)
    }

    /// Adds an input of this type and of fixed shape.
    #[must_use]
    pub fn input_of(mut self, name: &str, element: ElementType, shape: &[usize]) -> Self {
        self.graph.input.push(declaration(name, element, shape));
        self
    }

    /// Adds a constant tensor.
    #[must_use]
    pub fn tensor(mut self, name: &str, tensor: &TypedTensor) -> Self {
        self.graph.initializer.push(constant(name, tensor));
        self
    }

    /// Adds an f32 constant.
    #[must_use]
    pub fn constant(self, name: &str, shape: &[usize], values: &[f32]) -> Self {
        self.elements(name, shape, Elements::F32(values.to_vec()))
    }

    /// Adds an i64 constant, as shapes, axes and indices are given.
    #[must_use]
    pub fn integers(self, name: &str, shape: &[usize], values: &[i64]) -> Self {
        self.elements(name, shape, Elements::I64(values.to_vec()))
    }

    /// Adds a constant of truths, as a choice is given.
    #[must_use]
    pub fn truths(self, name: &str, shape: &[usize], values: &[bool]) -> Self {
        self.elements(name, shape, Elements::Bool(values.to_vec()))
    }

    /// Adds a constant, whether its elements fit its shape or not.
    fn elements(self, name: &str, shape: &[usize], elements: Elements) -> Self {
        self.tensor(name, &TypedTensor { shape: shape.to_vec(), elements })
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
            ..Default::default()
        });
        self
    }

    /// Says that the node that was added last is of another domain, in this version.
    ///
    /// # Panics
    /// When there is no node.
    #[must_use]
    pub fn of_domain(mut self, domain: &str, version: i64) -> Self {
        self.graph.node.last_mut().expect("a node was added").domain = Some(domain.into());
        if self.opsets.iter().all(|set| set.domain.as_deref() != Some(domain)) {
            self.opsets.push(OperatorSetIdProto { domain: Some(domain.into()), version: Some(version) });
        }
        self
    }

    /// Names an output; its type is inferred by whoever runs the graph.
    #[must_use]
    pub fn output(mut self, name: &str) -> Self {
        self.graph.output.push(undeclared(name));
        self
    }

    /// The file's bytes.
    pub fn to_bytes(self) -> Vec<u8> {
        ModelProto {
            ir_version: Some(IR_VERSION),
            producer_name: Some("vitruvian-conformance".into()),
            graph: Some(self.graph),
            opset_import: self.opsets,
            metadata_props: self.properties,
            ..Default::default()
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

/// An attribute of several numbers.
pub fn floats(name: &str, values: &[f32]) -> AttributeProto {
    AttributeProto { floats: values.to_vec(), ..attribute(name, AttributeKind::Floats) }
}

/// A text attribute.
pub fn text(name: &str, value: &str) -> AttributeProto {
    AttributeProto { s: Some(value.as_bytes().to_vec()), ..attribute(name, AttributeKind::String) }
}
