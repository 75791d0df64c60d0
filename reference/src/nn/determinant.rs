//! The determinant of square matrices.

use super::{Scalar, Tensor};

/// det of the last two axes: x [..,N,N] → [..]; 1 for N = 0.
///
/// Rounding: elimination with row exchanges computes the determinant of A + E exactly but for N roundings, with
/// |E| ≤ γ_N·|L||U| (Higham, theorem 9.3). To first order det(A + E) − det A = Σᵢⱼ Cᵢⱼ·Eᵢⱼ with the cofactors Cᵢⱼ, so
/// that m = |det A| + Σᵢⱼ |Cᵢⱼ|·(|L||U|)ᵢⱼ and n = 2N. L and U are those of the largest pivots; |L| ≤ 1 then.
///
/// # Panics
/// If the last two axes are not of one length.
///
/// # References
/// ONNX operator Det (version 22); N. J. Higham, Accuracy and Stability of Numerical Algorithms, 2nd ed., SIAM 2002, chapters 9 and 14.
pub fn det<T: Scalar>(x: &Tensor<T>) -> Tensor<T> {
    let square = x.rank() >= 2 && x.shape[x.rank() - 1] == x.shape[x.rank() - 2];
    assert!(square, "det: x must be [..,N,N], found shape {:?}", x.shape);
    let (outer, inner) = x.shape.split_at(x.rank() - 2);
    let n = inner[0];
    let matrix = |k: usize| -> Vec<T> { x.data[k * n * n..(k + 1) * n * n].to_vec() };
    let data = (0..outer.iter().product()).map(|k| det_of_matrix(&matrix(k), n)).collect();
    Tensor { shape: outer.to_vec(), data }
}

fn det_of_matrix<T: Scalar>(a: &[T], n: usize) -> T {
    let values: Vec<f64> = a.iter().map(|a| a.value()).collect();
    let (det, product) = eliminate(&values, n);
    if !T::TRACKS_ROUNDING {
        return T::exact(det);
    }
    let terms = a.iter().map(|a| a.terms()).fold(0.0, f64::max);
    let mut magnitude = det.abs();
    for i in 0..n {
        for j in 0..n {
            let minor: Vec<f64> =
                (0..n * n).filter(|k| k / n != i && k % n != j).map(|k| values[k]).collect();
            let entry = if terms == 0.0 { 0.0 } else { a[i * n + j].magnitude() };
            magnitude += eliminate(&minor, n - 1).0.abs() * (product[i * n + j] + entry);
        }
    }
    T::within(det, magnitude, terms + 2.0 * n as f64)
}

/// The determinant by elimination with the largest pivot of each column, and |L||U| in the rows' own order.
fn eliminate(a: &[f64], n: usize) -> (f64, Vec<f64>) {
    let mut u = a.to_vec();
    let mut rows: Vec<usize> = (0..n).collect();
    let mut product = vec![0.0; n * n];
    let mut det = 1.0;
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| u[rows[i] * n + k].abs().total_cmp(&u[rows[j] * n + k].abs()));
        let pivot = pivot.expect("a column has a row");
        if pivot != k {
            rows.swap(k, pivot);
            det = -det;
        }
        let top = rows[k];
        det *= u[top * n + k];
        for (i, &row) in rows.iter().enumerate().skip(k) {
            let factor = match i {
                i if i == k => 1.0,
                _ if u[top * n + k] == 0.0 => 0.0,
                _ => u[row * n + k] / u[top * n + k],
            };
            for j in k..n {
                product[row * n + j] += (factor * u[top * n + j]).abs();
                if i > k {
                    u[row * n + j] -= factor * u[top * n + j];
                }
            }
        }
    }
    (det, product)
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::super::{UNIT_ROUNDOFF_F32, matmul};
    use super::*;

    #[test]
    fn determinants_by_hand() {
        let x = Tensor::new(&[2, 2, 2], vec![0.0, 2.0, 3.0, 4.0, 1.0, 2.0, 2.0, 4.0]);
        assert_eq!(det(&x).data, [-6.0, 0.0]);
        assert_eq!(det(&Tensor::<f64>::zeros(&[3, 0, 0])).data, [1.0; 3], "the empty product");
    }

    #[test]
    fn the_determinant_of_a_product_is_the_product_of_determinants() {
        let (a, b) = (pattern(&[5, 5], 1), pattern(&[5, 5], 2));
        let error = det(&matmul(&a, &b)).data[0] - det(&a).data[0] * det(&b).data[0];
        assert!(error.abs() < 1e-12, "{error:e}");
    }

    #[test]
    fn f32_stays_within_the_bound_for_a_nearly_singular_matrix() {
        let a: [f32; 9] = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.000_01];
        let x = Tensor::new(&[3, 3], a.iter().map(|&v| f64::from(v)).collect()).rounded();
        let sarrus = a[0] * (a[4] * a[8] - a[5] * a[7]) - a[1] * (a[3] * a[8] - a[5] * a[6])
            + a[2] * (a[3] * a[7] - a[4] * a[6]);
        let y = det(&x).data[0];
        let error = (f64::from(sarrus) - y.value).abs();
        assert!(error > 0.0 && error <= y.bound(UNIT_ROUNDOFF_F32), "{error:e} for {y:?}");
    }

    #[test]
    #[should_panic(expected = "x must be [..,N,N], found shape [2, 3]")]
    fn a_matrix_must_be_square() {
        det(&Tensor::<f64>::zeros(&[2, 3]));
    }
}
