//! An audit as text: three questions, their answers, the worst nodes.

use console::{Style, Term};
use vitruvian_conformance::audit::report::{Audit, Grade, NodeReport, TensorReport};

use super::answers::{self, Answer};
use super::destinations::Destinations;
use super::figures::{count, ending, number, optional, plain, shell};
use crate::table;

/// Rows of the table of nodes unless all are asked for.
const ROWS: usize = 20;

/// Narrower than this nothing is made.
const NARROWEST: usize = 60;

/// How the text is to look.
#[derive(Clone, Copy, Debug)]
pub struct Look {
    /// Columns of the terminal; `None` where it is none, and nothing is cut or wrapped.
    pub width: Option<usize>,
    /// Whether every node gets a row.
    pub all: bool,
}

impl Look {
    /// The look of standard output as it is.
    pub fn of_standard_output(all: bool) -> Look {
        let width = Term::stdout().size_checked().map(|(_, columns)| usize::from(columns).max(NARROWEST));
        Look { width, all }
    }
}

/// The whole text.
pub fn text(audit: &Audit, look: Look) -> String {
    let [outside, start, body] = answers::answers(audit);
    let mut parts =
        vec![head(audit, look), section(&outside, look), nodes(audit, look), section(&start, look)];
    if let Some(first) = &audit.first_outside {
        parts.extend(bullets("Worst elements", &answers::worst(first), look));
    }
    parts.push(section(&body, look));
    let notes: Vec<String> = audit.notes.iter().map(|note| plain(note)).collect();
    parts.extend(bullets("Notes", &notes, look));
    parts.join("\n\n")
}

fn head(audit: &Audit, look: Look) -> String {
    let graph = &audit.graph;
    let verdict = graded(audit.verdict).bold().apply_to(words(audit.verdict));
    let facts = format!(
        "opset {}, written by {}; second party: {}; inputs: {}; {:.1} s",
        graph.opset,
        if graph.producer.is_empty() { "an unnamed program".into() } else { plain(&graph.producer) },
        plain(&audit.runtime),
        plain(&audit.inputs),
        audit.seconds
    );
    format!("{}: {verdict}\n{}", plain(&graph.path), wrapped(&facts, "", look))
}

/// A grade with its meaning.
pub fn words(grade: Grade) -> &'static str {
    match grade {
        Grade::G0 => "G0, bit for bit",
        Grade::G1 => "G1, ordinary rounding",
        Grade::G2 => "G2, unusual rounding",
        Grade::G3 => "G3, not rounding",
        Grade::NotComparable => "not comparable",
    }
}

fn graded(grade: Grade) -> Style {
    let style = Style::new().for_stdout();
    match grade {
        Grade::G0 | Grade::G1 => style.green(),
        Grade::G2 => style.yellow(),
        Grade::G3 => style.red(),
        Grade::NotComparable => style.magenta(),
    }
}

fn section(answer: &Answer, look: Look) -> String {
    let heading = Style::new().for_stdout().bold().apply_to(answer.question).to_string();
    let lines = answer.sentences.iter().map(|sentence| wrapped(sentence, "  ", look));
    [heading].into_iter().chain(lines).collect::<Vec<_>>().join("\n")
}

fn bullets(title: &str, lines: &[String], look: Look) -> Option<String> {
    let lines: Vec<String> = lines.iter().map(|line| wrapped(line, "    ", look)).collect();
    (!lines.is_empty()).then(|| format!("  {title}:\n{}", lines.join("\n")))
}

/// A sentence in lines of the look's width, each after `indent`; words that are longer stay whole.
fn wrapped(sentence: &str, indent: &str, look: Look) -> String {
    let Some(width) = look.width else { return format!("{indent}{sentence}") };
    let mut lines = vec![indent.to_owned()];
    for word in sentence.split(' ') {
        let line = lines.last_mut().expect("there is a first line");
        let is_empty = line.trim().is_empty();
        if !is_empty && line.chars().count() + 1 + word.chars().count() > width {
            lines.push(format!("{indent}{word}"));
        } else {
            line.push_str(if is_empty { "" } else { " " });
            line.push_str(word);
        }
    }
    lines.join("\n")
}

/// The table of nodes, worst first.
fn nodes(audit: &Audit, look: Look) -> String {
    let mut order: Vec<&NodeReport> = audit.nodes.iter().collect();
    order.sort_by(|a, b| severity(b).partial_cmp(&severity(a)).unwrap_or(std::cmp::Ordering::Equal));
    let shown = if look.all { order.len() } else { ROWS.min(order.len()) };
    let rows: Vec<Vec<String>> = order[..shown].iter().map(|node| row(node)).collect();
    let head = ["node", "operator", "grade", "csu", "n", "bits", "compared"];
    let widest = |column: usize| {
        let cells = rows.iter().map(|row| row[column].chars().count());
        cells.chain([head[column].len()]).max().unwrap_or(0) + 2
    };
    // What the numbers leave is the operator's and, of that, all but a little the name's where it is scarce.
    let texts = look.width.map(|width| {
        let left = width.saturating_sub(2 + (2..head.len()).map(widest).sum::<usize>());
        let name = left.saturating_sub(widest(1)).max(8);
        [name, left.saturating_sub(name + 2).max(8)]
    });
    let rows: Vec<Vec<String>> = rows
        .iter()
        .map(|row| {
            let mut row = row.clone();
            if let Some(longest) = texts {
                for (cell, longest) in row.iter_mut().zip(longest) {
                    *cell = ending(cell, longest);
                }
            }
            row
        })
        .collect();
    let table = table::aligned(&head, &rows);
    let mut lines: Vec<String> = table.lines().map(|line| format!("  {line}")).collect();
    for (line, node) in lines.iter_mut().skip(1).zip(&order) {
        if !matches!(node.verdict, Grade::G0 | Grade::G1) {
            *line = graded(node.verdict).apply_to(&*line).to_string();
        }
    }
    if shown < order.len() {
        lines.push(format!("  … and {} nodes that are no worse (--all shows them)", order.len() - shown));
    }
    lines.join("\n")
}

/// What the table is sorted by: the grade, then the largest difference as a share of its bound.
fn severity(node: &NodeReport) -> (u8, f64) {
    let rank = match node.verdict {
        Grade::G0 => 0,
        Grade::G1 => 1,
        Grade::G2 => 2,
        Grade::NotComparable => 3,
        Grade::G3 => 4,
    };
    let share =
        |tensor: &TensorReport| tensor.csu_max.map_or(f64::INFINITY, |csu| csu / tensor.n_eff.max(1.0));
    (rank, node.tensors.iter().map(share).fold(0.0, f64::max))
}

fn row(node: &NodeReport) -> Vec<String> {
    // A node that was not compared has no grade; why is said beside the coverage.
    let grade = match node.verdict {
        Grade::NotComparable => "–".to_owned(),
        grade => grade.to_string(),
    };
    let mut cells = vec![plain(&node.name), plain(&node.op), grade];
    match worst_tensor(node) {
        Some(tensor) => cells.extend([
            tensor.csu_max.map_or("∞".into(), number),
            number(tensor.n_eff),
            tensor.effective_bits.map_or("exact".into(), |bits| format!("{bits:.1}")),
            compared(tensor),
        ]),
        None => cells.extend(["–", "–", "–", "none"].map(str::to_owned)),
    }
    cells
}

/// The tensor that gives a node its verdict.
pub fn worst_tensor(node: &NodeReport) -> Option<&TensorReport> {
    let share =
        |tensor: &TensorReport| tensor.csu_max.map_or(f64::INFINITY, |csu| csu / tensor.n_eff.max(1.0));
    node.tensors.iter().max_by(|a, b| {
        let grades = (a.verdict == node.verdict).cmp(&(b.verdict == node.verdict));
        grades.then(share(a).total_cmp(&share(b)))
    })
}

fn compared(tensor: &TensorReport) -> String {
    if tensor.compared == tensor.elements {
        return count(tensor.elements);
    }
    format!("{} of {}", count(tensor.compared), count(tensor.elements))
}

/// One node's record.
pub fn record(node: &NodeReport, look: Look) -> String {
    let verdict = graded(node.verdict).bold().apply_to(words(node.verdict));
    let mut lines = vec![format!("{} ({}): {verdict}", plain(&node.name), plain(&node.op))];
    let mut say = |sentence: String| lines.push(wrapped(&sentence, "  ", look));
    if let Some(why) = &node.why {
        say(format!("Why: {}", plain(why)));
    }
    let names = |names: &[String]| {
        let names: Vec<String> =
            names.iter().map(|name| if name.is_empty() { "(none)".into() } else { plain(name) }).collect();
        names.join(", ")
    };
    say(format!("Reads: {}", names(&node.inputs)));
    say(format!("Makes: {}", names(&node.outputs)));
    answers::about(node).into_iter().for_each(&mut say);
    node.tensors.iter().flat_map(tensor).for_each(&mut say);
    lines.join("\n")
}

/// Everything that was measured on one tensor.
fn tensor(tensor: &TensorReport) -> Vec<String> {
    let mut lines = vec![
        format!(
            "{} {}{}: {}, {} compared{}",
            plain(&tensor.name),
            plain(&tensor.element),
            super::figures::list(&tensor.shape),
            words(tensor.verdict),
            compared(tensor),
            tensor.sample.as_deref().map_or(String::new(), |sample| format!(" ({})", plain(sample)))
        ),
        format!(
            "csu: at most {}, 99.9 % below {}, rms {}; n {}; effective bits {}",
            optional(tensor.csu_max),
            optional(tensor.csu_p999),
            optional(tensor.csu_rms),
            number(tensor.n_eff),
            tensor.effective_bits.map_or("–".into(), |bits| format!("{bits:.1}"))
        ),
        format!(
            "largest difference: {} absolute, {} relative, {} ulp",
            optional(tensor.abs_max),
            optional(tensor.rel_max),
            optional(tensor.ulp_max)
        ),
        format!(
            "slope {} (z {}), mean z {}; undecidable {}",
            optional(tensor.slope),
            optional(tensor.slope_z),
            optional(tensor.mean_z),
            tensor.undecidable
        ),
    ];
    if let Some(cumulative) = tensor.cumulative {
        lines.push(format!(
            "since the graph's inputs: {} at most; brought by the operands {} rms; amplified {} times",
            number(cumulative),
            optional(tensor.propagated),
            optional(tensor.amplification)
        ));
    }
    let special = tensor.special;
    if special != Default::default() {
        lines.push(format!(
            "found and expected: NaN {} and {}, infinite {} and {}, subnormal {} and {}",
            special.nan_found,
            special.nan_expected,
            special.inf_found,
            special.inf_expected,
            special.subnormal_found,
            special.subnormal_expected
        ));
    }
    lines
}

/// The command that says more.
pub fn next(audit: &Audit, destinations: &Destinations) -> String {
    let graph = shell(&audit.graph.path);
    let json = destinations.json.as_ref().filter(|_| !destinations.prints_json());
    match (&audit.first_outside, json) {
        (Some(first), Some(json)) => {
            let json = json.display().to_string();
            format!("next: vitruvian audit blame {} --node {}", shell(&json), shell(&first.node))
        }
        (Some(first), None) if first.reproduction.is_none() => {
            format!("next: vitruvian audit {graph} --reproduction reproduction --html audit.html")
        }
        (Some(_), None) => format!("next: vitruvian audit {graph} --html audit.html"),
        (None, _) => format!("next: vitruvian audit diff {graph} VARIANT.onnx"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::samples;

    const FILE: Look = Look { width: None, all: false };

    #[test]
    fn a_clean_audit_answers_no_nowhere_and_noise() {
        let text = text(&samples::clean(), FILE);
        for words in [
            "net.onnx: G1, ordinary rounding",
            "No: all 3 nodes are ordinary rounding (G1), 0 of them bit for bit (G0).",
            "Compared: 3 of 3 nodes, all of 12288 elements.",
            "Nowhere. ",
            "t2: at most 2.0e-6 from the reference's own chain: the noise that rounding makes",
        ] {
            assert!(text.contains(words), "{words:?} in\n{text}");
        }
    }

    #[test]
    fn a_planted_fault_is_named_with_its_cause_its_elements_and_its_folder() {
        let text = text(&samples::planted(), FILE);
        for words in [
            "Yes: 1 of 3 nodes differ by more than any rounding can make (G3).",
            "1 more is unusual (G2).",
            "Compared: 2 of 3 nodes, 8192 of 12288 elements",
            "Not comparable: 1 × Relu",
            "At Conv_2 (Conv, node 3 of 3), which makes t2.",
            "Source: model.py:32 in net.2: return self.layer(x)",
            "Cause: padding – pads are [1, 1, 1, 1] in the graph; reflected borders explain the numbers (1.40 csu are left).",
            "t2[0, 3, 0, 15]: found not finite, expected 2.500000000e-1, – csu, from x[0, 0:16, 0:2, 14:16]",
            "repro/Conv_2",
        ] {
            assert!(text.contains(words), "{words:?} in\n{text}");
        }
        let rows: Vec<&str> =
            text.lines().skip_while(|line| !line.starts_with("  node ")).skip(1).take(3).collect();
        assert!(
            ["Conv_2", "Relu_1", "Conv_0"]
                .iter()
                .zip(&rows)
                .all(|(name, row)| row.trim_start().starts_with(name))
        );
    }

    #[test]
    fn a_terminal_is_never_wider_than_it_is() {
        let mut audit = samples::planted();
        audit.nodes[2].name = "/encoder/stack/hourglass/".repeat(8);
        for width in [60, 80, 120] {
            let text = text(&audit, Look { width: Some(width), all: true });
            let table = text.lines().skip_while(|line| !line.starts_with("  node ")).take(4);
            for line in table.chain(text.lines().filter(|line| line.contains("Cause"))) {
                assert!(line.chars().count() <= width, "{width}: {line}");
            }
        }
    }

    #[test]
    fn long_tables_are_cut_unless_all_is_asked_for() {
        let mut audit = samples::clean();
        audit.nodes = (0..50).map(|at| samples::node(at, "Add")).collect();
        assert!(text(&audit, FILE).contains("… and 30 nodes that are no worse"));
        assert!(text(&audit, Look { all: true, ..FILE }).contains("Add_49"));
    }

    #[test]
    fn names_cannot_steer_the_terminal() {
        let mut audit = samples::planted();
        audit.nodes[2].name = "\u{1b}[2Jgone\r".into();
        audit.nodes[2].attributes[0].1 = "\u{7}".into();
        audit.graph.path = "a\nb".into();
        let text = text(&audit, FILE);
        assert!(!text.chars().any(|c| c.is_control() && c != '\n'), "{text:?}");
        assert!(text.starts_with("a\\nb: "));
    }
}
