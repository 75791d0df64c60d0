//! Recurrent layers.

use vitruvian_reference::nn::{
    Direction, Gate, Recurred, Recurrent, Scalar, Tensor, gru, lstm, rnn, transpose,
};

use super::{Answer, Attributes, Call, lengths, room};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    let (own, operands, defaults): (&[&str], _, &[&str]) = match call.operator {
        "GRU" => (&["linear_before_reset"], 6, &["Sigmoid", "Tanh"]),
        "LSTM" => (&["input_forget"], 8, &["Sigmoid", "Tanh", "Tanh"]),
        "RNN" => (&[], 6, &["Tanh"]),
        _ => return None,
    };
    Some(recurred(call, own, operands, defaults).and_then(|y| {
        let outputs = if call.operator == "LSTM" { vec![y.y, y.h, y.c] } else { vec![y.y, y.h] };
        outputs.into_iter().map(|y| call.like(y)).collect()
    }))
}

const SHARED: [&str; 7] =
    ["activation_alpha", "activation_beta", "activations", "clip", "direction", "hidden_size", "layout"];

fn recurred<T: Scalar>(
    call: &Call<T>,
    own: &[&str],
    operands: usize,
    defaults: &[&str],
) -> Result<Recurred<T>, String> {
    let attributes = call.attributes(&[&SHARED, own].concat())?;
    if call.operands.len() > operands {
        return Err(format!("{} operands, at most {operands} were expected", call.operands.len()));
    }
    let direction = match attributes.text("direction", "forward")? {
        "forward" => Direction::Forward,
        "reverse" => Direction::Reverse,
        "bidirectional" => Direction::Bidirectional,
        other => return Err(format!("attribute \"direction\" is {other}")),
    };
    let directions = if direction == Direction::Bidirectional { 2 } else { 1 };
    let (w, r) = (call.numbers(1)?, call.numbers(2)?);
    let hidden = attributes.count("hidden_size", r.shape.last().copied().unwrap_or(0))?;
    if r.shape.last() != Some(&hidden) {
        return Err(format!("attribute \"hidden_size\" is {hidden}, operand 2 has shape {:?}", r.shape));
    }
    // Batches may come first: [N,L,I] and [N,D,H].
    let batch_first = attributes.flag("layout", false)?;
    let turned =
        |x: &Tensor<T>| if batch_first && x.rank() == 3 { transpose(x, &[1, 0, 2]) } else { x.clone() };
    let x = turned(call.numbers(0)?);
    room(&[x.shape[..x.rank().min(2)].iter().product(), directions, hidden])?;
    let initial = |i: usize| Ok::<_, String>(call.optional_numbers(i)?.map(turned));
    let (initial_h, initial_c) = (initial(5)?, if operands == 8 { initial(6)? } else { None });
    let steps = match call.optional(4) {
        Some(_) => Some(lengths(&call.integers(4)?.data)?),
        None => None,
    };
    let layer = Recurrent {
        w,
        r,
        bias: call.optional_numbers(3)?,
        lengths: steps.as_deref(),
        initial_h: initial_h.as_ref(),
        direction,
        gates: &gates(attributes, directions, defaults)?,
        clip: attributes.has("clip").then(|| attributes.float("clip", 0.0)),
    };
    let y = match call.operator {
        "GRU" => gru(&x, &layer, attributes.int("linear_before_reset", 0) != 0),
        "LSTM" if attributes.flag("input_forget", false)? => {
            return Err("attribute \"input_forget\" is 1; coupled gates are not understood".into());
        }
        "LSTM" => lstm(&x, &layer, initial_c.as_ref(), call.optional_numbers(7)?),
        _ => rnn(&x, &layer),
    };
    Ok(match batch_first {
        false => y,
        true => Recurred { y: transpose(&y.y, &[2, 0, 1, 3]), h: turned(&y.h), c: turned(&y.c) },
    })
}

/// The gates' functions; `activation_alpha` and `activation_beta` are used up in the order of those that have them.
fn gates(attributes: Attributes, directions: usize, defaults: &[&str]) -> Result<Vec<Gate>, String> {
    let names = match attributes.texts("activations")? {
        Some(names) => names,
        None => defaults.repeat(directions),
    };
    let list = |name: &str| attributes.floats(name).unwrap_or_default().iter().map(|&x| f64::from(x));
    let (mut alphas, mut betas) = (list("activation_alpha"), list("activation_beta"));
    let mut setting = |alpha: f32, beta: Option<f32>| {
        let next = alphas.next().unwrap_or(alpha.into());
        (next, beta.map_or(0.0, |beta| betas.next().unwrap_or(beta.into())))
    };
    let gates = names
        .iter()
        .map(|name| {
            Ok(match name.to_ascii_lowercase().as_str() {
                "affine" => {
                    let (alpha, beta) = setting(1.0, Some(0.0));
                    Gate::Affine(alpha, beta)
                }
                "elu" => Gate::Elu(setting(1.0, None).0),
                "hardsigmoid" => {
                    let (alpha, beta) = setting(0.2, Some(0.5));
                    Gate::HardSigmoid(alpha, beta)
                }
                "leakyrelu" => Gate::LeakyRelu(setting(0.01, None).0),
                "relu" => Gate::Relu,
                "scaledtanh" => {
                    let (alpha, beta) = setting(1.0, Some(1.0));
                    Gate::ScaledTanh(alpha, beta)
                }
                "sigmoid" => Gate::Sigmoid,
                "softplus" => Gate::Softplus,
                "softsign" => Gate::Softsign,
                "tanh" => Gate::Tanh,
                "thresholdedrelu" => Gate::ThresholdedRelu(setting(1.0, None).0),
                _ => return Err(format!("attribute \"activations\" names {name}, which is not understood")),
            })
        })
        .collect::<Result<Vec<_>, String>>()?;
    if gates.len() != directions * defaults.len() {
        return Err(format!(
            "attribute \"activations\" names {} functions, {} were expected",
            gates.len(),
            directions * defaults.len()
        ));
    }
    Ok(gates)
}
