//! Functions of one number, element by element, and activations.

use vitruvian_reference::nn::{
    Elementary, Scalar, Tensor, ceil, celu, elu, floor, gelu, gelu_tanh, hard_sigmoid, hard_swish,
    leaky_relu, mish, prelu, relu, round, selu, shrink, sign, softsign, swish, thresholded_relu,
};

use super::{Answer, Attributes, Call, Data, Value, broadcast};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match (function(call.operator), integer_function(call.operator)) {
        (None, _) => with_attributes(call)?,
        (Some(on_numbers), on_integers) => {
            call.attributes(&[]).and_then(|_| match (&call.operand(0)?.data, on_integers) {
                (Data::Integers(x), Some(f)) => Value::from_integers(call.operand(0)?.element, x.map(f)),
                _ => call.like(on_numbers(call.numbers(0)?)),
            })
        }
    };
    Some(y.map(|y| vec![y]))
}

/// The operators without attributes.
fn function<T: Scalar>(operator: &str) -> Option<fn(&Tensor<T>) -> Tensor<T>> {
    Some(match operator {
        "Abs" => |x| x.map(|x| x.maximum(-x)),
        "Acos" => |x| x.map(Elementary::acos),
        "Acosh" => |x| x.map(Elementary::acosh),
        "Asin" => |x| x.map(Elementary::asin),
        "Asinh" => |x| x.map(Elementary::asinh),
        "Atan" => |x| x.map(Elementary::atan),
        "Atanh" => |x| x.map(Elementary::atanh),
        "Ceil" => ceil,
        "Cos" => |x| x.map(Elementary::cos),
        "Cosh" => |x| x.map(Elementary::cosh),
        "Erf" => |x| x.map(Elementary::erf),
        "Exp" => |x| x.map(Elementary::exp),
        "Floor" => floor,
        "HardSwish" => hard_swish,
        "Log" => |x| x.map(Elementary::ln),
        "Mish" => mish,
        "Neg" => |x| x.map(|x| -x),
        "Reciprocal" => |x| x.map(|x| T::exact(1.0) / x),
        "Relu" => relu,
        "Round" => round,
        "Sigmoid" => |x| x.map(Elementary::sigmoid),
        "Sign" => sign,
        "Sin" => |x| x.map(Elementary::sin),
        "Sinh" => |x| x.map(Elementary::sinh),
        "Softplus" => |x| x.map(Elementary::softplus),
        "Softsign" => softsign,
        "Sqrt" => |x| x.map(T::sqrt),
        "Tan" => |x| x.map(Elementary::tan),
        "Tanh" => |x| x.map(Elementary::tanh),
        _ => return None,
    })
}

/// Those of them that integers have as well.
fn integer_function(operator: &str) -> Option<fn(i64) -> i64> {
    Some(match operator {
        "Abs" => i64::wrapping_abs,
        "Neg" => i64::wrapping_neg,
        "Relu" => |x| x.max(0),
        "Sign" => i64::signum,
        _ => return None,
    })
}

/// An attribute's number, with a rounding where the element type of x does not hold it.
fn setting<T: Scalar>(call: &Call<T>, attributes: Attributes, name: &str, default: f32) -> Result<T, String> {
    call.constant(attributes.float(name, default))
}

/// The activations whose shape is set by attributes or a second operand; `None` for an operator of another family.
fn with_attributes<T: Scalar>(call: &Call<T>) -> Option<Result<Value<T>, String>> {
    Some(match call.operator {
        "Celu" => activated(call, &[("alpha", 1.0)], |x, [alpha]| Ok(celu(x, alpha))),
        "Elu" => activated(call, &[("alpha", 1.0)], |x, [alpha]| Ok(elu(x, alpha))),
        "Gelu" => gaussian(call),
        "HardSigmoid" => activated(call, &[("alpha", 0.2), ("beta", 0.5)], |x, [alpha, beta]| {
            Ok(hard_sigmoid(x, alpha, beta))
        }),
        "IsInf" => infinite(call),
        "IsNaN" => classified(call, &[], |_| |x| x.is_nan()),
        "LeakyRelu" => activated(call, &[("alpha", 0.01)], |x, [slope]| Ok(leaky_relu(x, slope))),
        "PRelu" => parametric(call),
        "Selu" => activated(call, &[("alpha", 1.673_263_2), ("gamma", 1.050_701)], |x, [alpha, gamma]| {
            Ok(selu(x, alpha, gamma))
        }),
        "Shrink" => shrunk(call),
        "SwiGLU" => gated(call),
        "Swish" => activated(call, &[("alpha", 1.0)], |x, [alpha]| Ok(swish(x, alpha))),
        "ThresholdedRelu" => activated(call, &[("alpha", 1.0)], |x, [alpha]| Ok(thresholded_relu(x, alpha))),
        _ => return None,
    })
}

/// f(x, settings) with the settings from attributes, whose defaults are ONNX's.
fn activated<T: Scalar, const N: usize>(
    call: &Call<T>,
    settings: &[(&str, f32); N],
    f: impl FnOnce(&Tensor<T>, [T; N]) -> Result<Tensor<T>, String>,
) -> Result<Value<T>, String> {
    let attributes = call.attributes(&settings.map(|(name, _)| name))?;
    let mut values = [T::ZERO; N];
    for (value, (name, default)) in values.iter_mut().zip(settings) {
        *value = setting(call, attributes, name, *default)?;
    }
    call.like(f(call.numbers(0)?, values)?)
}

fn gaussian<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    match call.attributes(&["approximate"])?.text("approximate", "none")? {
        "none" => call.like(gelu(call.numbers(0)?)),
        "tanh" => call.like(gelu_tanh(call.numbers(0)?)),
        other => Err(format!("attribute \"approximate\" is {other}, none or tanh was expected")),
    }
}

/// The slopes broadcast to x, and are of its type; integers are multiplied with wrap.
fn parametric<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    call.attributes(&[])?;
    let element = call.same_type()?;
    match &call.operand(0)?.data {
        Data::Integers(x) => {
            let slope = call.integers(1)?;
            if broadcast(&x.shape, &slope.shape)? != x.shape {
                return Err(format!("slopes {:?} do not broadcast to x {:?}", slope.shape, x.shape));
            }
            let y = vitruvian_reference::nn::broadcast("PRelu", x, slope, |x: i64, slope: i64| {
                if x < 0 { x.wrapping_mul(slope) } else { x }
            });
            Value::from_integers(element, y)
        }
        _ => call.like(prelu(call.numbers(0)?, call.numbers(1)?)),
    }
}

fn shrunk<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let Data::Integers(x) = &call.operand(0)?.data else {
        return activated(call, &[("lambd", 0.5), ("bias", 0.0)], |x, [lambda, bias]| {
            Ok(shrink(x, lambda, bias))
        });
    };
    // Integers are shrunk as numbers, and what results is cut off.
    let attributes = call.attributes(&["bias", "lambd"])?;
    let (lambda, bias) = (attributes.float("lambd", 0.5), attributes.float("bias", 0.0));
    let y = shrink(&x.map(|x| x as f64), lambda, bias);
    Value::from_integers(call.operand(0)?.element, y.map(|y| y as i64))
}

/// Swish of the first operand, times the second.
fn gated<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    call.same_type()?;
    let (gate, linear) = (call.numbers(0)?, call.numbers(1)?);
    if gate.shape != linear.shape {
        return Err(format!("shapes {:?} and {:?} differ", gate.shape, linear.shape));
    }
    activated(call, &[("alpha", 1.0)], |x, [alpha]| {
        Ok(vitruvian_reference::nn::mul(&swish(x, alpha), linear))
    })
}

fn infinite<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let known = ["detect_negative", "detect_positive"];
    let attributes = call.attributes(&known)?;
    let (negative, positive) = (attributes.flag(known[0], true)?, attributes.flag(known[1], true)?);
    classified(call, &known, |_| {
        move |x: f64| (negative && x == f64::NEG_INFINITY) || (positive && x == f64::INFINITY)
    })
}

/// A truth about each number.
fn classified<T: Scalar, F: Fn(f64) -> bool>(
    call: &Call<T>,
    known: &[&str],
    question: impl FnOnce(Attributes) -> F,
) -> Result<Value<T>, String> {
    let holds = question(call.attributes(known)?);
    Ok(Value::from_truths(call.numbers(0)?.map(|x| holds(x.value()))))
}

#[cfg(test)]
mod tests {
    use super::super::tests::node;
    use super::super::{Value, evaluate};
    use crate::onnx::builder::float;
    use crate::onnx::element::ElementType;
    use vitruvian_reference::nn::{Rounded, Tensor};

    #[test]
    fn integers_wrap_where_their_type_has_no_answer() {
        let x: Value = Value::from_integers(ElementType::I8, Tensor::new(&[2], vec![-128, 5])).expect("i8");
        let y = |operator| evaluate(&node(operator, vec![]), 21, &[Some(&x)]).expect("integers")[0].clone();
        assert_eq!(y("Neg").expect("y").integers().expect("integers").data, [-128, -5]);
        assert_eq!(y("Abs").expect("y").integers().expect("integers").data, [-128, 5]);
        assert!(evaluate(&node("Exp", vec![]), 21, &[Some(&x)]).is_err(), "of integers there is none");
    }

    #[test]
    fn a_setting_that_the_type_does_not_hold_costs_a_rounding() {
        let terms = |element, alpha| {
            let x: Value<Rounded> = Value::from_numbers(element, Tensor::new(&[1], vec![-3.0]).rounded());
            let node = node("LeakyRelu", vec![float("alpha", alpha)]);
            let y = evaluate(&node, 21, &[Some(&x)]).expect("y")[0].clone().expect("y");
            y.numbers().expect("numbers").data[0].terms
        };
        assert_eq!((terms(ElementType::F32, 0.1), terms(ElementType::F16, 0.1)), (1.0, 2.0));
        assert_eq!(terms(ElementType::F16, 0.125), 1.0, "an eighth is an f16");
    }
}
