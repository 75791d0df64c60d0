//! The causal convolution of each channel with its own kernel, which hands its last inputs to the next call.

use vitruvian_reference::nn::{Conv, Scalar, Tensor, concat, conv, slice, swish};

use super::{Answer, Call, Value};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    (call.operator == "CausalConvWithState").then(|| convolved(call))
}

/// x [N,C,L] behind the last K − 1 inputs of before, or zeros, with kernels [C,1,K].
fn convolved<T: Scalar>(call: &Call<T>) -> Result<Vec<Value<T>>, String> {
    let attributes = call.attributes(&["activation"])?;
    let (x, w) = (call.numbers(0)?, call.numbers(1)?);
    let ([samples, channels, _], [kernels, 1, taps]) = (&x.shape[..], &w.shape[..]) else {
        return Err(format!("shapes {:?} and {:?}, [N,C,L] and [C,1,K] were expected", x.shape, w.shape));
    };
    if kernels != channels || *taps == 0 {
        return Err(format!("{kernels} kernels of {taps} taps for {channels} channels"));
    }
    let past = match call.optional_numbers(3)? {
        Some(past) => past.clone(),
        None => Tensor::zeros(&[*samples, *channels, taps - 1]),
    };
    let all = concat(&[&past, x], 2);
    let params = Conv { groups: *channels, ..Conv::new(1) };
    let y = conv(&all, w, call.optional_numbers(2)?, &params);
    let y = match attributes.text("activation", "none")? {
        "none" => y,
        "silu" | "swish" => swish(&y, T::exact(1.0)),
        other => {
            return Err(format!("attribute \"activation\" is {other}, none, silu or swish was expected"));
        }
    };
    let length = all.shape[2];
    Ok(vec![call.like(y)?, call.like(slice(&all, 2, length + 1 - taps, length, 1))?])
}
