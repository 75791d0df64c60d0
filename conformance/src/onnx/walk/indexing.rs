//! Operators that pick elements by their places and put others into theirs.

use vitruvian_reference::nn::{
    Scalar, Tensor, compress, gather, gather_elements, gather_nd, non_zero, replace, reverse_sequence,
    scatter_elements, scatter_nd, top_k, unique,
};

use super::choice::order;
use super::movement::moved;
use super::{Answer, Call, Data, Value, axes, axis, lengths};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "Compress" => compressed(call),
        "Gather" => gathered(call),
        "GatherElements" => gathered_elements(call),
        "GatherND" => gathered_slices(call),
        "NonZero" => found(call),
        "ReverseSequence" => reversed(call),
        // Scatter is the name that ScatterElements had until opset 10.
        "Scatter" | "ScatterElements" => scattered(call),
        "ScatterND" => scattered_slices(call),
        "TensorScatter" => written(call),
        "TopK" => return Some(topmost(call)),
        "Unique" => return Some(distinct(call)),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// Places in a length, negative ones from the end.
fn places(indices: &Tensor<i64>, length: usize) -> Result<Tensor<usize>, String> {
    Ok(Tensor::new(&indices.shape, axes(&indices.data, length)?))
}

/// Places of K indices each in their last axis, the k-th of them in a length of `sides[k]`.
fn deep_places(indices: &Tensor<i64>, sides: &[usize]) -> Result<Tensor<usize>, String> {
    let depth = indices.shape.last().copied().ok_or("operand 1 has no axis")?;
    if depth > sides.len() {
        return Err(format!("places of {depth} indices are too deep for the sides {sides:?}"));
    }
    let place = |(k, &index): (usize, &i64)| axis(index, sides[k % depth]);
    let places = indices.data.iter().enumerate().map(place).collect::<Result<_, _>>()?;
    Ok(Tensor::new(&indices.shape, places))
}

/// Integers as an output of i64.
pub(super) fn counted<T: Scalar>(integers: &Tensor<usize>) -> Result<Value<T>, String> {
    Value::from_integers(ElementType::I64, integers.map(|i| i as i64))
}

fn compressed<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axis"])?;
    let condition = &call.truths(1)?.data;
    moved(call, |x| {
        if !attributes.has("axis") {
            return Ok(compress(&x.reshape(&[x.data.len()]), condition, 0));
        }
        Ok(compress(x, condition, axis(attributes.int("axis", 0), x.rank())?))
    })
}

fn gathered<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let at = call.attributes(&["axis"])?.int("axis", 0);
    moved(call, |x| {
        let at = axis(at, x.rank())?;
        Ok(gather(x, &places(call.integers(1)?, x.shape[at])?, at))
    })
}

fn gathered_elements<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let at = call.attributes(&["axis"])?.int("axis", 0);
    moved(call, |x| {
        let at = axis(at, x.rank())?;
        Ok(gather_elements(x, &places(call.integers(1)?, x.shape[at])?, at))
    })
}

fn gathered_slices<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let batch_axes = call.attributes(&["batch_dims"])?.count("batch_dims", 0)?;
    moved(call, |x| {
        let sides = x.shape.get(batch_axes..).ok_or("there are more batch axes than axes")?;
        Ok(gather_nd(x, &deep_places(call.integers(1)?, sides)?, batch_axes))
    })
}

fn found<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    counted(&non_zero(&match &call.operand(0)?.data {
        Data::Numbers(x) => x.map(|x| x.value() != 0.0),
        Data::Integers(x) => x.map(|i| i != 0),
        Data::Truths(x) => x.clone(),
    }))
}

fn reversed<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["batch_axis", "time_axis"])?;
    let lengths = lengths(&call.integers(1)?.data)?;
    moved(call, |x| {
        let at = |name, default| axis(attributes.int(name, default), x.rank());
        Ok(reverse_sequence(x, &lengths, at("batch_axis", 1)?, at("time_axis", 0)?))
    })
}

/// How an update meets the element in its place.
#[derive(Clone, Copy)]
enum Reduction {
    Replace,
    Add,
    Mul,
    Min,
    Max,
}

impl Reduction {
    fn named(name: &str) -> Result<Self, String> {
        match name {
            "none" => Ok(Self::Replace),
            "add" => Ok(Self::Add),
            "mul" => Ok(Self::Mul),
            "min" => Ok(Self::Min),
            "max" => Ok(Self::Max),
            other => Err(format!("reduction {other} is not understood")),
        }
    }

    fn of_numbers<T: Scalar>(self) -> fn(T, T) -> T {
        match self {
            Self::Replace => replace,
            Self::Add => T::plus,
            Self::Mul => |y, u| y * u,
            Self::Min => |y, u| -T::maximum(-y, -u),
            Self::Max => T::maximum,
        }
    }

    fn of_integers(self) -> fn(i64, i64) -> i64 {
        match self {
            Self::Replace => replace,
            Self::Add => i64::wrapping_add,
            Self::Mul => i64::wrapping_mul,
            Self::Min => i64::min,
            Self::Max => i64::max,
        }
    }
}

/// Where updates go: elements along an axis, or slices.
enum Target {
    Elements(Tensor<usize>, usize),
    Slices(Tensor<usize>),
}

impl Target {
    fn update<E: Copy>(&self, x: &Tensor<E>, updates: &Tensor<E>, f: fn(E, E) -> E) -> Tensor<E> {
        match self {
            Self::Elements(places, axis) => scatter_elements(x, places, updates, *axis, f),
            Self::Slices(places) => scatter_nd(x, places, updates, f),
        }
    }
}

fn updated<T: Scalar>(call: &Call<T>, target: &Target, reduction: Reduction) -> Result<Value<T>, String> {
    let (x, updates) = (call.operand(0)?, call.operand(2)?);
    match (&x.data, reduction) {
        (Data::Numbers(y), _) => call.like(target.update(y, call.numbers(2)?, reduction.of_numbers())),
        (Data::Integers(y), _) => {
            Value::from_integers(x.element, target.update(y, call.integers(2)?, reduction.of_integers()))
        }
        (Data::Truths(y), Reduction::Replace) => {
            Ok(Value::from_truths(target.update(y, updates.truths()?, replace)))
        }
        (Data::Truths(_), _) => Err("truths are not reduced".into()),
    }
}

fn scattered<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axis", "reduction"])?;
    let shape = call.operand(0)?.shape();
    let at = axis(attributes.int("axis", 0), shape.len())?;
    let target = Target::Elements(places(call.integers(1)?, shape[at])?, at);
    updated(call, &target, Reduction::named(attributes.text("reduction", "none")?)?)
}

fn scattered_slices<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let reduction = Reduction::named(call.attributes(&["reduction"])?.text("reduction", "none")?)?;
    let target = Target::Slices(deep_places(call.integers(1)?, call.operand(0)?.shape())?);
    updated(call, &target, reduction)
}

/// A cache with an update written into each batch at its own place along an axis.
fn written<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axis", "mode"])?;
    let circular = match attributes.text("mode", "linear")? {
        "linear" => false,
        "circular" => true,
        other => return Err(format!("attribute \"mode\" is {other}, linear or circular was expected")),
    };
    let (cache, update) = (call.operand(0)?, call.operand(1)?);
    let at = axis(attributes.int("axis", -2), cache.shape().len())?;
    let rank = cache.shape().len();
    let fits = update.shape().len() == rank
        && at > 0
        && (0..rank).all(|a| match a == at {
            true => update.shape()[a] <= cache.shape()[a],
            false => update.shape()[a] == cache.shape()[a],
        });
    if !fits {
        let (cache, update) = (cache.shape(), update.shape());
        return Err(format!("an update of shape {update:?} does not fit a cache of shape {cache:?} at {at}"));
    }
    let first = match call.optional(2) {
        Some(_) => lengths(&call.integers(2)?.data)?,
        None => vec![0; cache.shape()[0]],
    };
    let (batches, length, written) = (cache.shape()[0], cache.shape()[at], update.shape()[at]);
    if first.len() != batches {
        return Err(format!(
            "{} places to write at, one for each of {batches} batches was expected",
            first.len()
        ));
    }
    if !circular && first.iter().any(|&first| first.saturating_add(written) > length) {
        return Err(format!("{written} written at {first:?} reach beyond a length of {length}"));
    }
    Value::arranged(&[cache, update], |places| {
        // What of the update stands at a place of the cache: the last that was written there.
        Ok(Tensor::from_fn(cache.shape(), |index| {
            let behind = (index[at] + length - first[index[0]] % length) % length;
            let mut from = index.to_vec();
            from[at] = behind;
            if behind < written { places[1].at(&from) } else { places[0].at(index) }
        }))
    })
}

fn topmost<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    // `sorted` = 0 leaves the order open: sorted is as good as any.
    let attributes = call.attributes(&["axis", "k", "largest", "sorted"])?;
    let count = match call.optional(1) {
        None if call.opset < 10 => attributes.int("k", 0),
        _ => match call.integers(1)?.data[..] {
            [count] => count,
            _ => return Err("operand 1 holds no single number of elements".into()),
        },
    };
    let count = usize::try_from(count).map_err(|_| format!("{count} elements are asked for"))?;
    let at = axis(attributes.int("axis", -1), call.operand(0)?.shape().len())?;
    let largest = attributes.flag("largest", true)?;
    let x = call.operand(0)?;
    let along = top_k(&ranked(x), count, at, |a, b| if largest { b.0.cmp(&a.0) } else { a.0.cmp(&b.0) }).1;
    Ok(vec![moved(call, |x| Ok(gather_elements(x, &along, at)))?, counted(&along)?])
}

/// An element's rank among all elements, equal ones having the same: an order for every element type.
#[derive(Clone, Copy)]
struct Rank(usize);

fn ranked<T: Scalar>(x: &Value<T>) -> Tensor<Rank> {
    let mut sorted: Vec<usize> = (0..x.len()).collect();
    sorted.sort_by(|&a, &b| order(x, a, b));
    let mut ranks = vec![Rank(0); x.len()];
    for pair in 1..sorted.len() {
        let (before, here) = (sorted[pair - 1], sorted[pair]);
        ranks[here] = Rank(ranks[before].0 + usize::from(order(x, before, here).is_ne()));
    }
    Tensor::new(x.shape(), ranks)
}

fn distinct<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let attributes = call.attributes(&["axis", "sorted"])?;
    let x = call.operand(0)?;
    let sorted = attributes.flag("sorted", true)?;
    let (ranks, at) = match attributes.has("axis") {
        true => (ranked(x), axis(attributes.int("axis", 0), x.shape().len())?),
        false => (ranked(x).reshape(&[x.len()]), 0),
    };
    let found = unique(&ranks, at, sorted, |a, b| a.0.cmp(&b.0));
    let list = |list: &[usize]| counted(&Tensor::new(&[list.len()], list.to_vec()));
    let first = Tensor::new(&[found.first.len()], found.first.clone());
    let values = moved(call, |x| {
        let flat = if attributes.has("axis") { x.clone() } else { x.reshape(&[x.data.len()]) };
        Ok(gather(&flat, &first, at))
    })?;
    Ok(vec![values, list(&found.first)?, list(&found.inverse)?, list(&found.counts)?])
}

#[cfg(test)]
mod tests {
    use super::super::tests::node;
    use super::super::{OPSETS, evaluate};
    use super::*;
    use crate::onnx::builder::{int, text};
    use crate::onnx::message::NodeProto;

    fn outputs(node: &NodeProto, opset: i64, operands: &[&Value]) -> Result<Vec<Value>, String> {
        let operands: Vec<Option<&Value>> = operands.iter().copied().map(Some).collect();
        Ok(evaluate(node, opset, &operands)?.into_iter().flatten().collect())
    }

    fn integers(element: ElementType, shape: &[usize], data: Vec<i64>) -> Value {
        Value::from_integers(element, Tensor::new(shape, data)).expect("integers of the type")
    }

    #[test]
    fn places_may_count_from_the_end() {
        let x = Value::from_numbers(ElementType::F32, Tensor::new(&[3], vec![1.0, 2.0, 3.0]));
        let last = outputs(&node("Gather", vec![]), 21, &[&x, &Value::list(vec![-1])]).expect("gathered");
        assert_eq!(last[0].numbers().expect("numbers").data, [3.0]);
        let beyond = outputs(&node("Gather", vec![]), 21, &[&x, &Value::list(vec![3])]);
        assert!(beyond.expect_err("refused").contains("index 3"), "a place that is not there");
        let deep = integers(ElementType::I64, &[1, 2], vec![0, 0]);
        let deep = outputs(&node("GatherND", vec![]), 21, &[&x, &deep]);
        assert!(deep.expect_err("refused").contains("too deep"), "two indices in a list");
    }

    #[test]
    fn updates_that_meet_are_reduced_in_their_type() {
        let x = integers(ElementType::U8, &[2], vec![250, 1]);
        let (places, updates) = (Value::list(vec![0, 0]), integers(ElementType::U8, &[2], vec![5, 3]));
        let with = |reduction: &str| {
            let node = node("ScatterElements", vec![text("reduction", reduction)]);
            Ok::<_, String>(outputs(&node, 18, &[&x, &places, &updates])?[0].integers()?.data.clone())
        };
        assert_eq!(with("none"), Ok(vec![3, 1]));
        assert_eq!(with("add"), Ok(vec![2, 1]), "258 wraps in eight bits");
        assert_eq!(with("max"), Ok(vec![250, 1]));
        assert_eq!(with("min"), Ok(vec![3, 1]));
        assert!(with("mean").expect_err("refused").contains("reduction mean"), "by name");
    }

    #[test]
    fn the_number_of_elements_was_an_attribute_before_opset_10() {
        let x = integers(ElementType::I32, &[3], vec![5, 9, 7]);
        let mut old = node("TopK", vec![int("k", 2)]);
        old.output.push("places".into());
        let found = outputs(&old, 7, &[&x]).expect("the topmost");
        assert_eq!(found[0].integers().expect("integers").data, [9, 7]);
        assert_eq!(found[1], Value::list(vec![1, 2]));
        let new = node("TopK", vec![int("largest", 0)]);
        let found = outputs(&new, *OPSETS.end(), &[&x, &Value::list(vec![1])]).expect("the least");
        assert_eq!((found[0].integers().expect("integers").data[0], found[0].element), (5, ElementType::I32));
        let missing = outputs(&node("TopK", vec![]), 11, &[&x]);
        assert!(missing.expect_err("refused").contains("operand 1"), "no number");
    }

    #[test]
    fn a_circular_cache_is_written_around_its_end() {
        let cache = integers(ElementType::I32, &[1, 4], vec![0, 0, 0, 0]);
        let update = integers(ElementType::I32, &[1, 2], vec![1, 2]);
        let at = |mode: &str, first: i64| {
            let node = node("TensorScatter", vec![int("axis", 1), text("mode", mode)]);
            let written = outputs(&node, 24, &[&cache, &update, &Value::list(vec![first])])?;
            Ok::<_, String>(written[0].integers()?.data.clone())
        };
        assert_eq!(at("linear", 1), Ok(vec![0, 1, 2, 0]));
        assert_eq!(at("circular", 3), Ok(vec![2, 0, 0, 1]));
        assert!(at("linear", 3).expect_err("refused").contains("beyond a length of 4"), "no room");
    }
}
