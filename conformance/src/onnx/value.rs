//! What a tensor of a graph holds, in which element type: numbers that round, integers, or truths.

use vitruvian_reference::nn::{Scalar, Tensor};

use super::element::ElementType;
use super::typed_tensor::{Elements, TypedTensor};

/// A tensor in a graph.
///
/// Numbers are *not* rounded to the element type: they are what the graph means, and the type says in which precision
/// another party computed. Integers are: they have wrapped to their type.
#[derive(Clone, Debug, PartialEq)]
pub struct Value<T = f64> {
    /// The type of the elements.
    pub element: ElementType,
    /// The elements.
    pub data: Data<T>,
}

/// The elements of a [`Value`], by kind.
#[derive(Clone, Debug, PartialEq)]
pub enum Data<T> {
    /// Floating-point numbers.
    Numbers(Tensor<T>),
    /// Integers, which name shapes, axes and places, or are numbers quantised.
    Integers(Tensor<i64>),
    /// Truths, which choose.
    Truths(Tensor<bool>),
}

impl<T: Scalar> Value<T> {
    /// A tensor as it was found, without error.
    ///
    /// # Errors
    /// When it holds an integer beyond 2⁶³ − 1.
    pub fn of(tensor: &TypedTensor) -> Result<Self, String> {
        let (shape, element) = (&tensor.shape[..], tensor.element());
        fn wide<E: Copy + Into<i64>>(values: &[E]) -> Vec<i64> {
            values.iter().map(|&v| v.into()).collect()
        }
        let data = match &tensor.elements {
            Elements::Bool(v) => return Ok(Self::from_truths(Tensor::new(shape, v.clone()))),
            Elements::I8(v) => wide(v),
            Elements::U8(v) => wide(v),
            Elements::I16(v) => wide(v),
            Elements::U16(v) => wide(v),
            Elements::I32(v) => wide(v),
            Elements::U32(v) => wide(v),
            Elements::I64(v) => v.clone(),
            Elements::U64(v) => v.iter().map(|&i| i as i64).collect(),
            Elements::F32(_) | Elements::F64(_) | Elements::F16(_) | Elements::Bf16(_) => {
                let numbers = tensor.to_f64().unwrap_or_default().into_iter().map(T::exact).collect();
                return Ok(Self::from_numbers(element, Tensor::new(shape, numbers)));
            }
        };
        Self::from_integers(element, Tensor::new(shape, data))
    }

    /// Numbers of a float type.
    ///
    /// # Panics
    /// When the type is none.
    pub fn from_numbers(element: ElementType, numbers: Tensor<T>) -> Self {
        assert!(element.is_float(), "numbers of element type {element}, a float type was expected");
        Self { element, data: Data::Numbers(numbers) }
    }

    /// Integers, wrapped to their type.
    ///
    /// # Errors
    /// When one is an u64 beyond 2⁶³ − 1.
    ///
    /// # Panics
    /// When the type is no integer type.
    pub fn from_integers(element: ElementType, integers: Tensor<i64>) -> Result<Self, String> {
        assert!(
            element.range().is_some(),
            "integers of element type {element}, an integer type was expected"
        );
        let data = integers.data.into_iter().map(|i| element.wrap(i)).collect::<Result<_, _>>()?;
        Ok(Self { element, data: Data::Integers(Tensor { shape: integers.shape, data }) })
    }

    /// Truths.
    pub fn from_truths(truths: Tensor<bool>) -> Self {
        Self { element: ElementType::Bool, data: Data::Truths(truths) }
    }

    /// A list of i64, as shapes and axes are.
    pub fn list(integers: Vec<i64>) -> Self {
        let integers = Tensor::new(&[integers.len()], integers);
        Self { element: ElementType::I64, data: Data::Integers(integers) }
    }

    /// The shape.
    pub fn shape(&self) -> &[usize] {
        match &self.data {
            Data::Numbers(x) => &x.shape,
            Data::Integers(x) => &x.shape,
            Data::Truths(x) => &x.shape,
        }
    }

    /// The number of elements.
    pub fn len(&self) -> usize {
        match &self.data {
            Data::Numbers(x) => x.data.len(),
            Data::Integers(x) => x.data.len(),
            Data::Truths(x) => x.data.len(),
        }
    }

    /// Whether it has no element.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What it holds, for messages.
    pub fn kind(&self) -> &'static str {
        match self.data {
            Data::Numbers(_) => "numbers",
            Data::Integers(_) => "integers",
            Data::Truths(_) => "truths",
        }
    }

    /// The numbers.
    ///
    /// # Errors
    /// When it holds something else.
    pub fn numbers(&self) -> Result<&Tensor<T>, String> {
        match &self.data {
            Data::Numbers(x) => Ok(x),
            _ => Err(format!("holds {}, numbers were expected", self.kind())),
        }
    }

    /// The integers.
    ///
    /// # Errors
    /// When it holds something else.
    pub fn integers(&self) -> Result<&Tensor<i64>, String> {
        match &self.data {
            Data::Integers(x) => Ok(x),
            _ => Err(format!("holds {}, integers were expected", self.kind())),
        }
    }

    /// The truths.
    ///
    /// # Errors
    /// When it holds something else.
    pub fn truths(&self) -> Result<&Tensor<bool>, String> {
        match &self.data {
            Data::Truths(x) => Ok(x),
            _ => Err(format!("holds {}, truths were expected", self.kind())),
        }
    }

    /// The elements of these tensors in another arrangement, whatever they are.
    ///
    /// A movement is a movement of places: `arrange` is given tensors of the shapes of `values` that hold the places of
    /// their elements, counted through all of them, and says which element goes where.
    ///
    /// # Errors
    /// As `arrange`, or when the values are not all of one element type.
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
        let element = values[0].element;
        if let Some(other) = values.iter().find(|value| value.element != element) {
            return Err(format!("elements of {element} and of {} do not mix", other.element));
        }
        let mut counted = 0;
        let places: Vec<Tensor<usize>> = values
            .iter()
            .map(|value| {
                let first = counted;
                counted += value.len();
                Tensor::new(value.shape(), (first..counted).collect())
            })
            .collect();
        let arrangement = arrange(&places)?;
        let data = match values[0].data {
            Data::Numbers(_) => {
                let tensors: Result<Vec<_>, _> = values.iter().map(|value| value.numbers()).collect();
                Data::Numbers(taken(&tensors?, &arrangement))
            }
            Data::Integers(_) => {
                let tensors: Result<Vec<_>, _> = values.iter().map(|value| value.integers()).collect();
                Data::Integers(taken(&tensors?, &arrangement))
            }
            Data::Truths(_) => {
                let tensors: Result<Vec<_>, _> = values.iter().map(|value| value.truths()).collect();
                Data::Truths(taken(&tensors?, &arrangement))
            }
        };
        Ok(Self { element, data })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(element: ElementType, data: [f64; 2]) -> Value {
        Value::from_numbers(element, Tensor::new(&[2], data.to_vec()))
    }

    #[test]
    fn every_kind_is_arranged_in_the_same_way() {
        let swap =
            |places: &[Tensor<usize>]| Ok(Tensor::new(&[2], vec![places[1].data[0], places[0].data[1]]));
        let f32 = |data| numbers(ElementType::F32, data);
        let both = Value::arranged(&[&f32([1.0, 2.0]), &f32([3.0, 4.0])], swap);
        assert_eq!(both, Ok(f32([3.0, 2.0])), "numbers");
        let integers: Value = Value::list(vec![1, 2]);
        assert_eq!(Value::arranged(&[&integers, &integers], swap), Ok(Value::list(vec![1, 2])), "integers");
        for other in [integers, numbers(ElementType::F16, [0.0, 0.0])] {
            let mixed = Value::arranged(&[&f32([1.0, 2.0]), &other], swap).expect_err("never a mixture");
            assert!(mixed.contains("elements of f32 and of"), "{mixed}");
        }
    }

    #[test]
    fn integers_wrap_and_a_huge_one_is_refused_by_name() {
        let wrapped: Value = Value::from_integers(ElementType::I8, Tensor::new(&[1], vec![130])).expect("i8");
        assert_eq!(wrapped.integers().expect("integers").data, [-126]);
        let huge = TypedTensor::new(&[1], Elements::U64(vec![1 << 63])).expect("a tensor");
        let message = Value::<f64>::of(&huge).expect_err("refused");
        assert!(message.contains("9223372036854775808"), "{message}");
    }
}
