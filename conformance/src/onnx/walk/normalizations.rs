//! Operators that normalise: batch, group, instance, layer, RMS, Lp and mean–variance.

use vitruvian_reference::nn::{
    Length, Scalar, Tensor, batch_norm, batch_norm_training, group_norm, instance_norm, layer_norm, lp_norm,
    mean_variance_norm, per_channel, rms_norm,
};

use super::{Answer, Attributes, Call, Value, axes, axis};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let one = |y: Result<Tensor<T>, String>| y.and_then(|y| Ok(vec![call.like(y)?]));
    Some(match call.operator {
        "BatchNormalization" => batch(call),
        "GroupNormalization" => one(group(call)),
        "InstanceNormalization" => one(instance(call)),
        "LayerNormalization" => layer(call),
        "LpNormalization" => one(lp(call)),
        "MeanVarianceNormalization" => one(mean_variance(call)),
        "RMSNormalization" => one(root_mean_square(call)),
        _ => return None,
    })
}

fn epsilon<T: Scalar>(call: &Call<T>, attributes: Attributes) -> Result<T, String> {
    call.constant(attributes.float("epsilon", 1e-5))
}

/// The precision of the statistics, which no operand's type may fall behind: bounds are those of the operand's type.
fn stashed(attributes: Attributes) -> Result<ElementType, String> {
    match attributes.int("stash_type", 1) {
        1 => Ok(ElementType::F32),
        11 => Ok(ElementType::F64),
        other => Err(format!("attribute \"stash_type\" is {other}, 1 (f32) or 11 (f64) was expected")),
    }
}

fn batch<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let attributes = call.attributes(&["epsilon", "momentum", "spatial", "training_mode"])?;
    if !attributes.flag("spatial", true)? {
        return Err("attribute \"spatial\" is 0; one statistic per channel was expected".into());
    }
    if call.opset < 14 && (1..5).any(|i| call.wants(i)) {
        return Err(
            "training, which more outputs than one ask for before version 14, is not understood".into()
        );
    }
    let [x, scale, bias, mean, variance] =
        [call.numbers(0)?, call.numbers(1)?, call.numbers(2)?, call.numbers(3)?, call.numbers(4)?];
    let epsilon = epsilon(call, attributes)?;
    if !attributes.flag("training_mode", false)? {
        return Ok(vec![call.like(batch_norm(x, scale, bias, mean, variance, epsilon))?]);
    }
    let momentum = call.constant(attributes.float("momentum", 0.9))?;
    let trained = batch_norm_training(x, [scale, bias, mean, variance], epsilon, momentum);
    let stored = call.operand(3)?.element;
    let statistics = [trained.mean, trained.variance].map(|s| Value::from_numbers(stored, s));
    Ok([vec![call.like(trained.y)?], statistics.to_vec()].concat())
}

/// One scale and bias per group in version 18, one per channel since 21.
fn group<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["epsilon", "num_groups", "stash_type"])?;
    stashed(attributes)?;
    let groups = attributes.count("num_groups", 0)?;
    let [x, scale, bias] = [call.numbers(0)?, call.numbers(1)?, call.numbers(2)?];
    let epsilon = epsilon(call, attributes)?;
    if call.opset >= 21 {
        return Ok(group_norm(x, groups, scale, bias, epsilon));
    }
    if scale.shape != [groups] || bias.shape != [groups] {
        return Err(format!(
            "scale {:?} and bias {:?}; before version 21 each of the {groups} groups has one",
            scale.shape, bias.shape
        ));
    }
    let channels = x.shape.get(1).copied().unwrap_or(0);
    Ok(group_norm(x, groups, &per_channel(scale, channels), &per_channel(bias, channels), epsilon))
}

fn instance<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let epsilon = epsilon(call, call.attributes(&["epsilon"])?)?;
    Ok(instance_norm(call.numbers(0)?, call.numbers(1)?, call.numbers(2)?, epsilon))
}

fn layer<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let attributes = call.attributes(&["axis", "epsilon", "stash_type"])?;
    let stash = stashed(attributes)?;
    let x = call.numbers(0)?;
    let at = axis(attributes.int("axis", -1), x.rank())?;
    let y = layer_norm(x, at, call.numbers(1)?, call.optional_numbers(2)?, epsilon(call, attributes)?);
    let statistics = [y.mean, y.inverse_deviation].map(|s| Value::from_numbers(stash, s));
    Ok([vec![call.like(y.y)?], statistics.to_vec()].concat())
}

fn root_mean_square<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["axis", "epsilon", "stash_type"])?;
    stashed(attributes)?;
    let x = call.numbers(0)?;
    let at = axis(attributes.int("axis", -1), x.rank())?;
    Ok(rms_norm(x, at, call.numbers(1)?, epsilon(call, attributes)?))
}

fn lp<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["axis", "p"])?;
    let x = call.numbers(0)?;
    let length = match attributes.int("p", 2) {
        1 => Length::Absolute,
        2 => Length::Euclidean,
        p => return Err(format!("attribute \"p\" is {p}, 1 or 2 was expected")),
    };
    Ok(lp_norm(x, axis(attributes.int("axis", -1), x.rank())?, length))
}

fn mean_variance<T: Scalar>(call: &Call<T>) -> Result<Tensor<T>, String> {
    let x = call.numbers(0)?;
    let over = call.attributes(&["axes"])?.integers("axes").unwrap_or_else(|| vec![0, 2, 3]);
    Ok(mean_variance_norm(x, &axes(&over, x.rank())?, call.constant(1e-9)?))
}

#[cfg(test)]
mod tests {
    use super::super::evaluate;
    use super::super::tests::node;
    use super::*;
    use crate::onnx::builder::int;

    fn numbers(shape: &[usize], data: &[f64]) -> Value {
        Value::from_numbers(ElementType::F32, Tensor::new(shape, data.to_vec()))
    }

    #[test]
    fn groups_had_one_scale_each_until_version_21() {
        let x = numbers(&[1, 4, 1], &[-1.0, 1.0, -1.0, 1.0]);
        let (two, zeros) = (numbers(&[2], &[1.0, 10.0]), numbers(&[2], &[0.0; 2]));
        let (four, none) = (numbers(&[4], &[1.0, 10.0, 100.0, 1000.0]), numbers(&[4], &[0.0; 4]));
        let y = |opset, scale: &Value, bias: &Value| {
            let node = node("GroupNormalization", vec![int("num_groups", 2)]);
            let y = evaluate(&node, opset, &[Some(&x), Some(scale), Some(bias)])?;
            Ok::<_, String>(y[0].as_ref().expect("y").numbers()?.map(f64::round).data)
        };
        assert_eq!(y(18, &two, &zeros), Ok(vec![-1.0, 1.0, -10.0, 10.0]));
        assert_eq!(y(21, &four, &none), Ok(vec![-1.0, 10.0, -100.0, 1000.0]));
        assert!(y(18, &four, &none).expect_err("refused").contains("each of the 2 groups has one"));
    }

    #[test]
    fn all_outputs_of_a_layer_are_given_in_their_types() {
        let x = Value::from_numbers(ElementType::F16, Tensor::new(&[1, 2], vec![1.0, 3.0]));
        let scale = Value::from_numbers(ElementType::F16, Tensor::new(&[2], vec![1.0, 1.0]));
        let mut node = node("LayerNormalization", vec![]);
        node.output = vec!["y".into(), "mean".into(), "inverse".into()];
        let outputs = evaluate::<f64>(&node, 17, &[Some(&x), Some(&scale)]).expect("outputs");
        let types: Vec<_> = outputs.iter().map(|y| y.as_ref().expect("an output").element).collect();
        assert_eq!(types, [ElementType::F16, ElementType::F32, ElementType::F32]);
    }
}
