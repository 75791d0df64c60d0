//! What an audit found, as data: the terminal table, the JSON file, JUnit and the page are views of it.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::certificate::Verdict;

/// The name and version of the JSON form. A field may be added under the same version, never renamed or removed.
pub const SCHEMA: &str = "vitruvian.audit/1";

/// The name and version of a passes report's JSON.
pub const PASSES_SCHEMA: &str = "vitruvian.audit.passes/1";

/// A verdict, or that there is none: what was not compared is never called right.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize, JsonSchema)]
pub enum Grade {
    /// Bit-identical to the reference, rounded to the tensor's precision.
    G0,
    /// Ordinary rounding.
    G1,
    /// Within the proven bound, but more than random roundings make, or biased.
    G2,
    /// More than any order of roundings can make.
    G3,
    /// Not compared, or not wholly: an unknown operator, a missing tensor.
    #[serde(rename = "not-comparable")]
    NotComparable,
}

impl From<Verdict> for Grade {
    fn from(verdict: Verdict) -> Self {
        match verdict {
            Verdict::Exact => Self::G0,
            Verdict::Rounding => Self::G1,
            Verdict::Unusual => Self::G2,
            Verdict::Different => Self::G3,
        }
    }
}

impl fmt::Display for Grade {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::G0 => "G0",
            Self::G1 => "G1",
            Self::G2 => "G2",
            Self::G3 => "G3",
            Self::NotComparable => "not-comparable",
        })
    }
}

/// A whole audit. The verdict is the worst node's: G3 before not-comparable before G2.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Audit {
    /// [`SCHEMA`].
    pub schema: String,
    /// The answer.
    pub verdict: Grade,
    /// What was audited.
    pub graph: GraphSummary,
    /// Who computed the numbers that were judged, such as `ONNX Runtime 1.32.0, optimisation off` or `npz:dump.npz`.
    pub runtime: String,
    /// Where the inputs came from: a file, or a seed and what was drawn.
    pub inputs: String,
    /// The first node, in topological order, outside rounding.
    pub first_outside: Option<Outside>,
    /// Every node of the graph, in topological order.
    pub nodes: Vec<NodeReport>,
    /// How much was compared.
    pub coverage: Coverage,
    /// The graph's outputs, end to end.
    pub outputs: Vec<OutputReport>,
    /// The session as shipped, against the same reference; absent where the second party is a dump.
    pub shipped: Option<ShippedReport>,
    /// What a reader should know beside the numbers.
    pub notes: Vec<String>,
    /// Seconds it took.
    pub seconds: f64,
}

/// The file that was audited.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct GraphSummary {
    /// Its path as given.
    pub path: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
    /// Version of ONNX's own operators.
    pub opset: i64,
    /// The program that wrote it.
    pub producer: String,
    /// Names of its inputs.
    pub inputs: Vec<String>,
}

/// The first node outside rounding, with all that helps to find the cause.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Outside {
    /// The node's name as in [`NodeReport::name`].
    pub node: String,
    /// Its operator.
    pub op: String,
    /// The tensors that it makes.
    pub outputs: Vec<String>,
    /// The mistake that explains the numbers, if one of those that are tried does.
    pub hypothesis: Option<Hypothesis>,
    /// The worst elements, with what they were computed from.
    pub worst: Vec<WorstElement>,
    /// Where the one-node reproduction was written.
    pub reproduction: Option<String>,
}

/// A mistake that turns the specified meaning into the numbers that were found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Hypothesis {
    /// A stable name in lower case, such as `align_corners`, `epsilon`, `f16-inputs`.
    pub name: String,
    /// One sentence with the values: `align_corners is 1 in the graph; 0 explains the numbers`.
    pub detail: String,
    /// The largest difference left under this mistake, in csu.
    pub csu: f64,
}

/// One element that differs, and what it was computed from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WorstElement {
    /// The tensor.
    pub tensor: String,
    /// Its place, one index per axis.
    pub index: Vec<usize>,
    /// The reference's value; absent when it is not finite.
    pub expected: Option<f64>,
    /// The second party's; absent when it is not finite.
    pub found: Option<f64>,
    /// The difference in condition-scaled ulps; absent when it is not finite.
    pub csu: Option<f64>,
    /// The part of each operand that the element is computed from, as text: `X[0, 0:64, 3:6, 7:10]`.
    pub receptive_field: Vec<String>,
}

/// One node of the graph.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NodeReport {
    /// Its place in topological order, from 0.
    pub index: usize,
    /// The node's name; `OPERATOR_INDEX` where the file gives none.
    pub name: String,
    /// The operator, with its domain where that is not ONNX's own.
    pub op: String,
    /// The worst of its tensors' verdicts.
    pub verdict: Grade,
    /// Why it could not be compared.
    pub why: Option<String>,
    /// Its attributes as text, in the file's order.
    pub attributes: Vec<(String, String)>,
    /// Names of the tensors that it reads, "" where one is left out.
    pub inputs: Vec<String>,
    /// Names of the tensors that it makes.
    pub outputs: Vec<String>,
    /// One report per output that was compared.
    pub tensors: Vec<TensorReport>,
    /// Where the exporter says the node comes from: `model.py:37`, its line and the module's path.
    pub source: Option<Source>,
    /// Seconds that the reference took.
    pub seconds: f64,
}

/// Where a node was written.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Source {
    /// Path of the Python file, as the exporter wrote it.
    pub file: String,
    /// Line, from 1.
    pub line: usize,
    /// The line's text, where the exporter left it.
    pub code: String,
    /// The module's path, such as `encoder.stack.0.conv1`.
    pub module: String,
}

/// One tensor that a node made, compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct TensorReport {
    /// Its name.
    pub name: String,
    /// Its element type, such as `f32`.
    pub element: String,
    /// Its shape.
    pub shape: Vec<usize>,
    /// Its verdict.
    pub verdict: Grade,
    /// Elements it has.
    pub elements: u64,
    /// Elements that were compared; fewer than it has when a stated sample was taken.
    pub compared: u64,
    /// How the sample was drawn, with what it could have missed; absent when all were compared.
    pub sample: Option<String>,
    /// Roundings on the longest path to an element: the largest over the elements.
    pub n_eff: f64,
    /// Largest difference in csu; absent when it is not finite, as where a shape or a NaN differs.
    pub csu_max: Option<f64>,
    /// 99.9th percentile of the differences in csu.
    pub csu_p999: Option<f64>,
    /// Root mean square of the differences in csu.
    pub csu_rms: Option<f64>,
    /// Largest absolute difference.
    pub abs_max: Option<f64>,
    /// Largest difference relative to the reference's value.
    pub rel_max: Option<f64>,
    /// Largest difference in units in the last place of the tensor's precision.
    pub ulp_max: Option<f64>,
    /// The element with the largest share of its bound.
    pub worst: Option<WorstElement>,
    /// A factor common to the differences, less one; absent when too few elements show one.
    pub slope: Option<f64>,
    /// The slope in units of its standard deviation.
    pub slope_z: Option<f64>,
    /// The mean difference in units of its standard deviation.
    pub mean_z: Option<f64>,
    /// −log₂ of the root mean square difference relative to the magnitudes; absent where there is no difference.
    pub effective_bits: Option<f64>,
    /// Differences counted in decades of csu: below 10⁻³, 10⁻³..10⁻², …, 10⁵ and above (10 counts).
    pub histogram: Vec<u64>,
    /// NaN, infinite and subnormal numbers.
    pub special: Special,
    /// Elements that depend on a decision closer than the rounding: either outcome was accepted.
    pub undecidable: u64,
    /// Largest absolute difference from the reference's own chain, computed from the graph's inputs; where it was made.
    pub cumulative: Option<f64>,
    /// The part of it that came in with the operands: cumulative less local, root mean square.
    pub propagated: Option<f64>,
    /// Norm of the difference that went out over the norm of the difference that came in.
    pub amplification: Option<f64>,
}

/// Numbers that are not ordinary, on both sides.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Special {
    /// NaN in the second party's tensor.
    pub nan_found: u64,
    /// NaN by the reference.
    pub nan_expected: u64,
    /// Infinities in the second party's tensor.
    pub inf_found: u64,
    /// Infinities by the reference.
    pub inf_expected: u64,
    /// Subnormal numbers in the second party's tensor.
    pub subnormal_found: u64,
    /// Subnormal numbers by the reference, in the tensor's precision.
    pub subnormal_expected: u64,
    /// Zeros in the second party's tensor for numbers too small to be normal, accepted.
    #[serde(default)]
    pub flushed: u64,
}

/// How much of the graph was compared.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Coverage {
    /// Nodes of the graph.
    pub nodes: usize,
    /// Nodes of which every output was compared.
    pub compared: usize,
    /// Elements that the nodes make.
    pub elements: u64,
    /// Elements that were compared.
    pub elements_compared: u64,
    /// What kept nodes from being compared, and how many.
    pub unsupported: Vec<Unsupported>,
    /// Tensors of the graph that the second party does not have.
    pub missing: Vec<String>,
    /// Tensors of the second party that the graph does not have.
    pub unmatched: Vec<String>,
}

/// One reason for not comparing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Unsupported {
    /// The operator.
    pub op: String,
    /// What is not understood.
    pub why: String,
    /// How many nodes.
    pub count: usize,
}

/// One output of the graph, end to end.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct OutputReport {
    /// Its name.
    pub name: String,
    /// Largest absolute difference from the reference's own chain; absent where the chain was not computed.
    pub cumulative: Option<f64>,
    /// The same, root mean square.
    pub cumulative_rms: Option<f64>,
    /// Root mean square by which the output moves when the reference's roundings are drawn at random in the tensors'
    /// precisions; absent where the chain was not computed.
    pub noise_floor: Option<f64>,
}

/// The session as shipped: optimised, with no tensor asked for but the outputs and those that survive.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShippedReport {
    /// The optimisation level.
    pub level: String,
    /// The worst of the tensors that could be compared.
    pub verdict: Grade,
    /// Nodes before and after optimisation.
    pub nodes: (usize, usize),
    /// The tensors that survive, and the outputs.
    pub tensors: Vec<ShippedTensor>,
    /// Operators of the optimised graph that are not ONNX's own.
    #[serde(default)]
    pub operators: Vec<ForeignOperator>,
    /// What a reader should know beside the numbers.
    #[serde(default)]
    pub notes: Vec<String>,
}

/// An operator that an optimiser put in, in ONNX's words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ForeignOperator {
    /// Its domain and name.
    pub op: String,
    /// How many nodes.
    pub count: usize,
    /// What it stands for; absent where that is not known.
    pub meaning: Option<String>,
}

/// One tensor of the shipped session.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ShippedTensor {
    /// Its name.
    pub name: String,
    /// Whether it is bit-identical to the session without optimisation.
    pub identical: bool,
    /// Its largest absolute difference from the session without optimisation.
    pub abs_max: Option<f64>,
    /// Its verdict against the reference, from the last tensors before it that survive.
    pub verdict: Grade,
    /// The lowest optimisation level at which it changes.
    pub changed_at: Option<String>,
    /// Why there is no verdict.
    #[serde(default)]
    pub why: Option<String>,
}

/// Which optimisers change a graph's outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PassesReport {
    /// [`PASSES_SCHEMA`].
    pub schema: String,
    /// The optimisation level.
    pub level: String,
    /// Outputs that differ from those of the session without optimisation.
    pub changed: Vec<ChangedOutput>,
    /// Optimisers that change an output by themselves, or that do so only together.
    pub passes: Vec<PassReport>,
    /// Sessions that it took.
    pub sessions: usize,
    /// What a reader should know beside the numbers.
    pub notes: Vec<String>,
}

/// One optimiser that changes outputs, or several that do so only together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PassReport {
    /// Their names in ONNX Runtime.
    pub names: Vec<String>,
    /// What they change, compared with the session without optimisation.
    pub outputs: Vec<ChangedOutput>,
}

/// An output that is not bit-identical.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ChangedOutput {
    /// Its name.
    pub name: String,
    /// Its largest absolute difference; absent when it is not finite, as where a shape or a NaN differs.
    pub abs_max: Option<f64>,
}
