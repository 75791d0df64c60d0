//! Losses of classes: of logarithms of probabilities, and of scores.

use vitruvian_reference::nn::{Reduction, Scalar, Tensor, log_softmax, negative_log_likelihood};

use super::{Answer, Attributes, Call};

pub(super) fn evaluate<T: Scalar>(call: &Call<T>) -> Answer<T> {
    Some(match call.operator {
        "NegativeLogLikelihoodLoss" => call.numbers(0).and_then(|x| Ok(vec![call.like(loss(call, x)?)?])),
        "SoftmaxCrossEntropyLoss" => call.numbers(0).and_then(|x| {
            if x.rank() < 2 {
                return Err(format!("operand 0 has shape {:?}, [N,C,…] was expected", x.shape));
            }
            let logarithms = log_softmax(x, 1);
            Ok(vec![call.like(loss(call, &logarithms)?)?, call.like(logarithms)?])
        }),
        _ => return None,
    })
}

fn loss<T: Scalar>(call: &Call<T>, x: &Tensor<T>) -> Result<Tensor<T>, String> {
    let attributes = call.attributes(&["ignore_index", "reduction"])?;
    Ok(negative_log_likelihood(
        x,
        &targets(call, attributes)?,
        call.optional_numbers(2)?,
        match attributes.text("reduction", "mean")? {
            "none" => Reduction::None,
            "sum" => Reduction::Sum,
            "mean" => Reduction::Mean,
            other => {
                return Err(format!("attribute \"reduction\" is {other}, none, sum or mean was expected"));
            }
        },
    ))
}

/// The classes; `None` where one is `ignore_index`, which need not be a class.
fn targets<T: Scalar>(call: &Call<T>, attributes: Attributes) -> Result<Tensor<Option<usize>>, String> {
    let ignored = attributes.has("ignore_index").then(|| attributes.int("ignore_index", 0));
    let targets = call.integers(1)?;
    let class = |&target: &i64| match target {
        target if ignored == Some(target) => Ok(None),
        target => {
            usize::try_from(target).map(Some).map_err(|_| format!("a target is {target}, which is no class"))
        }
    };
    Ok(Tensor::new(&targets.shape, targets.data.iter().map(class).collect::<Result<_, _>>()?))
}
