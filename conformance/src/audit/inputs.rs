//! Inputs for a graph when none are given: drawn from a seed, by what the graph declares.

use std::collections::BTreeMap;

use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use crate::error::{Error, Result};
use crate::onnx::element::ElementType;
use crate::onnx::message::{DimensionProto, DimensionValue, ValueInfoProto};
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::{Elements, TypedTensor};

/// Elements of the largest input that is drawn.
const LARGEST: usize = 1 << 28;

/// Drawn inputs, and in one sentence how they were drawn.
pub type Drawn = (BTreeMap<String, TypedTensor>, String);

/// Inputs of the declared types and shapes. Floats are standard normal numbers, integers lie in 0..8, truths are even odds;
/// graphs that declare by `vitruvian.kind` what they take get such things: a ball of voxels, pictures of a disc before
/// nothing, coordinates somewhat beyond −1..1.
///
/// A dimension that the graph leaves open has the length that `dimensions` gives to its symbol.
///
/// # Errors
/// When a dimension is open and not given (names all of them), an input is no tensor of a known type, or it would be too
/// large.
pub fn draw(model: &Model, seed: u64, dimensions: &BTreeMap<String, usize>) -> Result<Drawn> {
    let error = |item: String, message: String| Error::Onnx { graph: model.name().to_owned(), item, message };
    let declared = model.declared_inputs();
    let mut open: Vec<&str> = declared.iter().flat_map(|input| symbols(input)).collect();
    open.retain(|symbol| length(symbol, dimensions).is_none());
    open.iter_mut().for_each(|symbol| *symbol = parts(symbol).map_or(*symbol, |(symbol, _, _)| symbol));
    open.sort_unstable();
    open.dedup();
    if !open.is_empty() {
        let options: Vec<String> = open.iter().map(|symbol| format!("--dim {symbol}=1")).collect();
        return Err(error(
            "inputs".into(),
            format!("the graph leaves lengths open; say how long they are, such as {}", options.join(" ")),
        ));
    }
    let kind = model.property("vitruvian.kind").unwrap_or_default();
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut inputs = BTreeMap::new();
    let mut drawn = Vec::new();
    for input in declared {
        let name = input.name.clone().unwrap_or_default();
        let item = || format!("input \"{name}\"");
        let (element, shape) = signature(input, dimensions).map_err(|why| error(item(), why))?;
        let count = shape.iter().try_fold(1_usize, |n, &side| n.checked_mul(side)).filter(|&n| n <= LARGEST);
        let count =
            count.ok_or_else(|| error(item(), format!("shape {shape:?} is too large to be drawn")))?;
        let (what, numbers) = numbers(kind, &name, &shape, count, element, &mut random);
        drawn.push(format!("{name} {element}{shape:?} {what}"));
        inputs.insert(name.clone(), typed(element, &shape, &numbers).map_err(|why| error(item(), why))?);
    }
    Ok((inputs, format!("drawn from seed {seed}: {}", drawn.join("; "))))
}

/// Whether a tensor is what the graph declares for an input; sides that it leaves open may have any length.
///
/// # Errors
/// What was found and what was expected.
pub(super) fn check(input: &ValueInfoProto, tensor: &TypedTensor) -> std::result::Result<(), String> {
    let Some(declared) = input.r#type.as_ref().and_then(|t| t.tensor_type.as_ref()) else { return Ok(()) };
    let element = declared.elem_type.and_then(ElementType::from_number);
    if let Some(element) = element.filter(|&element| element != tensor.element()) {
        let found = tensor.element();
        return Err(format!("is {found}, the graph takes {element}; convert the array before it is given"));
    }
    let Some(shape) = &declared.shape else { return Ok(()) };
    let side = |dim: &DimensionProto| match &dim.value {
        Some(DimensionValue::Number(side)) => side.to_string(),
        Some(DimensionValue::Symbol(symbol)) => symbol.clone(),
        None => "?".to_owned(),
    };
    let fits = |(dim, &length): (&DimensionProto, &usize)| match dim.value {
        Some(DimensionValue::Number(side)) => usize::try_from(side) == Ok(length),
        _ => true,
    };
    if shape.dim.len() == tensor.shape.len() && shape.dim.iter().zip(&tensor.shape).all(fits) {
        return Ok(());
    }
    let expected: Vec<String> = shape.dim.iter().map(side).collect();
    Err(format!("has shape {:?}, the graph takes [{}]", tensor.shape, expected.join(", ")))
}

/// The length of an open dimension: what is given for its symbol, or for `S` where the exporter wrote `S/2` or `2*S`.
fn length(symbol: &str, dimensions: &BTreeMap<String, usize>) -> Option<usize> {
    if let Some(&length) = dimensions.get(symbol) {
        return Some(length);
    }
    let (symbol, factor, divisor) = parts(symbol)?;
    Some(dimensions.get(symbol)?.checked_mul(factor)? / divisor)
}

/// `S/2` is (S, 1, 2), `2*S` is (S, 2, 1).
fn parts(symbol: &str) -> Option<(&str, usize, usize)> {
    if let Some((symbol, divisor)) = symbol.split_once('/') {
        return Some((symbol.trim(), 1, divisor.trim().parse().ok().filter(|&divisor| divisor > 0)?));
    }
    let (factor, symbol) = symbol.split_once('*')?;
    Some((symbol.trim(), factor.trim().parse().ok()?, 1))
}

fn symbols(input: &ValueInfoProto) -> Vec<&str> {
    let shape = input.r#type.as_ref().and_then(|t| t.tensor_type.as_ref()).and_then(|t| t.shape.as_ref());
    shape
        .into_iter()
        .flat_map(|shape| &shape.dim)
        .filter_map(|dim| match &dim.value {
            Some(DimensionValue::Symbol(symbol)) => Some(symbol.as_str()),
            _ => None,
        })
        .collect()
}

fn signature(
    input: &ValueInfoProto,
    dimensions: &BTreeMap<String, usize>,
) -> std::result::Result<(ElementType, Vec<usize>), String> {
    let tensor = input.r#type.as_ref().and_then(|t| t.tensor_type.as_ref());
    let tensor = tensor.ok_or("is no tensor; give it by --inputs")?;
    let number = tensor.elem_type.unwrap_or(0);
    let element =
        ElementType::from_number(number).ok_or_else(|| format!("element type {number} is not drawn"))?;
    let shape = tensor.shape.as_ref().ok_or("the graph does not say its shape; give it by --inputs")?;
    let sides = shape.dim.iter().map(|dim| match &dim.value {
        Some(DimensionValue::Number(side)) => {
            usize::try_from(*side).map_err(|_| format!("a side of its shape is {side}"))
        }
        Some(DimensionValue::Symbol(symbol)) => {
            length(symbol, dimensions).ok_or_else(|| format!("its side {symbol} is open"))
        }
        None => Err("a side of its shape is open and has no name; give it by --inputs".to_owned()),
    });
    Ok((element, sides.collect::<std::result::Result<_, _>>()?))
}

/// The numbers of one input, and what they are.
fn numbers(
    kind: &str,
    name: &str,
    shape: &[usize],
    count: usize,
    element: ElementType,
    random: &mut ChaCha8Rng,
) -> (&'static str, Vec<f64>) {
    let mut uniform =
        |reach: f64| (0..count).map(|_| random.random_range(-reach..reach)).collect::<Vec<f64>>();
    match (kind, name, shape) {
        (_, "voxels", [.., depth, height, width]) if kind.starts_with("vsr") => {
            let ball = |place: usize| {
                let index = [place / width / height % depth, place / width % height, place % width];
                let inside = index
                    .iter()
                    .zip([depth, height, width])
                    .map(|(&i, &side)| ((i as f64 + 0.5) / side as f64 - 0.5).powi(2));
                f64::from(u8::from(inside.sum::<f64>() < 0.35 * 0.35))
            };
            ("a ball of voxels", (0..count).map(ball).collect())
        }
        (_, "images" | "image" | "crops", [.., height, width]) if !kind.is_empty() => {
            let mut pixels = uniform(0.2);
            for (place, pixel) in pixels.iter_mut().enumerate() {
                let (x, y) = (
                    (place % width) as f64 / *width as f64,
                    (place / width % height) as f64 / *height as f64,
                );
                let radius = ((x - 0.5).powi(2) + (y - 0.5).powi(2)).sqrt();
                *pixel = if radius < 0.35 { 0.7 * (radius * 30.0).sin() + *pixel } else { 0.0 };
            }
            ("a textured disc before nothing", pixels)
        }
        (_, "uv" | "depth" | "points", _) if !kind.is_empty() => ("uniform in −1.1..1.1", uniform(1.1)),
        _ if element == ElementType::Bool => {
            ("even odds", (0..count).map(|_| f64::from(u8::from(random.random_bool(0.5)))).collect())
        }
        _ if element.is_float() => {
            // Box and Muller's pair of normal numbers, of which one is taken.
            let normal = |_| {
                let radius = (-2.0 * (1.0 - random.random::<f64>()).ln()).sqrt();
                radius * (std::f64::consts::TAU * random.random::<f64>()).cos()
            };
            ("normal", (0..count).map(normal).collect())
        }
        _ => ("in 0..8", (0..count).map(|_| f64::from(random.random_range(0..8_i32))).collect()),
    }
}

fn typed(element: ElementType, shape: &[usize], numbers: &[f64]) -> std::result::Result<TypedTensor, String> {
    macro_rules! cast {
        ($type:ty) => {
            numbers.iter().map(|&x| x as $type).collect()
        };
    }
    let elements = match element {
        ElementType::F32 => Elements::F32(cast!(f32)),
        ElementType::F64 => Elements::F64(numbers.to_vec()),
        ElementType::F16 => Elements::F16(numbers.iter().map(|&x| half::f16::from_f64(x)).collect()),
        ElementType::Bf16 => Elements::Bf16(numbers.iter().map(|&x| half::bf16::from_f64(x)).collect()),
        ElementType::I8 => Elements::I8(cast!(i8)),
        ElementType::U8 => Elements::U8(cast!(u8)),
        ElementType::I16 => Elements::I16(cast!(i16)),
        ElementType::U16 => Elements::U16(cast!(u16)),
        ElementType::I32 => Elements::I32(cast!(i32)),
        ElementType::U32 => Elements::U32(cast!(u32)),
        ElementType::I64 => Elements::I64(cast!(i64)),
        ElementType::U64 => Elements::U64(cast!(u64)),
        ElementType::Bool => Elements::Bool(numbers.iter().map(|&x| x != 0.0).collect()),
    };
    TypedTensor::new(shape, elements)
}
