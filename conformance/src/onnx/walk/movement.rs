//! Operators that move elements, of whatever kind, and change nothing else.

use vitruvian_reference::nn::{Scalar, Tensor, concat, expand, gather, tile, transpose};

use super::{Answer, Call, Value, axes, axis, broadcast, lengths, room};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let y = match call.operator {
        "Concat" => concatenated(call),
        "Dropout" => return Some(kept(call)),
        "Expand" => moved(call, |x| {
            let shape = lengths(&call.integers(1)?.data)?;
            room(&broadcast(&x.shape, &shape)?)?;
            Ok(expand(x, &shape))
        }),
        "Flatten" => moved(call, |x| {
            let at = call.attributes(&["axis"])?.int("axis", 1);
            // An axis may also stand behind the last.
            let at = if at == x.rank() as i64 { x.rank() } else { axis(at, x.rank())? };
            let rows = x.shape[..at].iter().product();
            Ok(x.reshape(&[rows, x.shape[at..].iter().product()]))
        }),
        "Identity" => call.operand(0).cloned(),
        "Reshape" => moved(call, |x| {
            let allowzero = call.attributes(&["allowzero"])?.flag("allowzero", false)?;
            Ok(x.reshape(&reshaped(&x.shape, &call.integers(1)?.data, allowzero)?))
        }),
        "Slice" => sliced(call),
        "Split" => return Some(split(call)),
        "Squeeze" => squeezed(call),
        "Tile" => moved(call, |x| {
            let repeats = lengths(&call.integers(1)?.data)?;
            let sides = x.shape.iter().zip(&repeats).map(|(&side, &times)| side.saturating_mul(times));
            room(&sides.collect::<Vec<_>>())?;
            Ok(tile(x, &repeats))
        }),
        "Transpose" => moved(call, |x| {
            let reversed: Vec<usize> = (0..x.rank()).rev().collect();
            match call.attributes(&["perm"])?.counts("perm", x.rank(), usize::MAX)? {
                order if order.contains(&usize::MAX) => Ok(transpose(x, &reversed)),
                order => Ok(transpose(x, &order)),
            }
        }),
        "Unsqueeze" => unsqueezed(call),
        _ => return None,
    };
    Some(y.map(|y| vec![y]))
}

/// The first operand with its elements moved.
pub(super) fn moved<T: Scalar>(
    call: &Call<T>,
    arrange: impl FnOnce(&Tensor<usize>) -> Result<Tensor<usize>, String>,
) -> Result<Value<T>, String> {
    Value::arranged(&[call.operand(0)?], |places| arrange(&places[0]))
}

fn concatenated<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let at = call.attributes(&["axis"])?.int("axis", 0);
    let all: Vec<_> = (0..call.operands.len()).map(|i| call.operand(i)).collect::<Result<_, _>>()?;
    let rank = call.operand(0)?.shape().len();
    Value::arranged(&all, |places| Ok(concat(&places.iter().collect::<Vec<_>>(), axis(at, rank)?)))
}

/// At inference Dropout does nothing, and its mask says so.
fn kept<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    call.attributes(&["ratio", "seed"])?;
    let x = call.operand(0)?;
    if let Some(training) = call.optional(2) {
        let drops = match call.optional(1) {
            Some(_) => call.numbers(1)?.data.iter().any(|ratio| ratio.value() != 0.0),
            None => true,
        };
        if training.truths()?.data.contains(&true) && drops {
            return Err("training_mode 1 draws at random; only inference is defined here".into());
        }
    }
    let mask = match call.opset {
        ..10 => call.like(Tensor::filled(x.shape(), T::exact(1.0)))?,
        _ => Value::from_truths(Tensor::filled(x.shape(), true)),
    };
    Ok(vec![x.clone(), mask])
}

fn sliced<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axes", "ends", "starts"])?;
    let needed = |i, name| call.list(i, attributes, name)?.ok_or_else(|| format!("no {name} are given"));
    let (starts, ends) = (needed(1, "starts")?, needed(2, "ends")?);
    let along = call.list(3, attributes, "axes")?.unwrap_or_else(|| (0..starts.len() as i64).collect());
    let steps = call.optional(4).map(|_| call.integers(4)).transpose()?;
    moved(call, |x| {
        let mut y = x.clone();
        for (k, &at) in along.iter().enumerate() {
            let at = axis(at, x.rank())?;
            let step = steps.map_or(Some(1), |steps| steps.data.get(k).copied());
            let (Some(&start), Some(&end), Some(step)) = (starts.get(k), ends.get(k), step) else {
                return Err(format!(
                    "{} axes have {} starts and {} ends",
                    along.len(),
                    starts.len(),
                    ends.len()
                ));
            };
            y = gather(&y, &range_of_slice(start, end, step, y.shape[at])?, at);
        }
        Ok(y)
    })
}

/// The places start, start + step, … before end: negative ones count from the end, and what lies outside is cut off.
///
/// Backwards, a start before the first place is cut to the first place: so the specification has it, unlike NumPy.
fn range_of_slice(start: i64, end: i64, step: i64, length: usize) -> Result<Tensor<usize>, String> {
    let length = length as i64;
    let from_start = |at: i64| if at < 0 { at.saturating_add(length) } else { at };
    let (start, end) = (from_start(start), from_start(end));
    let places: Vec<usize> = match step {
        0 => return Err("a step of 0 never ends".into()),
        1.. => {
            let range = start.clamp(0, length)..end.clamp(0, length);
            range.step_by(step as usize).map(|i| i as usize).collect()
        }
        _ if length == 0 => Vec::new(),
        _ => {
            let range = end.clamp(-1, length - 1) + 1..=start.clamp(0, length - 1);
            range.rev().step_by(step.unsigned_abs() as usize).map(|i| i as usize).collect()
        }
    };
    Ok(Tensor::new(&[places.len()], places))
}

fn split<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let attributes = call.attributes(&["axis", "num_outputs", "split"])?;
    let x = call.operand(0)?;
    let at = axis(attributes.int("axis", 0), x.shape().len())?;
    let length = x.shape()[at];
    let sides = match call.list(1, attributes, "split")? {
        Some(sides) => lengths(&sides)?,
        None => {
            // Equal parts, the last one smaller.
            let names = call.node.output.len();
            let parts = attributes.count("num_outputs", names)?.max(1);
            if parts != names.max(1) {
                return Err(format!("attribute \"num_outputs\" is {parts}, the node has {names} outputs"));
            }
            let side = length.div_ceil(parts);
            (0..parts).map(|k| side.min(length - (k * side).min(length))).collect()
        }
    };
    if sides.iter().try_fold(0_usize, |all, &side| all.checked_add(side)) != Some(length) {
        return Err(format!("parts {sides:?} do not make up axis {at} of shape {:?}", x.shape()));
    }
    let mut first = 0;
    let part = |side: &usize| {
        let range = Tensor::new(&[*side], (first..first + side).collect());
        first += side;
        Value::arranged(&[x], |places| Ok(gather(&places[0], &range, at)))
    };
    sides.iter().map(part).collect()
}

fn squeezed<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axes"])?;
    let shape = call.operand(0)?.shape();
    let gone = match call.list(1, attributes, "axes")? {
        Some(list) => axes(&list, shape.len())?,
        None => (0..shape.len()).filter(|&a| shape[a] == 1).collect(),
    };
    if let Some(&long) = gone.iter().find(|&&a| shape[a] != 1) {
        return Err(format!("axis {long} of shape {shape:?} is not of length one"));
    }
    let left: Vec<usize> = (0..shape.len()).filter(|a| !gone.contains(a)).map(|a| shape[a]).collect();
    moved(call, |x| Ok(x.reshape(&left)))
}

fn unsqueezed<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["axes"])?;
    let list = call.list(1, attributes, "axes")?.ok_or("no axes are given")?;
    moved(call, |x| {
        let rank = x.rank() + list.len();
        let ones = axes(&list, rank)?;
        let mut sides = x.shape.iter();
        let side = |a| if ones.contains(&a) { 1 } else { sides.next().copied().unwrap_or(1) };
        Ok(x.reshape(&(0..rank).map(side).collect::<Vec<_>>()))
    })
}

/// The shape that a Reshape asks for: 0 keeps a side (unless `allowzero`), −1 is what remains.
fn reshaped(from: &[usize], to: &[i64], allowzero: bool) -> Result<Vec<usize>, String> {
    let error = || format!("shape {from:?} cannot become {to:?}");
    let mut shape = Vec::with_capacity(to.len());
    for (i, &side) in to.iter().enumerate() {
        shape.push(match side {
            0 if !allowzero => *from.get(i).ok_or_else(error)?,
            -1 => 1,
            side => usize::try_from(side).map_err(|_| error())?,
        });
    }
    let (total, rest): (usize, usize) = (from.iter().product(), shape.iter().product());
    if let Some(open) = to.iter().position(|&side| side == -1) {
        shape[open] = total.checked_div(rest).ok_or_else(error)?;
    }
    if shape.iter().product::<usize>() == total { Ok(shape) } else { Err(error()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reshape_keeps_infers_and_refuses() {
        assert_eq!(reshaped(&[2, 3, 4], &[0, -1], false), Ok(vec![2, 12]), "keep and infer");
        assert_eq!(reshaped(&[2, 3, 4], &[4, 6], false), Ok(vec![4, 6]), "as said");
        assert!(reshaped(&[2, 3, 4], &[5, -1], false).is_err(), "24 is no multiple of 5");
        assert!(reshaped(&[2, 3, 4], &[0, 0], false).is_err(), "24 elements do not fit in 6");
    }

    #[test]
    fn a_slice_counts_from_either_end_and_runs_either_way() {
        let places = |start, end, step| range_of_slice(start, end, step, 5).expect("a range").data;
        assert_eq!(places(1, 4, 2), [1, 3], "forwards");
        assert_eq!(places(-2, i64::MAX, 1), [3, 4], "from the end to what lies outside");
        assert_eq!(places(-1, i64::MIN, -2), [4, 2, 0], "backwards to the first");
        assert_eq!(places(-9, i64::MIN, -1), [0], "backwards from before the first is the first");
        assert_eq!(places(7, 9, 1), [0_usize; 0], "behind the end is nothing");
        assert!(range_of_slice(0, 5, 0, 5).is_err(), "a step of 0");
    }
}
