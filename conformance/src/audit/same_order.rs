//! Nodes that give their operand's elements in the same order under another shape.

use super::case::{Operand, View};

/// The output's shape of such a node; `None` of another node, or where its operands do not say.
pub(super) fn shape(view: &View) -> Option<Vec<usize>> {
    let x = view.operands.first()?.as_ref()?.shape();
    let count: usize = x.iter().product();
    let attribute =
        |name: &str| view.node.attribute.iter().find(|attribute| attribute.name.as_deref() == Some(name));
    let given = || match view.operands.get(1)?.as_ref()? {
        Operand::Given(tensor) => match &tensor.elements {
            crate::onnx::typed_tensor::Elements::I64(v) => Some(v.clone()),
            _ => None,
        },
        Operand::Derived(_) => None,
    };
    let list = |name: &str| attribute(name).map(|attribute| attribute.ints.clone()).or_else(given);
    let within = |axis: i64, rank: usize| {
        usize::try_from(if axis < 0 { axis + rank as i64 } else { axis }).ok().filter(|&axis| axis < rank)
    };
    let shape = match view.operator() {
        "Reshape" => {
            let wanted = given()?;
            let keeps_zero = attribute("allowzero").is_some_and(|attribute| attribute.i == Some(1));
            let side = |(axis, &side): (usize, &i64)| match side {
                0 if !keeps_zero => x.get(axis).copied(),
                -1 => Some(usize::MAX),
                side => usize::try_from(side).ok(),
            };
            let mut shape: Vec<usize> = wanted.iter().enumerate().map(side).collect::<Option<_>>()?;
            let known: usize = shape.iter().filter(|&&side| side != usize::MAX).product();
            let open = shape.iter_mut().find(|side| **side == usize::MAX);
            if let Some(open) = open {
                *open = count.checked_div(known)?;
            }
            shape
        }
        "Flatten" => {
            let axis = attribute("axis").map_or(1, |attribute| attribute.i.unwrap_or(0));
            let axis = if axis == x.len() as i64 { x.len() } else { within(axis, x.len())? };
            vec![x[..axis].iter().product(), x[axis..].iter().product()]
        }
        "Squeeze" => {
            let axes = list("axes").unwrap_or_default();
            let axes: Vec<usize> =
                axes.into_iter().map(|axis| within(axis, x.len())).collect::<Option<_>>()?;
            let goes = |axis: usize| if axes.is_empty() { x[axis] == 1 } else { axes.contains(&axis) };
            (0..x.len()).filter(|&axis| !goes(axis)).map(|axis| x[axis]).collect()
        }
        "Unsqueeze" => {
            let axes = list("axes")?;
            let rank = x.len() + axes.len();
            let axes: Vec<usize> = axes.into_iter().map(|axis| within(axis, rank)).collect::<Option<_>>()?;
            let mut sides = x.iter();
            (0..rank)
                .map(|axis| if axes.contains(&axis) { Some(1) } else { sides.next().copied() })
                .collect::<Option<_>>()?
        }
        _ => return None,
    };
    let fits = shape.iter().try_fold(1_usize, |n, &side| n.checked_mul(side)) == Some(count);
    fits.then_some(shape)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::case::Case;
    use crate::onnx::builder::{GraphBuilder, int};
    use crate::onnx::model::Model;
    use crate::onnx::typed_tensor::{Elements, TypedTensor};

    fn asked(operator: &str, axis: Option<i64>, sides: &[i64]) -> Option<Vec<usize>> {
        let attributes = axis.map(|axis| int("axis", axis)).into_iter().collect();
        let bytes = GraphBuilder::new(21).input("x", &[2, 1, 6]).integers("s", &[sides.len()], sides).node(
            operator,
            &["x", "s"],
            &["y"],
            attributes,
        );
        let model = Model::from_bytes("g", bytes.output("y").to_bytes()).expect("a model");
        let x = TypedTensor { shape: vec![2, 1, 6], elements: Elements::F32(vec![0.0; 12]) };
        let list = TypedTensor { shape: vec![sides.len()], elements: Elements::I64(sides.to_vec()) };
        let case = Case {
            node: model.nodes()[0].clone(),
            opset: 21,
            name: "node".into(),
            operands: vec![Some(x), (!sides.is_empty()).then_some(list)],
            found: vec![None],
        };
        shape(&case.view())
    }

    #[test]
    fn the_shape_is_the_one_that_onnx_says() {
        assert_eq!(asked("Reshape", None, &[0, -1, 3]), Some(vec![2, 2, 3]));
        assert_eq!(asked("Reshape", None, &[5]), None, "twelve elements do not fit");
        assert_eq!(asked("Flatten", Some(1), &[]), Some(vec![2, 6]));
        assert_eq!(asked("Squeeze", None, &[]), Some(vec![2, 6]));
        assert_eq!(asked("Squeeze", None, &[-2]), Some(vec![2, 6]));
        assert_eq!(asked("Unsqueeze", None, &[0, -1]), Some(vec![1, 2, 1, 6, 1]));
        assert_eq!(asked("Relu", None, &[]), None, "another node");
    }
}
