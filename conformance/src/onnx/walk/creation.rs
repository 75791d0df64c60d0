//! Operators that make tensors of shapes, patterns and constants.

use vitruvian_reference::nn::{Scalar, Tensor, expand, eye, one_hot, triangle};

use super::{Answer, Attributes, Call, Data, Value, axis, lengths, room};
use crate::onnx::element::ElementType;
use crate::onnx::typed_tensor::TypedTensor;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "Constant" => constant(call),
        "ConstantOfShape" => filled(call),
        "EyeLike" => identity_matrix(call),
        "OneHot" => hot(call),
        "Range" => range(call),
        "Shape" => shape(call),
        "Size" => call.operand(0).and_then(|x| single(ElementType::I64, x.len() as i64)),
        "Trilu" => part_of_matrix(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

fn single<T: Scalar>(element: ElementType, integer: i64) -> Result<Value<T>, String> {
    Value::from_integers(element, Tensor::new(&[], vec![integer]))
}

fn constant<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let known = ["value", "value_float", "value_floats", "value_int", "value_ints"];
    let attributes = call.attributes(&known)?;
    let floats = |shape: &[usize], list: &[f32]| {
        let exact = list.iter().map(|&x| T::exact(x.into())).collect();
        Value::from_numbers(ElementType::F32, Tensor::new(shape, exact))
    };
    if let Some(list) = attributes.integers("value_ints") {
        Ok(Value::list(list))
    } else if attributes.has("value_int") {
        single(ElementType::I64, attributes.int("value_int", 0))
    } else if let Some(list) = attributes.floats("value_floats") {
        Ok(floats(&[list.len()], list))
    } else if attributes.has("value_float") {
        Ok(floats(&[], &[attributes.float("value_float", 0.0) as f32]))
    } else {
        Value::of(&attributes.tensor("value")?)
    }
}

fn filled<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["value"])?;
    let shape = lengths(&call.integers(0)?.data)?;
    room(&shape)?;
    let element = match attributes.has("value") {
        true => {
            let value = attributes.tensor("value")?;
            Value::of(&TypedTensor::new(&[], value.elements)?)?
        }
        false => Value::from_numbers(ElementType::F32, Tensor::new(&[], vec![T::ZERO])),
    };
    Value::arranged(&[&element], |places| Ok(expand(&places[0], &shape)))
}

/// The element type that an attribute names, or another where there is no such attribute.
pub(super) fn element(
    attributes: Attributes,
    name: &str,
    default: ElementType,
) -> Result<ElementType, String> {
    let number = attributes.int(name, default.number().into());
    let element = i32::try_from(number).ok().and_then(ElementType::from_number);
    element.ok_or_else(|| format!("attribute \"{name}\" names element type {number}, which is not read here"))
}

/// Numbers without error in any element type.
fn of_type<T: Scalar>(element: ElementType, numbers: &Tensor<f64>) -> Result<Value<T>, String> {
    match element {
        ElementType::Bool => Ok(Value::from_truths(numbers.map(|x| x != 0.0))),
        float if float.is_float() => Ok(Value::from_numbers(float, numbers.map(T::exact))),
        integer => Value::from_integers(integer, numbers.map(|x| x as i64)),
    }
}

fn identity_matrix<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["dtype", "k"])?;
    let x = call.operand(0)?;
    let &[rows, columns] = x.shape() else {
        return Err(format!("operand 0 has shape {:?}, a matrix was expected", x.shape()));
    };
    of_type(element(attributes, "dtype", x.element)?, &eye(rows, columns, attributes.int("k", 0)))
}

/// The one integer of an operand of one element, whatever its number type.
fn whole<T: Scalar>(call: &Call<T>, i: usize) -> Result<i64, String> {
    match &integers_of(call, i)?[..] {
        &[Some(whole)] => Ok(whole),
        _ => Err(format!("operand {i} has shape {:?}, one integer was expected", call.operand(i)?.shape())),
    }
}

/// An operand's elements as integers; `None` where a number is none.
fn integers_of<T: Scalar>(call: &Call<T>, i: usize) -> Result<Vec<Option<i64>>, String> {
    match &call.operand(i)?.data {
        Data::Integers(x) => Ok(x.data.iter().copied().map(Some).collect()),
        Data::Numbers(x) => {
            let whole = |x: &T| (x.value().trunc() == x.value()).then_some(x.value() as i64);
            Ok(x.data.iter().map(whole).collect())
        }
        Data::Truths(_) => Err(format!("operand {i} holds truths, numbers were expected")),
    }
}

fn hot<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let at = call.attributes(&["axis"])?.int("axis", -1);
    let depth = whole(call, 1)?;
    let depth = usize::try_from(depth).map_err(|_| format!("operand 1 is {depth}, a depth was expected"))?;
    let shape = call.operand(0)?.shape();
    // What lies outside of the depth is off everywhere.
    let place = |index: &Option<i64>| index.and_then(|index| axis(index, depth).ok());
    let places = Tensor::new(shape, integers_of(call, 0)?.iter().map(place).collect());
    let at = axis(at, shape.len() + 1)?;
    room(&[shape, &[depth]].concat())?;
    Value::arranged(&[call.operand(2)?], |values| match values[0].data[..] {
        [off, on] => Ok(one_hot(&places, depth, off, on, at)),
        _ => Err(format!("operand 2 has shape {:?}, two values were expected", values[0].shape)),
    })
}

/// start, start + δ, start + 2δ, … before the limit.
fn range<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    // stash_type names the precision of the steps; the reference's is higher than any.
    call.attributes(&["stash_type"])?;
    let element = call.operand(0)?.element;
    let count = |steps: f64| -> Result<usize, String> {
        // A step of 0 makes ±∞ or NaN of the quotient.
        if !steps.is_finite() {
            return Err("a step of 0 never ends".into());
        }
        let count = steps.ceil().max(0.0) as usize;
        room(&[count]).map(|()| count)
    };
    if element.is_float() {
        let one = |i: usize| match call.numbers(i)?.data[..] {
            [value] => Ok(value),
            _ => Err(format!("operand {i} has shape {:?}, one number was expected", call.numbers(i)?.shape)),
        };
        let (start, limit, delta) = (one(0)?, one(1)?, one(2)?);
        let count = count((limit.value() - start.value()) / delta.value())?;
        let step = |k: usize| if k == 0 { start } else { start + T::exact(k as f64) * delta };
        return call.like(Tensor::new(&[count], (0..count).map(step).collect()));
    }
    let (start, limit, delta) = (whole(call, 0)?, whole(call, 1)?, whole(call, 2)?);
    // ⌈(limit − start)/δ⌉ in integers, since an f64 holds 53 bits only.
    let (span, delta) = (i128::from(limit) - i128::from(start), i128::from(delta));
    let steps = if delta == 0 { None } else { Some(-(-span * delta.signum()).div_euclid(delta.abs())) };
    let count = count(steps.map_or(f64::NAN, |steps| steps as f64))?;
    let step = |k: usize| (i128::from(start) + k as i128 * delta) as i64;
    Value::from_integers(element, Tensor::new(&[count], (0..count).map(step).collect()))
}

fn shape<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["end", "start"])?;
    let shape = call.operand(0)?.shape();
    let rank = shape.len() as i64;
    let bound = |at: i64| (if at < 0 { at.saturating_add(rank) } else { at }).clamp(0, rank) as usize;
    let (start, end) = (bound(attributes.int("start", 0)), bound(attributes.int("end", rank)));
    Ok(Value::list(shape[start..end.max(start)].iter().map(|&n| n as i64).collect()))
}

fn part_of_matrix<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let upper = call.attributes(&["upper"])?.flag("upper", true)?;
    let k = match call.optional(1) {
        Some(_) => whole(call, 1)?,
        None => 0,
    };
    let x = call.operand(0)?;
    // A zero of the same type stands behind the elements, so that the triangle is a movement like any other.
    let zero = of_type(x.element, &Tensor::zeros(&[]))?;
    Value::arranged(&[x, &zero], |places| Ok(triangle(&places[0], k, upper, places[1].data[0])))
}

#[cfg(test)]
mod tests {
    use super::super::evaluate;
    use super::super::tests::node;
    use super::*;
    use crate::onnx::builder::int;

    fn scalar(x: f64) -> Value {
        Value::from_numbers(ElementType::F32, Tensor::new(&[], vec![x]))
    }

    fn integer(i: i64) -> Value {
        single(ElementType::I64, i).expect("an i64")
    }

    fn range(operands: [Value; 3]) -> Result<Value, String> {
        let operands: Vec<Option<&Value>> = operands.iter().map(Some).collect();
        Ok(evaluate(&node("Range", vec![]), 11, &operands)?[0].clone().expect("an output"))
    }

    #[test]
    fn a_range_ends_before_its_limit() {
        let numbers = range([scalar(1.0), scalar(5.0), scalar(2.0)]).expect("a range");
        assert_eq!(numbers.numbers().expect("numbers").data, [1.0, 3.0]);
        let integers = |a, b, c| range([integer(a), integer(b), integer(c)]);
        assert_eq!(integers(10, 4, -2), Ok(Value::list(vec![10, 8, 6])));
        assert_eq!(integers(10, 5, -2), Ok(Value::list(vec![10, 8, 6])));
        assert_eq!(integers(0, -1, 1), Ok(Value::list(vec![])), "the limit lies behind");
        assert_eq!(
            integers(i64::MIN, i64::MAX, i64::MAX),
            Ok(Value::list(vec![i64::MIN, -1, i64::MAX - 1])),
            "spans that no i64 holds"
        );
        assert!(integers(0, 1, 0).expect_err("refused").contains("never ends"), "no step");
        assert!(integers(0, 1 << 40, 1).expect_err("refused").contains("elements"), "too long");
    }

    #[test]
    fn a_place_beyond_the_depth_is_off() {
        let (indices, values) = (Value::list(vec![-1, 3]), Value::list(vec![0, 7]));
        let y = evaluate(
            &node("OneHot", vec![int("axis", 0)]),
            11,
            &[Some(&indices), Some(&integer(3)), Some(&values)],
        );
        let y = y.expect("an answer")[0].clone().expect("an output");
        assert_eq!(y.integers().expect("integers"), &Tensor::new(&[3, 2], vec![0, 0, 0, 0, 7, 0]));
    }

    #[test]
    fn the_rest_of_a_triangle_is_the_zero_of_its_type() {
        let x = Value::<f64>::from_truths(Tensor::filled(&[2, 2], true));
        let y = evaluate(&node("Trilu", vec![int("upper", 0)]), 14, &[Some(&x)]).expect("an answer");
        let y = y[0].clone().expect("an output");
        assert_eq!(y.truths().expect("truths").data, [true, false, true, true]);
    }
}
