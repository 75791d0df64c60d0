//! Files and nodes broken at random: whatever comes, it is read or refused, never a panic, an abort or an endless loop.
//!
//! `VITRUVIAN_CASES=20000 cargo test --test fuzz` tries more, from `VITRUVIAN_SEED`.

use rand::seq::IndexedRandom as _;
use rand::{Rng, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use vitruvian_conformance::onnx::builder::{GraphBuilder, int};
use vitruvian_conformance::onnx::element::ElementType;
use vitruvian_conformance::onnx::message::{AttributeKind, AttributeProto, NodeProto};
use vitruvian_conformance::onnx::model::Model;
use vitruvian_conformance::onnx::walk::{self, Data, Value};
use vitruvian_conformance::onnx::write;
use vitruvian_reference::nn::{Rounded, Scalar, Tensor};

fn setting(name: &str, default: u64) -> u64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Files of every kind: exports with and without metadata, constants, several opsets.
fn files() -> Vec<Vec<u8>> {
    let small = GraphBuilder::new(17)
        .input("x", &[1, 2])
        .constant("w", &[2], &[3.0, 4.0])
        .integers("shape", &[2], &[2, 1])
        .truths("choice", &[2], &[true, false])
        .node("Mul", &["x", "w"], &["m"], vec![])
        .node("Where", &["choice", "m", "w"], &["c"], vec![])
        .node("Reshape", &["c", "shape"], &["y"], vec![int("allowzero", 0)])
        .output("y")
        .to_bytes();
    vec![
        small,
        include_bytes!("foreign/axis_angle_dynamo.onnx").to_vec(),
        include_bytes!("foreign/axis_angle_torchscript.onnx").to_vec(),
        include_bytes!("foreign/matrix_dynamo.onnx").to_vec(),
    ]
}

/// One to four changes: bits, bytes, lengths that lie, pieces moved, left out or doubled.
fn break_bytes(random: &mut impl Rng, bytes: &mut Vec<u8>) {
    for _ in 0..random.random_range(1..=4) {
        if bytes.is_empty() {
            return;
        }
        let at = random.random_range(0..bytes.len());
        let end = (at + random.random_range(1..=64)).min(bytes.len());
        match random.random_range(0..7) {
            0 => bytes[at] ^= 1 << random.random_range(0..8),
            1 => bytes[at] = random.random(),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..end)),
            4 => {
                let piece = bytes[at..end].to_vec();
                let to = random.random_range(0..=bytes.len());
                bytes.splice(to..to, piece);
            }
            // A length or a number of up to 2⁶³.
            5 => {
                let last = (at + 9).min(bytes.len());
                bytes[at..last].fill(0xff);
                if let Some(byte) = bytes.get_mut(last) {
                    *byte = 0x7f;
                }
            }
            _ => bytes[at..end].fill(random.random()),
        }
    }
}

#[test]
fn a_file_broken_at_random_is_read_or_refused() {
    let mut random = ChaCha8Rng::seed_from_u64(setting("VITRUVIAN_SEED", 1));
    let (files, mut read) = (files(), 0);
    let cases = setting("VITRUVIAN_CASES", 2000);
    for _ in 0..cases {
        let mut bytes = files.choose(&mut random).expect("files").clone();
        break_bytes(&mut random, &mut bytes);
        match Model::from_bytes("broken", bytes) {
            Err(why) => assert_eq!(why.to_string().lines().count(), 1, "{why}"),
            Ok(model) => {
                read += 1;
                for name in model.constant_names() {
                    // What was read when the file was opened is read now.
                    let Ok(tensor) = model.constant(name) else { continue };
                    assert_eq!(tensor.len(), tensor.shape.iter().product::<usize>(), "{name}");
                }
                for node in model.nodes() {
                    let operands = vec![None; node.input.len()];
                    let _refused_or_not = walk::evaluate::<f64>(node, model.opset(), &operands);
                }
            }
        }
    }
    println!("{read} of {cases} were read all the same");
}

/// ONNX's own operators.
const OPERATORS: &str = "Abs Acos Acosh Add AffineGrid And ArgMax ArgMin Asin Asinh Atan Atanh Attention AveragePool \
    BatchNormalization Bernoulli BitCast BitShift BitwiseAnd BitwiseNot BitwiseOr BitwiseXor BlackmanWindow Cast CastLike \
    CausalConvWithState Ceil Celu CenterCropPad Clip Col2Im Compress Concat Constant ConstantOfShape Conv ConvInteger \
    ConvTranspose Cos Cosh CumProd CumSum DFT DeformConv DepthToSpace DequantizeLinear Det Div Dropout \
    DynamicQuantizeLinear Einsum Elu Equal Erf Exp Expand EyeLike Flatten Floor GRU Gather GatherElements GatherND Gelu \
    Gemm GlobalAveragePool GlobalLpPool GlobalMaxPool Greater GreaterOrEqual GridSample GroupNormalization HammingWindow \
    HannWindow HardSigmoid HardSwish Hardmax Identity If InstanceNormalization IsInf IsNaN LRN LSTM LayerNormalization \
    LeakyRelu Less LessOrEqual LinearAttention Log LogSoftmax Loop LpNormalization LpPool MatMul MatMulInteger Max MaxPool \
    MaxRoiPool MaxUnpool Mean MeanVarianceNormalization MelWeightMatrix Min Mish Mod Mul Multinomial Neg \
    NegativeLogLikelihoodLoss NonMaxSuppression NonZero Not OneHot Optional Or PRelu Pad Pow QLinearConv QLinearMatMul \
    QuantizeLinear RMSNormalization RNN RandomNormal RandomNormalLike RandomUniform RandomUniformLike Range Reciprocal \
    ReduceL1 ReduceL2 ReduceLogSum ReduceLogSumExp ReduceMax ReduceMean ReduceMin ReduceProd ReduceSum ReduceSumSquare \
    Relu Reshape Resize ReverseSequence RoiAlign RotaryEmbedding Round STFT Scan Scatter ScatterElements ScatterND Selu \
    SequenceAt SequenceConstruct Shape Shrink Sigmoid Sign Sin Sinh Size Slice Softmax SoftmaxCrossEntropyLoss Softplus \
    Softsign SpaceToDepth Split Sqrt Squeeze StringConcat Sub Sum SwiGLU Swish Tan Tanh TensorScatter TfIdfVectorizer \
    ThresholdedRelu Tile TopK Transpose Trilu Unique Unsqueeze Upsample Where Xor";

/// Those of ONNX Runtime's own domain.
const FOREIGN: &str = "BiasGelu DequantizeLinear DynamicQuantizeMatMul FastGelu FusedConv FusedGemm FusedMatMul Gelu \
    MatMulIntegerToFloat NhwcMaxPool QGemm QLinearAdd QLinearAveragePool QLinearConcat QLinearConv \
    QLinearGlobalAveragePool QLinearLeakyRelu QLinearMul QLinearSigmoid QLinearSoftmax QLinearWhere \
    QuantizeLinear QuickGelu";

const INTS: &str = "axes dilations ends kernel_shape ngram_counts ngram_indexes output_padding output_shape paddings pads \
    perm pooled_shape shape split starts strides value_ints";

const FLOATS: &str = "activation_alpha activation_beta scales value_floats weights";

const NUMBERS: &str = "alpha beta bias clip cubic_coeff_a epsilon extrapolation_value gamma height_scale high lambd low max \
    mean min momentum ratio scale softcap spatial_scale value_float width_scale";

const TEXTS: &str = "activation approximate auto_pad coordinate_transformation_mode direction equation \
    keep_aspect_ratio_policy mode nearest_mode padding_mode reduction round_mode update_rule";

const WORDS: &str = "linear nearest cubic bilinear bicubic zeros border reflection constant reflect edge wrap none add mul \
    min max avg mean sum NOTSET SAME_UPPER SAME_LOWER VALID half_pixel asymmetric align_corners pytorch_half_pixel \
    tf_crop_and_resize half_pixel_symmetric round_prefer_floor ceil DCR CRD stretch not_larger not_smaller output_half_pixel \
    tanh LEFT RIGHT forward reverse bidirectional ij,jk->ik ...i->i i-> ii->i ij...,...j->... a,b->ab";

const OPSETS: [i64; 12] = [7, 9, 10, 11, 13, 15, 16, 18, 20, 22, 24, 28];

/// Mostly small, sometimes as large as a number can be; never so that a few of them ask for gigabytes and get them.
fn integer(random: &mut impl Rng) -> i64 {
    const LARGE: [i64; 9] = [
        i64::MIN,
        i64::MAX,
        i64::MIN + 1,
        -(1 << 31),
        1 << 31,
        1 << 40,
        1 << 62,
        u32::MAX as i64,
        -1_000_000_007,
    ];
    match random.random_range(0..12) {
        0 => *LARGE.choose(random).expect("numbers"),
        1..=3 => random.random_range(-5..0),
        _ => random.random_range(0..5),
    }
}

fn shape(random: &mut impl Rng, rank: usize) -> Vec<usize> {
    (0..rank).map(|_| *[0, 1, 1, 2, 2, 2, 3, 3, 4, 6].choose(random).expect("sides")).collect()
}

fn value<T: Scalar>(random: &mut impl Rng, element: ElementType, shape: &[usize]) -> Value<T> {
    let count: usize = shape.iter().product();
    if element == ElementType::Bool {
        return Value::from_truths(Tensor::new(shape, (0..count).map(|_| random.random()).collect()));
    }
    if element.is_float() {
        let number = |_| {
            let wild = [0.0, 1.0, -1.0, f64::NAN, f64::INFINITY, 1e30, -1e-40, 2.5e9];
            let tame = random.random_range(0..8) > 0;
            let number =
                if tame { random.random_range(-4.0..4.0) } else { *wild.choose(random).expect("numbers") };
            T::exact(element.round(number))
        };
        return Value::from_numbers(element, Tensor::new(shape, (0..count).map(number).collect()));
    }
    let integers = Tensor::new(shape, (0..count).map(|_| integer(random)).collect());
    // What no value holds becomes a small number.
    Value::from_integers(element, integers.clone())
        .unwrap_or_else(|_| Value::from_integers(element, integers.map(|i| i & 7)).expect("small numbers"))
}

fn operands<T: Scalar>(random: &mut impl Rng) -> Vec<Option<Value<T>>> {
    let rank = random.random_range(0..=5);
    let base = shape(random, rank);
    let common = if random.random_range(0..5) > 0 {
        ElementType::F32
    } else {
        *ElementType::ALL.choose(random).expect("types")
    };
    let count = random.random_range(0..=6);
    let operand = |k| {
        if k > 0 && random.random_range(0..8) == 0 {
            return None;
        }
        let element = match random.random_range(0..6) {
            _ if k == 0 => common,
            0..=3 => common,
            4 => ElementType::I64,
            _ => *ElementType::ALL.choose(random).expect("types"),
        };
        let shape = match random.random_range(0..8) {
            _ if k == 0 => base.clone(),
            0..=2 => base.clone(),
            3 => base.get(1).into_iter().copied().collect(),
            4 => Vec::new(),
            5 | 6 => vec![random.random_range(0..=base.len().max(1) * 2)],
            _ => {
                let rank = random.random_range(0..=5);
                shape(random, rank)
            }
        };
        Some(value(random, element, &shape))
    };
    (0..count).map(operand).collect()
}

fn attribute(random: &mut impl Rng, name: &str, rank: usize) -> AttributeProto {
    let listed = |names: &str| names.split_whitespace().any(|listed| listed == name);
    let length = *[0, 1, 2, rank, rank.saturating_sub(2), 2 * rank, 2 * rank.saturating_sub(2)]
        .choose(random)
        .expect("lengths");
    let mut attribute = AttributeProto { name: Some(name.into()), ..Default::default() };
    let kind = if random.random_range(0..30) == 0 {
        AttributeKind::Graphs
    } else if listed(INTS) {
        attribute.ints = (0..length).map(|_| integer(random)).collect();
        AttributeKind::Ints
    } else if listed(FLOATS) {
        attribute.floats =
            (0..length).map(|_| *[0.5, 2.0, -1.0, 1e30, f32::NAN].choose(random).expect("numbers")).collect();
        AttributeKind::Floats
    } else if listed(NUMBERS) {
        attribute.f = Some(*[0.0, 1.0, -0.75, 1e30, f32::NAN].choose(random).expect("numbers"));
        AttributeKind::Float
    } else if listed(TEXTS) {
        let words: Vec<&str> = WORDS.split_whitespace().collect();
        attribute.s = Some(words.choose(random).expect("words").as_bytes().to_vec());
        AttributeKind::String
    } else if name == "value" {
        let tensor = vitruvian_conformance::onnx::typed_tensor::TypedTensor::new(
            &[1],
            vitruvian_conformance::onnx::typed_tensor::Elements::F32(vec![2.0]),
        );
        attribute.t = Some(Box::new(write::constant("value", &tensor.expect("a tensor"))));
        AttributeKind::Tensor
    } else {
        attribute.i = Some(integer(random));
        AttributeKind::Int
    };
    attribute.kind = Some(kind as i32);
    attribute
}

fn evaluate<T: Scalar>(
    node: &NodeProto,
    opset: i64,
    operands: &[Option<Value<T>>],
) -> Result<Vec<Option<Value<T>>>, String> {
    walk::evaluate(node, opset, &operands.iter().map(Option::as_ref).collect::<Vec<_>>())
}

/// The attributes that an operator understands, as it says itself when it is given one that nobody does.
fn attributes<T: Scalar>(random: &mut impl Rng, domain: &str, operator: &str) -> Vec<String> {
    let foreign = AttributeProto { name: Some("nobody's".into()), ..Default::default() };
    for _ in 0..200 {
        let node = NodeProto {
            domain: Some(domain.into()),
            op_type: Some(operator.into()),
            attribute: vec![foreign.clone()],
            output: vec!["y".into()],
            ..Default::default()
        };
        let opset = *OPSETS.choose(random).expect("versions");
        let answer = evaluate::<T>(&node, opset, &operands(random));
        if let Some((_, known)) = answer.as_ref().err().and_then(|why| why.split_once("known are [")) {
            let names = known.trim_end_matches(']').split(", ").map(|name| name.trim_matches('"').to_owned());
            return names.filter(|name| !name.is_empty()).collect();
        }
    }
    Vec::new()
}

/// What is given must be whole: as many elements as places, and of the type's kind.
fn assert_whole<T: Scalar>(operator: &str, value: &Value<T>) {
    let (shape, count) = (value.shape(), value.len());
    let places = shape.iter().try_fold(1_usize, |all, &side| all.checked_mul(side));
    assert_eq!(places, Some(count), "{operator}: shape {shape:?}");
    let fits = match &value.data {
        Data::Numbers(_) => value.element.is_float(),
        Data::Integers(integers) => {
            integers.data.iter().all(|&i| value.element.range().is_some() && value.element.wrap(i) == Ok(i))
        }
        Data::Truths(_) => value.element == ElementType::Bool,
    };
    assert!(fits, "{operator}: {} as {}", value.kind(), value.element);
}

fn fuzz<T: Scalar>(seed: u64) {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let cases = setting("VITRUVIAN_CASES", 150);
    let mut never = Vec::new();
    let own = OPERATORS.split_whitespace().map(|operator| ("", operator));
    for (domain, operator) in
        own.chain(FOREIGN.split_whitespace().map(|operator| ("com.microsoft", operator)))
    {
        let known = attributes::<T>(&mut random, domain, operator);
        let mut answered = 0;
        for _ in 0..cases {
            let operands = operands::<T>(&mut random);
            let rank = operands.first().and_then(Option::as_ref).map_or(0, |value| value.shape().len());
            let some = random.random_range(0..3);
            let chosen: Vec<&String> = known.choose_multiple(&mut random, some).collect();
            let node = NodeProto {
                domain: Some(domain.into()),
                op_type: Some(operator.into()),
                attribute: chosen.into_iter().map(|name| attribute(&mut random, name, rank)).collect(),
                output: (0..random.random_range(1..=3)).map(|k| format!("y{k}")).collect(),
                ..Default::default()
            };
            let opset = *OPSETS.choose(&mut random).expect("versions");
            match evaluate(&node, opset, &operands) {
                Err(why) => assert_eq!(why.lines().count(), 1, "{operator}: {why}"),
                Ok(outputs) => {
                    answered += 1;
                    outputs.iter().flatten().for_each(|value| assert_whole(operator, value));
                }
            }
        }
        if answered == 0 {
            never.push(operator);
        }
    }
    println!("never answered: {never:?}");
}

#[test]
fn a_node_drawn_at_random_is_computed_or_refused() {
    fuzz::<f64>(setting("VITRUVIAN_SEED", 1));
}

#[test]
fn a_node_drawn_at_random_has_bounds_or_is_refused() {
    fuzz::<Rounded>(setting("VITRUVIAN_SEED", 2));
}
