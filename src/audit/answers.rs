//! The three questions that an audit answers, and its answers: the same words on the terminal and on the page.

use serde::Serialize;
use vitruvian_conformance::audit::report::{
    Audit, Coverage, Grade, NodeReport, OutputReport, Outside, ShippedReport, TensorReport,
};

use super::figures::{count, counted, list, number, optional, plain};

/// How many times its noise floor an output may be off (root mean square) and still be called noise.
///
/// The floor is itself estimated from a few random draws; errors of one run scatter around it by a small factor. Ten is far
/// above that scatter and far below what a changed meaning does.
const NOISE: f64 = 10.0;

/// A question and the sentences that answer it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Answer {
    /// The question.
    pub question: &'static str,
    /// The answer, the main sentence first.
    pub sentences: Vec<String>,
}

/// The questions with their answers, in order.
pub fn answers(audit: &Audit) -> [Answer; 3] {
    [
        Answer { question: "Is anything outside rounding?", sentences: outside(audit) },
        Answer { question: "Where does it start, and why?", sentences: start(audit) },
        Answer { question: "Does it change the body?", sentences: body(audit) },
    ]
}

/// Nodes of one grade.
fn of(audit: &Audit, grade: Grade) -> usize {
    audit.nodes.iter().filter(|node| node.verdict == grade).count()
}

fn outside(audit: &Audit) -> Vec<String> {
    let all = audit.nodes.len();
    let [different, unknown, unusual, exact] =
        [Grade::G3, Grade::NotComparable, Grade::G2, Grade::G0].map(|grade| of(audit, grade));
    let mut sentences = vec![match audit.verdict {
        Grade::G0 => {
            format!("No: all that {} make is bit for bit the rounded reference.", counted(all, "node"))
        }
        Grade::G1 => format!(
            "No: all {} are ordinary rounding (G1), {exact} of them bit for bit (G0).",
            counted(all, "node")
        ),
        Grade::G2 => format!(
            "Perhaps: {unusual} of {} within the proven bound, but not as chance rounds (G2).",
            are(all)
        ),
        Grade::G3 => format!("Yes: {different} of {} by more than any rounding can make (G3).", differ(all)),
        Grade::NotComparable => {
            format!(
                "Unknown: {unknown} of {} could not be compared; no node that could is outside.",
                counted(all, "node")
            )
        }
    }];
    if audit.verdict == Grade::G3 && unusual > 0 {
        sentences.push(format!("{unusual} more {} unusual (G2).", if unusual == 1 { "is" } else { "are" }));
    }
    let gap = audit.nodes.iter().find(|node| node.verdict == Grade::NotComparable);
    sentences.extend(gap.and_then(|node| {
        let why = node.why.as_ref()?;
        Some(format!(
            "The first that could not: {} ({}): {}.",
            plain(&node.name),
            plain(&node.op),
            plain(why)
        ))
    }));
    sentences.push(coverage(&audit.coverage, audit.nodes.iter().flat_map(|node| &node.tensors)));
    sentences.extend(gaps(&audit.coverage));
    sentences
}

fn are(all: usize) -> String {
    format!("{} {}", counted(all, "node"), if all == 1 { "is" } else { "are" })
}

fn differ(all: usize) -> String {
    format!("{} {}", counted(all, "node"), if all == 1 { "differs" } else { "differ" })
}

/// How much was compared, never rounded up to all.
fn coverage<'a>(coverage: &Coverage, tensors: impl Iterator<Item = &'a TensorReport>) -> String {
    let elements = if coverage.elements == coverage.elements_compared {
        format!("all of {} elements", count(coverage.elements))
    } else {
        format!(
            "{} of {} elements (stated samples)",
            count(coverage.elements_compared),
            count(coverage.elements)
        )
    };
    let undecidable: u64 = tensors.map(|tensor| tensor.undecidable).sum();
    let undecidable = match undecidable {
        0 => String::new(),
        n => format!("; {} depend on a decision closer than the rounding (undecidable)", count(n)),
    };
    format!(
        "Compared: {} of {}, {elements}{undecidable}.",
        coverage.compared,
        counted(coverage.nodes, "node")
    )
}

/// What was not compared, and why.
fn gaps(coverage: &Coverage) -> Vec<String> {
    let unsupported = coverage
        .unsupported
        .iter()
        .map(|gap| format!("Not comparable: {} × {}: {}.", gap.count, plain(&gap.op), plain(&gap.why)));
    let named =
        |what: &str, names: &[String]| (!names.is_empty()).then(|| format!("{what}: {}.", some_of(names)));
    unsupported
        .chain(named("Tensors that the second party lacks", &coverage.missing))
        .chain(named("Tensors of the second party that the graph lacks", &coverage.unmatched))
        .collect()
}

/// The first few names, and how many more there are.
fn some_of(names: &[String]) -> String {
    const FEW: usize = 6;
    let shown: Vec<String> = names.iter().take(FEW).map(|name| plain(name)).collect();
    let more = names.len().saturating_sub(FEW);
    shown.join(", ") + &if more > 0 { format!(" and {more} more") } else { String::new() }
}

fn start(audit: &Audit) -> Vec<String> {
    let Some(first) = &audit.first_outside else {
        let rounded = audit.nodes.iter().filter(|node| node.verdict != Grade::G0);
        return match rounded.max_by(|a, b| share(a).total_cmp(&share(b))) {
            Some(node) if share(node) > 0.0 => vec![format!(
                "Nowhere. {} ({}) comes closest to its bound: {:.0} % of it.",
                plain(&node.name),
                plain(&node.op),
                (100.0 * share(node)).min(100.0)
            )],
            _ => vec!["Nowhere.".into()],
        };
    };
    let node = audit.nodes.iter().find(|node| node.name == first.node);
    let mut sentences = vec![format!(
        "At {} ({}{}), which makes {}.",
        plain(&first.node),
        plain(&first.op),
        node.map_or(String::new(), |node| format!(", node {} of {}", node.index + 1, audit.nodes.len())),
        some_of(&first.outputs)
    )];
    sentences.extend(node.into_iter().flat_map(about));
    sentences.push(cause(first));
    if let Some(folder) = &first.reproduction {
        sentences.push(format!("The node by itself, in ONNX's test layout: {}", plain(folder)));
    }
    sentences
}

/// Largest difference of a node as a share of its bound.
fn share(node: &NodeReport) -> f64 {
    let of = |tensor: &TensorReport| {
        tensor.csu_max.filter(|_| tensor.n_eff > 0.0).map_or(0.0, |csu| csu / tensor.n_eff)
    };
    node.tensors.iter().map(of).fold(0.0, f64::max)
}

/// Attributes, source and arithmetic of a node.
pub fn about(node: &NodeReport) -> Vec<String> {
    let mut lines = Vec::new();
    if !node.attributes.is_empty() {
        let attributes: Vec<String> =
            node.attributes.iter().map(|(name, value)| format!("{}={}", plain(name), plain(value))).collect();
        lines.push(format!("Attributes: {}", attributes.join("  ")));
    }
    if let Some(source) = &node.source {
        let mut line = format!("Source: {}:{}", plain(&source.file), source.line);
        if !source.module.is_empty() {
            line += &format!(" in {}", plain(&source.module));
        }
        if !source.code.is_empty() {
            line += &format!(": {}", plain(source.code.trim()));
        }
        lines.push(line);
    }
    lines
}

/// The mistake that explains the numbers, or that none does.
pub fn cause(first: &Outside) -> String {
    match &first.hypothesis {
        Some(cause) => {
            format!(
                "Cause: {} – {} ({} csu are left).",
                plain(&cause.name),
                plain(&cause.detail),
                number(cause.csu)
            )
        }
        None => "Cause: none of the usual mistakes explains the numbers.".into(),
    }
}

fn body(audit: &Audit) -> Vec<String> {
    let mut sentences: Vec<String> = audit.outputs.iter().map(output).collect();
    if sentences.is_empty() {
        sentences.push("The graph's outputs were not compared end to end.".into());
    }
    sentences.extend(audit.shipped.as_ref().map(shipped));
    sentences
}

fn output(output: &OutputReport) -> String {
    let name = plain(&output.name);
    let Some(largest) = output.cumulative else {
        return format!("{name}: the reference's own chain was not computed.");
    };
    let words = match (output.cumulative_rms, output.noise_floor) {
        (Some(rms), Some(floor)) if rms <= NOISE * floor => {
            format!("the noise that rounding makes ({} rms, floor {})", number(rms), number(floor))
        }
        (Some(rms), Some(floor)) if floor > 0.0 => {
            format!(
                "{} times the noise that rounding makes ({} rms, floor {})",
                number(rms / floor),
                number(rms),
                number(floor)
            )
        }
        (rms, _) => format!("{} rms", optional(rms)),
    };
    format!("{name}: at most {} from the reference's own chain: {words}.", number(largest))
}

fn shipped(shipped: &ShippedReport) -> String {
    let changed = shipped.tensors.iter().filter(|tensor| !tensor.identical).count();
    format!(
        "As shipped (optimisation {}, {} → {} nodes): {}; of {} that survive, {} differ from the session without optimisation.",
        plain(&shipped.level),
        shipped.nodes.0,
        shipped.nodes.1,
        shipped.verdict,
        counted(shipped.tensors.len(), "tensor"),
        changed
    )
}

/// The worst elements of the first node outside, with what they were computed from: a line each.
pub fn worst(first: &Outside) -> Vec<String> {
    let line = |element: &vitruvian_conformance::audit::report::WorstElement| {
        let value = |x: Option<f64>| x.map_or("not finite".into(), |x| format!("{x:.9e}"));
        let from: Vec<String> = element.receptive_field.iter().map(|part| plain(part)).collect();
        format!(
            "{}{}: found {}, expected {}, {} csu{}",
            plain(&element.tensor),
            list(&element.index),
            value(element.found),
            value(element.expected),
            optional(element.csu),
            if from.is_empty() { String::new() } else { format!(", from {}", from.join(", ")) }
        )
    };
    first.worst.iter().map(line).collect()
}
