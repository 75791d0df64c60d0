//! The regressor: its stages inside any export of it, a graph of it built here, and faults planted in that graph.
//!
//! An export names its inner tensors as it likes, but ResNet-50 and its head have one order: the layers end at the 3rd,
//! 7th, 13th and 16th addition, and the corrections of pose, betas and camera are the additions after the mean over the
//! pixels, three a round. [`stages`] finds them so.

use crate::error::{Error, Result};
use crate::onnx::message::NodeProto;
use crate::onnx::model::Model;

mod faults;
mod graph;

pub use faults::{FAULTS, Fault};
pub use graph::graph;

/// Additions that end the four layers of ResNet-50, counted from one.
const LAYER_ENDS: [usize; 4] = [3, 7, 13, 16];

/// Operators that end the ResNet by a mean over the pixels.
const MEANS: [&str; 3] = ["AveragePool", "GlobalAveragePool", "ReduceMean"];

/// Where the stages of `vitruvian_reference::network::regressor` stand in a graph: (stage, tensor), in the graph's order.
///
/// The stages found are `stem`, `layer1` … `layer4`, `feature` where the mean drops the axes of the pixels, and of the
/// rounds `pose_k`, `betas_k`, `camera_k`, k = 1, 2, 3.
///
/// # Errors
/// When the graph has not the additions of a ResNet-50 and its head.
pub fn stages(model: &Model) -> Result<Vec<(String, String)>> {
    let error = |message: String| Error::Onnx {
        graph: model.name().to_owned(),
        item: "graph".into(),
        message: format!("{message}; ResNet-50 with a head of three rounds was expected"),
    };
    let operator = |node: &NodeProto| node.op_type.clone().unwrap_or_default();
    let output = |node: &NodeProto| node.output.first().cloned().unwrap_or_default();
    let reader =
        |tensor: &str| model.nodes().iter().find(|node| node.input.iter().any(|name| name == tensor));

    let mean = model.nodes().iter().position(|node| MEANS.contains(&operator(node).as_str()));
    let mean = mean.ok_or_else(|| error(format!("it has none of {MEANS:?}")))?;
    let (trunk, head) = model.nodes().split_at(mean);
    let additions = |nodes: &[NodeProto]| -> Vec<String> {
        nodes.iter().filter(|node| operator(node) == "Add").map(output).collect()
    };
    let (residuals, corrections) = (additions(trunk), additions(head));
    if residuals.len() != LAYER_ENDS[3] || corrections.len() != 9 {
        let (blocks, rounds) = (residuals.len(), corrections.len());
        return Err(error(format!(
            "it has {blocks} additions before the mean and {rounds} after it, not 16 and 9"
        )));
    }

    let mut found = Vec::new();
    let pool = trunk.iter().find(|node| operator(node) == "MaxPool");
    found.push(("stem".to_owned(), output(pool.ok_or_else(|| error("it has no MaxPool".into()))?)));
    for (l, end) in LAYER_ENDS.into_iter().enumerate() {
        let addition = &residuals[end - 1];
        let relu = reader(addition).filter(|node| operator(node) == "Relu");
        let relu = relu.ok_or_else(|| error(format!("no Relu reads \"{addition}\"")))?;
        found.push((format!("layer{}", l + 1), output(relu)));
    }
    if operator(&head[0]) == "ReduceMean" {
        found.push(("feature".to_owned(), output(&head[0])));
    }
    for (place, tensor) in corrections.into_iter().enumerate() {
        let name = ["pose", "betas", "camera"][place % 3];
        found.push((format!("{name}_{}", place / 3 + 1), tensor));
    }
    Ok(found)
}
