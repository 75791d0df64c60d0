//! Movements, followed by moving places.

use vitruvian_reference::nn::Tensor;

use super::{Field, MOVEMENTS, View, named};
use crate::audit::case::Case;
use crate::onnx::element::ElementType;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// The elements that a movement moves to a place, found by moving places.
pub(super) fn moved(case: &Case, output: usize, index: &[usize]) -> Option<Vec<Option<Field>>> {
    let operator = case.node.op_type.as_deref()?;
    if !named(MOVEMENTS, operator) {
        return None;
    }
    // Which operands are moved; the others say where to.
    let data = |i: usize| match operator {
        "Concat" => true,
        "ScatterElements" | "ScatterND" => i == 0 || i == 2,
        "Pad" => i == 0 || i == 2,
        _ => i == 0,
    };
    // Places are counted from 1 through all operands, so that 0, a padding's own number, is none.
    let mut counted = 1;
    let mut firsts = vec![0; case.operands.len()];
    let mut places: Vec<Option<Value>> = Vec::with_capacity(case.operands.len());
    for (i, operand) in case.operands.iter().enumerate() {
        let Some(operand) = operand else {
            places.push(None);
            continue;
        };
        if data(i) {
            let count: usize = operand.shape.iter().product();
            firsts[i] = counted;
            let numbers = (counted..counted + count).map(|place| place as f64).collect();
            // f64 holds every place below 2⁵³.
            let data = Data::Numbers(Tensor::new(&operand.shape, numbers));
            places.push(Some(Value { element: ElementType::F64, data }));
            counted += count;
        } else {
            places.push(Some(Value::of(operand).ok()?));
        }
    }
    let operands: Vec<Option<&Value>> = places.iter().map(Option::as_ref).collect();
    let moved = walk::evaluate(&case.node, case.opset, &operands).ok()?.into_iter().nth(output)??;
    let moved = moved.numbers().ok()?;
    let at = moved.shape.iter().zip(index).fold(0, |at, (&side, &i)| at * side + i);
    let place = *moved.data.get(at)? as usize;
    let view = View { node: &case.node, operands: &case.operands, output: &moved.shape };
    let field = |i: usize| -> Option<Field> {
        if !data(i) {
            return view.whole(i);
        }
        let shape = view.shape(i)?;
        let mut inside = place.checked_sub(firsts[i])?;
        if inside >= shape.iter().product() {
            return None;
        }
        let mut field = vec![0..1; shape.len()];
        for axis in (0..shape.len()).rev() {
            let i = inside % shape[axis];
            (field[axis], inside) = (i..i + 1, inside / shape[axis]);
        }
        Some(field)
    };
    Some((0..case.operands.len()).map(field).collect())
}
