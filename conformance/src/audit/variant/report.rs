//! What two graphs differ by, as data: the terminal table, the JSON file and the page are views of it.
//!
//! Lengths are millimetres, pixels are those of a regressor's crop. A number that is not finite is absent.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// The name and version of [`DiffReport`]'s JSON form. A field may be added under the same version, never renamed or removed.
pub const SCHEMA: &str = "vitruvian.audit.diff/1";

/// The name and version of [`PlanReport`]'s JSON form.
pub const PLAN_SCHEMA: &str = "vitruvian.audit.plan/1";

/// Two graphs, or a graph and a dump, compared on the same inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DiffReport {
    /// [`SCHEMA`].
    pub schema: String,
    /// The graph that is right.
    pub base: Side,
    /// The graph that is compared with it.
    pub variant: Side,
    /// What counts as the truth: the base run by ONNX Runtime, or by the reference in f64.
    pub truth: String,
    /// Where the inputs came from.
    pub inputs: String,
    /// How many inputs were run.
    pub draws: usize,
    /// Which tensors were taken for the same.
    pub pairing: Pairing,
    /// What the outputs mean.
    pub geometry: Geometry,
    /// Every output's numbers.
    pub outputs: Vec<NumbersReport>,
    /// The whole difference in millimetres: [`Summary::of`](crate::audit::variant::geometry::summary) the distances; absent
    /// without a geometry, or where a distance is not finite.
    pub millimetres: Option<f64>,
    /// Which number of the distances that is.
    pub statistic: Statistic,
    /// What was allowed.
    pub budget_mm: Option<f64>,
    /// Whether the difference is within the budget; absent without one.
    pub pass: Option<bool>,
    /// Which nodes cost it.
    pub attribution: Option<Attribution>,
    /// The worst input's mesh, for a picture.
    pub view: Option<View>,
    /// What a reader should know beside the numbers.
    pub notes: Vec<String>,
    /// Seconds it took.
    pub seconds: f64,
}

/// One of the two that are compared.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Side {
    /// Its path as given.
    pub path: String,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
    /// Who computed its numbers.
    pub runtime: String,
    /// Nodes, 0 for a dump.
    pub nodes: usize,
}

/// Which tensors of the two were taken for the same.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Pairing {
    /// The inputs.
    pub inputs: Vec<Paired>,
    /// The outputs.
    pub outputs: Vec<Paired>,
}

/// A tensor of the base and the variant's that is the same.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Paired {
    /// Its name in the base.
    pub base: String,
    /// Its name in the variant.
    pub variant: String,
    /// Whether the names agree; otherwise they were paired by their order.
    pub by_name: bool,
    /// Element type in the base.
    pub base_element: String,
    /// Element type in the variant; inputs are rounded to it.
    pub variant_element: String,
}

/// Which number of many distances is held against a budget.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Statistic {
    /// Their mean.
    Mean,
    /// The one that a hundredth of them exceeds.
    P99,
    /// The largest.
    #[default]
    Max,
}

/// Many distances in a few numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Summary {
    /// How many there are.
    pub count: u64,
    /// Their mean.
    pub mean: f64,
    /// Their root mean square.
    pub rms: f64,
    /// The one that a hundredth of them exceeds.
    pub p99: f64,
    /// The largest.
    pub max: f64,
}

/// What the outputs mean, and what the difference is in those terms.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "lowercase")]
pub enum Geometry {
    /// Joints and vertices of bodies.
    Body(BodyReport),
    /// The surface of an implicit field.
    Field(FieldReport),
    /// Numbers without a geometry that is known.
    Numbers,
}

/// How far two bodies are apart, over all inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct BodyReport {
    /// Where vertices come from: the graph's own outputs, or a body posed by its pose and betas.
    pub body: String,
    /// Bodies compared.
    pub bodies: usize,
    /// Mean per-joint position error, millimetres, roots together; this and what follows is absent where a body is not finite.
    pub mpjpe: Option<f64>,
    /// The same after each body's similarity.
    pub pa_mpjpe: Option<f64>,
    /// Distances of the joints as they stand.
    pub joints: Option<Summary>,
    /// Distances of the vertices as they stand.
    pub vertices: Option<Summary>,
    /// The vertex that is farthest off.
    pub worst_vertex: Option<WorstVertex>,
    /// The joint that is farthest off.
    pub worst_joint: Option<WorstJoint>,
    /// Distances of the projected joints in pixels of the crop, for a graph that has a camera.
    pub reprojection_px: Option<Summary>,
    /// How far the camera's translation (t_x, t_y, 2f/(S s)) moves; a crop's long focal length makes its depth tens of metres.
    pub camera: Option<Summary>,
}

/// The vertex that is farthest off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WorstVertex {
    /// Its number.
    pub vertex: usize,
    /// Which body, counted over all inputs.
    pub body: usize,
    /// Where it is in the base, metres.
    pub at: [f64; 3],
    /// How far it moves.
    pub millimetres: f64,
    /// The joint that it follows most, where the skinning weights are known.
    pub joint: Option<String>,
}

/// The joint that is farthest off.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct WorstJoint {
    /// Its name, or its number where it has none.
    pub joint: String,
    /// Which body, counted over all inputs.
    pub body: usize,
    /// How far it moves.
    pub millimetres: f64,
}

/// How far the surfaces of two fields are apart, over all inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct FieldReport {
    /// How points were asked and what a unit is, in words.
    pub lattice: String,
    /// Points along each axis.
    pub shape: [usize; 3],
    /// Millimetres between neighbouring points.
    pub spacing: f64,
    /// The field's value at the surface, as the graph counts.
    pub level: f64,
    /// |Δf|/‖∇f‖ at the base's surface: the displacement to first order.
    pub displacement: Option<Summary>,
    /// Points of the base's surface where the field is flat, so that no displacement follows from it.
    pub flat: u64,
    /// From the vertices of each surface to the nearest point of the other.
    pub distance: Option<Summary>,
    /// The largest of them (of all inputs): Hausdorff's distance between the two, from vertices to triangles.
    pub hausdorff: Option<f64>,
    /// Half the sum of the mean distances there and back.
    pub chamfer: Option<f64>,
    /// Lattice points that change sides.
    pub flipped: u64,
    /// How far from the level the base is, at most, where points change sides; in the field's own units.
    pub flipped_margin: Option<f64>,
    /// Lattice points, over all inputs.
    pub points: u64,
    /// Points at which either field is not finite; they are taken as outside.
    pub not_finite: u64,
    /// The base's surface, one per input.
    pub base_topology: Vec<TopologyReport>,
    /// The variant's.
    pub variant_topology: Vec<TopologyReport>,
    /// Whether every number of the two topologies agrees.
    pub same_topology: bool,
}

/// What a marched surface is, apart from its shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct TopologyReport {
    /// Vertices.
    pub vertices: usize,
    /// Triangles.
    pub faces: usize,
    /// b₀: pieces.
    pub components: usize,
    /// χ = V − E + F.
    pub euler: i64,
    /// b₁ (over ℤ/2): twice the handles of a closed surface.
    pub betti_1: i64,
    /// b₂ (over ℤ/2): pieces that enclose a volume.
    pub betti_2: usize,
}

/// One output, number by number, over all inputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct NumbersReport {
    /// Its name in the base.
    pub name: String,
    /// The shape of the first input's.
    pub shape: Vec<usize>,
    /// Numbers compared.
    pub count: u64,
    /// Largest absolute difference.
    pub abs_max: Option<f64>,
    /// Root mean square difference.
    pub rms: Option<f64>,
    /// Root mean square difference relative to the base's root mean square.
    pub rel_rms: Option<f64>,
    /// −log₂ of the same: how many bits the two share. Absent where there is no difference.
    pub effective_bits: Option<f64>,
    /// Where the largest difference is, one index per axis, and in which input.
    pub worst: Vec<usize>,
    /// Which input.
    pub worst_draw: usize,
    /// The base's number there.
    pub expected: Option<f64>,
    /// The variant's.
    pub found: Option<f64>,
    /// NaN and infinite numbers of the base.
    pub not_finite_base: u64,
    /// NaN and infinite numbers of the variant.
    pub not_finite_variant: u64,
}

/// Which nodes cost the millimetres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Attribution {
    /// What was done, in words.
    pub method: String,
    /// What the numbers are: `mm` with the statistic, or relative where there is no geometry.
    pub unit: String,
    /// The whole difference, in that unit.
    pub whole: Option<f64>,
    /// The sum of the costs below: first-order, and of absolute values.
    pub sum: f64,
    /// The share of the whole displacement that all costs explain together: 1 where errors add up linearly.
    pub explained: f64,
    /// Pairs of tensors that were taken for the same.
    pub matched: Matched,
    /// One row for each node or group, the dearest first.
    pub costs: Vec<Cost>,
}

/// How the tensors of two graphs were found to be the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Matched {
    /// Tensors that nodes of the base make.
    pub base_tensors: usize,
    /// Of these matched by their names.
    pub by_name: usize,
    /// By operators and their place in the graph.
    pub by_structure: usize,
    /// By the numbers they hold.
    pub by_values: usize,
}

/// What one node or group of nodes costs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Cost {
    /// The last node of the base in it, or the first and the last.
    pub name: String,
    /// Its operators in order, such as `Conv, BatchNormalization, Relu`.
    pub operators: String,
    /// The nodes of the base that it consists of.
    pub base_nodes: Vec<String>,
    /// The variant's nodes that compute the same.
    pub variant_nodes: Vec<String>,
    /// The whole's measure when this alone is computed as the variant does, from the base's tensors, and the rest as the base.
    pub alone: Option<f64>,
    /// ⟨Δ_k, Δ⟩/⟨Δ, Δ⟩: the signed share of the whole displacement.
    pub share: f64,
    /// Root mean square of its own outputs' difference, relative to theirs.
    pub local: Option<f64>,
}

/// A mesh with an error at each vertex.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct View {
    /// What it shows, in words.
    pub title: String,
    /// Vertices of the base, metres.
    pub vertices: Vec<[f32; 3]>,
    /// Triangles.
    pub faces: Vec<[u32; 3]>,
    /// Millimetres at each vertex.
    pub millimetres: Vec<f32>,
}

/// Which nodes to keep in f32.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PlanReport {
    /// [`PLAN_SCHEMA`].
    pub schema: String,
    /// The graph.
    pub base: Side,
    /// Where the inputs came from.
    pub inputs: String,
    /// The precision that is planned for, `f16` or `int8`.
    pub to: String,
    /// How that precision was simulated, in words.
    pub simulation: String,
    /// What is allowed.
    pub budget_mm: f64,
    /// Which number of the distances.
    pub statistic: Statistic,
    /// Nodes that could be lowered.
    pub candidates: usize,
    /// The measure with all of them lowered.
    pub all_lowered: Option<f64>,
    /// Nodes to keep in f32: onnxconverter-common's `node_block_list`, ONNX Runtime's `nodes_to_exclude`.
    pub keep: Vec<String>,
    /// The measure with these kept, as verified by a run of the mixed graph.
    pub planned: Option<f64>,
    /// Whether that is within the budget.
    pub pass: bool,
    /// Every graph that was run, in order: how many nodes were kept and what came out.
    pub trials: Vec<Trial>,
    /// What the nodes cost when all are lowered.
    pub attribution: Attribution,
    /// Where the mixed graph was written.
    pub graph: Option<String>,
    /// What a reader should know beside the numbers.
    pub notes: Vec<String>,
    /// Seconds it took.
    pub seconds: f64,
}

/// One mixed graph that was run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Trial {
    /// Nodes kept in f32.
    pub kept: usize,
    /// The measure.
    pub millimetres: Option<f64>,
}
