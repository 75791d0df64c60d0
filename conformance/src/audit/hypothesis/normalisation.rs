//! Normalisations: epsilon, the kind of variance, exchanged statistics and scales, groups and axes.

use vitruvian_reference::nn::{Rounded, Scalar, Tensor};

use super::Suspicion;
use super::change::{
    Meaning, Operands, Outputs, attributes, exact, float, int, numbers, operator, reordered, with_attributes,
};
use super::fit::Parameter;
use super::trial::Trial;
use crate::onnx::builder;
use crate::onnx::message::NodeProto;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

const WITH_EPSILON: [&str; 5] = [
    "BatchNormalization",
    "InstanceNormalization",
    "GroupNormalization",
    "LayerNormalization",
    "RMSNormalization",
];

/// Values of ε in use: PyTorch's, TensorFlow's, the 1e-6 of transformers, guards, and none.
const EPSILONS: [f32; 10] = [1e-3, 1e-5, 1e-6, 1e-4, 1e-8, 0.0, 1e-2, 1e-7, 1e-12, 2e-5];

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    if !WITH_EPSILON.contains(&trial.operator()) {
        return match trial.operator() {
            "LRN" => local_response(trial),
            "LpNormalization" => {
                let p = int(trial.node(), "p", 2);
                vec![Suspicion::new(
                    "p",
                    format!("p is {p} in the graph; {} explains the numbers", 3 - p),
                    attributes(vec![builder::int("p", 3 - p)]),
                )]
            }
            _ => Vec::new(),
        };
    }
    let is = float(trial.node(), "epsilon", 1e-5);
    let mut all: Vec<Suspicion> = Vec::new();
    for epsilon in EPSILONS.into_iter().filter(|&other| other != is) {
        all.push(Suspicion::new(
            "epsilon",
            format!("epsilon is {is:e} in the graph; {epsilon:e} explains the numbers"),
            attributes(vec![builder::float("epsilon", epsilon)]),
        ));
    }
    all.extend(match trial.operator() {
        "BatchNormalization" => batch(trial),
        "GroupNormalization" => group(trial),
        "LayerNormalization" | "RMSNormalization" => layer(trial),
        _ => Vec::new(),
    });
    for (name, detail, change) in STATISTICS {
        if trial.operator() != "BatchNormalization" {
            all.push(Suspicion::new(*name, *detail, by_statistics(*change)));
        }
    }
    let [scale, bias] = [("scale", 1, 1.0), ("bias", 2, 0.0)].map(|(what, place, neutral)| {
        Suspicion::new(
            format!("{what}-missing"),
            format!("the {what} was left out"),
            numbers(place, move |_| neutral),
        )
    });
    all.extend([scale, bias]);
    if trial.shape(1) == trial.shape(2) {
        let mut order: Vec<usize> = (0..trial.case.operands.len()).collect();
        order.swap(1, 2);
        all.push(Suspicion::new("scale-bias-swapped", "scale and bias were exchanged", reordered(order)));
    }
    all
}

/// What a number of elements, their mean, variance and ε make of the factor 1/√(v + ε), and of the mean to subtract.
type Change = fn(count: f64, mean: f64, variance: f64, epsilon: f64) -> (f64, f64);

const STATISTICS: &[(&str, &str, Change)] = &[
    ("variance", "the variance was divided by N − 1 (unbiased), not by N", |n, mean, v, eps| {
        (mean, 1.0 / (v * n / (n - 1.0) + eps).sqrt())
    }),
    ("epsilon", "epsilon was added to the standard deviation, outside the root", |_, mean, v, eps| {
        (mean, 1.0 / (v.sqrt() + eps))
    }),
    ("mean", "the mean was not subtracted, only the deviation was divided by", |_, _, v, eps| {
        (0.0, 1.0 / (v + eps).sqrt())
    }),
    ("rms", "the root mean square was divided by, and the mean not subtracted", |_, mean, v, eps| {
        (0.0, 1.0 / (v + mean * mean + eps).sqrt())
    }),
    ("variance", "the mean was subtracted, and nothing divided by", |_, mean, _, _| (mean, 1.0)),
];

/// Instance, group or layer normalisation with other statistics.
///
/// The bound is the specified operator's: the same numbers are summed.
fn by_statistics(change: Change) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let specified: Vec<Option<Value<Rounded>>> = walk::evaluate(node, opset, operands)?;
        let of = |i: usize| operands.get(i).copied().flatten().ok_or("has no such operand");
        let x = of(0)?.numbers()?;
        let scale = of(1)?.numbers()?;
        let bias = operands.get(2).copied().flatten().map(Value::numbers).transpose()?;
        let first = specified.first().and_then(Option::as_ref).ok_or("has no output")?;
        let bounds = first.numbers()?;
        let epsilon = f64::from(float(node, "epsilon", 1e-5));
        let channels = x.shape.get(1).copied().unwrap_or(1);
        let place: usize = x.shape.iter().skip(2).product();
        let operator = node.op_type.as_deref().unwrap_or_default();
        // Elements that share statistics lie beside one another.
        let together = match operator {
            "InstanceNormalization" => place,
            "GroupNormalization" => {
                let groups = usize::try_from(int(node, "num_groups", 1)).unwrap_or(1).max(1);
                place * channels / groups
            }
            _ => {
                let axis = int(node, "axis", -1);
                let axis = if axis < 0 { axis + x.shape.len() as i64 } else { axis };
                x.shape.iter().skip(usize::try_from(axis).unwrap_or(0)).product()
            }
        };
        if together == 0 || x.data.len() % together != 0 {
            return Err("has no groups".into());
        }
        let own = |tensor: &Tensor<Rounded>, i: usize| {
            let at = match operator {
                "InstanceNormalization" | "GroupNormalization" => {
                    let channel = i / place % channels;
                    channel * tensor.data.len() / channels
                }
                _ => i % tensor.data.len().max(1),
            };
            tensor.data.get(at).map_or(0.0, |r| r.value)
        };
        let mut data = Vec::with_capacity(x.data.len());
        for (g, elements) in x.data.chunks_exact(together).enumerate() {
            let n = together as f64;
            let mean = elements.iter().map(|r| r.value).sum::<f64>() / n;
            let variance = elements.iter().map(|r| (r.value - mean).powi(2)).sum::<f64>() / n;
            let (subtracted, factor) = change(n, mean, variance, epsilon);
            for (k, r) in elements.iter().enumerate() {
                let i = g * together + k;
                let y =
                    (r.value - subtracted) * factor * own(scale, i) + bias.map_or(0.0, |bias| own(bias, i));
                let bound = bounds.data[i];
                let magnitude = bound.magnitude.max(y.abs()).max((r.value * factor * own(scale, i)).abs());
                data.push(Rounded::within(y, magnitude, bound.terms));
            }
        }
        let mut outputs = specified;
        outputs[0] = Some(Value {
            element: outputs[0].as_ref().ok_or("has no output")?.element,
            data: Data::Numbers(Tensor::new(&x.shape, data)),
        });
        Ok(outputs)
    })
}

fn batch(trial: &Trial) -> Vec<Suspicion> {
    let swapped = |a: usize, b: usize| {
        let mut order: Vec<usize> = (0..5).collect();
        order.swap(a, b);
        reordered(order)
    };
    let epsilon = f64::from(float(trial.node(), "epsilon", 1e-5));
    let outside = Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let old = operands.get(4).copied().flatten().ok_or("has no variance")?;
        let new =
            super::change::changed(old, |v| (v.value.sqrt() + epsilon).powi(2)).ok_or("has no variance")?;
        let mut operands = operands.to_vec();
        operands[4] = Some(&new);
        walk::evaluate(&with_attributes(node, &[builder::float("epsilon", 0.0)]), opset, &operands)
    });
    let mut all = vec![
        Suspicion::new("mean-variance-swapped", "mean and variance were exchanged", swapped(3, 4)),
        Suspicion::new("scale-mean-swapped", "scale and mean were exchanged", swapped(1, 3)),
        Suspicion::new("bias-mean-swapped", "bias and mean were exchanged", swapped(2, 3)),
        Suspicion::new("epsilon", "epsilon was added to the standard deviation, outside the root", outside),
        Suspicion::new("mean", "the mean was not subtracted", numbers(3, |_| 0.0)),
        Suspicion::new("variance", "the variance was taken as 1", numbers(4, |_| 1.0)),
        Suspicion::new(
            "variance",
            "the variance was taken for the standard deviation",
            numbers(4, |v| v * v),
        ),
        Suspicion::new(
            "variance",
            "the standard deviation was taken for the variance",
            numbers(4, f64::sqrt),
        ),
        Suspicion::new(
            "training_mode",
            "the batch's own mean and variance were used, as in training, not the running ones",
            of_the_batch(),
        ),
    ];
    // What the running variance of a batch of this size is larger by.
    if let Some(x) = trial.shape(0) {
        let n = x.iter().product::<usize>() as f64 / x.get(1).copied().unwrap_or(1).max(1) as f64;
        if n > 1.0 {
            all.push(Suspicion::new(
                "variance",
                "the variance was divided by N − 1 (unbiased), not by N",
                numbers(4, move |v| v * n / (n - 1.0)),
            ));
        }
    }
    all
}

/// Batch normalisation by the mean and variance of the operand itself.
fn of_the_batch() -> Meaning {
    Box::new(|node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let of = |i: usize| operands.get(i).copied().flatten().ok_or("has no such operand");
        let x = of(0)?.numbers()?;
        let channels = x.shape.get(1).copied().unwrap_or(1);
        let place: usize = x.shape.iter().skip(2).product();
        let mut sums = vec![[0.0; 3]; channels];
        for (i, r) in x.data.iter().enumerate() {
            let sum = &mut sums[i / place % channels];
            *sum = [sum[0] + 1.0, sum[1] + r.value, sum[2] + r.value * r.value];
        }
        let statistic = |f: fn([f64; 3]) -> f64, i: usize| -> Result<Value<Rounded>, String> {
            let data = sums.iter().map(|&sum| exact(f(sum))).collect();
            Ok(Value { element: of(i)?.element, data: Data::Numbers(Tensor::new(&[channels], data)) })
        };
        let mean = statistic(|[n, s, _]| s / n, 3)?;
        let variance = statistic(|[n, s, q]| (q / n - (s / n).powi(2)).max(0.0), 4)?;
        let operands = [operands[0], operands[1], operands[2], Some(&mean), Some(&variance)];
        // The statistics themselves are sums of n numbers.
        let mut outputs: Vec<Option<Value<Rounded>>> = walk::evaluate(node, opset, &operands)?;
        let n = sums.first().map_or(1.0, |sum| sum[0]);
        if let Some(Value { data: Data::Numbers(y), .. }) = outputs.first_mut().and_then(Option::as_mut) {
            y.data.iter_mut().for_each(|r| r.terms += 2.0 * n);
        }
        Ok(outputs)
    })
}

fn group(trial: &Trial) -> Vec<Suspicion> {
    let Some(&channels) = trial.shape(0).and_then(|shape| shape.get(1)) else { return Vec::new() };
    let groups = usize::try_from(int(trial.node(), "num_groups", 1)).unwrap_or(1).max(1);
    let mut all = Vec::new();
    for other in (1..=channels).filter(|other| channels % other == 0 && *other != groups) {
        all.push(Suspicion::new(
            "num_groups",
            format!("num_groups is {groups} in the graph; {other} explains the numbers"),
            attributes(vec![builder::int("num_groups", other as i64)]),
        ));
    }
    if trial.shape(1) == Some(&[channels]) && channels % groups == 0 && groups < channels {
        let size = channels / groups;
        // As in opset 18: one scale a group, or the same list dealt out in turn.
        let ways: [(&str, fn(usize, usize) -> usize); 3] = [
            ("each group took that of its first channel", |c, size| c / size * size),
            ("one for each group, the first of the list", |c, size| c / size),
            ("each group took those of the first channels", |c, size| c % size),
        ];
        for (how, from) in ways {
            let order: Vec<usize> = (0..channels).map(|c| from(c, size)).collect();
            for (what, places) in [("scale and bias", &[1, 2][..]), ("scale", &[1]), ("bias", &[2])] {
                let detail = format!("{what} were not taken by channel: {how}");
                all.push(Suspicion::new("scale-per-group", detail, dealt(order.clone(), places)));
            }
        }
    }
    all.push(Suspicion::new(
        "num_groups",
        "every channel was normalised alone, as by InstanceNormalization",
        operator(
            "InstanceNormalization",
            vec![builder::float("epsilon", float(trial.node(), "epsilon", 1e-5))],
            &[0, 1, 2],
        ),
    ));
    all
}

/// Lists of one number a channel in another order.
fn dealt(order: Vec<usize>, places: &'static [usize]) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let dealt = |i: usize| -> Result<Option<Value<Rounded>>, String> {
            let old = operands.get(i).copied().flatten().ok_or("has no such operand")?;
            if !places.contains(&i) {
                return Ok(Some(old.clone()));
            }
            let x = old.numbers()?;
            let data: Option<Vec<Rounded>> = order.iter().map(|&c| x.data.get(c).copied()).collect();
            Ok(data
                .map(|data| Value { element: old.element, data: Data::Numbers(Tensor::new(&x.shape, data)) }))
        };
        let (scale, bias) = (dealt(1)?, dealt(2)?);
        walk::evaluate(node, opset, &[operands[0], scale.as_ref(), bias.as_ref()])
    })
}

fn layer(trial: &Trial) -> Vec<Suspicion> {
    let Some(rank) = trial.shape(0).map(<[usize]>::len) else { return Vec::new() };
    let axis = int(trial.node(), "axis", -1);
    let counted = if axis < 0 { axis + rank as i64 } else { axis };
    let mut all = Vec::new();
    for other in (0..rank as i64).filter(|&other| other != counted) {
        all.push(Suspicion::new(
            "axis",
            format!("axis is {axis} in the graph; {other} explains the numbers"),
            attributes(vec![builder::int("axis", other)]),
        ));
    }
    all
}

fn local_response(trial: &Trial) -> Vec<Suspicion> {
    let node = trial.node();
    let (alpha, size) = (float(node, "alpha", 1e-4), int(node, "size", 1));
    vec![
        Suspicion::new(
            "alpha",
            format!("alpha {alpha:e} was not divided by size {size}"),
            attributes(vec![builder::float("alpha", alpha * size as f32)]),
        ),
        Suspicion::new("bias", "bias was taken as 1", attributes(vec![builder::float("bias", 1.0)])),
    ]
}

pub(super) fn parameters(trial: &Trial) -> Vec<Parameter> {
    if !WITH_EPSILON.contains(&trial.operator()) {
        return Vec::new();
    }
    let is = float(trial.node(), "epsilon", 1e-5);
    let epsilon = Parameter::new(
        "epsilon",
        f64::from(is),
        move |epsilon| format!("epsilon is {is:e} in the graph; {epsilon:e} explains the numbers"),
        |epsilon| attributes(vec![builder::float("epsilon", epsilon as f32)]),
    );
    vec![epsilon.at_least(0.0)]
}
