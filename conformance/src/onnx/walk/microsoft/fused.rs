//! Several of ONNX's operators in one, as an optimiser leaves them.

use vitruvian_reference::nn::{Scalar, Tensor, transpose};

use super::{Answer, Attributes, Call, Inner, Value};
use crate::onnx::builder::{float, text};
use crate::onnx::element::ElementType;
use crate::onnx::message::AttributeProto;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "BiasGelu" => call.attributes(&[]).and_then(|_| {
            let sum = plain(call, "Add", vec![]).run(&[call.optional(0), call.optional(1)])?;
            plain(call, "Gelu", vec![]).run(&[Some(&sum)])
        }),
        "FastGelu" => call.attributes(&[]).and_then(|_| {
            let gelu = plain(call, "Gelu", vec![text("approximate", "tanh")]);
            match call.optional(1) {
                Some(bias) => {
                    gelu.run(&[Some(&plain(call, "Add", vec![]).run(&[call.optional(0), Some(bias)])?)])
                }
                None => gelu.run(&[call.optional(0)]),
            }
        }),
        "FusedConv" => convolution(call),
        "FusedGemm" => matrix_product(call),
        "FusedMatMul" | "TransposeMatMul" => batched_product(call),
        "Gelu" => call.attributes(&[]).and_then(|_| plain(call, "Gelu", vec![]).run(call.operands)),
        "QuickGelu" => call.attributes(&["alpha"]).and_then(|attributes| {
            let alpha = attributes.float("alpha", 1.702) as f32;
            plain(call, "Swish", vec![float("alpha", alpha)]).run(call.operands)
        }),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// One of ONNX's operators with these attributes and none of the node's.
fn plain<T>(call: &Call<T>, operator: &str, attributes: Vec<AttributeProto>) -> Inner {
    let mut inner = Inner::of(call, operator, &[]);
    inner.node.attribute = attributes;
    inner
}

/// y by the activation of this name, whose settings are in the order of ONNX's attributes; without a name y itself.
fn activated<T: Scalar>(
    call: &Call<T>,
    y: Value<T>,
    name: &str,
    settings: &[f32],
) -> Result<Value<T>, String> {
    let known: &[&str] = match name {
        "" => return Ok(y),
        "Relu" | "Sigmoid" | "Tanh" => &[],
        "LeakyRelu" => &["alpha"],
        "HardSigmoid" => &["alpha", "beta"],
        "Clip" => return limited(call, &y, settings),
        _ => return Err(format!("attribute \"activation\" is {name}, which is not understood")),
    };
    if settings.len() > known.len() {
        return Err(format!(
            "settings {settings:?} of the activation {name}, at most {} were expected",
            known.len()
        ));
    }
    let attributes = known.iter().zip(settings).map(|(name, &setting)| float(name, setting)).collect();
    plain(call, name, attributes).run(&[Some(&y)])
}

/// y between two limits.
fn limited<T: Scalar>(call: &Call<T>, y: &Value<T>, settings: &[f32]) -> Result<Value<T>, String> {
    let &[low, high] = settings else {
        return Err(format!("settings {settings:?} of the activation Clip, two limits were expected"));
    };
    let limit = |x: f32| Value::from_numbers(y.element, Tensor::new(&[], vec![T::exact(f64::from(x))]));
    plain(call, "Clip", vec![]).run(&[Some(y), Some(&limit(low)), Some(&limit(high))])
}

/// Activation(Conv(x, w, bias) + z).
fn convolution<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let outer = ["activation", "activation_params"];
    let inner = Inner::of(call, "Conv", &outer);
    let around = inner.attributes(&outer)?;
    let (name, settings) =
        (around.text("activation", "")?, around.floats("activation_params").unwrap_or_default());
    let y = inner.run(&[call.optional(0), call.optional(1), call.optional(2)])?;
    let y = match call.optional(3) {
        Some(z) => plain(call, "Add", vec![]).run(&[Some(&y), Some(z)])?,
        None => y,
    };
    activated(call, y, name, settings)
}

/// Activation(Gemm(a, b, c)).
fn matrix_product<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let outer = ["activation", "activation_alpha", "activation_beta", "activation_gamma"];
    let inner = Inner::of(call, "Gemm", &outer);
    let around = inner.attributes(&outer)?;
    let given = outer[1..].iter().take_while(|name| around.has(name));
    let settings: Vec<f32> = given.map(|name| around.float(name, 0.0) as f32).collect();
    activated(call, inner.run(call.operands)?, around.text("activation", "")?, &settings)
}

/// alpha·a·b, with the last two axes of either exchanged before if asked for.
fn batched_product<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let known = ["alpha", "transA", "transB", "transBatchA", "transBatchB"];
    let attributes: Attributes = call.attributes(&known)?;
    for name in &known[3..] {
        if attributes.flag(name, false)? {
            return Err(format!("attribute \"{name}\" is 1, which is not understood"));
        }
    }
    let matrix = |i: usize, name: &str| {
        let (x, element) = (call.numbers(i)?, call.operand(i)?.element);
        // A vector has no axes to exchange.
        let exchanged = attributes.flag(name, false)? && x.rank() > 1;
        let mut order: Vec<usize> = (0..x.rank()).collect();
        if exchanged {
            order.swap(x.rank() - 2, x.rank() - 1);
        }
        Ok::<_, String>(Value::from_numbers(element, transpose(x, &order)))
    };
    let y = plain(call, "MatMul", vec![]).run(&[Some(&matrix(0, "transA")?), Some(&matrix(1, "transB")?)])?;
    let alpha = attributes.float("alpha", 1.0);
    if alpha == 1.0 {
        return Ok(y);
    }
    let element: ElementType = y.element;
    let alpha = call.constant(alpha)?;
    Ok(Value::from_numbers(element, y.numbers()?.map(|y| alpha * y)))
}
