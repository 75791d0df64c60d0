//! The negative log-likelihood of classes.

use super::{Scalar, Tensor};

/// What is given instead of one loss per target.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reduction {
    /// The losses as they are.
    None,
    /// Their sum.
    Sum,
    /// Their sum divided by the sum of the *weights* of the targets that count, not by their number.
    Mean,
}

/// −w_t·x\[n,t,…\] for the class t that stands in the targets at \[n,…\]; the targets that are `None` count nothing.
///
/// x [N,C,…] holds logarithms of probabilities, targets [N,…] classes 0…C−1, weights \[C\] are 1 if absent.
///
/// Rounding: a product for a weight, the sum in any order, and its quotient.
///
/// # Panics
/// If the shapes do not fit or a class is not below C.
///
/// # References
/// ONNX operators NegativeLogLikelihoodLoss (version 22) and, after [`log_softmax`](super::log_softmax) over the classes,
/// SoftmaxCrossEntropyLoss (version 13).
pub fn negative_log_likelihood<T: Scalar>(
    x: &Tensor<T>,
    targets: &Tensor<Option<usize>>,
    weights: Option<&Tensor<T>>,
    reduction: Reduction,
) -> Tensor<T> {
    let fits = x.rank() >= 2 && targets.shape == [&x.shape[..1], &x.shape[2..]].concat();
    assert!(fits, "negative_log_likelihood: targets {:?} are not those of x {:?}", targets.shape, x.shape);
    let classes = x.shape[1];
    let known = targets.data.iter().flatten().all(|&class| class < classes);
    assert!(
        known,
        "negative_log_likelihood: a target is not one of the {classes} classes of x {:?}",
        x.shape
    );
    let one_each = weights.is_none_or(|w| w.shape == [classes]);
    assert!(one_each, "negative_log_likelihood: {classes} weights were expected for x {:?}", x.shape);

    let pixels: usize = x.shape[2..].iter().product();
    let weight = |class: usize| weights.map_or(T::exact(1.0), |w| w.data[class]);
    let losses: Vec<T> = targets
        .data
        .iter()
        .enumerate()
        .map(|(place, target)| match target {
            None => T::ZERO,
            Some(class) => {
                let loss = -x.data[(place / pixels * classes + class) * pixels + place % pixels];
                if weights.is_some() { weight(*class) * loss } else { loss }
            }
        })
        .collect();
    let sum = |terms: &mut dyn Iterator<Item = T>| terms.fold(T::ZERO, T::plus);
    let total = |data: T| Tensor::new(&[], vec![data]);
    match reduction {
        Reduction::None => Tensor::new(&targets.shape, losses),
        Reduction::Sum => total(sum(&mut losses.into_iter())),
        Reduction::Mean => {
            // Without weights the divisor is a count, which is exact.
            let divisor = match weights {
                Some(_) => sum(&mut targets.data.iter().flatten().map(|&class| weight(class))),
                None => T::exact(targets.data.iter().flatten().count() as f64),
            };
            total(sum(&mut losses.into_iter()) / divisor)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn case() -> (Tensor, Tensor<Option<usize>>) {
        let x = Tensor::new(&[2, 3, 2], (0..12).map(f64::from).collect());
        (x, Tensor::new(&[2, 2], vec![Some(0), Some(2), None, Some(1)]))
    }

    #[test]
    fn each_target_picks_its_class() {
        let (x, targets) = case();
        let loss = |weights, reduction| negative_log_likelihood(&x, &targets, weights, reduction).data;
        assert_eq!(loss(None, Reduction::None), [-0.0, -5.0, 0.0, -9.0]);
        assert_eq!(loss(None, Reduction::Sum), [-14.0]);
        assert_eq!(loss(None, Reduction::Mean), [-14.0 / 3.0], "what is ignored does not count");
        let weights = Tensor::new(&[3], vec![1.0, 2.0, 3.0]);
        assert_eq!(loss(Some(&weights), Reduction::Mean), [-33.0 / 6.0], "the weights' mean");
    }

    #[test]
    #[should_panic(expected = "a target is not one of the 3 classes")]
    fn a_class_must_exist() {
        let (x, _) = case();
        negative_log_likelihood(&x, &Tensor::filled(&[2, 2], Some(3)), None, Reduction::Sum);
    }
}
