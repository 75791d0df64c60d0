//! Every operator that the networks use, on random problems, with ONNX Runtime's optimisation off and on.

use std::cell::RefCell;
use std::fmt;

use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestCaseError, TestError, TestRng, TestRunner};

use crate::compare::{Comparison, compare};
use crate::engine::OPTIMIZATIONS;
use crate::problem::Problem;
use crate::problem::{
    axis, choice, convolution, elementwise, grid_sample, matrix_product, movement, normalization, pooling,
    resampling,
};

/// How many random problems, and which.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Draw {
    /// Problems per operator.
    pub cases: u32,
    /// Where the random numbers start; the same seed draws the same problems.
    pub seed: u64,
}

impl Draw {
    /// `VITRUVIAN_CASES` problems from `VITRUVIAN_SEED` on, where these variables are set; else `cases` and a fixed seed.
    ///
    /// # Panics
    /// When a variable is set to something that is not a number.
    pub fn from_environment(cases: u32) -> Self {
        fn number<T: std::str::FromStr>(name: &str, otherwise: T) -> T {
            match std::env::var(name) {
                Ok(text) => text.parse().unwrap_or_else(|_| panic!("{name}={text} is not a number")),
                Err(_) => otherwise,
            }
        }
        Self { cases: number("VITRUVIAN_CASES", cases), seed: number("VITRUVIAN_SEED", 20_210_615) }
    }

    /// A source of problems for one operator, independent of the others.
    pub(crate) fn runner(&self, operator: &str) -> TestRunner {
        let mut seed = [0; 32];
        seed[..8].copy_from_slice(&self.seed.to_le_bytes());
        for (i, byte) in operator.bytes().enumerate() {
            seed[8 + i % 24] ^= byte.rotate_left((i / 24) as u32);
        }
        let config = Config { cases: self.cases, failure_persistence: None, ..Config::default() };
        TestRunner::new_with_rng(config, TestRng::from_seed(RngAlgorithm::ChaCha, &seed))
    }
}

/// What came of one operator's problems.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tally {
    /// Problems judged, each with optimisation off and on.
    pub cases: usize,
    /// Elements compared.
    pub elements: usize,
    /// Tensors in which every element was f32(y) bit for bit.
    pub exact: usize,
    /// Tensors in which an element was unusually far, though within its bound (G2).
    pub unusual: usize,
    /// Largest difference in condition-scaled ulps.
    pub csu: f64,
    /// Largest share of the bound.
    pub share: f64,
}

impl Tally {
    fn add(&mut self, comparison: &Comparison) {
        if let Some(report) = comparison.report() {
            self.elements += report.elements;
            self.csu = self.csu.max(report.csu);
            self.share = self.share.max(report.share);
            match report.verdict {
                crate::certificate::Verdict::Exact => self.exact += 1,
                crate::certificate::Verdict::Unusual => self.unusual += 1,
                _ => (),
            }
        }
    }
}

/// A problem, shrunk, that runtime and reference answer differently, and how to meet it again.
#[derive(Clone, Debug, PartialEq)]
pub struct Disagreement {
    /// The judged operator, as in [`Judge::name`].
    pub judge: &'static str,
    /// What was found and the smallest problem that shows it.
    pub message: String,
    /// The draw that met it.
    pub draw: Draw,
}

impl fmt::Display for Disagreement {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: {}\nreplay with VITRUVIAN_SEED={} VITRUVIAN_CASES={}",
            self.judge, self.message, self.draw.seed, self.draw.cases
        )
    }
}

/// Draws problems and judges each with optimisation off and on.
///
/// # Errors
/// The first problem on which the two differ, shrunk.
pub fn judge(
    name: &'static str,
    strategy: &impl Strategy<Value = Problem>,
    draw: Draw,
) -> Result<Tally, Disagreement> {
    let tally = RefCell::new(Tally::default());
    let outcome = draw.runner(name).run(strategy, |problem| {
        let fail = |error: crate::error::Error| TestCaseError::fail(error.to_string());
        let expected = problem.expected().map_err(fail)?;
        for optimization in OPTIMIZATIONS {
            let found = problem.runtime(optimization).map_err(fail)?;
            let comparison = compare(&expected, &found);
            if !comparison.agrees() {
                return Err(TestCaseError::fail(format!("optimization {optimization:?}: {comparison}")));
            }
            tally.borrow_mut().add(&comparison);
        }
        tally.borrow_mut().cases += 1;
        Ok(())
    });
    match outcome {
        Ok(()) => Ok(tally.into_inner()),
        Err(TestError::Fail(why, problem)) => {
            Err(Disagreement { judge: name, message: format!("{why}\n{problem:?}"), draw })
        }
        Err(TestError::Abort(why)) => {
            Err(Disagreement { judge: name, message: format!("no problems could be drawn: {why}"), draw })
        }
    }
}

/// An operator that is judged.
#[derive(Clone, Copy)]
pub struct Judge {
    /// The operator and its variant, such as `Conv 2-D`.
    pub name: &'static str,
    /// ONNX's name of the operator.
    pub operator: &'static str,
    /// Draws problems and judges them.
    pub run: fn(&'static str, Draw) -> Result<Tally, Disagreement>,
}

impl Judge {
    /// Draws problems of this operator and judges them.
    ///
    /// # Errors
    /// The first disagreement.
    pub fn run(&self, draw: Draw) -> Result<Tally, Disagreement> {
        (self.run)(self.name, draw)
    }
}

/// Every operator that is judged. An operator that appears in an exported graph and not here fails the completeness test.
pub const JUDGES: &[Judge] = &[
    Judge { name: "Conv 1-D", operator: "Conv", run: |name, draw| judge(name, &convolution::conv(1), draw) },
    Judge { name: "Conv 2-D", operator: "Conv", run: |name, draw| judge(name, &convolution::conv(2), draw) },
    Judge { name: "Conv 3-D", operator: "Conv", run: |name, draw| judge(name, &convolution::conv(3), draw) },
    Judge {
        name: "ConvTranspose 2-D",
        operator: "ConvTranspose",
        run: |name, draw| judge(name, &convolution::conv_transpose(2), draw),
    },
    Judge {
        name: "ConvTranspose 3-D",
        operator: "ConvTranspose",
        run: |name, draw| judge(name, &convolution::conv_transpose(3), draw),
    },
    Judge { name: "Gemm", operator: "Gemm", run: |name, draw| judge(name, &matrix_product::gemm(), draw) },
    Judge {
        name: "MatMul",
        operator: "MatMul",
        run: |name, draw| judge(name, &matrix_product::matmul(), draw),
    },
    Judge {
        name: "GridSample 2-D",
        operator: "GridSample",
        run: |name, draw| judge(name, &grid_sample::grid_sample(2, "linear"), draw),
    },
    Judge {
        name: "GridSample 3-D",
        operator: "GridSample",
        run: |name, draw| judge(name, &grid_sample::grid_sample(3, "linear"), draw),
    },
    Judge {
        name: "BatchNormalization",
        operator: "BatchNormalization",
        run: |name, draw| judge(name, &normalization::batch_norm(), draw),
    },
    Judge {
        name: "GroupNormalization",
        operator: "GroupNormalization",
        run: |name, draw| judge(name, &normalization::group_norm(), draw),
    },
    Judge {
        name: "InstanceNormalization",
        operator: "InstanceNormalization",
        run: |name, draw| judge(name, &normalization::instance_norm(), draw),
    },
    Judge {
        name: "MaxPool 2-D",
        operator: "MaxPool",
        run: |name, draw| judge(name, &pooling::max_pool(2), draw),
    },
    Judge {
        name: "MaxPool 3-D",
        operator: "MaxPool",
        run: |name, draw| judge(name, &pooling::max_pool(3), draw),
    },
    Judge {
        name: "ReduceMean",
        operator: "ReduceMean",
        run: |name, draw| judge(name, &pooling::reduce("ReduceMean"), draw),
    },
    Judge { name: "Add", operator: "Add", run: |name, draw| judge(name, &elementwise::binary("Add"), draw) },
    Judge { name: "Sub", operator: "Sub", run: |name, draw| judge(name, &elementwise::binary("Sub"), draw) },
    Judge { name: "Mul", operator: "Mul", run: |name, draw| judge(name, &elementwise::binary("Mul"), draw) },
    Judge { name: "Div", operator: "Div", run: |name, draw| judge(name, &elementwise::binary("Div"), draw) },
    Judge {
        name: "Sqrt",
        operator: "Sqrt",
        run: |name, draw| judge(name, &elementwise::unary("Sqrt"), draw),
    },
    Judge {
        name: "Relu",
        operator: "Relu",
        run: |name, draw| judge(name, &elementwise::unary("Relu"), draw),
    },
    Judge {
        name: "LeakyRelu",
        operator: "LeakyRelu",
        run: |name, draw| judge(name, &elementwise::unary("LeakyRelu"), draw),
    },
    Judge {
        name: "Sigmoid",
        operator: "Sigmoid",
        run: |name, draw| judge(name, &elementwise::unary("Sigmoid"), draw),
    },
    Judge { name: "Concat", operator: "Concat", run: |name, draw| judge(name, &movement::concat(), draw) },
    Judge { name: "Reshape", operator: "Reshape", run: |name, draw| judge(name, &movement::reshape(), draw) },
    Judge {
        name: "Unsqueeze",
        operator: "Unsqueeze",
        run: |name, draw| judge(name, &movement::unsqueeze(), draw),
    },
    Judge {
        name: "Transpose",
        operator: "Transpose",
        run: |name, draw| judge(name, &movement::transpose(), draw),
    },
    Judge { name: "Gather", operator: "Gather", run: |name, draw| judge(name, &movement::gather(), draw) },
    Judge {
        name: "ReduceSum",
        operator: "ReduceSum",
        run: |name, draw| judge(name, &pooling::reduce("ReduceSum"), draw),
    },
    Judge {
        name: "ReduceL2",
        operator: "ReduceL2",
        run: |name, draw| judge(name, &pooling::reduce("ReduceL2"), draw),
    },
    Judge {
        name: "AveragePool",
        operator: "AveragePool",
        run: |name, draw| judge(name, &pooling::average_pool(), draw),
    },
    Judge {
        name: "GlobalAveragePool",
        operator: "GlobalAveragePool",
        run: |name, draw| judge(name, &pooling::global_pool("GlobalAveragePool"), draw),
    },
    Judge {
        name: "Einsum",
        operator: "Einsum",
        run: |name, draw| judge(name, &matrix_product::einsum(), draw),
    },
    Judge { name: "Max", operator: "Max", run: |name, draw| judge(name, &elementwise::binary("Max"), draw) },
    Judge { name: "Min", operator: "Min", run: |name, draw| judge(name, &elementwise::binary("Min"), draw) },
    Judge {
        name: "Tanh",
        operator: "Tanh",
        run: |name, draw| judge(name, &elementwise::unary("Tanh"), draw),
    },
    Judge {
        name: "Softplus",
        operator: "Softplus",
        run: |name, draw| judge(name, &elementwise::unary("Softplus"), draw),
    },
    Judge { name: "Neg", operator: "Neg", run: |name, draw| judge(name, &elementwise::unary("Neg"), draw) },
    Judge { name: "Abs", operator: "Abs", run: |name, draw| judge(name, &elementwise::unary("Abs"), draw) },
    Judge {
        name: "Reciprocal",
        operator: "Reciprocal",
        run: |name, draw| judge(name, &elementwise::unary("Reciprocal"), draw),
    },
    Judge {
        name: "Sin",
        operator: "Sin",
        run: |name, draw| judge(name, &elementwise::transcendental("Sin"), draw),
    },
    Judge {
        name: "Cos",
        operator: "Cos",
        run: |name, draw| judge(name, &elementwise::transcendental("Cos"), draw),
    },
    Judge {
        name: "Acos",
        operator: "Acos",
        run: |name, draw| judge(name, &elementwise::transcendental("Acos"), draw),
    },
    Judge {
        name: "Atan",
        operator: "Atan",
        run: |name, draw| judge(name, &elementwise::transcendental("Atan"), draw),
    },
    Judge {
        name: "Exp",
        operator: "Exp",
        run: |name, draw| judge(name, &elementwise::transcendental("Exp"), draw),
    },
    Judge {
        name: "Log",
        operator: "Log",
        run: |name, draw| judge(name, &elementwise::transcendental("Log"), draw),
    },
    Judge { name: "Clip", operator: "Clip", run: |name, draw| judge(name, &elementwise::clip(), draw) },
    Judge { name: "Pow", operator: "Pow", run: |name, draw| judge(name, &elementwise::pow(), draw) },
    Judge { name: "Expand", operator: "Expand", run: |name, draw| judge(name, &movement::expand(), draw) },
    Judge { name: "Tile", operator: "Tile", run: |name, draw| judge(name, &movement::tile(), draw) },
    Judge { name: "Slice", operator: "Slice", run: |name, draw| judge(name, &movement::slice(), draw) },
    Judge { name: "Split", operator: "Split", run: |name, draw| judge(name, &movement::split(), draw) },
    Judge { name: "Squeeze", operator: "Squeeze", run: |name, draw| judge(name, &movement::squeeze(), draw) },
    Judge { name: "Flatten", operator: "Flatten", run: |name, draw| judge(name, &movement::flatten(), draw) },
    Judge { name: "Shape", operator: "Shape", run: |name, draw| judge(name, &movement::shape(), draw) },
    Judge {
        name: "Less",
        operator: "Less",
        run: |name, draw| judge(name, &choice::comparison("Less"), draw),
    },
    Judge {
        name: "Greater",
        operator: "Greater",
        run: |name, draw| judge(name, &choice::comparison("Greater"), draw),
    },
    Judge {
        name: "Equal",
        operator: "Equal",
        run: |name, draw| judge(name, &choice::comparison("Equal"), draw),
    },
    Judge { name: "IsNaN", operator: "IsNaN", run: |name, draw| judge(name, &choice::is_nan(), draw) },
    Judge { name: "Where", operator: "Where", run: |name, draw| judge(name, &choice::choice(), draw) },
    Judge {
        name: "ScatterND",
        operator: "ScatterND",
        run: |name, draw| judge(name, &choice::scatter_nd(), draw),
    },
    Judge {
        name: "ScatterElements",
        operator: "ScatterElements",
        run: |name, draw| judge(name, &choice::scatter_elements(), draw),
    },
    Judge {
        name: "Celu",
        operator: "Celu",
        run: |name, draw| judge(name, &elementwise::activation("Celu"), draw),
    },
    Judge {
        name: "Ceil",
        operator: "Ceil",
        run: |name, draw| judge(name, &elementwise::activation("Ceil"), draw),
    },
    Judge {
        name: "Elu",
        operator: "Elu",
        run: |name, draw| judge(name, &elementwise::activation("Elu"), draw),
    },
    Judge {
        name: "Erf",
        operator: "Erf",
        run: |name, draw| judge(name, &elementwise::activation("Erf"), draw),
    },
    Judge {
        name: "Floor",
        operator: "Floor",
        run: |name, draw| judge(name, &elementwise::activation("Floor"), draw),
    },
    Judge {
        name: "Gelu",
        operator: "Gelu",
        run: |name, draw| judge(name, &elementwise::activation("Gelu"), draw),
    },
    Judge {
        name: "HardSigmoid",
        operator: "HardSigmoid",
        run: |name, draw| judge(name, &elementwise::activation("HardSigmoid"), draw),
    },
    Judge {
        name: "HardSwish",
        operator: "HardSwish",
        run: |name, draw| judge(name, &elementwise::activation("HardSwish"), draw),
    },
    Judge {
        name: "Mish",
        operator: "Mish",
        run: |name, draw| judge(name, &elementwise::activation("Mish"), draw),
    },
    Judge {
        name: "Round",
        operator: "Round",
        run: |name, draw| judge(name, &elementwise::activation("Round"), draw),
    },
    Judge {
        name: "Selu",
        operator: "Selu",
        run: |name, draw| judge(name, &elementwise::activation("Selu"), draw),
    },
    Judge {
        name: "Shrink",
        operator: "Shrink",
        run: |name, draw| judge(name, &elementwise::activation("Shrink"), draw),
    },
    Judge {
        name: "Sign",
        operator: "Sign",
        run: |name, draw| judge(name, &elementwise::activation("Sign"), draw),
    },
    Judge {
        name: "Softsign",
        operator: "Softsign",
        run: |name, draw| judge(name, &elementwise::activation("Softsign"), draw),
    },
    Judge {
        name: "ThresholdedRelu",
        operator: "ThresholdedRelu",
        run: |name, draw| judge(name, &elementwise::activation("ThresholdedRelu"), draw),
    },
    Judge { name: "PRelu", operator: "PRelu", run: |name, draw| judge(name, &elementwise::prelu(), draw) },
    Judge {
        name: "Pow with exponents",
        operator: "Pow",
        run: |name, draw| judge(name, &elementwise::powers(), draw),
    },
    Judge { name: "Mod", operator: "Mod", run: |name, draw| judge(name, &elementwise::modulo(), draw) },
    Judge {
        name: "Tan",
        operator: "Tan",
        run: |name, draw| judge(name, &elementwise::transcendental("Tan"), draw),
    },
    Judge {
        name: "Asin",
        operator: "Asin",
        run: |name, draw| judge(name, &elementwise::transcendental("Asin"), draw),
    },
    Judge {
        name: "Sinh",
        operator: "Sinh",
        run: |name, draw| judge(name, &elementwise::transcendental("Sinh"), draw),
    },
    Judge {
        name: "Cosh",
        operator: "Cosh",
        run: |name, draw| judge(name, &elementwise::transcendental("Cosh"), draw),
    },
    Judge {
        name: "Asinh",
        operator: "Asinh",
        run: |name, draw| judge(name, &elementwise::transcendental("Asinh"), draw),
    },
    Judge {
        name: "Acosh",
        operator: "Acosh",
        run: |name, draw| judge(name, &elementwise::transcendental("Acosh"), draw),
    },
    Judge {
        name: "Atanh",
        operator: "Atanh",
        run: |name, draw| judge(name, &elementwise::transcendental("Atanh"), draw),
    },
    Judge {
        name: "Softmax",
        operator: "Softmax",
        run: |name, draw| judge(name, &axis::softmax("Softmax"), draw),
    },
    Judge {
        name: "LogSoftmax",
        operator: "LogSoftmax",
        run: |name, draw| judge(name, &axis::softmax("LogSoftmax"), draw),
    },
    Judge {
        name: "Hardmax",
        operator: "Hardmax",
        run: |name, draw| judge(name, &axis::softmax("Hardmax"), draw),
    },
    Judge { name: "ArgMax", operator: "ArgMax", run: |name, draw| judge(name, &axis::place("ArgMax"), draw) },
    Judge { name: "ArgMin", operator: "ArgMin", run: |name, draw| judge(name, &axis::place("ArgMin"), draw) },
    Judge {
        name: "CumSum",
        operator: "CumSum",
        run: |name, draw| judge(name, &axis::cumulative_sum(), draw),
    },
    Judge {
        name: "ReduceMax",
        operator: "ReduceMax",
        run: |name, draw| judge(name, &pooling::reduce("ReduceMax"), draw),
    },
    Judge {
        name: "ReduceMin",
        operator: "ReduceMin",
        run: |name, draw| judge(name, &pooling::reduce("ReduceMin"), draw),
    },
    Judge {
        name: "ReduceProd",
        operator: "ReduceProd",
        run: |name, draw| judge(name, &pooling::reduce("ReduceProd"), draw),
    },
    Judge {
        name: "ReduceL1",
        operator: "ReduceL1",
        run: |name, draw| judge(name, &pooling::reduce("ReduceL1"), draw),
    },
    Judge {
        name: "ReduceSumSquare",
        operator: "ReduceSumSquare",
        run: |name, draw| judge(name, &pooling::reduce("ReduceSumSquare"), draw),
    },
    Judge {
        name: "ReduceLogSum",
        operator: "ReduceLogSum",
        run: |name, draw| judge(name, &pooling::reduce("ReduceLogSum"), draw),
    },
    Judge {
        name: "ReduceLogSumExp",
        operator: "ReduceLogSumExp",
        run: |name, draw| judge(name, &pooling::reduce("ReduceLogSumExp"), draw),
    },
    Judge {
        name: "LayerNormalization",
        operator: "LayerNormalization",
        run: |name, draw| judge(name, &normalization::layer_norm(), draw),
    },
    Judge {
        name: "LpNormalization",
        operator: "LpNormalization",
        run: |name, draw| judge(name, &normalization::lp_norm(), draw),
    },
    Judge {
        name: "GridSample 2-D nearest",
        operator: "GridSample",
        run: |name, draw| judge(name, &grid_sample::grid_sample(2, "nearest"), draw),
    },
    Judge {
        name: "GridSample 3-D nearest",
        operator: "GridSample",
        run: |name, draw| judge(name, &grid_sample::grid_sample(3, "nearest"), draw),
    },
    Judge {
        name: "GridSample 2-D cubic",
        operator: "GridSample",
        run: |name, draw| judge(name, &grid_sample::grid_sample(2, "cubic"), draw),
    },
    Judge {
        name: "Resize 1-D nearest",
        operator: "Resize",
        run: |name, draw| judge(name, &resampling::resize(1, "nearest"), draw),
    },
    Judge {
        name: "Resize 1-D linear",
        operator: "Resize",
        run: |name, draw| judge(name, &resampling::resize(1, "linear"), draw),
    },
    Judge {
        name: "Resize 2-D nearest",
        operator: "Resize",
        run: |name, draw| judge(name, &resampling::resize(2, "nearest"), draw),
    },
    Judge {
        name: "Resize 2-D linear",
        operator: "Resize",
        run: |name, draw| judge(name, &resampling::resize(2, "linear"), draw),
    },
    Judge {
        name: "Resize 3-D nearest",
        operator: "Resize",
        run: |name, draw| judge(name, &resampling::resize(3, "nearest"), draw),
    },
    Judge {
        name: "Resize 3-D linear",
        operator: "Resize",
        run: |name, draw| judge(name, &resampling::resize(3, "linear"), draw),
    },
    Judge {
        name: "Resize 2-D cubic",
        operator: "Resize",
        run: |name, draw| judge(name, &resampling::resize(2, "cubic"), draw),
    },
    Judge {
        name: "MaxPool 2-D with dilation",
        operator: "MaxPool",
        run: |name, draw| judge(name, &pooling::dilated_pool("MaxPool", 2), draw),
    },
    Judge {
        name: "MaxPool 3-D with dilation",
        operator: "MaxPool",
        run: |name, draw| judge(name, &pooling::dilated_pool("MaxPool", 3), draw),
    },
    Judge {
        name: "AveragePool 2-D with dilation",
        operator: "AveragePool",
        run: |name, draw| judge(name, &pooling::dilated_pool("AveragePool", 2), draw),
    },
    Judge {
        name: "AveragePool 3-D with dilation",
        operator: "AveragePool",
        run: |name, draw| judge(name, &pooling::dilated_pool("AveragePool", 3), draw),
    },
    Judge {
        name: "LpPool 2-D with dilation",
        operator: "LpPool",
        run: |name, draw| judge(name, &pooling::dilated_pool("LpPool", 2), draw),
    },
    Judge {
        name: "LpPool 3-D with dilation",
        operator: "LpPool",
        run: |name, draw| judge(name, &pooling::dilated_pool("LpPool", 3), draw),
    },
    Judge {
        name: "GlobalMaxPool",
        operator: "GlobalMaxPool",
        run: |name, draw| judge(name, &pooling::global_pool("GlobalMaxPool"), draw),
    },
    Judge {
        name: "GlobalLpPool",
        operator: "GlobalLpPool",
        run: |name, draw| judge(name, &pooling::global_pool("GlobalLpPool"), draw),
    },
    Judge { name: "Pad", operator: "Pad", run: |name, draw| judge(name, &resampling::pad(), draw) },
    Judge {
        name: "DepthToSpace",
        operator: "DepthToSpace",
        run: |name, draw| judge(name, &resampling::depth_to_space(), draw),
    },
    Judge {
        name: "LRN",
        operator: "LRN",
        run: |name, draw| judge(name, &resampling::local_response(), draw),
    },
    Judge {
        name: "Conv with auto_pad",
        operator: "Conv",
        run: |name, draw| judge(name, &resampling::same_convolution(), draw),
    },
];
