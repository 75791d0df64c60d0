//! A node's output, piece by piece: which part of each operand a box of the output is computed from.
//!
//! A box of a convolution's output is the convolution of a box of its input, with what is left of the padding; a few rows
//! of a matrix product are the product of these rows. So a large node is judged as many small ones, each a node of its own
//! that the same reference evaluates: nothing large is ever widened to numbers with bounds, boxes are judged in parallel,
//! and a sample of a node is some of its boxes.
//!
//! | file | nodes that |
//! |---|---|
//! | [`elementwise`] | compute each element from those at its place |
//! | [`axes`] | work along some axes and treat all places of the others alike |
//! | [`window`] | slide a kernel over an image |
//! | [`product`] | multiply matrices |
//! | [`movement`] | move elements |

mod axes;
mod elementwise;
mod movement;
mod product;
mod window;

use super::case::{Case, Operand, View};
use super::region::{Region, part};
use crate::onnx::message::{AttributeKind, AttributeProto, NodeProto};
use crate::onnx::model::is_own;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// What an operand of a piece is.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Source {
    /// Left out.
    Absent,
    /// The operand as it is.
    Whole,
    /// A box of the operand.
    Part(Region),
    /// Another tensor in its place, such as the lengths of the piece.
    Made(TypedTensor),
}

/// A box of an output as a node of its own.
#[derive(Clone, Debug)]
pub(super) struct Piece {
    /// The node that makes it, its only output.
    pub node: NodeProto,
    /// What it reads.
    pub operands: Vec<Source>,
}

type Cut<'a> = Box<dyn Fn(&Region) -> Option<Piece> + Sync + 'a>;

/// How an output may be cut.
pub(super) struct Division<'a> {
    /// The output's shape, by the operands'.
    pub shape: Vec<usize>,
    /// Whether each axis may be cut; a box spans the others.
    pub axes: Vec<bool>,
    /// About how many products, or comparable operations, one element takes.
    pub cost: f64,
    /// The axis along which neighbours share most of what they are computed from.
    pub run: Option<usize>,
    /// A box must not reach across a multiple of this along axis 1, as from one group of channels to the next.
    pub block: Option<usize>,
    /// The piece that makes a box of the output; `None` where the box is not of the output.
    cut: Cut<'a>,
}

impl<'a> Division<'a> {
    /// How output `output` of a node may be cut; `None` where that is not known.
    pub fn of(view: &'a View<'a>, output: usize) -> Option<Self> {
        // Other domains have operators of the same names whose axes stand elsewhere.
        if !is_own(view.node) {
            return None;
        }
        let asked = Asked { view, output };
        let several = view.node.output.iter().filter(|name| !name.is_empty()).count() > 1;
        if several && view.operator() != "Split" {
            return None;
        }
        let families = [elementwise::divide, axes::divide, window::divide, product::divide, movement::divide];
        families.into_iter().find_map(|divide| divide(asked))
    }

    /// The piece that makes this box; `None` where the box is not of the output.
    pub fn piece(&self, region: &Region) -> Option<Piece> {
        if !region.fits(&self.shape) {
            return None;
        }
        (self.cut)(region)
    }
}

impl Case {
    /// The part of the case that a box of one of its outputs is, as a case of its own; `None` where the output cannot be
    /// cut there, or its shape is not what the operands make.
    pub fn piece(&self, output: usize, region: &Region) -> Option<Case> {
        let view = self.view();
        let found = self.found.get(output)?.as_ref()?;
        let division = Division::of(&view, output)?;
        if division.shape != found.shape {
            return None;
        }
        let piece = division.piece(region)?;
        let operands = piece.operands.into_iter().zip(&self.operands).map(|(source, operand)| match source {
            Source::Absent => None,
            Source::Whole => operand.clone(),
            Source::Part(region) => operand.as_ref().map(|operand| part(operand, &region)),
            Source::Made(tensor) => Some(tensor),
        });
        Some(Case {
            operands: operands.collect(),
            found: vec![Some(part(found, region))],
            node: piece.node,
            opset: self.opset,
            name: self.name.clone(),
        })
    }
}

/// A node of which an output is to be cut, with its attributes and shapes at hand.
#[derive(Clone, Copy)]
struct Asked<'a> {
    view: &'a View<'a>,
    output: usize,
}

impl<'a> Asked<'a> {
    fn operator(self) -> &'a str {
        self.view.operator()
    }

    fn shape(self, operand: usize) -> Option<&'a [usize]> {
        self.view.operands.get(operand)?.as_ref().map(Operand::shape)
    }

    fn attribute(self, name: &str) -> Option<&'a AttributeProto> {
        self.view.node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name))
    }

    fn int(self, name: &str, default: i64) -> i64 {
        self.attribute(name).map_or(default, |attribute| attribute.i.unwrap_or(0))
    }

    fn ints(self, name: &str) -> Option<&'a [i64]> {
        self.attribute(name).map(|attribute| &attribute.ints[..])
    }

    fn text(self, name: &str) -> Option<&'a [u8]> {
        self.attribute(name).and_then(|attribute| attribute.s.as_deref())
    }

    /// The integers of an operand.
    fn integers(self, operand: usize) -> Option<Vec<i64>> {
        match self.view.operands.get(operand)?.as_ref()? {
            Operand::Given(tensor) => match &tensor.elements {
                Elements::I64(v) => Some(v.clone()),
                Elements::I32(v) => Some(v.iter().map(|&i| i.into()).collect()),
                _ => None,
            },
            Operand::Derived(value) => value.integers().ok().map(|integers| integers.data.clone()),
        }
    }

    /// An axis counted from the front.
    fn axis(self, axis: i64, rank: usize) -> Option<usize> {
        let axis = if axis < 0 { axis + rank as i64 } else { axis };
        usize::try_from(axis).ok().filter(|&axis| axis < rank)
    }

    /// Every operand as it is.
    fn operands(self) -> Vec<Source> {
        let source =
            |operand: &Option<Operand>| if operand.is_some() { Source::Whole } else { Source::Absent };
        self.view.operands.iter().map(source).collect()
    }

    /// The node with no output but the one asked for.
    fn node(self) -> NodeProto {
        let output = vec![self.view.node.output[self.output].clone()];
        NodeProto { output, ..self.view.node.clone() }
    }
}

/// Sets an attribute that is a list of integers.
fn set_ints(node: &mut NodeProto, name: &str, ints: Vec<i64>) {
    node.attribute.retain(|attribute| attribute.name.as_deref() != Some(name));
    node.attribute.push(AttributeProto {
        name: Some(name.to_owned()),
        kind: Some(AttributeKind::Ints as i32),
        ints,
        ..AttributeProto::default()
    });
}

/// Sets an attribute that is one integer.
fn set_int(node: &mut NodeProto, name: &str, i: i64) {
    node.attribute.retain(|attribute| attribute.name.as_deref() != Some(name));
    node.attribute.push(AttributeProto {
        name: Some(name.to_owned()),
        kind: Some(AttributeKind::Int as i32),
        i: Some(i),
        ..AttributeProto::default()
    });
}

/// A list of integers as an operand.
fn list(integers: Vec<i64>) -> TypedTensor {
    TypedTensor { shape: vec![integers.len()], elements: Elements::I64(integers) }
}

#[cfg(test)]
mod tests;
