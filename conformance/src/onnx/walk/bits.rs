//! Operators on the bits of integers.

use vitruvian_reference::nn::Scalar;

use super::choice::zipped;
use super::{Answer, Call, Value};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "BitShift" => shifted(call),
        "BitwiseAnd" => combined(call, |a, b| a & b),
        "BitwiseNot" => call
            .attributes(&[])
            .and_then(|_| Value::from_integers(call.operand(0)?.element, call.integers(0)?.map(|i| !i))),
        "BitwiseOr" => combined(call, |a, b| a | b),
        "BitwiseXor" => combined(call, |a, b| a ^ b),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// Integers are kept as i64 with the sign of their type, so that their lower bits combine as those of the type do.
fn combined<T: Scalar>(call: &Call<T>, f: fn(i64, i64) -> i64) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    let element = call.same_type()?;
    Value::from_integers(element, zipped(call.integers(0)?, call.integers(1)?, f)?)
}

fn shifted<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let left = match call.attributes(&["direction"])?.text("direction", "")? {
        "LEFT" => true,
        "RIGHT" => false,
        other => return Err(format!("attribute \"direction\" is {other:?}, LEFT or RIGHT was expected")),
    };
    let element = call.same_type()?;
    let shifts = call.integers(1)?;
    let bits = 8 * element.size() as i64;
    let within = |shift: &i64| (0..bits).contains(shift);
    if let Some(shift) = shifts.data.iter().find(|shift| !within(shift) && call.opset < 28) {
        return Err(format!("a shift of {element} by {shift}; ONNX leaves the result open before opset 28"));
    }
    // What is shifted beyond the type is cut off by wrapping; only a shift to the right keeps a sign, which i64's does too.
    let shift = |i: i64, by: i64| match (within(&by), left) {
        (true, true) => i.wrapping_shl(by as u32),
        (true, false) => i.wrapping_shr(by as u32),
        // Nothing of the number is left, but its sign to the right.
        (false, true) => 0,
        (false, false) => i.signum().min(0),
    };
    Value::from_integers(element, zipped(call.integers(0)?, shifts, shift)?)
}

#[cfg(test)]
mod tests {
    use vitruvian_reference::nn::Tensor;

    use super::super::evaluate;
    use super::super::tests::node;
    use super::*;
    use crate::onnx::builder::text;
    use crate::onnx::element::ElementType;

    fn shifted_at(opset: i64, direction: &str, element: ElementType, x: i64, by: i64) -> Result<i64, String> {
        let one = |i| Value::<f64>::from_integers(element, Tensor::new(&[1], vec![i]));
        let node = node("BitShift", vec![text("direction", direction)]);
        let y = evaluate(&node, opset, &[Some(&one(x)?), Some(&one(by)?)])?;
        Ok(y[0].as_ref().expect("an output").integers()?.data[0])
    }

    fn shifted(direction: &str, element: ElementType, x: i64, by: i64) -> Result<i64, String> {
        shifted_at(11, direction, element, x, by)
    }

    #[test]
    fn since_opset_28_a_shift_beyond_the_type_leaves_the_sign() {
        for by in [-1, 8, 100] {
            assert_eq!(shifted_at(28, "RIGHT", ElementType::I8, -3, by), Ok(-1), "by {by}");
            assert_eq!(shifted_at(28, "RIGHT", ElementType::I8, 3, by), Ok(0), "by {by}");
            assert_eq!(shifted_at(28, "LEFT", ElementType::I8, -3, by), Ok(0), "by {by}");
        }
    }

    #[test]
    fn what_leaves_the_type_is_lost_and_a_sign_stays() {
        assert_eq!(shifted("LEFT", ElementType::U8, 0b1100_0001, 2), Ok(4));
        assert_eq!(shifted("RIGHT", ElementType::U8, 0b1100_0001, 6), Ok(3));
        assert_eq!(shifted("RIGHT", ElementType::I8, -8, 1), Ok(-4));
        assert!(shifted("LEFT", ElementType::U8, 1, 8).expect_err("refused").contains("by 8"), "open");
        assert!(shifted("UP", ElementType::U8, 1, 1).expect_err("refused").contains("UP"), "by name");
    }

    #[test]
    fn the_complement_is_that_of_the_type() {
        let not = |element, i| {
            let x = Value::<f64>::from_integers(element, Tensor::new(&[1], vec![i]))?;
            let y = evaluate(&node("BitwiseNot", vec![]), 18, &[Some(&x)])?;
            Ok::<_, String>(y[0].as_ref().expect("an output").integers()?.data[0])
        };
        assert_eq!((not(ElementType::U8, 1), not(ElementType::I8, 1)), (Ok(254), Ok(-2)));
    }
}
