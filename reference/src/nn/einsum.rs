//! Einstein's summation: products of tensors with named axes, summed over the names that the result lacks.
//!
//! "bi,bi->b" is the inner product of each pair of rows, "ij,jk->ik" the matrix product, "bij->bji" a transposition,
//! "ii->i" a diagonal, "...ij->...ji" a transposition of the last two axes, however many come before.
//!
//! Rounding: a product of K factors rounds K − 1 times, the sum as any sum.

use super::{Ring, Tensor};

/// Σ over the names that stand on the left of the arrow only, of the products of the operands.
///
/// Names are single letters; a name that an operand has twice walks along its diagonal. Without an arrow the result has the
/// names that occur once, in alphabetic order. A name has one length; a length of one repeats. An ellipsis stands for the axes
/// that have no name: they are aligned at the last one and broadcast, and without an arrow come first.
///
/// # Panics
/// If the equation is no list of names for these operands, names an axis twice in the result, or lengths differ.
///
/// # References
/// ONNX operator Einsum (version 12); Einstein 1916.
///
/// ```
/// use vitruvian_reference::nn::{Tensor, einsum};
/// let rows = Tensor::new(&[2, 2], vec![1.0, 2.0, 3.0, 4.0]);
/// assert_eq!(einsum("bi,bi->b", &[&rows, &rows]), Tensor::new(&[2], vec![5.0, 25.0]));
/// ```
pub fn einsum<T: Ring>(equation: &str, operands: &[&Tensor<T>]) -> Tensor<T> {
    let shapes: Vec<&[usize]> = operands.iter().map(|x| &x.shape[..]).collect();
    let Named { operands: names, result } = named(equation, &shapes);
    let mut summed: Vec<Axis> =
        names.iter().flatten().filter(|axis| !result.contains(axis)).copied().collect();
    summed.sort_unstable();
    summed.dedup();
    let lengths = |axes: &[Axis]| -> Vec<usize> {
        axes.iter().map(|&axis| length(equation, &names, &shapes, axis)).collect()
    };
    let (outer, inner) = (lengths(&result), lengths(&summed));

    // How far each operand moves when a name's index grows by one.
    let strides = |over: &[Axis]| -> Vec<Vec<usize>> {
        let of_operand = |(names, x): (&Vec<Axis>, &&Tensor<T>)| {
            let own = x.strides();
            let of_axis = |axis: &Axis| {
                (0..names.len()).filter(|&k| names[k] == *axis && x.shape[k] != 1).map(|k| own[k]).sum()
            };
            over.iter().map(of_axis).collect()
        };
        names.iter().zip(operands).map(of_operand).collect()
    };
    let (outer_strides, inner_strides) = (strides(&result), strides(&summed));
    let place =
        |strides: &[usize], index: &[usize]| -> usize { strides.iter().zip(index).map(|(s, i)| s * i).sum() };
    Tensor::from_fn(&outer, |index| {
        let bases: Vec<usize> = outer_strides.iter().map(|strides| place(strides, index)).collect();
        let mut inner_index = vec![0; inner.len()];
        let mut sum = T::ZERO;
        for _ in 0..inner.iter().product() {
            let factor = |k: usize| operands[k].data[bases[k] + place(&inner_strides[k], &inner_index)];
            sum = match operands.len() {
                2 => sum.plus_product(factor(0), factor(1)),
                n => sum.plus((1..n).fold(factor(0), |product, k| product * factor(k))),
            };
            super::tensor::advance(&mut inner_index, &inner);
        }
        sum
    })
}

/// The shape of the result, for operands of these shapes.
///
/// # Panics
/// As [`einsum`].
pub fn einsum_shape(equation: &str, shapes: &[&[usize]]) -> Vec<usize> {
    let Named { operands, result } = named(equation, shapes);
    result.iter().map(|&axis| length(equation, &operands, shapes, axis)).collect()
}

/// The length of an axis, which all operands that have it share, unless it is one.
fn length(equation: &str, names: &[Vec<Axis>], shapes: &[&[usize]], axis: Axis) -> usize {
    let lengths: Vec<usize> = names
        .iter()
        .zip(shapes)
        .flat_map(|(names, shape)| names.iter().zip(*shape).filter(|(own, _)| **own == axis))
        .map(|(_, &n)| n)
        .collect();
    let length = *lengths
        .iter()
        .find(|&&n| n != 1)
        .or(lengths.first())
        .unwrap_or_else(|| panic!("einsum: {equation:?} has no operand with {axis}"));
    assert!(
        lengths.iter().all(|&n| n == 1 || n == length),
        "einsum: {axis} of {equation:?} has several lengths in shapes {shapes:?}"
    );
    length
}

/// An axis of an equation: one that an ellipsis stands for, counted from the last, or one that has a letter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Axis {
    Ellipsis(usize),
    Letter(char),
}

impl std::fmt::Display for Axis {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Axis::Ellipsis(k) => write!(f, "the ellipsis' axis {k} from the last"),
            Axis::Letter(c) => write!(f, "axis {c:?}"),
        }
    }
}

/// An equation for tensors of known ranks: every axis of every operand has a name.
struct Named {
    operands: Vec<Vec<Axis>>,
    result: Vec<Axis>,
}

fn named(equation: &str, shapes: &[&[usize]]) -> Named {
    let complain = || -> ! { panic!("einsum: {equation:?} does not name the axes of shapes {shapes:?}") };
    let text: String = equation.chars().filter(|c| !c.is_whitespace()).collect();
    let (left, right) = match text.split_once("->") {
        Some((left, right)) => (left, Some(right)),
        None => (&text[..], None),
    };
    // The names of a term whose ellipsis, if it has one, stands for `hidden` axes.
    let axes = |term: &str, hidden: usize| -> Vec<Axis> {
        let letters = |part: &str| -> Vec<Axis> {
            if !part.chars().all(|c| c.is_ascii_alphabetic()) {
                complain();
            }
            part.chars().map(Axis::Letter).collect()
        };
        match term.split_once("...") {
            None => letters(term),
            Some((before, after)) => {
                let ellipsis = (0..hidden).rev().map(Axis::Ellipsis).collect();
                [letters(before), ellipsis, letters(after)].concat()
            }
        }
    };
    let terms: Vec<&str> = left.split(',').collect();
    if terms.len() != shapes.len() {
        complain();
    }
    let operands: Vec<Vec<Axis>> = terms
        .iter()
        .zip(shapes)
        .map(|(term, shape)| axes(term, (shape.len() + 3).saturating_sub(term.len())))
        .collect();
    if operands.iter().zip(shapes).any(|(names, shape)| names.len() != shape.len()) {
        complain();
    }
    let mut all: Vec<Axis> = operands.concat();
    all.sort_unstable();
    let hidden =
        all.iter().filter_map(|axis| if let Axis::Ellipsis(k) = axis { Some(k + 1) } else { None }).max();
    let hidden = hidden.unwrap_or(0);
    let result = match right {
        Some(right) => axes(right, hidden),
        None => {
            let once = |axis: &Axis| all.iter().filter(|other| *other == axis).count() == 1;
            let letters = all.iter().filter(|axis| matches!(axis, Axis::Letter(_)) && once(axis));
            (0..hidden).rev().map(Axis::Ellipsis).chain(letters.copied()).collect()
        }
    };
    let duplicates = (1..result.len()).any(|k| result[..k].contains(&result[k]));
    assert!(!duplicates, "einsum: {equation:?} names an axis of the result twice");
    Named { operands, result }
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::super::{matmul, reduce_sum, transpose};
    use super::*;
    use std::num::Wrapping;

    #[test]
    fn known_operators_are_special_cases() {
        let (a, b) = (pattern(&[3, 4], 1), pattern(&[4, 2], 2));
        assert_eq!(einsum("ij,jk->ik", &[&a, &b]), matmul(&a, &b));
        assert_eq!(einsum("ij,jk", &[&a, &b]), matmul(&a, &b), "the names that occur once");
        assert_eq!(einsum("ij->ji", &[&a]), transpose(&a, &[1, 0]));
        let square = pattern(&[2, 2], 1);
        assert_eq!(einsum("ii->", &[&square]).data, [square.data[0] + square.data[3]], "a trace");
        assert_eq!(einsum("ii->i", &[&square]).data, [square.data[0], square.data[3]], "a diagonal");
    }

    #[test]
    fn an_ellipsis_stands_for_the_axes_without_a_name() {
        let (a, b) = (pattern(&[2, 5, 3, 4], 1), pattern(&[5, 4, 2], 2));
        assert_eq!(einsum("...ij,...jk->...ik", &[&a, &b]), matmul(&a, &b));
        assert_eq!(einsum("...ij,...jk", &[&a, &b]), matmul(&a, &b), "it comes first");
        assert_eq!(einsum("...j->...", &[&a]), reduce_sum(&a, &[3], false));
        let one = pattern(&[1, 4, 2], 2);
        assert_eq!(einsum("...ij,...jk->...ik", &[&a, &one]), matmul(&a, &one), "and broadcasts");
        assert_eq!(einsum("ij...->...", &[&pattern(&[2, 3], 1)]).shape, [0usize; 0], "it may be empty");
        assert_eq!(einsum("...ii->...i", &[&pattern(&[2, 3, 3], 1)]).shape, [2, 3]);
    }

    #[test]
    fn agrees_with_pytorch() {
        let (a, b, c) = (pattern(&[2, 3, 4], 1), pattern(&[2, 4, 3], 2), pattern(&[3], 3));
        check(&einsum("bij,bjk,k->bik", &[&a, &b, &c]), &goldens::EINSUM);
    }

    #[test]
    fn a_dot_product_counts_its_products() {
        let x = Tensor::new(&[1, 3], vec![1.0, -2.0, 3.0]).rounded();
        let y = einsum("bi,bi->b", &[&x, &x]).data[0];
        assert_eq!((y.value, y.magnitude, y.terms), (14.0, 14.0, 3.0));
    }

    #[test]
    fn integers_wrap() {
        let x = Tensor::new(&[2], vec![Wrapping(i64::MAX), Wrapping(1)]);
        assert_eq!(einsum("i->", &[&x]).data, [Wrapping(i64::MIN)]);
    }

    #[test]
    #[should_panic(expected = "axis 'i' of \"bi,bi->b\" has several lengths")]
    fn a_name_has_one_length() {
        einsum("bi,bi->b", &[&Tensor::<f64>::zeros(&[2, 3]), &Tensor::zeros(&[2, 2])]);
    }

    #[test]
    #[should_panic(expected = "does not name the axes of shapes [[2, 3]]")]
    fn every_axis_has_a_name() {
        einsum("b->b", &[&Tensor::<f64>::zeros(&[2, 3])]);
    }

    #[test]
    #[should_panic(expected = "names an axis of the result twice")]
    fn the_result_has_each_name_once() {
        einsum("ij->ii", &[&Tensor::<f64>::zeros(&[2, 3])]);
    }
}
