//! The weights of a network by name.

use crate::nn::Tensor;
use std::collections::BTreeMap;

/// Named tensors, as a PyTorch state_dict or the initialisers of an ONNX graph hold them.
///
/// A network takes what it knows and then asserts that nothing is left ([`finish`](Weights::finish)), so that a weight under an
/// unexpected name is found on loading and not in the numbers. (`num_batches_tracked` of PyTorch's batch
/// normalisation is no weight: leave it out.)
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Weights {
    tensors: BTreeMap<String, Tensor>,
}

impl Weights {
    /// The shape of a weight.
    ///
    /// # Panics
    /// If there is none of this name.
    pub fn shape(&self, name: &str) -> &[usize] {
        match self.tensors.get(name) {
            Some(tensor) => &tensor.shape,
            None => panic!("Weights: no weight {name:?}; there are {:?}", self.names().collect::<Vec<_>>()),
        }
    }

    /// The names that are left, in alphabetic order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// Remove and return a weight of this shape.
    ///
    /// # Panics
    /// If there is none of this name, or it has another shape.
    pub fn take(&mut self, name: &str, shape: &[usize]) -> Tensor {
        let found = self.shape(name);
        assert!(found == shape, "Weights: {name:?} has shape {found:?}, the network needs {shape:?}");
        self.tensors.remove(name).expect("its shape was just read")
    }

    /// Assert that every weight was taken.
    ///
    /// # Panics
    /// If one is left, naming all that are.
    pub fn finish(self) {
        let left: Vec<&str> = self.names().collect();
        assert!(left.is_empty(), "Weights: the network has no use for {left:?}");
    }
}

impl FromIterator<(String, Tensor)> for Weights {
    fn from_iter<I: IntoIterator<Item = (String, Tensor)>>(named: I) -> Weights {
        Weights { tensors: named.into_iter().collect() }
    }
}

#[cfg(test)]
impl Weights {
    /// The weights that reference/goldens/generate.py fills its networks with: see `fill` there.
    pub(crate) fn pattern(shapes: Vec<(String, Vec<usize>)>) -> Weights {
        let shapes: BTreeMap<_, _> = shapes.into_iter().collect();
        let fill = |(k, (name, shape)): (usize, (String, Vec<usize>))| {
            let inputs = shape[1..].iter().product::<usize>() as f64;
            let value = crate::nn::goldens::pattern(&shape, k + 1).map(|v| {
                if shape.len() > 1 {
                    v / inputs.sqrt()
                } else if name.contains("var") {
                    1.0 + v * v
                } else if name.ends_with("weight") {
                    1.0 + v / 2.0
                } else {
                    v
                }
            });
            (name, value)
        };
        shapes.into_iter().enumerate().map(fill).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one() -> Weights {
        [("a.weight".to_owned(), Tensor::zeros(&[2, 3]))].into_iter().collect()
    }

    #[test]
    fn a_weight_is_taken_once() {
        let mut weights = one();
        assert_eq!(weights.take("a.weight", &[2, 3]).shape, [2, 3]);
        weights.finish();
    }

    #[test]
    #[should_panic(expected = "has no use for [\"a.weight\"]")]
    fn a_left_over_name_is_refused() {
        one().finish();
    }

    #[test]
    #[should_panic(expected = "\"a.weight\" has shape [2, 3], the network needs [3, 2]")]
    fn a_shape_must_fit() {
        one().take("a.weight", &[3, 2]);
    }

    #[test]
    #[should_panic(expected = "no weight \"b\"; there are [\"a.weight\"]")]
    fn a_name_must_exist() {
        one().shape("b");
    }
}
