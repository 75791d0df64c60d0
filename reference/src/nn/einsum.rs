//! Einstein's summation: products of tensors with named axes, summed over the names that the result lacks.
//!
//! "bi,bi->b" is the inner product of each pair of rows, "ij,jk->ik" the matrix product, "bij->bji" a transposition.
//!
//! Rounding: a product of K factors rounds K − 1 times, the sum as any sum.

use super::{Scalar, Tensor};

/// Σ over the names that stand on the left of the arrow only, of the products of the operands.
///
/// Names are single letters; without an arrow the result has the names that occur once, in alphabetic order. A name has one
/// length; a length of one repeats.
///
/// # Panics
/// If the equation is no list of names for these operands, names an axis twice in the result, or lengths differ. An ellipsis
/// is not understood.
///
/// # References
/// ONNX operator Einsum (version 12); Einstein 1916.
///
/// ```
/// use vitruvian_reference::nn::{Tensor, einsum};
/// let rows = Tensor::new(&[2, 2], vec![1.0, 2.0, 3.0, 4.0]);
/// assert_eq!(einsum("bi,bi->b", &[&rows, &rows]), Tensor::new(&[2], vec![5.0, 25.0]));
/// ```
pub fn einsum<T: Scalar>(equation: &str, operands: &[&Tensor<T>]) -> Tensor<T> {
    let equation: String = equation.chars().filter(|c| !c.is_whitespace()).collect();
    let (left, right) = match equation.split_once("->") {
        Some((left, right)) => (left, right.chars().collect()),
        None => (equation.as_str(), names_that_occur_once(&equation)),
    };
    let names: Vec<Vec<char>> = left.split(',').map(|names| names.chars().collect()).collect();
    let fits = names.len() == operands.len()
        && names.iter().zip(operands).all(|(names, x)| names.len() == x.rank())
        && names.iter().flatten().all(|name| name.is_ascii_alphabetic());
    let shapes: Vec<&[usize]> = operands.iter().map(|x| &x.shape[..]).collect();
    assert!(fits, "einsum: {equation:?} does not name the axes of shapes {shapes:?}");

    // The result's names come first, then those that are summed over.
    let mut all = right.clone();
    all.extend(names.iter().flatten().filter(|name| !right.contains(name)));
    let mut summed: Vec<char> = all.split_off(right.len());
    summed.sort_unstable();
    summed.dedup();
    let length = |name: char| {
        let mut lengths = names.iter().zip(&shapes).flat_map(|(names, shape)| {
            names.iter().zip(*shape).filter(move |(own, _)| **own == name).map(|(_, n)| *n)
        });
        let longest = lengths.clone().max();
        let longest =
            longest.unwrap_or_else(|| panic!("einsum: {equation:?} has no operand with axis {name:?}"));
        assert!(
            lengths.all(|n| n == 1 || n == longest),
            "einsum: axis {name:?} of {equation:?} has several lengths in shapes {shapes:?}"
        );
        longest
    };
    let shape: Vec<usize> = right.iter().map(|&name| length(name)).collect();
    let inner: Vec<usize> = summed.iter().map(|&name| length(name)).collect();
    let duplicates = (1..right.len()).any(|k| right[..k].contains(&right[k]));
    assert!(!duplicates, "einsum: {equation:?} names an axis of the result twice");

    let place = |names: &[char], x: &Tensor<T>, outer: &[usize], inner: &[usize]| {
        let index = |name: &char| match right.iter().position(|n| n == name) {
            Some(k) => outer[k],
            None => inner[summed.iter().position(|n| n == name).expect("every name is kept or summed")],
        };
        names
            .iter()
            .zip(&x.shape)
            .fold(0, |offset, (name, &n)| offset * n + if n == 1 { 0 } else { index(name) })
    };
    Tensor::from_fn(&shape, |outer| {
        let mut sum = T::ZERO;
        let mut index = vec![0; inner.len()];
        for _ in 0..inner.iter().product() {
            let mut factors =
                names.iter().zip(operands).map(|(names, x)| x.data[place(names, x, outer, &index)]);
            let first = factors.next().expect("an equation has an operand");
            sum = sum.plus(factors.fold(first, |product, factor| product * factor));
            super::tensor::advance(&mut index, &inner);
        }
        sum
    })
}

fn names_that_occur_once(left: &str) -> Vec<char> {
    let mut names: Vec<char> = left.chars().filter(|c| *c != ',').collect();
    names.sort_unstable();
    let once = |name: &char| names.iter().filter(|n| *n == name).count() == 1;
    names.iter().copied().filter(once).collect()
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::super::{matmul, transpose};
    use super::*;

    #[test]
    fn known_operators_are_special_cases() {
        let (a, b) = (pattern(&[3, 4], 1), pattern(&[4, 2], 2));
        assert_eq!(einsum("ij,jk->ik", &[&a, &b]), matmul(&a, &b));
        assert_eq!(einsum("ij,jk", &[&a, &b]), matmul(&a, &b), "the names that occur once");
        assert_eq!(einsum("ij->ji", &[&a]), transpose(&a, &[1, 0]));
        assert_eq!(
            einsum("ii->", &[&pattern(&[2, 2], 1)]).data,
            [pattern(&[2, 2], 1).data[0] + pattern(&[2, 2], 1).data[3]]
        );
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
    #[should_panic(expected = "axis 'i' of \"bi,bi->b\" has several lengths")]
    fn a_name_has_one_length() {
        einsum("bi,bi->b", &[&Tensor::<f64>::zeros(&[2, 3]), &Tensor::zeros(&[2, 2])]);
    }

    #[test]
    #[should_panic(expected = "does not name the axes of shapes [[2, 3]]")]
    fn every_axis_has_a_name() {
        einsum("b->b", &[&Tensor::<f64>::zeros(&[2, 3])]);
    }
}
