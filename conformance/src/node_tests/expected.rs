//! What the reference says of a case, and how far another party's answer is from it.

use std::collections::BTreeMap;

use vitruvian_reference::nn::{Rounded, gamma};

use super::case::Case;
use crate::onnx::element::ElementType;
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::{Data, Value};
use crate::onnx::walk::evaluate_graph;

/// The outputs of a case by the reference, with the precision of whoever computes in the graph's types.
#[derive(Clone, Debug)]
pub struct Expected {
    /// The outputs, in the graph's order.
    pub outputs: Vec<Value<Rounded>>,
    /// The largest unit roundoff of the float types on the way, which every rounding is counted as.
    unit: f64,
    /// The largest of their smallest numbers: what one underflow can cost.
    underflow: f64,
}

/// How far a party's outputs are from the reference's; the largest over all elements.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distance {
    /// Whether every element lies within its bound, integers and truths being met exactly.
    pub within: bool,
    /// The error in condition-scaled units: |ŷ − y|/(u·m).
    pub csu: f64,
    /// The numbers of the element type that lie between ŷ and the reference's rounded value; the difference of integers.
    pub ulp: u64,
    /// |ŷ − y|, infinite where only one of them is a number.
    pub error: f64,
}

impl Distance {
    /// No distance at all.
    pub const NONE: Self = Self { within: true, csu: 0.0, ulp: 0, error: 0.0 };

    fn or(self, other: Self) -> Self {
        Self {
            within: self.within && other.within,
            csu: self.csu.max(other.csu),
            ulp: self.ulp.max(other.ulp),
            error: self.error.max(other.error),
        }
    }
}

impl Expected {
    /// Runs the case on the reference.
    ///
    /// # Errors
    /// What is not understood: an operator, an attribute, an element type.
    pub fn of(case: &Case) -> Result<Self, String> {
        let mut inputs = BTreeMap::new();
        for (name, tensor) in &case.inputs {
            inputs.insert(name.clone(), Value::of(tensor).map_err(|why| format!("input \"{name}\": {why}"))?);
        }
        let (mut unit, mut underflow) = (0.0_f64, 0.0_f64);
        let mut meet = |element: ElementType| {
            unit = unit.max(element.unit_roundoff().unwrap_or(0.0));
            underflow = underflow.max(element.smallest_subnormal().unwrap_or(0.0));
        };
        inputs.values().for_each(|value| meet(value.element));
        let see = &mut |value: &Value<Rounded>| meet(value.element);
        let outputs = evaluate_graph(case.model.graph(), case.model.opset(), &inputs, see)?;
        Ok(Self { outputs, unit, underflow })
    }

    /// The outputs as a party would give them that rounds once, at the end.
    pub fn rounded(&self) -> Vec<Vec<f64>> {
        let rounded = |value: &Value<Rounded>| match &value.data {
            Data::Numbers(x) => x.data.iter().map(|r| value.element.round(r.value)).collect(),
            Data::Integers(x) => x.data.iter().map(|&i| i as f64).collect(),
            Data::Truths(x) => x.data.iter().map(|&t| f64::from(u8::from(t))).collect(),
        };
        self.outputs.iter().map(rounded).collect()
    }

    /// How far a party's outputs are off.
    ///
    /// # Errors
    /// When their number, an element type or a shape differs.
    pub fn distance(&self, found: &[TypedTensor]) -> Result<Distance, String> {
        if found.len() != self.outputs.len() {
            return Err(format!("{} outputs, {} were expected", found.len(), self.outputs.len()));
        }
        let distances = self.outputs.iter().zip(found).map(|(expected, found)| self.tensor(expected, found));
        distances.enumerate().try_fold(Distance::NONE, |all, (i, distance)| {
            distance.map(|distance| all.or(distance)).map_err(|why| format!("output {i}: {why}"))
        })
    }

    fn tensor(&self, expected: &Value<Rounded>, found: &TypedTensor) -> Result<Distance, String> {
        if (found.element(), &found.shape[..]) != (expected.element, expected.shape()) {
            return Err(format!(
                "{}{:?}, {}{:?} was expected",
                found.element(),
                found.shape,
                expected.element,
                expected.shape()
            ));
        }
        let pairs: Vec<Distance> = match &expected.data {
            Data::Numbers(x) => {
                let found = numbers(found);
                x.data.iter().zip(found).map(|(&y, found)| self.number(y, found, expected.element)).collect()
            }
            Data::Integers(x) => {
                let found = Value::<f64>::of(found)?;
                let found = &found.integers()?.data;
                x.data.iter().zip(found).map(|(y, found)| counted(y.abs_diff(*found))).collect()
            }
            Data::Truths(x) => {
                let found = numbers(found);
                let differ = |(&y, found): (&bool, f64)| counted(u64::from(y != (found != 0.0)));
                x.data.iter().zip(found).map(differ).collect()
            }
        };
        Ok(pairs.into_iter().fold(Distance::NONE, Distance::or))
    }

    fn number(&self, y: Rounded, found: f64, element: ElementType) -> Distance {
        let rounded = element.round(y.value);
        if found == rounded || (found.is_nan() && rounded.is_nan()) {
            return Distance::NONE;
        }
        let error = (found - y.value).abs();
        let error = if error.is_nan() { f64::INFINITY } else { error };
        // γ_n·m for the party, the same of f64 for the reference itself, and n underflows.
        let own = element.unit_roundoff().unwrap_or(0.0).max(self.unit);
        let bound = y.bound(own) + y.bound(f64::EPSILON / 2.0) + y.terms * self.underflow;
        // A γ of one or more bounds nothing worth the name.
        let within = error <= bound && gamma(y.terms, own) < 1.0;
        let csu = if y.magnitude > 0.0 { error / (own * y.magnitude) } else { f64::INFINITY };
        Distance { within, csu, ulp: steps(found, rounded, element), error }
    }
}

fn counted(difference: u64) -> Distance {
    Distance { within: difference == 0, csu: 0.0, ulp: difference, error: difference as f64 }
}

/// A tensor's elements as f64: floats exactly, integers to the nearest, truths as 0 and 1.
pub fn numbers(tensor: &TypedTensor) -> Vec<f64> {
    fn wide<E: Copy>(values: &[E], f: impl Fn(E) -> f64) -> Vec<f64> {
        values.iter().map(|&v| f(v)).collect()
    }
    match &tensor.elements {
        Elements::I8(v) => wide(v, f64::from),
        Elements::U8(v) => wide(v, f64::from),
        Elements::I16(v) => wide(v, f64::from),
        Elements::U16(v) => wide(v, f64::from),
        Elements::I32(v) => wide(v, f64::from),
        Elements::U32(v) => wide(v, f64::from),
        Elements::I64(v) => wide(v, |i| i as f64),
        Elements::U64(v) => wide(v, |i| i as f64),
        Elements::Bool(v) => wide(v, |t| f64::from(u8::from(t))),
        Elements::F32(_) | Elements::F64(_) | Elements::F16(_) | Elements::Bf16(_) => {
            tensor.to_f64().unwrap_or_default()
        }
    }
}

/// How many numbers of a float type further `b` lies than `a`; +0 and −0 are one number.
fn steps(a: f64, b: f64, element: ElementType) -> u64 {
    if a.is_nan() || b.is_nan() {
        return u64::MAX;
    }
    // The place of a number in the order of its type, from its bits: those of an f64 serve f64, of an f32 the rest.
    let place = |x: f64| -> i128 {
        let bits = match element {
            ElementType::F64 => x.abs().to_bits(),
            ElementType::F32 => (x.abs() as f32).to_bits().into(),
            ElementType::F16 => half::f16::from_f64(x.abs()).to_bits().into(),
            _ => half::bf16::from_f64(x.abs()).to_bits().into(),
        };
        if x < 0.0 { -i128::from(bits) } else { bits.into() }
    };
    u64::try_from((place(a) - place(b)).unsigned_abs()).unwrap_or(u64::MAX)
}

/// The official rule: |found − expected| ≤ 10⁻⁷ + 10⁻³·|expected|; infinities and NaN must be the same.
pub fn passes_officially(found: &[f64], expected: &[f64]) -> bool {
    found.len() == expected.len()
        && found.iter().zip(expected).all(|(&found, &expected)| {
            found == expected
                || (found.is_nan() && expected.is_nan())
                || (expected.is_finite() && (found - expected).abs() <= 1e-7 + 1e-3 * expected.abs())
        })
}

#[cfg(test)]
mod tests {
    use vitruvian_reference::nn::{Scalar, Tensor};

    use super::*;

    fn expected(element: ElementType, values: Vec<Rounded>) -> Expected {
        let outputs = vec![Value::from_numbers(element, Tensor::new(&[values.len()], values))];
        let (unit, underflow) = (element.unit_roundoff(), element.smallest_subnormal());
        Expected { outputs, unit: unit.expect("a float type"), underflow: underflow.expect("a float type") }
    }

    fn f32s(values: &[f32]) -> Vec<TypedTensor> {
        vec![TypedTensor::new(&[values.len()], Elements::F32(values.to_vec())).expect("a tensor")]
    }

    #[test]
    fn within_the_bound_passes_and_beyond_it_does_not() {
        let u = 2.0_f64.powi(-24);
        let y = expected(ElementType::F32, vec![Rounded::within(1.0, 1.0, 4.0)]);
        let at = |x: f64| y.distance(&f32s(&[x as f32])).expect("comparable");
        assert_eq!(at(1.0), Distance::NONE);
        assert_eq!(at(1.0 + 4.0 * u), Distance { within: true, csu: 4.0, ulp: 2, error: 4.0 * u });
        assert!(!at(1.0 + 6.0 * u).within, "six units where four are possible");
        for wrong in [f64::NAN, f64::INFINITY, -1.0, 0.0] {
            assert!(!at(wrong).within, "{wrong} for 1");
        }
    }

    #[test]
    fn what_is_exact_is_met_exactly() {
        let y = expected(ElementType::F32, vec![Rounded::exact(0.0), Rounded::exact(0.1)]);
        assert!(y.distance(&f32s(&[-0.0, 0.1])).expect("comparable").within, "0.1 rounded once");
        assert!(
            !y.distance(&f32s(&[1e-30, 0.1])).expect("comparable").within,
            "a little where there is nothing"
        );
        assert!(!y.distance(&f32s(&[0.0, 0.1_f32.next_up()])).expect("comparable").within, "the next number");
    }

    #[test]
    fn a_bound_of_everything_accepts_nothing() {
        let y = expected(ElementType::F32, vec![Rounded::within(1.0, 1.0, 1e7)]);
        assert!(!y.distance(&f32s(&[1.5])).expect("comparable").within);
    }

    #[test]
    fn another_shape_or_type_is_no_answer() {
        let y = expected(ElementType::F32, vec![Rounded::exact(0.0)]);
        assert!(y.distance(&f32s(&[0.0, 0.0])).expect_err("refused").contains("f32[2], f32[1] was expected"));
        let f64s = TypedTensor::new(&[1], Elements::F64(vec![0.0])).expect("a tensor");
        assert!(y.distance(&[f64s]).expect_err("refused").contains("f64[1]"));
        assert!(y.distance(&[]).is_err(), "no output");
    }

    #[test]
    fn the_official_rule_is_relative_and_wants_the_same_infinities() {
        assert!(passes_officially(
            &[1.0009, 0.0, f64::NAN, f64::INFINITY],
            &[1.0, 9e-8, f64::NAN, f64::INFINITY]
        ));
        for (found, expected) in [
            (1.002, 1.0),
            (0.0, 2e-7),
            (f64::MAX, f64::INFINITY),
            (f64::INFINITY, f64::MAX),
            (0.0, f64::NAN),
            (f64::NAN, 0.0),
        ] {
            assert!(!passes_officially(&[found], &[expected]), "{found} for {expected}");
        }
        assert!(!passes_officially(&[], &[1.0]), "none for one");
    }

    #[test]
    fn steps_are_counted_through_zero() {
        let least = f64::from(f32::from_bits(1));
        assert_eq!(steps(-least, least, ElementType::F32), 2);
        assert_eq!(steps(0.0, -0.0, ElementType::F64), 0);
        assert_eq!(steps(1.0, 1.0 + 2.0_f64.powi(-10), ElementType::F16), 1);
    }
}
