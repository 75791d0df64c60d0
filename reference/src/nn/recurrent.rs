//! Recurrent layers: the plain one, GRU and LSTM.
//!
//! x \[L,N,I\] is read step by step, forwards or from the end of each sample's own length, by one set of weights for each
//! direction: w [D,G·H,I], r [D,G·H,H], bias [D,2G·H] (that of w, then that of r). Past a sample's length y is zero and the state stays.
//!
//! | layer | G, in this order | hₜ |
//! |---|---|---|
//! | [`rnn`] | one | f(Wx + Rh + b) |
//! | [`gru`] | z update, r reset, h hidden | (1 − z)·g(…) + z·h |
//! | [`lstm`] | i input, o output, f forget, c cell | o·h(c), c = f·c + i·g(…) |
//!
//! # Conventions
//! PyTorch orders the gates of a GRU r, z, n and those of an LSTM i, f, g, o. Its GRU resets *after* the linear map, which is
//! ONNX's `linear_before_reset` = 1, not the default.
//!
//! Rounding: of the formulas, step after step: the bound grows with the steps as errors through the recurrence may.
//!
//! # References
//! ONNX operators RNN, GRU and LSTM (version 22); Hochreiter and Schmidhuber 1997; Cho and others, EMNLP 2014.

use super::transcendental::Elementary;
use super::{Scalar, Tensor, elu, hard_sigmoid, leaky_relu, softsign, thresholded_relu};

/// A gate's function.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gate {
    /// αx + β.
    Affine(f64, f64),
    /// α(eˣ − 1) below zero.
    Elu(f64),
    /// max(0, min(1, αx + β)).
    HardSigmoid(f64, f64),
    /// αx below zero.
    LeakyRelu(f64),
    /// max(x, 0).
    Relu,
    /// α·tanh(βx).
    ScaledTanh(f64, f64),
    /// 1/(1 + e⁻ˣ).
    Sigmoid,
    /// ln(1 + eˣ).
    Softplus,
    /// x/(1 + |x|).
    Softsign,
    /// tanh x.
    Tanh,
    /// x beyond α.
    ThresholdedRelu(f64),
}

impl Gate {
    fn apply<T: Scalar>(self, x: T) -> T {
        let of_tensor = |f: &dyn Fn(&Tensor<T>) -> Tensor<T>| f(&Tensor::new(&[], vec![x])).data[0];
        let e = T::exact;
        match self {
            Gate::Affine(a, b) => (e(a) * x).plus(e(b)),
            Gate::Elu(a) => of_tensor(&|x| elu(x, e(a))),
            Gate::HardSigmoid(a, b) => of_tensor(&|x| hard_sigmoid(x, e(a), e(b))),
            Gate::LeakyRelu(a) => of_tensor(&|x| leaky_relu(x, e(a))),
            Gate::Relu => x.maximum(T::ZERO),
            Gate::ScaledTanh(a, b) => e(a) * Elementary::tanh(e(b) * x),
            Gate::Sigmoid => Elementary::sigmoid(x),
            Gate::Softplus => Elementary::softplus(x),
            Gate::Softsign => of_tensor(&softsign),
            Gate::Tanh => Elementary::tanh(x),
            Gate::ThresholdedRelu(a) => of_tensor(&|x| thresholded_relu(x, e(a))),
        }
    }
}

/// In which order a layer reads its input.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the first step to the last.
    Forward,
    /// From the last step of each sample to the first.
    Reverse,
    /// Both, side by side, each with its own weights.
    Bidirectional,
}

/// The weights and settings that all recurrent layers have.
#[derive(Clone, Debug, PartialEq)]
pub struct Recurrent<'a, T> {
    /// [D,G·H,I].
    pub w: &'a Tensor<T>,
    /// [D,G·H,H].
    pub r: &'a Tensor<T>,
    /// [D,2G·H]; zero if absent.
    pub bias: Option<&'a Tensor<T>>,
    /// The steps of each sample; all L if absent.
    pub lengths: Option<&'a [usize]>,
    /// \[D,N,H\]; zero if absent.
    pub initial_h: Option<&'a Tensor<T>>,
    /// The order of reading.
    pub direction: Direction,
    /// The functions of each direction's gates, one direction after the other.
    pub gates: &'a [Gate],
    /// What goes into a gate is kept within ±clip.
    pub clip: Option<f64>,
}

/// What a recurrent layer gives.
#[derive(Clone, Debug, PartialEq)]
pub struct Recurred<T> {
    /// The state after every step \[L,D,N,H\].
    pub y: Tensor<T>,
    /// The last state \[D,N,H\].
    pub h: Tensor<T>,
    /// The last cell \[D,N,H\]; zero where there is none.
    pub c: Tensor<T>,
}

/// A sample's state in one direction, and the two halves of each gate's input.
struct Step<'a, T> {
    direction: usize,
    /// Wx + its bias, gate after gate.
    input: &'a [T],
    /// Rh + its bias, gate after gate; `row` gives it for another h.
    recurrent: &'a [T],
    h: &'a mut [T],
    c: &'a mut [T],
}

impl<T: Scalar> Recurrent<'_, T> {
    fn hidden(&self) -> usize {
        self.r.shape.last().copied().unwrap_or(0)
    }

    /// f(x) of gate k of a direction, its input clipped.
    fn gate(&self, direction: usize, k: usize, x: T) -> T {
        let functions = self.gates.len() / self.w.shape[0];
        let clipped = self.clip.map_or(x, |c| -T::maximum(-x.maximum(T::exact(-c)), T::exact(-c)));
        self.gates[direction * functions + k].apply(clipped)
    }

    /// Row `row` of a direction's r times h, with the bias of r.
    fn row(&self, direction: usize, row: usize, h: &[T]) -> T {
        let rows = self.r.shape[1];
        let weights = &self.r.data[(direction * rows + row) * h.len()..][..h.len()];
        let bias = self.bias.map_or(T::ZERO, |b| b.data[direction * 2 * rows + rows + row]);
        weights.iter().zip(h).fold(bias, |sum, (&r, &h)| sum.plus_product(r, h))
    }

    /// Every step of every sample in every direction.
    fn unroll(
        &self,
        operator: &str,
        x: &Tensor<T>,
        initial_c: Option<&Tensor<T>>,
        gates: usize,
        functions: usize,
        step: impl Fn(Step<T>),
    ) -> Recurred<T> {
        let directions = if self.direction == Direction::Bidirectional { 2 } else { 1 };
        let hidden = self.hidden();
        let [w, r] = [&self.w.shape, &self.r.shape];
        assert!(
            x.rank() == 3
                && *w == [directions, gates * hidden, x.shape[2]]
                && *r == [directions, gates * hidden, hidden]
                && self.bias.is_none_or(|b| b.shape == [directions, 2 * gates * hidden])
                && self.gates.len() == directions * functions,
            "{operator}: w {w:?}, r {r:?} and bias {:?} do not fit x {:?} in {directions} direction(s) with {} functions",
            self.bias.map(|b| &b.shape),
            x.shape,
            self.gates.len()
        );
        let [steps, samples, features] = [x.shape[0], x.shape[1], x.shape[2]];
        let state = [directions, samples, hidden];
        assert!(
            self.initial_h.is_none_or(|h| h.shape == state)
                && initial_c.is_none_or(|c| c.shape == state)
                && self.lengths.is_none_or(|l| l.len() == samples && l.iter().all(|&l| l <= steps)),
            "{operator}: initial states {:?} and {:?} and lengths {:?} do not fit x {:?}",
            self.initial_h.map(|h| &h.shape),
            initial_c.map(|c| &c.shape),
            self.lengths,
            x.shape
        );
        let start = |given: Option<&Tensor<T>>| given.cloned().unwrap_or_else(|| Tensor::zeros(&state));
        let (mut h, mut c) = (start(self.initial_h), start(initial_c));
        let mut y = Tensor::zeros(&[steps, directions, samples, hidden]);
        let rows = gates * hidden;
        for d in 0..directions {
            let reversed = d == 1 || self.direction == Direction::Reverse;
            for n in 0..samples {
                let at = (d * samples + n) * hidden;
                let length = self.lengths.map_or(steps, |lengths| lengths[n]);
                for t in 0..length {
                    let t = if reversed { length - 1 - t } else { t };
                    let x = &x.data[(t * samples + n) * features..][..features];
                    let input: Vec<T> = (0..rows)
                        .map(|row| {
                            let weights = &self.w.data[(d * rows + row) * features..][..features];
                            let bias = self.bias.map_or(T::ZERO, |b| b.data[d * 2 * rows + row]);
                            weights.iter().zip(x).fold(bias, |sum, (&w, &x)| sum.plus_product(w, x))
                        })
                        .collect();
                    let h = &mut h.data[at..at + hidden];
                    let recurrent: Vec<T> = (0..rows).map(|row| self.row(d, row, h)).collect();
                    let c = &mut c.data[at..at + hidden];
                    step(Step { direction: d, input: &input, recurrent: &recurrent, h, c });
                    y.data[((t * directions + d) * samples + n) * hidden..][..hidden].copy_from_slice(h);
                }
            }
        }
        Recurred { y, h, c }
    }
}

/// The plain recurrent layer hₜ = f(Wxₜ + Rhₜ₋₁ + b), one function for each direction.
///
/// # Panics
/// If the shapes do not fit.
pub fn rnn<T: Scalar>(x: &Tensor<T>, layer: &Recurrent<T>) -> Recurred<T> {
    layer.unroll("rnn", x, None, 1, 1, |step| {
        for (k, h) in step.h.iter_mut().enumerate() {
            *h = layer.gate(step.direction, 0, step.input[k].plus(step.recurrent[k]));
        }
    })
}

/// The gated recurrent unit, two functions for each direction: f of z and r, and g.
///
/// The hidden gate is g(Wx + R(r·h) + b), or with `linear_before_reset` g(Wx + b_w + r·(Rh + b_r)).
///
/// # Panics
/// If the shapes do not fit.
pub fn gru<T: Scalar>(x: &Tensor<T>, layer: &Recurrent<T>, linear_before_reset: bool) -> Recurred<T> {
    let n = layer.hidden();
    layer.unroll("gru", x, None, 3, 2, |step| {
        let d = step.direction;
        let both = |row: usize| step.input[row].plus(step.recurrent[row]);
        let update: Vec<T> = (0..n).map(|k| layer.gate(d, 0, both(k))).collect();
        let reset: Vec<T> = (0..n).map(|k| layer.gate(d, 0, both(n + k))).collect();
        let kept: Vec<T> = reset.iter().zip(&*step.h).map(|(&r, &h)| r * h).collect();
        for k in 0..n {
            let recurrent = match linear_before_reset {
                true => reset[k] * step.recurrent[2 * n + k],
                false => layer.row(d, 2 * n + k, &kept),
            };
            let new = layer.gate(d, 1, step.input[2 * n + k].plus(recurrent));
            step.h[k] = ((T::exact(1.0) - update[k]) * new).plus(update[k] * step.h[k]);
        }
    })
}

/// Long short-term memory, three functions for each direction: f of i, f and o, g of the cell's input, h of the cell.
///
/// Peepholes \[D,3H\] in the order i, o, f let the gates see the cell: i and f that before the step, o that after it.
///
/// # Panics
/// If the shapes do not fit.
pub fn lstm<T: Scalar>(
    x: &Tensor<T>,
    layer: &Recurrent<T>,
    initial_c: Option<&Tensor<T>>,
    peepholes: Option<&Tensor<T>>,
) -> Recurred<T> {
    let n = layer.hidden();
    let fits = peepholes.is_none_or(|p| p.shape == [layer.w.shape[0], 3 * n]);
    assert!(fits, "lstm: peepholes {:?} do not fit r {:?}", peepholes.map(|p| &p.shape), layer.r.shape);
    layer.unroll("lstm", x, initial_c, 4, 3, |step| {
        let d = step.direction;
        for k in 0..n {
            let both = |gate: usize| step.input[gate * n + k].plus(step.recurrent[gate * n + k]);
            let peeped = |gate: usize, x: T, cell: T| match peepholes {
                Some(p) => x.plus_product(p.data[(d * 3 + gate) * n + k], cell),
                None => x,
            };
            let before = step.c[k];
            let input = layer.gate(d, 0, peeped(0, both(0), before));
            let forget = layer.gate(d, 0, peeped(2, both(2), before));
            let cell = (forget * before).plus(input * layer.gate(d, 1, both(3)));
            let output = layer.gate(d, 0, peeped(1, both(1), cell));
            step.c[k] = cell;
            step.h[k] = output * layer.gate_of_cell(d, cell);
        }
    })
}

impl<T: Scalar> Recurrent<'_, T> {
    /// h of an LSTM's cell, which no clip touches.
    fn gate_of_cell(&self, direction: usize, cell: T) -> T {
        self.gates[direction * 3 + 2].apply(cell)
    }
}

#[cfg(test)]
mod tests {
    use super::super::goldens::pattern;
    use super::*;

    const LSTM: [Gate; 3] = [Gate::Sigmoid, Gate::Tanh, Gate::Tanh];

    fn layer<'a>(w: &'a Tensor, r: &'a Tensor, gates: &'a [Gate]) -> Recurrent<'a, f64> {
        Recurrent {
            w,
            r,
            bias: None,
            lengths: None,
            initial_h: None,
            direction: Direction::Forward,
            gates,
            clip: None,
        }
    }

    #[test]
    fn a_plain_layer_by_hand() {
        let x = Tensor::new(&[2, 1, 1], vec![1.0, 2.0]);
        let (w, r) = (Tensor::new(&[1, 1, 1], vec![3.0]), Tensor::new(&[1, 1, 1], vec![10.0]));
        let bias = Tensor::new(&[1, 2], vec![0.5, 0.25]);
        let gates = [Gate::Relu];
        let plain = Recurrent { bias: Some(&bias), ..layer(&w, &r, &gates) };
        let y = rnn(&x, &plain);
        assert_eq!((y.y.data, y.h.data), (vec![3.75, 44.25], vec![44.25]));
        let clipped = rnn(&x, &Recurrent { clip: Some(2.0), ..plain.clone() });
        assert_eq!(clipped.y.data, [2.0, 2.0]);
        let reversed = rnn(&x, &Recurrent { direction: Direction::Reverse, ..plain });
        assert_eq!((reversed.y.data, reversed.h.data), (vec![71.25, 6.75], vec![71.25]));
    }

    #[test]
    fn a_short_sample_ends_early_and_is_reversed_within_its_length() {
        let x = Tensor::new(&[3, 1, 1], vec![1.0, 2.0, 100.0]);
        let (w, r) = (Tensor::filled(&[2, 1, 1], 1.0), Tensor::filled(&[2, 1, 1], 10.0));
        let gates = [Gate::Relu; 2];
        let both =
            Recurrent { direction: Direction::Bidirectional, lengths: Some(&[2]), ..layer(&w, &r, &gates) };
        let y = rnn(&x, &both);
        assert_eq!(y.y.data, [1.0, 21.0, 12.0, 2.0, 0.0, 0.0], "forwards beside backwards, then nothing");
        assert_eq!(y.h.data, [12.0, 21.0]);
    }

    #[test]
    fn gates_that_are_shut_keep_the_state() {
        // With an update gate of 1 a GRU keeps h, with a forget gate of 1 and an input gate of 0 an LSTM keeps c.
        let x = pattern(&[4, 2, 3], 1);
        let h = pattern(&[1, 2, 2], 2);
        let open = |gates: usize, which: usize, value: f64| {
            Tensor::from_fn(&[1, 2 * gates * 2], |i| if i[1] / 2 == which { value } else { 0.0 })
        };
        let (w, r) = (Tensor::zeros(&[1, 6, 3]), Tensor::zeros(&[1, 6, 2]));
        let bias = open(3, 0, 800.0);
        let gates = [Gate::Sigmoid, Gate::Tanh];
        let kept = Recurrent { bias: Some(&bias), initial_h: Some(&h), ..layer(&w, &r, &gates) };
        assert_eq!(gru(&x, &kept, false).h, h);
        let (w, r) = (Tensor::zeros(&[1, 8, 3]), Tensor::zeros(&[1, 8, 2]));
        let mut bias = open(4, 0, -800.0);
        bias.data[4..6].fill(800.0);
        let kept = Recurrent { bias: Some(&bias), ..layer(&w, &r, &LSTM) };
        let y = lstm(&x, &kept, Some(&h), None);
        assert_eq!(y.c, h);
        assert_eq!(y.h, h.map(|c| 0.5 * c.tanh()));
    }

    #[test]
    fn resetting_before_or_after_the_linear_map_differs_by_the_bias_alone_when_one_state_is_hidden() {
        let x = pattern(&[3, 1, 2], 1);
        let (w, r, bias) = (pattern(&[1, 3, 2], 2), pattern(&[1, 3, 1], 3), pattern(&[1, 6], 4));
        let gates = [Gate::Sigmoid, Gate::Tanh];
        let with = |bias: &Tensor, linear| {
            gru(&x, &Recurrent { bias: Some(bias), ..layer(&w, &r, &gates) }, linear).h.data[0]
        };
        assert!((with(&bias, false) - with(&bias, true)).abs() > 1e-3);
        let mut unbiased = bias.clone();
        unbiased.data[5] = 0.0;
        assert!((with(&unbiased, false) - with(&unbiased, true)).abs() < 1e-15);
    }

    #[test]
    fn peepholes_see_the_old_cell_and_the_output_gate_the_new_one() {
        let x = Tensor::zeros(&[1, 1, 1]);
        let (w, r) = (Tensor::zeros(&[1, 4, 1]), Tensor::zeros(&[1, 4, 1]));
        let c = Tensor::new(&[1, 1, 1], vec![2.0]);
        let gates = [Gate::Affine(1.0, 0.0), Gate::Affine(1.0, 1.0), Gate::Affine(1.0, 0.0)];
        let p = Tensor::new(&[1, 3], vec![3.0, 5.0, 7.0]);
        let y = lstm(&x, &layer(&w, &r, &gates), Some(&c), Some(&p));
        // i = 3·2, f = 7·2, c = 14·2 + 6·1, o = 5·34, h = o·c.
        assert_eq!((y.c.data[0], y.h.data[0]), (34.0, 170.0 * 34.0));
    }

    #[test]
    #[should_panic(expected = "lstm: w [1, 8, 3], r [1, 8, 2]")]
    fn weights_must_fit_the_input() {
        let (w, r) = (Tensor::zeros(&[1, 8, 3]), Tensor::zeros(&[1, 8, 2]));
        lstm(&Tensor::zeros(&[1, 1, 4]), &layer(&w, &r, &LSTM), None, None);
    }
}
