//! Operands drawn at random, operator by operator.

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::Foreign;
use crate::onnx::builder::{float, floats, int, ints, text};
use crate::onnx::message::AttributeProto;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// One problem; with `halves` its scales are powers of two, so that many numbers lie half way between two integers.
///
/// # Panics
/// When the operator is none of [`QUANTIZED`](super::QUANTIZED) and [`REAL`](super::REAL).
pub fn drawn(operator: &'static str, seed: u64, halves: bool) -> Foreign {
    let mut draw = Draw::new(seed, halves);
    let (attributes, operands) = match operator {
        "BiasGelu" | "FastGelu" | "Gelu" | "QuickGelu" => draw.activation(operator),
        "DynamicQuantizeMatMul" => draw.dynamic_product(),
        "FusedConv" => draw.fused_convolution(),
        "FusedGemm" | "FusedMatMul" => draw.fused_product(operator),
        "MatMulIntegerToFloat" => draw.product_to_float(),
        "QGemm" => draw.product(),
        "QLinearAdd" | "QLinearMul" | "QLinearWhere" => draw.pair(operator),
        "QLinearAveragePool" | "QLinearGlobalAveragePool" => draw.pool(operator),
        "QLinearConcat" => draw.concat(),
        "QLinearConv" => draw.convolution(),
        "QLinearLeakyRelu" | "QLinearSigmoid" | "QLinearSoftmax" => draw.function(operator),
        other => panic!("no problems of {other} are drawn"),
    };
    Foreign { operator, attributes, operands }
}

type Parts = (Vec<AttributeProto>, Vec<Option<TypedTensor>>);

/// The shape of a convolution with the window of these attributes, which come first: kernel, pads and strides.
fn convolved(x: &[usize], outputs: usize, window: &[AttributeProto]) -> Vec<usize> {
    let side = |axis: usize| {
        let [kernel, before, after, stride] =
            [&window[0].ints[axis], &window[1].ints[axis], &window[1].ints[axis + 2], &window[2].ints[axis]];
        (x[axis + 2] as i64 + before + after - kernel) / stride + 1
    };
    vec![x[0], outputs, side(0) as usize, side(1) as usize]
}

/// Random operands.
struct Draw {
    random: ChaCha8Rng,
    signed: bool,
    halves: bool,
}

fn scalar(x: f32) -> Option<TypedTensor> {
    Some(TypedTensor { shape: vec![], elements: Elements::F32(vec![x]) })
}

impl Draw {
    fn new(seed: u64, halves: bool) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let signed = random.random_bool(0.5);
        Self { random, signed, halves }
    }

    fn coin(&mut self) -> bool {
        self.random.random_bool(0.5)
    }

    fn side(&mut self, most: usize) -> usize {
        self.random.random_range(1..=most)
    }

    fn shape(&mut self, ranks: std::ops::RangeInclusive<usize>, most: usize) -> Vec<usize> {
        let rank = self.random.random_range(ranks);
        (0..rank).map(|_| self.side(most)).collect()
    }

    /// A scale about this size.
    fn step(&mut self, about: f32) -> f32 {
        let step = about * 10_f32.powf(self.random.random_range(-0.3..0.3));
        if self.halves { step.log2().round().exp2() } else { step }
    }

    fn small_step(&mut self) -> f32 {
        let about = 10_f32.powf(self.random.random_range(-3.0..-1.0));
        self.step(about)
    }

    /// Integers of the problem's type, as many as the shape has places, within the whole type or a part of it.
    fn bytes(&mut self, shape: &[usize], signed: bool, part: i32) -> TypedTensor {
        let count = shape.iter().product();
        let elements = if signed {
            Elements::I8((0..count).map(|_| (self.random.random_range(-128..=127) / part) as i8).collect())
        } else {
            Elements::U8((0..count).map(|_| (self.random.random_range(0..=255) / part) as u8).collect())
        };
        TypedTensor { shape: shape.to_vec(), elements }
    }

    fn zero(&mut self) -> Option<TypedTensor> {
        self.coin().then(|| self.bytes(&[], self.signed, 2)).or_else(|| self.zero_of(0))
    }

    /// This zero point.
    fn zero_of(&self, zero: i8) -> Option<TypedTensor> {
        let elements =
            if self.signed { Elements::I8(vec![zero]) } else { Elements::U8(vec![zero.unsigned_abs()]) };
        Some(TypedTensor { shape: vec![], elements })
    }

    /// Integers, their scale and their zero point.
    fn stored(&mut self, shape: &[usize], step: f32) -> [Option<TypedTensor>; 3] {
        [Some(self.bytes(shape, self.signed, 1)), scalar(step), self.zero()]
    }

    fn numbers(&mut self, shape: &[usize], size: f32) -> Option<TypedTensor> {
        let values = (0..shape.iter().product()).map(|_| self.random.random_range(-size..size)).collect();
        Some(TypedTensor { shape: shape.to_vec(), elements: Elements::F32(values) })
    }

    /// A shape that broadcasts to this one.
    fn broadcast(&mut self, shape: &[usize]) -> Vec<usize> {
        let from = self.random.random_range(0..=shape.len());
        shape[from..].iter().map(|&side| if self.random.random_bool(0.3) { 1 } else { side }).collect()
    }

    fn pair(&mut self, operator: &str) -> Parts {
        let shape = self.shape(1..=4, 9);
        let (other, a_step, b_step) = (self.broadcast(&shape), self.small_step(), self.small_step());
        let (a, b) = (self.stored(&shape, a_step), self.stored(&other, b_step));
        let y_step = match operator {
            "QLinearMul" => self.step(a_step * b_step * 90.0),
            _ => self.step((a_step + b_step) * 0.7),
        };
        let mut operands = [a, b].concat();
        if operator == "QLinearWhere" {
            let truths = (0..shape.iter().product()).map(|_| self.coin()).collect();
            operands.insert(0, Some(TypedTensor { shape, elements: Elements::Bool(truths) }));
        }
        operands.extend([scalar(y_step), self.zero()]);
        (vec![], operands)
    }

    fn function(&mut self, operator: &str) -> Parts {
        let shape = self.shape(1..=4, 9);
        let step = self.step(0.04);
        let mut operands = self.stored(&shape, step).to_vec();
        let (attributes, y_step, zero) = match operator {
            "QLinearLeakyRelu" => {
                (vec![float("alpha", self.random.random_range(0.0..0.5))], self.step(step), None)
            }
            "QLinearSigmoid" => (vec![], self.step(1.0 / 256.0), None),
            _ => {
                let axis = self.random.random_range(0..shape.len());
                let opset = if self.coin() { 12 } else { 13 };
                // ONNX Runtime takes 1/s_y as a whole number.
                (
                    vec![int("axis", axis as i64), int("opset", opset)],
                    1.0 / 256.0,
                    self.zero_of(if self.signed { -128 } else { 0 }),
                )
            }
        };
        operands.extend([scalar(y_step), zero.or_else(|| self.zero())]);
        (attributes, operands)
    }

    fn concat(&mut self) -> Parts {
        let shape = self.shape(1..=4, 6);
        let axis = self.random.random_range(0..shape.len());
        let y_step = self.small_step();
        let mut operands = vec![scalar(y_step), self.zero()];
        for _ in 0..self.random.random_range(2..=4) {
            let mut shape = shape.clone();
            shape[axis] = self.side(6);
            let step = self.step(y_step);
            operands.extend(self.stored(&shape, step));
        }
        (vec![int("axis", axis as i64)], operands)
    }

    /// Samples, an image of two sides and channels, in either order.
    fn image(&mut self, last: bool) -> (Vec<usize>, [usize; 2]) {
        let (n, c, sides) = (self.side(2), self.side(5), [self.side(9) + 2, self.side(9) + 2]);
        let shape = if last { vec![n, sides[0], sides[1], c] } else { vec![n, c, sides[0], sides[1]] };
        (shape, sides)
    }

    fn window(&mut self, kernel: [usize; 2]) -> Vec<AttributeProto> {
        let pads: Vec<usize> = (0..4).map(|k| self.random.random_range(0..kernel[k % 2])).collect();
        vec![
            ints("kernel_shape", &kernel),
            ints("pads", &pads),
            ints("strides", &[self.side(2), self.side(2)]),
        ]
    }

    fn pool(&mut self, operator: &str) -> Parts {
        let last = self.coin();
        let (shape, _) = self.image(last);
        let step = self.small_step();
        let mut operands = self.stored(&shape, step).to_vec();
        let y_step = self.step(step * 0.6);
        operands.extend([scalar(y_step), self.zero()]);
        let mut attributes = vec![int("channels_last", i64::from(last))];
        if operator == "QLinearAveragePool" {
            let kernel = [self.side(3), self.side(3)];
            attributes.extend(self.window(kernel));
            attributes.push(int("count_include_pad", i64::from(self.coin())));
        }
        (attributes, operands)
    }

    /// Weights of eight bits, small enough that no instruction that adds two products of bytes in sixteen bits cuts them off.
    fn weights(&mut self, shape: &[usize], signed: bool) -> TypedTensor {
        self.bytes(shape, signed, if signed { 2 } else { 1 })
    }

    /// Scales and zero points of weights: one for all, or one for each of so many channels.
    fn of_channels(&mut self, channels: usize, signed: bool) -> [Option<TypedTensor>; 2] {
        let shape = if self.coin() { vec![] } else { vec![channels] };
        let steps = (0..shape.iter().product()).map(|_| self.small_step()).collect();
        let zero = if signed { 128 } else { 1 };
        let zeros = self.bytes(&shape, signed, zero);
        [Some(TypedTensor { shape, elements: Elements::F32(steps) }), Some(zeros)]
    }

    fn convolution(&mut self) -> Parts {
        let last = self.coin();
        let (shape, _) = self.image(last);
        let (inputs, outputs) = (shape[if last { 3 } else { 1 }], self.side(4));
        let kernel = [self.side(3), self.side(3)];
        let x_step = self.small_step();
        let x = self.stored(&shape, x_step);
        let w = self.weights(&[outputs, inputs, kernel[0], kernel[1]], self.signed);
        let w_step = self.small_step();
        let y_step = self.step(x_step * w_step * 60.0 * (inputs as f32 * 3.0).sqrt());
        let mut operands = x.to_vec();
        operands.extend([Some(w), scalar(w_step), self.zero_of(0), scalar(y_step), self.zero()]);
        let mut attributes = self.window(kernel);
        attributes.push(int("channels_last", i64::from(last)));
        (attributes, operands)
    }

    fn product(&mut self) -> Parts {
        let (m, k, n) = (self.side(9), self.side(40), self.side(9));
        let (trans_a, trans_b) = (self.coin(), self.coin());
        let turned = |turned: bool, a, b| if turned { [b, a] } else { [a, b] };
        let a_step = self.small_step();
        let a = self.stored(&turned(trans_a, m, k), a_step);
        let b_signed = self.signed || self.coin();
        let b = self.weights(&turned(trans_b, k, n), b_signed);
        let [b_step, b_zero] = self.of_channels(n, b_signed);
        let alpha = if self.coin() { 1.0 } else { self.random.random_range(0.2..2.0) };
        let c = self.coin().then(|| TypedTensor {
            shape: vec![n],
            elements: Elements::I32((0..n).map(|_| self.random.random_range(-9000..9000)).collect()),
        });
        let mut operands = [a.to_vec(), vec![Some(b), b_step, b_zero, c]].concat();
        if self.random.random_bool(0.75) {
            let y_step = self.step(a_step * 0.03 * 60.0 * (k as f32).sqrt());
            operands.extend([scalar(y_step), self.zero()]);
        }
        let attributes =
            vec![float("alpha", alpha), int("transA", i64::from(trans_a)), int("transB", i64::from(trans_b))];
        (attributes, operands)
    }

    /// Matrices of so many rows, by one with a list of scales for its columns.
    fn sides(&mut self) -> (Vec<usize>, usize, usize) {
        let (batch, m, k, n) = (self.side(3), self.side(9), self.side(40), self.side(9));
        (vec![batch, m, k], k, n)
    }

    fn product_to_float(&mut self) -> Parts {
        let (shape, k, n) = self.sides();
        let a_step = self.small_step();
        let [a, a_step, a_zero] = self.stored(&shape, a_step);
        let b_signed = self.signed || self.coin();
        let b = self.weights(&[k, n], b_signed);
        let [b_step, b_zero] = self.of_channels(n, b_signed);
        let bias = self.coin().then(|| self.numbers(&[n], 2.0)).flatten();
        (vec![], vec![a, Some(b), a_step, b_step, a_zero, b_zero, bias])
    }

    fn dynamic_product(&mut self) -> Parts {
        let (shape, k, n) = self.sides();
        let a = self.numbers(&shape, 3.0);
        let b_signed = self.coin();
        let b = self.weights(&[k, n], b_signed);
        let [b_step, b_zero] = self.of_channels(n, b_signed);
        let bias = self.coin().then(|| self.numbers(&[n], 2.0)).flatten();
        (vec![], vec![a, Some(b), b_step, b_zero, bias])
    }

    fn activation(&mut self, operator: &str) -> Parts {
        let shape = self.shape(1..=3, 9);
        let x = self.numbers(&shape, 4.0);
        match operator {
            "QuickGelu" => (vec![float("alpha", self.random.random_range(0.5..2.0))], vec![x]),
            "Gelu" => (vec![], vec![x]),
            _ => {
                let bias = self.numbers(&shape[shape.len() - 1..], 1.0);
                (vec![], vec![x, bias])
            }
        }
    }

    /// An activation that ONNX Runtime fuses, and its settings.
    fn fused(&mut self) -> (&'static str, Vec<f32>) {
        match self.random.random_range(0..6) {
            0 => ("Relu", vec![]),
            1 => ("Sigmoid", vec![]),
            2 => ("Tanh", vec![]),
            3 => ("LeakyRelu", vec![self.random.random_range(0.0..0.5)]),
            4 => ("HardSigmoid", vec![0.2, 0.5]),
            _ => ("Clip", vec![-0.5, 0.75]),
        }
    }

    fn fused_convolution(&mut self) -> Parts {
        let (shape, _) = self.image(false);
        let (outputs, kernel) = (self.side(4), [self.side(3), self.side(3)]);
        let x = self.numbers(&shape, 1.0);
        let w = self.numbers(&[outputs, shape[1], kernel[0], kernel[1]], 0.5);
        let bias = self.coin().then(|| self.numbers(&[outputs], 1.0)).flatten();
        let (name, settings) = self.fused();
        let mut attributes = self.window(kernel);
        attributes.push(text("activation", name));
        if !settings.is_empty() {
            attributes.push(floats("activation_params", &settings));
        }
        let z = self.coin().then(|| self.numbers(&convolved(&shape, outputs, &attributes), 1.0)).flatten();
        (attributes, vec![x, w, bias, z])
    }

    fn fused_product(&mut self, operator: &str) -> Parts {
        let (m, k, n) = (self.side(9), self.side(40), self.side(9));
        let (trans_a, trans_b) = (self.coin(), self.coin());
        let turned = |turned: bool, a, b| if turned { [b, a] } else { [a, b] };
        let (a, b) = (self.numbers(&turned(trans_a, m, k), 1.0), self.numbers(&turned(trans_b, k, n), 1.0));
        let mut attributes = vec![
            float("alpha", self.random.random_range(0.2..2.0)),
            int("transA", i64::from(trans_a)),
            int("transB", i64::from(trans_b)),
        ];
        if operator == "FusedMatMul" {
            return (attributes, vec![a, b]);
        }
        let c = self.numbers(&[n], 1.0);
        // Limits are no settings of this operator's.
        let (name, settings) =
            std::iter::repeat_with(|| self.fused()).find(|(name, _)| *name != "Clip").expect("one");
        attributes.push(text("activation", name));
        let names = ["activation_alpha", "activation_beta"];
        attributes.extend(names.iter().zip(settings).map(|(name, setting)| float(name, setting)));
        (attributes, vec![a, b, c])
    }
}
