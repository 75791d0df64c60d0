//! What a forward pass leaves behind: its intermediate tensors by name, in the order of their computation.

use crate::nn::Tensor;

/// The named tensors of one forward pass.
#[derive(Clone, Debug, PartialEq)]
pub struct Stages<T = f64> {
    stages: Vec<(String, Tensor<T>)>,
}

impl<T> Default for Stages<T> {
    fn default() -> Stages<T> {
        Stages { stages: Vec::new() }
    }
}

impl<T> Stages<T> {
    /// Record a stage and return it for the next one.
    pub(super) fn record(&mut self, name: impl Into<String>, tensor: Tensor<T>) -> &Tensor<T> {
        self.stages.push((name.into(), tensor));
        &self.stages.last().expect("one was just pushed").1
    }

    /// The tensor of a stage.
    ///
    /// # Panics
    /// If there is none of this name.
    pub fn get(&self, name: &str) -> &Tensor<T> {
        match self.stages.iter().find(|(found, _)| found == name) {
            Some((_, tensor)) => tensor,
            None => panic!(
                "Stages: no stage {name:?}; there are {:?}",
                self.iter().map(|s| s.0).collect::<Vec<_>>()
            ),
        }
    }

    /// Every stage, first to last.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Tensor<T>)> {
        self.stages.iter().map(|(name, tensor)| (name.as_str(), tensor))
    }

    /// The stages `features_1`, `features_2`, …: what an encoder hands to the query.
    pub fn features(&self) -> Vec<&Tensor<T>> {
        self.iter().filter(|(name, _)| name.starts_with("features_")).map(|(_, tensor)| tensor).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stages_keep_their_order_and_features_are_found() {
        let mut stages: Stages = Stages::default();
        stages.record("stem", Tensor::zeros(&[1]));
        stages.record("features_1", Tensor::zeros(&[2]));
        stages.record("features_2", Tensor::zeros(&[3]));
        assert_eq!(stages.iter().map(|s| s.0).collect::<Vec<_>>(), ["stem", "features_1", "features_2"]);
        assert_eq!(stages.features().iter().map(|t| t.shape[0]).collect::<Vec<_>>(), [2, 3]);
    }

    #[test]
    #[should_panic(expected = "no stage \"leaf\"; there are [\"stem\"]")]
    fn an_unknown_stage_is_refused() {
        let mut stages: Stages = Stages::default();
        stages.record("stem", Tensor::zeros(&[1]));
        stages.get("leaf");
    }
}
