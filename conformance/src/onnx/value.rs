//! What a tensor of a graph holds: numbers that round, integers, or truths.

use vitruvian_reference::nn::{Scalar, Tensor};

use super::constant::{Constant, Elements};

/// A tensor in a graph.
#[derive(Clone, Debug, PartialEq)]
pub enum Value<T = f64> {
    /// Floating-point numbers.
    Numbers(Tensor<T>),
    /// Integers, which name shapes, axes and places.
    Integers(Tensor<i64>),
    /// Truths, which choose.
    Truths(Tensor<bool>),
}

impl<T: Scalar> Value<T> {
    /// A constant of a graph, without error.
    pub fn constant(constant: &Constant) -> Self {
        let shape = &constant.shape;
        match &constant.elements {
            Elements::F32(v) => {
                Self::Numbers(Tensor::new(shape, v.iter().map(|&x| T::exact(x.into())).collect()))
            }
            Elements::F64(v) => Self::Numbers(Tensor::new(shape, v.iter().map(|&x| T::exact(x)).collect())),
            Elements::I32(v) => Self::Integers(Tensor::new(shape, v.iter().map(|&i| i.into()).collect())),
            Elements::I64(v) => Self::Integers(Tensor::new(shape, v.clone())),
            Elements::Bool(v) => Self::Truths(Tensor::new(shape, v.clone())),
        }
    }

    /// A list of integers, as shapes and axes are.
    pub fn list(integers: Vec<i64>) -> Self {
        Self::Integers(Tensor::new(&[integers.len()], integers))
    }

    /// The shape.
    pub fn shape(&self) -> &[usize] {
        match self {
            Self::Numbers(x) => &x.shape,
            Self::Integers(x) => &x.shape,
            Self::Truths(x) => &x.shape,
        }
    }

    /// What it holds, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Numbers(_) => "numbers",
            Self::Integers(_) => "integers",
            Self::Truths(_) => "truths",
        }
    }

    /// The numbers.
    ///
    /// # Errors
    /// When it holds something else.
    pub fn numbers(&self) -> Result<&Tensor<T>, String> {
        match self {
            Self::Numbers(x) => Ok(x),
            other => Err(format!("holds {}, numbers were expected", other.kind())),
        }
    }

    /// The integers.
    ///
    /// # Errors
    /// When it holds something else.
    pub fn integers(&self) -> Result<&Tensor<i64>, String> {
        match self {
            Self::Integers(x) => Ok(x),
            other => Err(format!("holds {}, integers were expected", other.kind())),
        }
    }

    /// The truths.
    ///
    /// # Errors
    /// When it holds something else.
    pub fn truths(&self) -> Result<&Tensor<bool>, String> {
        match self {
            Self::Truths(x) => Ok(x),
            other => Err(format!("holds {}, truths were expected", other.kind())),
        }
    }

    /// The elements of these tensors in another arrangement, whatever they are.
    ///
    /// A movement is a movement of places: `arrange` is given tensors of the shapes of `values` that hold the places of
    /// their elements, counted through all of them, and says which element goes where.
    ///
    /// # Errors
    /// As `arrange`, or when the values are not all of one kind.
    ///
    /// # Panics
    /// When there is no value.
    pub fn arranged(
        values: &[&Self],
        arrange: impl FnOnce(&[Tensor<usize>]) -> Result<Tensor<usize>, String>,
    ) -> Result<Self, String> {
        fn taken<E: Copy>(tensors: &[&Tensor<E>], arrangement: &Tensor<usize>) -> Tensor<E> {
            let all: Vec<E> = tensors.iter().flat_map(|tensor| tensor.data.iter().copied()).collect();
            arrangement.map(|place| all[place])
        }
        let mut counted = 0;
        let places: Vec<Tensor<usize>> = values
            .iter()
            .map(|value| {
                let first = counted;
                counted += value.shape().iter().product::<usize>();
                Tensor::new(value.shape(), (first..counted).collect())
            })
            .collect();
        let arrangement = arrange(&places)?;
        Ok(match values[0] {
            Self::Numbers(_) => {
                let tensors: Result<Vec<_>, _> = values.iter().map(|value| value.numbers()).collect();
                Self::Numbers(taken(&tensors?, &arrangement))
            }
            Self::Integers(_) => {
                let tensors: Result<Vec<_>, _> = values.iter().map(|value| value.integers()).collect();
                Self::Integers(taken(&tensors?, &arrangement))
            }
            Self::Truths(_) => {
                let tensors: Result<Vec<_>, _> = values.iter().map(|value| value.truths()).collect();
                Self::Truths(taken(&tensors?, &arrangement))
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_is_arranged_in_the_same_way() {
        let swap =
            |places: &[Tensor<usize>]| Ok(Tensor::new(&[2], vec![places[1].data[0], places[0].data[1]]));
        let numbers = |data: [f64; 2]| Value::Numbers(Tensor::new(&[2], data.to_vec()));
        let both = Value::arranged(&[&numbers([1.0, 2.0]), &numbers([3.0, 4.0])], swap);
        assert_eq!(both, Ok(numbers([3.0, 2.0])), "numbers");
        let integers: Value = Value::list(vec![1, 2]);
        assert_eq!(Value::arranged(&[&integers, &integers], swap), Ok(Value::list(vec![1, 2])), "integers");
        let mixed = Value::arranged(&[&numbers([1.0, 2.0]), &integers], swap);
        assert_eq!(mixed, Err("holds integers, numbers were expected".into()), "never a mixture");
    }
}
