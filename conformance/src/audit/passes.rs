//! Which optimiser changes a graph's outputs.
//!
//! ONNX Runtime takes a list of optimisers to leave out. With all of them left out the outputs are those of the session without
//! optimisation; with only some of them at work, a half that changes nothing is passed over and one that changes something is
//! halved again, until single optimisers are left, or several that change something only together.

use std::collections::BTreeMap;

use vitruvian_runtime::session::{Optimization, Rewriting, Session, Settings};

use super::report::{ChangedOutput, PASSES_SCHEMA, PassReport, PassesReport};
use super::shipped::{Inputs, largest_difference};
use crate::error::Result;
use crate::onnx::model::Model;
use crate::onnx::typed_tensor::TypedTensor;

/// The optimisers of ONNX Runtime 1.32's CPU sessions; a name that a release does not know does nothing.
pub const OPTIMIZERS: [&str; 79] = [
    "AttentionFusion",
    "Avx2WeightS8ToU8Transformer",
    "BiasDropoutFusion",
    "BiasGeluFusion",
    "BiasSkipLayerNormFusion",
    "BiasSoftmaxFusion",
    "CastChainElimination",
    "CastElimination",
    "ClipQuantRewrite",
    "CommonSubexpressionElimination",
    "ConstantFolding",
    "ConstantFoldingDQ",
    "ConstantSharing",
    "ConvActivationFusion",
    "ConvAddActivationFusion",
    "ConvAddFusion",
    "ConvBNFusion",
    "ConvMulFusion",
    "DQMatMulNBitsFusion",
    "DivMulFusion",
    "DoubleQDQPairsRemover",
    "DynamicQuantizeMatMulFusion",
    "EliminateDropout",
    "EliminateIdentity",
    "EliminateSlice",
    "EmbedLayerNormFusion",
    "EnsureUniqueDQForNodeUnit",
    "ExpandElimination",
    "FastGeluFusion",
    "FuseReluClip",
    "GatherSliceToSplitFusion",
    "GatherToSliceFusion",
    "GatherToSplitFusion",
    "GeluFusion",
    "GeluFusionL1",
    "GeluFusionL2",
    "GemmActivationFusion",
    "GemmSumFusion",
    "GemmTransposeFusion",
    "GqaValueLayoutTransformer",
    "GroupQueryAttentionFusion",
    "GroupQueryAttentionPreNormFusion",
    "LabelEncoderFusion",
    "LayerNormFusion",
    "LayerNormFusionL1",
    "LayerNormFusionL2",
    "MatMulActivationFusion",
    "MatMulAddFusion",
    "MatMulIntegerToFloatFusion",
    "MatMulNBitsFusion",
    "MatMulNBitsMlpFusion",
    "MatMulNBitsQLoRAFusion",
    "MatMulNBitsQkvFusion",
    "MatMulScaleFusion",
    "MatMul_BatchNormalization_Fusion",
    "MatmulTransposeFusion",
    "NchwcTransformer",
    "NhwcTransformer",
    "NoopElimination",
    "NotWhereFusion",
    "Pad_Fusion",
    "PreShapeNodeElimination",
    "QDQFinalCleanupTransformer",
    "QDQPropagationTransformer",
    "QDQS8ToU8Transformer",
    "QDQSelectorActionTransformer",
    "QuickGeluFusion",
    "ReluQuantRewrite",
    "RemoveDuplicateCastTransformer",
    "ReshapeFusion",
    "SimplifiedLayerNormFusion",
    "SkipLayerNormFusion",
    "SliceConcatToSpaceToDepthFusion",
    "SwiGluFusion",
    "TransposeOptimizer",
    "TransposeOptimizer_CPUExecutionProvider",
    "UnsqueezeElimination",
    "WeightBiasQuantization",
    "WhereDummyDq",
];

/// Finds the optimisers that change an output.
///
/// # Errors
/// When ONNX Runtime is missing, or refuses the graph or the inputs.
pub fn passes(model: &Model, inputs: &BTreeMap<String, TypedTensor>, threads: usize) -> Result<PassesReport> {
    let embedded = model.embedded()?;
    let inputs = Inputs::new(inputs)?;
    let mut search =
        Search { model: embedded.as_ref(), inputs: &inputs, threads, sessions: 0, plain: Vec::new() };
    search.plain = search.run(Optimization::Disabled, &[])?;
    let changed = search.changed(&OPTIMIZERS)?;
    let mut notes = Vec::new();
    let mut passes = Vec::new();
    let unlisted = search.changed(&[])?;
    if !unlisted.is_empty() {
        notes.push(
            "the outputs change even with all listed optimisers left out: one that is not listed, or the kernels \
             that a level allows, does it"
                .into(),
        );
    } else if !changed.is_empty() {
        for names in search.culprits(&OPTIMIZERS)? {
            let outputs = search.changed(&names)?;
            passes.push(PassReport { names: names.into_iter().map(str::to_owned).collect(), outputs });
        }
    }
    Ok(PassesReport {
        schema: PASSES_SCHEMA.to_owned(),
        level: "all".into(),
        changed,
        passes,
        sessions: search.sessions,
        notes,
    })
}

struct Search<'a> {
    model: &'a Model,
    inputs: &'a Inputs,
    threads: usize,
    sessions: usize,
    /// The outputs without optimisation.
    plain: Vec<(String, TypedTensor)>,
}

impl Search<'_> {
    fn run(&mut self, optimization: Optimization, without: &[&str]) -> Result<Vec<(String, TypedTensor)>> {
        self.sessions += 1;
        let settings = Settings { optimization, threads: self.threads };
        let rewriting = Rewriting { without, saved: None };
        let mut session = Session::rewritten(self.model.name(), self.model.bytes(), &settings, rewriting)?;
        let names: Vec<String> = session.outputs().iter().map(|output| output.name.clone()).collect();
        let found = self.inputs.run(&mut session, &names.iter().map(String::as_str).collect::<Vec<_>>())?;
        Ok(names.into_iter().zip(found).collect())
    }

    /// The outputs that change where these optimisers alone are at work.
    fn changed(&mut self, optimizers: &[&str]) -> Result<Vec<ChangedOutput>> {
        let without: Vec<&str> =
            OPTIMIZERS.iter().copied().filter(|name| !optimizers.contains(name)).collect();
        let found = self.run(Optimization::All, &without)?;
        let outputs = self.plain.iter().zip(&found).filter(|((_, before), (_, after))| {
            before.shape != after.shape || before.elements.to_bytes() != after.elements.to_bytes()
        });
        let output = |((name, before), (_, after)): (&(String, TypedTensor), &(String, TypedTensor))| {
            ChangedOutput { name: name.clone(), abs_max: largest_difference(before, after) }
        };
        Ok(outputs.map(output).collect())
    }

    /// The optimisers among these that change an output: each alone, or several together.
    ///
    /// The whole is known to change one.
    fn culprits(&mut self, optimizers: &[&'static str]) -> Result<Vec<Vec<&'static str>>> {
        if optimizers.len() == 1 {
            return Ok(vec![optimizers.to_vec()]);
        }
        let mut found = Vec::new();
        let (first, second) = optimizers.split_at(optimizers.len() / 2);
        for half in [first, second] {
            if !self.changed(half)?.is_empty() {
                found.extend(self.culprits(half)?);
            }
        }
        if found.is_empty() {
            found.push(self.together(optimizers)?);
        }
        Ok(found)
    }

    /// As few of these optimisers as change something together: each is left out unless nothing changes without it.
    fn together(&mut self, optimizers: &[&'static str]) -> Result<Vec<&'static str>> {
        let mut needed = optimizers.to_vec();
        for &name in optimizers {
            let rest: Vec<&'static str> = needed.iter().copied().filter(|other| *other != name).collect();
            if !self.changed(&rest)?.is_empty() {
                needed = rest;
            }
        }
        Ok(needed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::builder::{GraphBuilder, ints};
    use crate::onnx::typed_tensor::Elements;
    use crate::problem::values::Values;

    #[test]
    fn the_optimiser_that_blocks_channels_is_named() {
        let w = Values::ordinary(1).fill(&[32, 32, 3, 3]);
        let bytes = GraphBuilder::new(17)
            .input("x", &[1, 32, 9, 9])
            .constant("w", &[32, 32, 3, 3], &w.values)
            .node("Conv", &["x", "w"], &["c"], vec![ints("pads", &[1, 1, 1, 1])])
            .node("Relu", &["c"], &["r"], vec![])
            .node("Neg", &["r"], &["y"], vec![])
            .output("y")
            .to_bytes();
        let model = Model::from_bytes("conv.onnx", bytes).expect("a model");
        let x = Values::ordinary(2).fill(&[1, 32, 9, 9]);
        let x = TypedTensor::new(&x.shape, Elements::F32(x.values)).expect("a tensor");
        let report = passes(&model, &BTreeMap::from([("x".to_owned(), x)]), 1).expect("a report");
        // Where the processor's kernels for blocks sum in the same order, nothing changes and nobody is named.
        assert_eq!(report.changed.is_empty(), report.passes.is_empty(), "{report:?}");
        for pass in &report.passes {
            assert!(pass.names.contains(&"NchwcTransformer".to_owned()), "{report:?}");
            assert_eq!(pass.outputs[0].name, "y", "{report:?}");
        }
    }

    #[test]
    fn a_graph_that_no_optimiser_changes_has_no_culprit() {
        let bytes = GraphBuilder::new(17).input("x", &[3]).node("Neg", &["x"], &["y"], vec![]).output("y");
        let model = Model::from_bytes("neg.onnx", bytes.to_bytes()).expect("a model");
        let x = TypedTensor::new(&[3], Elements::F32(vec![1.0, 2.0, 3.0])).expect("a tensor");
        let report = passes(&model, &BTreeMap::from([("x".to_owned(), x)]), 1).expect("a report");
        assert!(
            report.changed.is_empty() && report.passes.is_empty() && report.notes.is_empty(),
            "{report:?}"
        );
    }
}
