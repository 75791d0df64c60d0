//! A dense tensor, row-major: the last axis is contiguous.

use super::Scalar;

/// A shape and its elements in row-major order; element (i₀, …, i_{r−1}) lies at ((i₀·d₁ + i₁)·d₂ + …) + i_{r−1}.
///
/// Axes are ONNX's: N C W, N C H W or N C D H W for maps. A scalar has the empty shape and one element.
#[derive(Clone, Debug, PartialEq)]
pub struct Tensor<T = f64> {
    /// Length of each axis.
    pub shape: Vec<usize>,
    /// Elements, the last axis fastest.
    pub data: Vec<T>,
}

impl<T: Copy> Tensor<T> {
    /// A tensor from its elements in row-major order.
    ///
    /// # Panics
    /// If the number of elements is not the product of the shape.
    pub fn new(shape: &[usize], data: Vec<T>) -> Tensor<T> {
        let expected: usize = shape.iter().product();
        assert!(
            data.len() == expected,
            "Tensor::new: shape {shape:?} holds {expected} elements, but {} were given",
            data.len()
        );
        Tensor { shape: shape.to_vec(), data }
    }

    /// A tensor with the same value everywhere.
    pub fn filled(shape: &[usize], value: T) -> Tensor<T> {
        Tensor { shape: shape.to_vec(), data: vec![value; shape.iter().product()] }
    }

    /// A tensor from a function of the index, called in row-major order.
    pub fn from_fn(shape: &[usize], mut f: impl FnMut(&[usize]) -> T) -> Tensor<T> {
        let mut index = vec![0; shape.len()];
        let data = (0..shape.iter().product())
            .map(|_| {
                let value = f(&index);
                advance(&mut index, shape);
                value
            })
            .collect();
        Tensor { shape: shape.to_vec(), data }
    }

    /// The number of axes.
    pub fn rank(&self) -> usize {
        self.shape.len()
    }

    /// The distance in `data` between neighbours along each axis.
    pub fn strides(&self) -> Vec<usize> {
        let mut strides = vec![1; self.rank()];
        for axis in (1..self.rank()).rev() {
            strides[axis - 1] = strides[axis] * self.shape[axis];
        }
        strides
    }

    /// The place of an element in `data`.
    ///
    /// # Panics
    /// If the index has another rank than the tensor or lies outside its shape.
    pub fn offset(&self, index: &[usize]) -> usize {
        let inside = index.len() == self.rank() && index.iter().zip(&self.shape).all(|(i, n)| i < n);
        assert!(inside, "Tensor::offset: index {index:?} does not lie in shape {:?}", self.shape);
        index.iter().zip(&self.shape).fold(0, |offset, (i, n)| offset * n + i)
    }

    /// The element at an index.
    ///
    /// # Panics
    /// As [`offset`](Tensor::offset).
    pub fn at(&self, index: &[usize]) -> T {
        self.data[self.offset(index)]
    }

    /// A function of every element.
    pub fn map<U>(&self, f: impl FnMut(T) -> U) -> Tensor<U> {
        Tensor { shape: self.shape.clone(), data: self.data.iter().copied().map(f).collect() }
    }

    /// The same elements in another shape.
    ///
    /// # Panics
    /// If the two shapes hold different numbers of elements.
    pub fn reshape(&self, shape: &[usize]) -> Tensor<T> {
        let expected: usize = shape.iter().product();
        assert!(
            expected == self.data.len(),
            "Tensor::reshape: shape {:?} has {} elements, shape {shape:?} holds {expected}",
            self.shape,
            self.data.len()
        );
        Tensor { shape: shape.to_vec(), data: self.data.clone() }
    }
}

impl<T: Scalar> Tensor<T> {
    /// A tensor of zeros.
    pub fn zeros(shape: &[usize]) -> Tensor<T> {
        Tensor::filled(shape, T::ZERO)
    }
}

/// The next index of a shape in row-major order; after the last it returns to zero.
pub(super) fn advance(index: &mut [usize], shape: &[usize]) {
    for axis in (0..shape.len()).rev() {
        index[axis] += 1;
        if index[axis] < shape[axis] {
            return;
        }
        index[axis] = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_axis_is_contiguous() {
        let t = Tensor::from_fn(&[2, 3, 4], |i| (100 * i[0] + 10 * i[1] + i[2]) as f64);
        assert_eq!(&t.data[..5], [0.0, 1.0, 2.0, 3.0, 10.0]);
        assert_eq!(t.strides(), [12, 4, 1]);
        assert_eq!(t.at(&[1, 2, 3]), 123.0);
        assert_eq!(t.reshape(&[6, 4]).at(&[5, 3]), 123.0);
    }

    #[test]
    fn a_scalar_has_one_element_and_an_empty_axis_none() {
        assert_eq!(Tensor::from_fn(&[], |_| 7.0).at(&[]), 7.0);
        assert_eq!(Tensor::<f64>::zeros(&[3, 0]).data.len(), 0);
    }

    #[test]
    #[should_panic(expected = "shape [2, 2] holds 4 elements, but 3 were given")]
    fn a_shape_must_hold_its_elements() {
        Tensor::new(&[2, 2], vec![1.0, 2.0, 3.0]);
    }

    #[test]
    #[should_panic(expected = "index [0, 2] does not lie in shape [2, 2]")]
    fn an_index_must_lie_in_the_shape() {
        Tensor::<f64>::zeros(&[2, 2]).at(&[0, 2]);
    }
}
