//! Meanings made from the specified one: other attributes, other operands, another arrangement of the numbers.

use vitruvian_reference::nn::{Rounded, Tensor};

use crate::onnx::message::{AttributeProto, NodeProto};
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// The operands of a node, `None` where one is left out.
pub type Operands<'a> = [Option<&'a Value<Rounded>>];

/// The outputs under some meaning, or why it has none for these operands.
pub type Outputs = Result<Vec<Option<Value<Rounded>>>, String>;

/// What a node could mean: its outputs from the node, its operator set's version and its operands.
pub type Meaning = Box<dyn Fn(&NodeProto, i64, &Operands) -> Outputs + Send + Sync>;

/// Where each element comes from: given the places of a tensor, the places in another arrangement.
pub type Arrangement = Box<dyn Fn(&Tensor<usize>) -> Option<Tensor<usize>> + Send + Sync>;

/// What the node specifies.
pub fn specified() -> Meaning {
    Box::new(walk::evaluate::<Rounded>)
}

/// An attribute by its name.
pub fn attribute<'a>(node: &'a NodeProto, name: &str) -> Option<&'a AttributeProto> {
    node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name))
}

/// An integer attribute, or ONNX's default.
pub fn int(node: &NodeProto, name: &str, default: i64) -> i64 {
    attribute(node, name).map_or(default, |attribute| attribute.i.unwrap_or(0))
}

/// A number attribute, or ONNX's default.
pub fn float(node: &NodeProto, name: &str, default: f32) -> f32 {
    attribute(node, name).map_or(default, |attribute| attribute.f.unwrap_or(0.0))
}

/// A text attribute, or ONNX's default.
pub fn text<'a>(node: &'a NodeProto, name: &str, default: &'a str) -> &'a str {
    attribute(node, name).map_or(default, |attribute| {
        std::str::from_utf8(attribute.s.as_deref().unwrap_or_default()).unwrap_or_default()
    })
}

/// A list of integers, empty where it is not given.
pub fn ints(node: &NodeProto, name: &str) -> Vec<i64> {
    attribute(node, name).map(|attribute| attribute.ints.clone()).unwrap_or_default()
}

/// The node with these attributes in place of those of the same names.
pub fn with_attributes(node: &NodeProto, attributes: &[AttributeProto]) -> NodeProto {
    let mut node = node.clone();
    node.attribute.retain(|old| attributes.iter().all(|new| new.name != old.name));
    node.attribute.extend_from_slice(attributes);
    node
}

/// The node with other attributes.
pub fn attributes(attributes: Vec<AttributeProto>) -> Meaning {
    Box::new(move |node, opset, operands| {
        walk::evaluate(&with_attributes(node, &attributes), opset, operands)
    })
}

/// Another operator with these attributes alone, on the operands named by their places.
pub fn operator(name: &'static str, attributes: Vec<AttributeProto>, places: &'static [usize]) -> Meaning {
    Box::new(move |node, opset, operands| {
        let node = NodeProto { op_type: Some(name.into()), attribute: attributes.clone(), ..node.clone() };
        let operands: Vec<_> = places.iter().map(|&i| operands.get(i).copied().flatten()).collect();
        walk::evaluate(&node, opset, &operands)
    })
}

/// The node with the same attributes, read as in another version of the operator set.
pub fn in_opset(other: i64) -> Meaning {
    Box::new(move |node, _, operands| walk::evaluate(node, other, operands))
}

/// The node on its operands in another order; a place beyond them leaves the operand out.
pub fn reordered(places: Vec<usize>) -> Meaning {
    Box::new(move |node, opset, operands| {
        let operands: Vec<_> = places.iter().map(|&i| operands.get(i).copied().flatten()).collect();
        walk::evaluate(node, opset, &operands)
    })
}

/// The node with one operand changed.
pub fn operand(
    place: usize,
    change: impl Fn(&Value<Rounded>) -> Option<Value<Rounded>> + Send + Sync + 'static,
) -> Meaning {
    operand_then(place, change, specified())
}

/// A meaning of the node with one operand changed.
pub fn operand_then(
    place: usize,
    change: impl Fn(&Value<Rounded>) -> Option<Value<Rounded>> + Send + Sync + 'static,
    meaning: Meaning,
) -> Meaning {
    Box::new(move |node, opset, operands| {
        let old = operands.get(place).copied().flatten().ok_or("has no such operand")?;
        let new = change(old).ok_or("has no such change")?;
        let mut operands = operands.to_vec();
        operands[place] = Some(&new);
        meaning(node, opset, &operands)
    })
}

/// The node with every number of one operand changed, each kept in the operand's type.
pub fn numbers(place: usize, change: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Meaning {
    operand(place, move |old| {
        let element = old.element;
        changed(old, |x| element.round(change(x.value)))
    })
}

/// The node with every element of one operand changed, be they numbers or integers.
pub fn elements(place: usize, change: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Meaning {
    operand(place, move |old| match &old.data {
        Data::Integers(x) => {
            let new = x.map(|i| change(i as f64) as i64);
            Some(Value { element: old.element, data: Data::Integers(new) })
        }
        _ => changed(old, |x| old.element.round(change(x.value))),
    })
}

/// The node with every number of all operands that hold numbers changed.
pub fn all_numbers(change: impl Fn(f64) -> f64 + Send + Sync + 'static) -> Meaning {
    Box::new(move |node, opset, operands| {
        let new: Vec<Option<Value<Rounded>>> = operands
            .iter()
            .map(|old| old.map(|old| changed(old, |x| change(x.value)).unwrap_or_else(|| old.clone())))
            .collect();
        walk::evaluate(node, opset, &new.iter().map(Option::as_ref).collect::<Vec<_>>())
    })
}

/// A value with every number changed, all exact; `None` for integers and truths.
pub fn changed(value: &Value<Rounded>, change: impl Fn(Rounded) -> f64) -> Option<Value<Rounded>> {
    let x = value.numbers().ok()?;
    let data = x.data.iter().map(|&x| exact(change(x))).collect();
    Some(Value { element: value.element, data: Data::Numbers(Tensor::new(&x.shape, data)) })
}

/// A number without error.
pub fn exact(value: f64) -> Rounded {
    Rounded { value, magnitude: value.abs(), terms: 0.0 }
}

/// The node with one list of integers changed, such as indices or axes.
pub fn integers(
    place: usize,
    change: impl Fn(&Tensor<i64>) -> Option<Tensor<i64>> + Send + Sync + 'static,
) -> Meaning {
    operand(place, move |old| {
        let new = change(old.integers().ok()?)?;
        Some(Value { element: old.element, data: Data::Integers(new) })
    })
}

/// The node with one operand's elements in another arrangement.
pub fn operand_arranged(place: usize, arrangement: Arrangement) -> Meaning {
    operand(place, move |old| rearranged(old, &arrangement))
}

/// The specified outputs with the first one's elements in another arrangement.
pub fn output_arranged(arrangement: Arrangement) -> Meaning {
    output(move |y| rearranged(y, &arrangement))
}

/// The specified outputs with the first one changed.
pub fn output(change: impl Fn(&Value<Rounded>) -> Option<Value<Rounded>> + Send + Sync + 'static) -> Meaning {
    Box::new(move |node, opset, operands| {
        let mut outputs = walk::evaluate(node, opset, operands)?;
        let first = outputs.first_mut().and_then(Option::as_mut).ok_or("has no first output")?;
        *first = change(first).ok_or("has no such change")?;
        Ok(outputs)
    })
}

/// The specified outputs with every number of the first one changed by one more operation.
pub fn output_numbers(change: impl Fn(Rounded) -> Rounded + Send + Sync + 'static) -> Meaning {
    output(move |y| {
        let x = y.numbers().ok()?;
        Some(Value { element: y.element, data: Data::Numbers(x.map(&change)) })
    })
}

/// A value with its elements in another arrangement.
pub fn rearranged(value: &Value<Rounded>, arrangement: &Arrangement) -> Option<Value<Rounded>> {
    Value::arranged(&[value], |places| {
        arrangement(&places[0]).ok_or_else(|| "has no such arrangement".into())
    })
    .ok()
}

/// Axes in another order.
pub fn permuted(order: Vec<usize>) -> Arrangement {
    Box::new(move |x| {
        if order.len() != x.shape.len() {
            return None;
        }
        let shape: Vec<usize> = order.iter().map(|&axis| x.shape[axis]).collect();
        let strides = strides(&x.shape);
        Some(Tensor::from_fn(&shape, |index| {
            x.data[order.iter().zip(index).map(|(&axis, &i)| i * strides[axis]).sum::<usize>()]
        }))
    })
}

/// The same elements in the same order under the axes' lengths in another order: `order` of the shape, not of the data.
///
/// So numbers look that lie in memory as N H W C and are read as N C H W.
pub fn misread(order: Vec<usize>) -> Arrangement {
    Box::new(move |x| {
        let moved = permuted(order.clone())(x)?;
        Some(Tensor::new(&x.shape, moved.data))
    })
}

/// The inverse of [`misread`].
pub fn misread_back(order: Vec<usize>) -> Arrangement {
    Box::new(move |x| {
        if order.len() != x.shape.len() {
            return None;
        }
        let shape: Vec<usize> = order.iter().map(|&axis| x.shape[axis]).collect();
        let inverse = (0..order.len())
            .map(|axis| order.iter().position(|&from| from == axis))
            .collect::<Option<_>>()?;
        permuted(inverse)(&Tensor::new(&shape, x.data.clone()))
    })
}

/// Index −1 − i for i along these axes.
pub fn flipped(axes: Vec<usize>) -> Arrangement {
    Box::new(move |x| along(x, |axis, i| if axes.contains(&axis) { x.shape[axis] - 1 - i } else { i }))
}

/// Slice `order[i]` for slice i of an axis.
pub fn chosen(axis: usize, order: Vec<usize>) -> Arrangement {
    Box::new(move |x| {
        if x.shape.get(axis) != Some(&order.len()) {
            return None;
        }
        along(x, |a, i| if a == axis { order[i] } else { i })
    })
}

/// Every element from an index found axis by axis.
fn along(x: &Tensor<usize>, from: impl Fn(usize, usize) -> usize) -> Option<Tensor<usize>> {
    let strides = strides(&x.shape);
    Some(Tensor::from_fn(&x.shape, |index| {
        x.data[index.iter().enumerate().map(|(axis, &i)| from(axis, i) * strides[axis]).sum::<usize>()]
    }))
}

/// How far apart neighbours along each axis lie.
pub fn strides(shape: &[usize]) -> Vec<usize> {
    (0..shape.len()).map(|axis| shape[axis + 1..].iter().product()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn places(shape: &[usize]) -> Tensor<usize> {
        Tensor::new(shape, (0..shape.iter().product()).collect())
    }

    #[test]
    fn misreading_and_reading_back_is_nothing() {
        let x = places(&[2, 3, 4, 5]);
        let order = vec![0, 2, 3, 1];
        let wrong = misread(order.clone())(&x).expect("four axes");
        assert_eq!(wrong.shape, x.shape, "only the elements move");
        assert_ne!(wrong, x, "and they do move");
        assert_eq!(misread_back(order)(&wrong), Some(x), "back");
    }

    #[test]
    fn flipping_is_an_involution_and_choosing_takes_slices() {
        let x = places(&[2, 3]);
        let flip = flipped(vec![1]);
        assert_eq!(flip(&x).expect("fits").data, [2, 1, 0, 5, 4, 3], "the last axis");
        assert_eq!(flip(&flip(&x).expect("fits")), Some(x.clone()), "twice");
        assert_eq!(chosen(0, vec![1, 1])(&x).expect("fits").data, [3, 4, 5, 3, 4, 5], "one slice twice");
        assert!(chosen(0, vec![0])(&x).is_none() && permuted(vec![0])(&x).is_none(), "other shapes");
    }
}
