//! Too few bits: operands, sums or results in a narrower type, weights in eight bits, numbers flushed to zero.
//!
//! tf32 and f16 carry the same 11-bit significand, so what is told from the numbers is "reduced precision, 11 bits"; the
//! format is named only where its range decides. A part computed in a narrower type, an island, is seen by its results,
//! which that type can hold.

use vitruvian_reference::nn::Rounded;

use super::Suspicion;
use super::change::{Meaning, Operands, Outputs, all_numbers, changed, numbers, output, specified};
use super::trial::Trial;
use crate::onnx::element::ElementType;
use crate::onnx::message::NodeProto;
use crate::onnx::value::{Data, Value};
use crate::onnx::walk;

/// A narrower format: its name for people, and how it rounds.
struct Format {
    name: &'static str,
    detail: &'static str,
    round: fn(f64) -> f64,
}

const ELEVEN: &str = "reduced precision, 11 bits (f16 or tf32)";
const EIGHT: &str = "reduced precision, 8 bits (bf16)";
const F16: &str = "reduced precision, 11 bits (f16)";

const FORMATS: [Format; 4] = [
    Format { name: ELEVEN, detail: "rounded to 11 bits, as by f16 and tf32", round: |x| bits(x, 11) },
    Format {
        name: F16,
        detail: "rounded to f16, whose range ends at 65504 and 6e-8",
        round: |x| ElementType::F16.round(x),
    },
    Format { name: EIGHT, detail: "rounded to 8 bits, as by bf16", round: |x| ElementType::Bf16.round(x) },
    Format {
        name: ELEVEN,
        detail: "cut to 11 bits, as by tf32 that is not rounded",
        round: |x| f64::from(f32::from_bits((x as f32).to_bits() & !0x1fff)),
    },
];

/// The nearest number with so many bits of significand, ties to even; ranges are not limited.
fn bits(x: f64, bits: i32) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return x;
    }
    let unit = (x.abs().log2().floor() as i32 - bits + 1).clamp(-1000, 1000);
    (x / 2f64.powi(unit)).round_ties_even() * 2f64.powi(unit)
}

pub(super) fn suspicions(trial: &Trial) -> Vec<Suspicion> {
    let mut all = Vec::new();
    let floats: Vec<usize> =
        (0..trial.case.operands.len()).filter(|&place| trial.numbers(place).is_some()).collect();
    for format in &FORMATS {
        let round = format.round;
        all.push(Suspicion::new(
            format.name,
            format!("all operands were {}", format.detail),
            all_numbers(round),
        ));
        all.push(Suspicion::new(
            format.name,
            format!("the result was {}", format.detail),
            held(trial, round, specified()),
        ));
        all.push(Suspicion::new(
            format.name,
            format!("all operands and the result were {}", format.detail),
            held(trial, round, all_numbers(round)),
        ));
        if floats.len() > 1 {
            for &place in &floats {
                let name = trial.node().input.get(place).map_or("", String::as_str);
                all.push(Suspicion::new(
                    format.name,
                    format!("operand {place} (\"{name}\") was {}", format.detail),
                    numbers(place, round),
                ));
            }
        }
        // The operands of the product, but not the bias.
        if floats.len() > 2 {
            all.push(Suspicion::new(
                format.name,
                format!("operands 0 and 1 were {}", format.detail),
                two(round),
            ));
        }
    }
    all.extend(eight_bits(trial));
    let normal = |x: f64| if x.abs() < f64::from(f32::MIN_POSITIVE) { 0.0 } else { x };
    all.push(Suspicion::new("flush-to-zero", "subnormal operands were taken as zero", all_numbers(normal)));
    all.push(Suspicion::new(
        "flush-to-zero",
        "subnormal results were flushed to zero",
        output(move |y| changed_within(y, normal)),
    ));
    all
}

/// Every number changed, with the bounds that it had.
fn changed_within(y: &Value<Rounded>, change: impl Fn(f64) -> f64) -> Option<Value<Rounded>> {
    let x = y.numbers().ok()?;
    let data = Data::Numbers(x.map(|r| Rounded { value: change(r.value), ..r }));
    Some(Value { element: y.element, data })
}

fn two(round: fn(f64) -> f64) -> Meaning {
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let rounded = |i: usize| {
            let old = operands.get(i).copied().flatten().ok_or("has no such operand")?;
            changed(old, |x| round(x.value)).ok_or("holds no numbers")
        };
        let (a, b) = (rounded(0)?, rounded(1)?);
        let mut operands = operands.to_vec();
        (operands[0], operands[1]) = (Some(&a), Some(&b));
        walk::evaluate(node, opset, &operands)
    })
}

/// The result under a meaning, kept in a narrower format: the neighbour that was found, where the bound reaches it.
///
/// A result within the bound of a tie may be rounded either way. So the found number is taken where it is what the format
/// makes of some number within the bound.
fn held(trial: &Trial, round: fn(f64) -> f64, meaning: Meaning) -> Meaning {
    let found = trial.found().unwrap_or_default();
    // Parts of a window are not told apart here; they are judged by the operands' rounding alone.
    let direct = trial.excerpt_shape().is_some();
    Box::new(move |node: &NodeProto, opset: i64, operands: &Operands| -> Outputs {
        let mut outputs = meaning(node, opset, operands)?;
        let first = outputs.first_mut().and_then(Option::as_mut).ok_or("has no output")?;
        let unit = first.element.unit_roundoff().ok_or("holds no numbers")?;
        let Data::Numbers(y) = &mut first.data else { return Err("holds no numbers".into()) };
        if !direct || y.data.len() != found.len() {
            return Err("is a part of a window".into());
        }
        for (r, &found) in y.data.iter_mut().zip(&found) {
            let bound = r.bound(unit);
            let (low, high) = (round(r.value - bound), round(r.value + bound));
            let reached = (low..=high).contains(&found) && round(found) == found;
            *r = super::change::exact(if reached { found } else { round(r.value) });
        }
        Ok(outputs)
    })
}

/// Weights in integers of eight bits, with one scale or one a channel, symmetric or not; and operands alike.
fn eight_bits(trial: &Trial) -> Vec<Suspicion> {
    let weights = match trial.operator() {
        "Conv" | "Gemm" | "MatMul" | "ConvTranspose" | "Einsum" | "Mul" | "Add" => 1,
        _ => return Vec::new(),
    };
    let Some(rank) = trial.shape(weights).map(<[usize]>::len) else { return Vec::new() };
    let mut all = Vec::new();
    let levels: [(&str, f64, f64); 3] =
        [("−127..127", -127.0, 127.0), ("−128..127", -128.0, 127.0), ("0..255", 0.0, 255.0)];
    for (range, low, high) in levels {
        all.push(Suspicion::new(
            "int8 weights, per tensor",
            format!("the weights were rounded to integers in {range} with one scale"),
            super::change::operand(weights, move |w| quantised(w, None, low, high)),
        ));
        for axis in 0..rank.min(2) {
            all.push(Suspicion::new(
                "int8 weights, per channel",
                format!(
                    "the weights were rounded to integers in {range} with one scale per slice of axis {axis}"
                ),
                super::change::operand(weights, move |w| quantised(w, Some(axis), low, high)),
            ));
        }
        all.push(Suspicion::new(
            "int8 operands",
            format!("operand 0 was rounded to integers in {range} with one scale"),
            super::change::operand(0, move |x| quantised(x, None, low, high)),
        ));
    }
    all
}

/// s·(round(x/s) between two integers), the scale s by the largest number; without a sign also a zero point.
fn quantised(value: &Value<Rounded>, axis: Option<usize>, low: f64, high: f64) -> Option<Value<Rounded>> {
    let x = value.numbers().ok()?;
    let (side, inner) = match axis {
        Some(axis) => (*x.shape.get(axis)?, x.shape[axis + 1..].iter().product::<usize>()),
        None => (1, x.data.len()),
    };
    let slice = |i: usize| i / inner.max(1) % side.max(1);
    let mut ranges = vec![(0.0_f64, 0.0_f64); side.max(1)];
    for (i, r) in x.data.iter().enumerate() {
        let range = &mut ranges[slice(i)];
        *range = (range.0.min(r.value), range.1.max(r.value));
    }
    let rounded = |(i, r): (usize, &Rounded)| {
        let (least, most) = ranges[slice(i)];
        let (scale, zero) = if low < 0.0 {
            ((most.max(-least) / high) as f32, 0.0)
        } else {
            let scale = ((most - least) / (high - low)) as f32;
            (scale, (low - least / f64::from(scale)).round_ties_even())
        };
        let scale = f64::from(scale);
        if scale == 0.0 {
            return super::change::exact(0.0);
        }
        let level = ((r.value / scale).round_ties_even() + zero).clamp(low, high);
        super::change::exact(value.element.round((level - zero) * scale))
    };
    let data = x.data.iter().enumerate().map(rounded).collect();
    Some(Value {
        element: value.element,
        data: Data::Numbers(vitruvian_reference::nn::Tensor::new(&x.shape, data)),
    })
}

/// Where no rounding of operands or results explains every bit: arithmetic in fewer bits, by the size of the differences.
///
/// The bound is the operator's in the narrower type, the finest first. A mistake of another kind may hide below so wide a
/// bound; so the differences must also be of the size that the type makes, and not a common factor.
pub(super) fn last_resort(trial: &Trial) -> Vec<Suspicion> {
    let (Some(found), Some(expected)) = (trial.found(), trial.values(&specified())) else {
        return Vec::new();
    };
    if found.len() != expected.len() {
        return Vec::new();
    }
    let mut all = Vec::new();
    for (name, bits) in [(ELEVEN, 11), (EIGHT, 8)] {
        let unit = 2f64.powi(-bits);
        let (mut sum, mut count) = (0.0, 0.0);
        for (f, e) in found.iter().zip(&expected).filter(|(_, e)| e.magnitude > 0.0) {
            sum += ((f - e.value) / (unit * e.magnitude)).powi(2);
            count += 1.0;
        }
        let rms = (sum / f64::max(count, 1.0)).sqrt();
        if !(0.01..=8.0).contains(&rms) {
            continue;
        }
        // Magnitudes in f32 units that are units of the narrower type; two more roundings, of operands and result.
        let wider = 2f64.powi(24 - bits);
        all.push(Suspicion::new(
            name,
            format!("the differences are those of arithmetic with {bits} bits"),
            output(move |y| {
                let x = y.numbers().ok()?;
                let data = x.map(|r| Rounded { magnitude: r.magnitude * wider, terms: r.terms + 2.0, ..r });
                Some(Value { element: y.element, data: Data::Numbers(data) })
            }),
        ));
    }
    all
}

#[cfg(test)]
mod tests {
    use super::bits;
    use crate::onnx::element::ElementType;

    #[test]
    fn eleven_bits_are_those_of_f16_where_its_range_does_not_end() {
        for x in [1.0, 1.0 + 2f64.powi(-11), -3.2171, 1e-3, 65504.0, 0.0, 1.0 + 3.0 * 2f64.powi(-11)] {
            assert_eq!(bits(x, 11), ElementType::F16.round(x), "{x}");
        }
        assert_eq!(bits(1e20, 11), bits(1e20 * 2f64.powi(10), 11) / 1024.0, "any range");
        assert_eq!(bits(f64::INFINITY, 11), f64::INFINITY);
    }
}
