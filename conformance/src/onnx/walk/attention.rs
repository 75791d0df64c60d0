//! Attention and rotary embedding.

use vitruvian_reference::nn::{
    Attention, LinearAttention, Pairs, Scalar, Tensor, attention, concat, gather, join_heads,
    linear_attention, rotary_embedding, split_heads,
};

use super::{Answer, Call, Data, Value, axes, room};
use crate::onnx::element::ElementType;

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    Some(match call.operator {
        "Attention" => attended(call),
        "LinearAttention" => linearly_attended(call),
        "RotaryEmbedding" => rotated(call).map(|y| vec![y]),
        _ => return None,
    })
}

/// \[N,H,L,E\] as it is, or [N,L,H·E] with its heads apart.
fn heads<T: Scalar>(x: &Tensor<T>, heads: usize, name: &str) -> Result<Tensor<T>, String> {
    match (x.rank(), heads) {
        (4, _) => Ok(x.clone()),
        (3, 0) => Err(format!("attribute \"{name}\" is missing, which operands of three axes need")),
        (3, heads) => Ok(split_heads(x, heads)),
        _ => Err(format!("shape {:?} has neither three nor four axes", x.shape)),
    }
}

fn attended<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let attributes = call.attributes(&[
        "is_causal",
        "kv_num_heads",
        "left_window_size",
        "q_num_heads",
        "qk_matmul_output_mode",
        "right_window_size",
        "scale",
        "softcap",
        "softmax_precision",
    ])?;
    let element = call.operand(0)?.element;
    precision(attributes.has("softmax_precision").then(|| attributes.int("softmax_precision", 1)), element)?;
    let (q_heads, kv_heads) = (attributes.count("q_num_heads", 0)?, attributes.count("kv_num_heads", 0)?);
    let flat = call.numbers(0)?.rank() == 3;
    let q = heads(call.numbers(0)?, q_heads, "q_num_heads")?;
    let cached = |i: usize, past: usize| {
        let new = heads(call.numbers(i)?, kv_heads, "kv_num_heads")?;
        Ok::<_, String>(match call.optional_numbers(past)? {
            Some(past) => concat(&[past, &new], 2),
            None => new,
        })
    };
    let (k, v) = (cached(1, 4)?, cached(2, 5)?);
    let samples = q.shape[0];
    room(&[&q.shape[..3], &[k.shape[2]]].concat())?;

    let lengths = match call.optional(6) {
        Some(_) => Some(super::lengths(&call.integers(6)?.data)?),
        None => None,
    };
    let offset = match (call.optional_numbers(4)?, &lengths) {
        (Some(_), Some(_)) => {
            return Err("operands 4 (past_key) and 6 (nonpad_kv_seqlen) exclude each other".into());
        }
        (Some(past), None) => vec![past.shape[2] as i64; samples],
        (None, Some(lengths)) => lengths.iter().map(|&n| n as i64 - q.shape[2] as i64).collect(),
        (None, None) => vec![0; samples],
    };
    // −1 leaves that side of the window open.
    let window = |name: &str| match attributes.int(name, -1) {
        -1 => Ok(None),
        _ => attributes.count(name, 0).map(Some),
    };
    let softcap = attributes.float("softcap", 0.0);
    let params = Attention {
        scale: attributes.has("scale").then(|| attributes.float("scale", 0.0)),
        softcap: (softcap > 0.0).then_some(softcap),
        causal: attributes.flag("is_causal", false)?,
        left_window: window("left_window_size")?,
        right_window: window("right_window_size")?,
        offsets: offset,
        lengths,
    };
    let found = attention(&q, &k, &v, mask(call)?.as_ref(), &params);
    let stage = match attributes.int("qk_matmul_output_mode", 0) {
        0 => found.scores,
        1 => found.capped,
        2 => found.biased,
        3 => found.weights,
        mode => return Err(format!("attribute \"qk_matmul_output_mode\" is {mode}, 0 to 3 was expected")),
    };
    let y = if flat { join_heads(&found.y) } else { found.y };
    let of_values = call.operand(2)?.element;
    Ok(vec![call.like(y)?, call.like(k)?, Value::from_numbers(of_values, v), call.like(stage)?])
}

/// A softmax in a narrower type than the operands' rounds more than the bounds say.
fn precision(number: Option<i64>, element: ElementType) -> Result<(), String> {
    let Some(number) = number else { return Ok(()) };
    let of_softmax = i32::try_from(number).ok().and_then(ElementType::from_number);
    match of_softmax.and_then(ElementType::unit_roundoff) {
        Some(u) if element.unit_roundoff().is_some_and(|own| u <= own) => Ok(()),
        _ => Err(format!(
            "attribute \"softmax_precision\" is {number}, a type no narrower than {element} was expected"
        )),
    }
}

/// What is added to the scores: true is 0, false is −∞.
fn mask<T: Scalar>(call: &Call<T>) -> Result<Option<Tensor<T>>, String> {
    Ok(match call.optional(3).map(|mask| &mask.data) {
        None => None,
        Some(Data::Truths(mask)) => {
            Some(mask.map(|seen| T::exact(if seen { 0.0 } else { f64::NEG_INFINITY })))
        }
        Some(Data::Numbers(mask)) => Some(mask.clone()),
        Some(Data::Integers(_)) => {
            return Err("operand 3 (attn_mask) holds integers, numbers or truths were expected".into());
        }
    })
}

/// Heads always lie side by side; their number is given.
fn linearly_attended<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let attributes =
        call.attributes(&["chunk_size", "kv_num_heads", "q_num_heads", "scale", "update_rule"])?;
    let (q_heads, kv_heads) = (attributes.count("q_num_heads", 0)?, attributes.count("kv_num_heads", 0)?);
    let flat = |i: usize, count: usize, name: &str| match call.numbers(i)? {
        x if x.rank() == 3 => heads(x, count, name),
        x => Err(format!("operand {i} has shape {:?}, [N,L,H·E] was expected", x.shape)),
    };
    let (q, k) = (flat(0, q_heads, "q_num_heads")?, flat(1, kv_heads, "kv_num_heads")?);
    let v = flat(2, kv_heads, "kv_num_heads")?;
    let (gated, corrected) = match attributes.text("update_rule", "gated_delta")? {
        "linear" => (false, false),
        "gated" => (true, false),
        "delta" => (false, true),
        "gated_delta" => (true, true),
        other => return Err(format!("attribute \"update_rule\" is {other}")),
    };
    if call.optional(4).is_some() != gated || call.optional(5).is_some() != corrected {
        return Err("operands 4 (decay) and 5 (beta) are not those that \"update_rule\" asks for".into());
    }
    let decay = gated.then(|| flat(4, kv_heads, "kv_num_heads")).transpose()?;
    // One rate for all heads, or one for each.
    let rates = |x: &Tensor<T>| if x.shape.last() == Some(&1) { 1 } else { kv_heads };
    let beta = corrected.then(|| flat(5, rates(call.numbers(5)?), "kv_num_heads")).transpose()?;
    let scale = attributes.float("scale", 0.0);
    let params = LinearAttention {
        decay: decay.as_ref(),
        beta: beta.as_ref(),
        past: call.optional_numbers(3)?,
        scale: (scale != 0.0).then_some(scale),
    };
    let (y, state) = linear_attention(&q, &k, &v, &params);
    let of_state = call.optional(3).map_or(call.operand(0)?.element, |past| past.element);
    Ok(vec![call.like(join_heads(&y))?, Value::from_numbers(of_state, state)])
}

fn rotated<T: Scalar>(call: &Call<T>) -> Result<Value<T>, String> {
    let attributes = call.attributes(&["interleaved", "num_heads", "rotary_embedding_dim"])?;
    let pairs = if attributes.flag("interleaved", false)? { Pairs::Neighbours } else { Pairs::Halves };
    let x = heads(call.numbers(0)?, attributes.count("num_heads", 0)?, "num_heads")?;
    let cached = |i: usize| match call.optional(3) {
        None => Ok::<_, String>(call.numbers(i)?.clone()),
        Some(_) => {
            let (cache, positions) = (call.numbers(i)?, call.integers(3)?);
            let rows = axes(&positions.data, cache.shape.first().copied().unwrap_or(0))?;
            Ok(gather(cache, &Tensor::new(&positions.shape, rows), 0))
        }
    };
    let (cos, sin) = (cached(1)?, cached(2)?);
    let turned = match attributes.count("rotary_embedding_dim", 0)? {
        0 => x.shape[3],
        turned => turned,
    };
    if cos.shape.last() != Some(&(turned / 2)) {
        return Err(format!(
            "{turned} features are turned, which needs caches of {}, found {:?}",
            turned / 2,
            cos.shape
        ));
    }
    let y = rotary_embedding(&x, &cos, &sin, pairs);
    call.like(if call.numbers(0)?.rank() == 3 { join_heads(&y) } else { y })
}
