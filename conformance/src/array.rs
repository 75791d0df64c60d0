//! f32 arrays as they enter and leave the runtime.

use std::fmt;

/// An f32 array, last axis fastest.
#[derive(Clone, PartialEq)]
pub struct Array {
    /// The shape; empty for a scalar.
    pub shape: Vec<usize>,
    /// As many values as the shape has places.
    pub values: Vec<f32>,
}

impl Array {
    /// An array of these values.
    ///
    /// # Panics
    /// When the shape has another number of places.
    pub fn new(shape: &[usize], values: Vec<f32>) -> Self {
        assert_eq!(values.len(), shape.iter().product::<usize>(), "values for shape {shape:?}");
        Self { shape: shape.to_vec(), values }
    }

    /// The same array with every value changed by `f`.
    #[must_use]
    pub fn map(&self, f: impl Fn(f32) -> f32) -> Self {
        Self { shape: self.shape.clone(), values: self.values.iter().map(|&v| f(v)).collect() }
    }

    /// The same values with two axes exchanged, as by `numpy.swapaxes`.
    ///
    /// # Panics
    /// When there is no such axis.
    #[must_use]
    pub fn swap_axes(&self, a: usize, b: usize) -> Self {
        let rank = self.shape.len();
        assert!(a < rank && b < rank, "axes {a} and {b} of shape {:?}", self.shape);
        let mut shape = self.shape.clone();
        shape.swap(a, b);
        let mut strides: Vec<usize> = (0..rank).map(|axis| self.shape[axis + 1..].iter().product()).collect();
        strides.swap(a, b);
        let values = (0..self.values.len())
            .map(|mut place| {
                let mut from = 0;
                for axis in (0..rank).rev() {
                    from += place % shape[axis] * strides[axis];
                    place /= shape[axis];
                }
                self.values[from]
            })
            .collect();
        Self { shape, values }
    }
}

/// The shape and the first values: a failing problem must fit on a screen.
impl fmt::Debug for Array {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const SHOWN: usize = 6;
        write!(f, "{:?}[", self.shape)?;
        for (i, value) in self.values.iter().take(SHOWN).enumerate() {
            write!(f, "{}{value:e}", if i == 0 { "" } else { ", " })?;
        }
        f.write_str(if self.values.len() > SHOWN { ", …]" } else { "]" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn swapping_axes_moves_every_value_and_twice_is_nothing() {
        let array = Array::new(&[2, 3, 4], (0..24_u8).map(f32::from).collect());
        let swapped = array.swap_axes(0, 2);
        assert_eq!(swapped.shape, [4, 3, 2], "sides");
        assert_eq!(swapped.values[(3 * 3 + 1) * 2], array.values[4 + 3], "[3, 1, 0] was [0, 1, 3]");
        assert_eq!(swapped.swap_axes(0, 2), array, "twice");
    }
}
