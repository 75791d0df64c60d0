//! What is found while a graph is gone through, node by node.

use std::collections::BTreeMap;
use std::sync::Arc;

use vitruvian_reference::nn::Rounded;

use super::blame::Scene;
use super::case::Case;
use super::gap::{Evidence, SAYS_NOTHING};
use super::node::Node;
use super::party::{Held, Tensors};
use super::report::{Coverage, Grade, NodeReport, Outside, Unsupported, WorstElement};
use crate::onnx::element::ElementType;
use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::{Data, Value};

/// Elements of the largest tensor that is filled in: each takes 24 bytes.
const LARGEST_FILLED_IN: usize = 1 << 24;

/// Said of a node that no bound could judge.
const BY_EVIDENCE: &str =
    "are judged by drawn roundings, with those before them that were not kept: evidence, not proof";

/// A node outside rounding.
struct Suspect {
    index: usize,
    grade: Grade,
    scene: Option<Scene>,
    worst: Vec<WorstElement>,
}

/// The nodes gone through so far.
#[derive(Default)]
pub(super) struct Findings {
    pub nodes: Vec<NodeReport>,
    pub notes: Vec<String>,
    /// Whether a tensor that is filled in takes the place of the party's own from there on.
    computes: bool,
    missing: Vec<String>,
    /// Nodes that could not be compared for another reason than a missing tensor.
    unsupported: Vec<usize>,
    /// How many nodes agree only under a condition.
    conditions: BTreeMap<&'static str, usize>,
    /// The nodes behind each tensor that was filled in.
    waiting: BTreeMap<String, Vec<usize>>,
    suspect: Option<Suspect>,
}

impl Findings {
    pub fn new(computes: bool) -> Self {
        Self { computes, ..Self::default() }
    }

    /// Adds the next node; its outputs that the party lacks are `missing`, with the reason, and are filled in. Of a node
    /// behind such tensors drawn roundings may have given `evidence`.
    pub fn add(
        &mut self,
        node: Node,
        missing: &BTreeMap<String, String>,
        evidence: Option<Evidence>,
        held: &mut Tensors,
    ) {
        let Node { mut report, judgement, derived, case } = node;
        let index = self.nodes.len();
        if let Some(note) = judgement.note {
            *self.conditions.entry(note).or_default() += 1;
        }
        let behind: Vec<usize> =
            derived.iter().filter_map(|name| self.waiting.get(name)).flatten().copied().collect();
        let lacking: Vec<&String> =
            report.outputs.iter().filter(|name| missing.contains_key(*name)).collect();
        if !lacking.is_empty() && report.op == "Constant" && judgement.verdict != Grade::NotComparable {
            // What the file itself says; nobody computes it.
            for (name, value) in report.outputs.iter().zip(judgement.derived) {
                if let Some(tensor) = value.as_ref().and_then(rounded) {
                    held.insert(name.clone(), Held::Constant(Arc::new(tensor)));
                }
            }
        } else if !lacking.is_empty() {
            let reason = report.why.clone().unwrap_or_else(|| missing[lacking[0]].clone());
            if judgement.verdict == Grade::NotComparable {
                self.unsupported.push(index);
            }
            let mut behind = behind;
            behind.push(index);
            for (k, name) in report.outputs.iter().enumerate().filter(|(_, name)| missing.contains_key(*name))
            {
                self.missing.push(name.clone());
                let value = judgement.derived.get(k).cloned().flatten();
                let stand_in = match value {
                    Some(value) if value.len() > LARGEST_FILLED_IN => {
                        Held::Unknown(format!("{} elements are too many to be filled in", value.len()))
                    }
                    Some(value) if self.computes => match rounded(&value) {
                        Some(tensor) => Held::Given(Arc::new(tensor)),
                        None => Held::Unknown(reason.clone()),
                    },
                    Some(value) => {
                        self.waiting.insert(name.clone(), behind.clone());
                        Held::Derived(Arc::new(value))
                    }
                    None => Held::Unknown(reason.clone()),
                };
                held.insert(name.clone(), stand_in);
            }
            if report.verdict != Grade::G3 {
                report.verdict = Grade::NotComparable;
            }
            report.why = Some(reason);
        } else if report.verdict == Grade::NotComparable {
            self.unsupported.push(index);
        } else if !behind.is_empty() {
            self.settle(&mut report, &behind, judgement.slack, evidence);
        } else if judgement.is_unbounded && report.verdict != Grade::G3 {
            report.verdict = Grade::NotComparable;
            report.why = Some("rounding inside it could make all of its values".to_owned());
            self.unsupported.push(index);
        }
        self.suspect(&report, case, judgement.worst, held);
        self.nodes.push(report);
    }

    /// A node was judged whose operands were filled in: the nodes behind them are judged with it, by the bound if it says
    /// something, or else by the evidence of drawn roundings.
    fn settle(&mut self, report: &mut NodeReport, behind: &[usize], slack: f64, evidence: Option<Evidence>) {
        let proves = slack <= SAYS_NOTHING;
        match evidence {
            Some(evidence) if !proves || report.verdict > Grade::G1 => {
                report.verdict = if proves { report.verdict.min(evidence.grade) } else { evidence.grade };
                report.tensors.iter_mut().for_each(|tensor| tensor.verdict = report.verdict);
                report.why = Some(format!(
                    "its differences are {:.2} times the usual scatter of drawn roundings",
                    evidence.share
                ));
                *self.conditions.entry(BY_EVIDENCE).or_default() += 1;
            }
            None if !proves => report.verdict = Grade::NotComparable,
            _ => {}
        }
        if report.verdict == Grade::NotComparable {
            let share = if slack < 1.0 { format!("{:.0} %", 100.0 * slack) } else { "all".to_owned() };
            report.why = Some(format!(
                "its operands are missing, and rounding on the way to them could make {share} of its values"
            ));
            return;
        }
        for &i in behind {
            let node = &mut self.nodes[i];
            if node.verdict != Grade::NotComparable || self.unsupported.contains(&i) {
                continue;
            }
            if report.verdict == Grade::G3 {
                node.why = Some(format!(
                    "judged together with {}, which is different: one of these nodes is wrong",
                    report.name
                ));
            } else {
                node.verdict = report.verdict;
                node.why = Some(format!("judged together with {}", report.name));
            }
        }
    }

    fn suspect(&mut self, report: &NodeReport, case: Option<Case>, worst: Vec<WorstElement>, held: &Tensors) {
        let grade = report.verdict;
        let earlier = self.suspect.as_ref().map(|suspect| suspect.grade);
        if (grade == Grade::G3 && earlier != Some(Grade::G3)) || (grade == Grade::G2 && earlier.is_none()) {
            let scene = case.map(|case| Scene::new(case, held));
            self.suspect = Some(Suspect { index: report.index, grade, scene, worst });
        }
    }

    /// The worst of all nodes: different before not comparable before unusual.
    pub fn verdict(&self) -> Grade {
        let any = |grade: Grade| self.nodes.iter().any(|node| node.verdict == grade);
        if any(Grade::G3) {
            Grade::G3
        } else if any(Grade::NotComparable) {
            Grade::NotComparable
        } else {
            self.nodes.iter().map(|node| node.verdict).max().unwrap_or(Grade::NotComparable)
        }
    }

    /// The first node that is different, or if none is the first that is unusual.
    pub fn first_outside(&self) -> Option<Outside> {
        let suspect = self.suspect.as_ref()?;
        let node = &self.nodes[suspect.index];
        Some(Outside {
            node: node.name.clone(),
            op: node.op.clone(),
            outputs: node.outputs.clone(),
            hypothesis: None,
            worst: suspect.worst.clone(),
            reproduction: None,
        })
    }

    /// The scene of [`Findings::first_outside`]; `None` where an operand of it is missing.
    pub fn scene_outside(&self) -> Option<&Scene> {
        self.suspect.as_ref()?.scene.as_ref()
    }

    /// How much was compared.
    pub fn coverage(&self, unmatched: Vec<String>) -> Coverage {
        let compared = |node: &&NodeReport| node.verdict != Grade::NotComparable;
        let tensors = || self.nodes.iter().flat_map(|node| &node.tensors);
        let mut reasons: BTreeMap<(String, String), usize> = BTreeMap::new();
        for &i in &self.unsupported {
            let node = &self.nodes[i];
            *reasons.entry((node.op.clone(), node.why.clone().unwrap_or_default())).or_default() += 1;
        }
        Coverage {
            nodes: self.nodes.len(),
            compared: self.nodes.iter().filter(compared).count(),
            elements: tensors().map(|tensor| tensor.elements).sum(),
            elements_compared: tensors().map(|tensor| tensor.compared).sum(),
            unsupported: reasons
                .into_iter()
                .map(|((op, why), count)| Unsupported { op, why, count })
                .collect(),
            missing: self.missing.clone(),
            unmatched,
        }
    }

    /// What a reader should know.
    pub fn notes(&self) -> Vec<String> {
        let conditions = self.conditions.iter().map(|(note, count)| format!("{count} nodes {note}"));
        self.notes.iter().cloned().chain(conditions).collect()
    }
}

/// The reference's tensor as its type holds it; `None` where the type cannot.
pub(super) fn rounded(value: &Value<Rounded>) -> Option<TypedTensor> {
    let element = value.element;
    let elements = match &value.data {
        Data::Truths(truths) => Elements::Bool(truths.data.clone()),
        Data::Integers(integers) => integers_of(element, &integers.data)?,
        Data::Numbers(numbers) => {
            let all = numbers.data.iter().map(|x| element.round(x.value));
            match element {
                ElementType::F32 => Elements::F32(all.map(|x| x as f32).collect()),
                ElementType::F64 => Elements::F64(all.collect()),
                ElementType::F16 => Elements::F16(all.map(half::f16::from_f64).collect()),
                ElementType::Bf16 => Elements::Bf16(all.map(half::bf16::from_f64).collect()),
                _ => return None,
            }
        }
    };
    Some(TypedTensor { shape: value.shape().to_vec(), elements })
}

fn integers_of(element: ElementType, integers: &[i64]) -> Option<Elements> {
    fn all<E: TryFrom<i64>>(integers: &[i64]) -> Option<Vec<E>> {
        integers.iter().map(|&i| E::try_from(i).ok()).collect()
    }
    Some(match element {
        ElementType::I8 => Elements::I8(all(integers)?),
        ElementType::U8 => Elements::U8(all(integers)?),
        ElementType::I16 => Elements::I16(all(integers)?),
        ElementType::U16 => Elements::U16(all(integers)?),
        ElementType::I32 => Elements::I32(all(integers)?),
        ElementType::U32 => Elements::U32(all(integers)?),
        ElementType::I64 => Elements::I64(integers.to_vec()),
        ElementType::U64 => Elements::U64(all(integers)?),
        ElementType::F32 | ElementType::F64 | ElementType::F16 | ElementType::Bf16 | ElementType::Bool => {
            return None;
        }
    })
}
