//! Matrix products: [`gemm`], the batched [`matmul`], and the fully connected layer [`linear`].
//!
//! Rounding: dot products of K terms, and what is added.

use super::elementwise::{broadcast, broadcast_offset, broadcast_shape};
use super::{Ring, Tensor, add, transpose};

/// C\[M,N\] += A\[M,K\]·B\[K,N\] on row-major slices.
fn add_product<T: Ring>(c: &mut [T], a: &[T], b: &[T], inner: usize, columns: usize) {
    for (row, a) in c.chunks_exact_mut(columns.max(1)).zip(a.chunks_exact(inner.max(1))) {
        for (k, &a) in a.iter().enumerate() {
            for (c, &b) in row.iter_mut().zip(&b[k * columns..(k + 1) * columns]) {
                *c = c.plus_product(a, b);
            }
        }
    }
}

/// α·A′B′ + β·C with A′ = A or Aᵀ and B′ = B or Bᵀ; A′ \[M,K\], B′ \[K,N\], C broadcast to \[M,N\].
///
/// # Panics
/// If A or B is no matrix, or the shapes do not fit.
///
/// # References
/// ONNX operator Gemm (version 13).
pub fn gemm<T: Ring>(
    a: &Tensor<T>,
    b: &Tensor<T>,
    c: Option<&Tensor<T>>,
    alpha: T,
    beta: T,
    trans_a: bool,
    trans_b: bool,
) -> Tensor<T> {
    let matrices = a.rank() == 2 && b.rank() == 2;
    assert!(matrices, "gemm: A {:?} and B {:?} must be matrices", a.shape, b.shape);
    let a = if trans_a { transpose(a, &[1, 0]) } else { a.clone() };
    let b = if trans_b { transpose(b, &[1, 0]) } else { b.clone() };
    let product = scaled(matmul(&a, &b), alpha);
    let Some(c) = c else { return product };
    let fits = broadcast_shape(&product.shape, &c.shape).is_some_and(|shape| shape == product.shape);
    assert!(fits, "gemm: C {:?} does not broadcast to the product {:?}", c.shape, product.shape);
    let c = scaled(c.clone(), beta);
    // The product may be summed on top of βC: the addition belongs to the sum, whose order is free.
    broadcast("gemm", &c, &product, T::plus)
}

/// α·x, which is x itself for α = 1.
fn scaled<T: Ring>(x: Tensor<T>, alpha: T) -> Tensor<T> {
    if alpha == T::one() { x } else { x.map(|v| alpha * v) }
}

/// A [..,M,K] · B [..,K,N] → [..,M,N]; leading axes broadcast, a vector is a row (A) or a column (B) and loses that axis.
///
/// # Panics
/// If the inner axes differ or the leading ones do not broadcast.
///
/// # References
/// ONNX operator MatMul (version 13), which is NumPy's.
pub fn matmul<T: Ring>(a: &Tensor<T>, b: &Tensor<T>) -> Tensor<T> {
    assert!(
        a.rank() > 0 && b.rank() > 0,
        "matmul: a scalar is no matrix; shapes {:?} and {:?}",
        a.shape,
        b.shape
    );
    if a.rank() == 1 {
        let mut y = matmul(&a.reshape(&[1, a.shape[0]]), b);
        y.shape.remove(y.rank() - if b.rank() == 1 { 1 } else { 2 });
        return y;
    }
    if b.rank() == 1 {
        let mut y = matmul(a, &b.reshape(&[b.shape[0], 1]));
        y.shape.pop();
        return y;
    }
    let (outer_a, inner_a) = a.shape.split_at(a.rank() - 2);
    let (outer_b, inner_b) = b.shape.split_at(b.rank() - 2);
    let outer = broadcast_shape(outer_a, outer_b).filter(|_| inner_a[1] == inner_b[0]);
    let outer = outer.unwrap_or_else(|| panic!("matmul: shapes {:?} and {:?} do not fit", a.shape, b.shape));
    let (rows, inner, columns) = (inner_a[0], inner_a[1], inner_b[1]);
    let mut y = Tensor::filled(&[&outer[..], &[rows, columns]].concat(), T::ZERO);
    let mut index = vec![0; outer.len()];
    for c in y.data.chunks_exact_mut((rows * columns).max(1)) {
        let a = &a.data[broadcast_offset(outer_a, &index) * rows * inner..][..rows * inner];
        let b = &b.data[broadcast_offset(outer_b, &index) * inner * columns..][..inner * columns];
        add_product(c, a, b, inner, columns);
        super::tensor::advance(&mut index, &outer);
    }
    y
}

/// A fully connected layer as PyTorch stores it: x [..,K], w \[N,K\], bias \[N\] → x wᵀ + bias [..,N].
///
/// # Panics
/// If the shapes do not fit.
pub fn linear<T: Ring>(x: &Tensor<T>, w: &Tensor<T>, bias: &Tensor<T>) -> Tensor<T> {
    assert!(w.rank() == 2, "linear: w must be [N,K], found shape {:?}", w.shape);
    add(&matmul(x, &transpose(w, &[1, 0])), bias)
}

#[cfg(test)]
mod tests {
    use super::super::goldens::{self, check, pattern};
    use super::super::{Rounded, Scalar as _};
    use super::*;
    use std::num::Wrapping;

    #[test]
    fn a_product_by_hand() {
        let a = Tensor::new(&[2, 3], vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let b = Tensor::new(&[3, 1], vec![1.0, 10.0, 100.0]);
        assert_eq!(matmul(&a, &b), Tensor::new(&[2, 1], vec![321.0, 654.0]));
        assert_eq!(
            matmul(&a, &Tensor::new(&[3], vec![1.0, 10.0, 100.0])),
            Tensor::new(&[2], vec![321.0, 654.0])
        );
        let row = Tensor::new(&[2], vec![1.0, -1.0]);
        assert_eq!(matmul(&row, &a), Tensor::new(&[3], vec![-3.0, -3.0, -3.0]));
        assert_eq!(matmul(&row, &row), Tensor::new(&[], vec![2.0]));
        let w = Tensor::new(&[1, 3], vec![1.0, 10.0, 100.0]);
        assert_eq!(linear(&a, &w, &Tensor::new(&[1], vec![0.5])).data, [321.5, 654.5]);
    }

    #[test]
    fn agrees_with_pytorch() {
        let (a, b) = (pattern(&[2, 1, 3, 4], 1), pattern(&[3, 4, 2], 2));
        check(&matmul(&a, &b), &goldens::MATMUL);
        let (a, b, c) = (pattern(&[4, 3], 3), pattern(&[2, 4], 4), pattern(&[2], 5));
        check(&gemm(&a, &b, Some(&c), 0.5, 2.0, true, true), &goldens::GEMM);
    }

    #[test]
    fn terms_count_the_inner_axis_the_scale_and_the_addition() {
        let (a, b) = (pattern(&[2, 5], 1).rounded(), pattern(&[5, 2], 2).rounded());
        let c = pattern(&[2], 3).rounded();
        assert_eq!(matmul(&a, &b).terms().data, [5.0; 4]);
        assert_eq!(
            gemm(&a, &b, Some(&c), Rounded::exact(1.0), Rounded::exact(1.0), false, false).terms().data,
            [6.0; 4]
        );
        assert_eq!(
            gemm(&a, &b, Some(&c), Rounded::exact(0.5), Rounded::exact(1.0), false, false).terms().data,
            [7.0; 4]
        );
    }

    #[test]
    fn integers_are_multiplied_exactly() {
        let large = Wrapping((1_i64 << 53) + 1);
        let a = Tensor::new(&[1, 2], vec![large, Wrapping(-3)]);
        let b = Tensor::new(&[2, 1], vec![Wrapping(1), Wrapping(2)]);
        assert_eq!(matmul(&a, &b).data, [large - Wrapping(6)], "no f64 holds it");
    }

    #[test]
    #[should_panic(expected = "shapes [2, 3] and [2, 3] do not fit")]
    fn inner_axes_must_agree() {
        matmul(&Tensor::<f64>::zeros(&[2, 3]), &Tensor::zeros(&[2, 3]));
    }
}
