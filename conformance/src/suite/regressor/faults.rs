//! Faults that an exporter, an optimiser or a hand could put into a regressor.

/// One fault in a graph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// ε = 10⁻³ for 10⁻⁵ in one batch normalisation.
    BatchNormEpsilon,
    /// One ReLU of a bottleneck is left out.
    MissingRelu,
    /// A ReLU between fc1 and fc2, where the head has none.
    ActivationInTheHead,
    /// The head corrects four times.
    FourthRound,
    /// The stride is on the first 1×1 of a bottleneck, as in the paper, and not on its 3×3.
    StrideOnTheFirst,
    /// A strided convolution is padded after the image only, as TensorFlow's "same" pads even sides.
    PaddingAfter,
    /// One weight of one kernel is off by a hundredth.
    OneWeight,
}

/// Every fault that must be seen.
pub const FAULTS: [Fault; 7] = [
    Fault::BatchNormEpsilon,
    Fault::MissingRelu,
    Fault::ActivationInTheHead,
    Fault::FourthRound,
    Fault::StrideOnTheFirst,
    Fault::PaddingAfter,
    Fault::OneWeight,
];

impl Fault {
    /// The first stage that it must spoil; none for a graph that has not the stages of a regressor.
    pub fn stage(self) -> Option<&'static str> {
        match self {
            Fault::BatchNormEpsilon | Fault::StrideOnTheFirst | Fault::PaddingAfter => Some("layer2"),
            Fault::MissingRelu | Fault::OneWeight => Some("layer3"),
            Fault::ActivationInTheHead => Some("pose_1"),
            Fault::FourthRound => None,
        }
    }
}
