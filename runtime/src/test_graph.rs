//! Small ONNX graphs for tests, written as protocol-buffer bytes: nothing is generated, nothing is stored.
//!
//! The field numbers are those of ONNX's `onnx.proto`.

/// An element type, with its number in `TensorProto.DataType`.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Element {
    F32 = 1,
    I64 = 7,
}

/// One side of a declared shape.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Side {
    Fixed(u64),
    Free(&'static str),
}

/// A node's attribute.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Attribute {
    Int(i64),
    Text(&'static str),
}

/// A graph under construction.
#[derive(Debug, Default)]
pub(crate) struct GraphBuilder {
    graph: Vec<u8>,
    metadata: Vec<u8>,
}

fn varint(mut value: u64, out: &mut Vec<u8>) {
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
}

fn number(field: u64, value: u64, out: &mut Vec<u8>) {
    varint(field << 3, out);
    varint(value, out);
}

fn bytes(field: u64, content: &[u8], out: &mut Vec<u8>) {
    varint(field << 3 | 2, out);
    varint(content.len() as u64, out);
    out.extend_from_slice(content);
}

fn message(field: u64, out: &mut Vec<u8>, fill: impl FnOnce(&mut Vec<u8>)) {
    let mut content = Vec::new();
    fill(&mut content);
    bytes(field, &content, out);
}

impl GraphBuilder {
    pub(crate) fn metadata(mut self, key: &str, value: &str) -> Self {
        message(14, &mut self.metadata, |entry| {
            bytes(1, key.as_bytes(), entry);
            bytes(2, value.as_bytes(), entry);
        });
        self
    }

    pub(crate) fn input(self, name: &str, element: Element, shape: &[Side]) -> Self {
        self.value_info(11, name, element, shape)
    }

    pub(crate) fn output(self, name: &str, element: Element, shape: &[Side]) -> Self {
        self.value_info(12, name, element, shape)
    }

    fn value_info(mut self, field: u64, name: &str, element: Element, shape: &[Side]) -> Self {
        message(field, &mut self.graph, |info| {
            bytes(1, name.as_bytes(), info);
            message(2, info, |kind| {
                message(1, kind, |tensor| {
                    number(1, element as u64, tensor);
                    message(2, tensor, |sides| {
                        for side in shape {
                            message(1, sides, |dimension| match side {
                                Side::Fixed(length) => number(1, *length, dimension),
                                Side::Free(symbol) => bytes(2, symbol.as_bytes(), dimension),
                            });
                        }
                    });
                });
            });
        });
        self
    }

    pub(crate) fn node(
        mut self,
        operator: &str,
        inputs: &[&str],
        outputs: &[&str],
        attributes: &[(&str, Attribute)],
    ) -> Self {
        message(1, &mut self.graph, |node| {
            inputs.iter().for_each(|name| bytes(1, name.as_bytes(), node));
            outputs.iter().for_each(|name| bytes(2, name.as_bytes(), node));
            bytes(4, operator.as_bytes(), node);
            for (name, attribute) in attributes {
                message(5, node, |content| {
                    bytes(1, name.as_bytes(), content);
                    match attribute {
                        Attribute::Int(value) => {
                            number(3, *value as u64, content);
                            number(20, 2, content);
                        }
                        Attribute::Text(text) => {
                            bytes(4, text.as_bytes(), content);
                            number(20, 3, content);
                        }
                    }
                });
            }
        });
        self
    }

    /// An i64 vector as an initialiser.
    pub(crate) fn integers(mut self, name: &str, values: &[i64]) -> Self {
        message(5, &mut self.graph, |tensor| {
            number(1, values.len() as u64, tensor);
            number(2, Element::I64 as u64, tensor);
            bytes(8, name.as_bytes(), tensor);
            bytes(9, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>(), tensor);
        });
        self
    }

    /// f32 numbers as an initialiser.
    pub(crate) fn numbers(mut self, name: &str, shape: &[u64], values: &[f32]) -> Self {
        message(5, &mut self.graph, |tensor| {
            shape.iter().for_each(|&side| number(1, side, tensor));
            number(2, Element::F32 as u64, tensor);
            bytes(8, name.as_bytes(), tensor);
            bytes(9, &values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>(), tensor);
        });
        self
    }

    /// The file: ONNX IR 10, operator set 21.
    pub(crate) fn to_bytes(&self) -> Vec<u8> {
        let mut model = Vec::new();
        number(1, 10, &mut model);
        message(7, &mut model, |graph| {
            graph.extend_from_slice(&self.graph);
            bytes(2, b"test", graph);
        });
        message(8, &mut model, |opset| number(2, 21, opset));
        model.extend_from_slice(&self.metadata);
        model
    }
}
