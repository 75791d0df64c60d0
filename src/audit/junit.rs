//! Reports as JUnit XML, for the tables that CI services make: an audit has a test case for each node.

use vitruvian_conformance::audit::report::{Audit, Grade, NodeReport};

use super::answers;
use super::figures::{number, plain};
use super::terminal::{words, worst_tensor};

/// The test cases of one report.
pub struct Suite {
    /// The verb, such as `audit`.
    pub verb: &'static str,
    /// What was looked at: a file.
    pub name: String,
    /// What else is to be known of the whole.
    pub properties: Vec<(&'static str, String)>,
    /// The cases, in the report's order.
    pub cases: Vec<Case>,
    /// Seconds it took.
    pub seconds: f64,
}

/// One test case.
pub struct Case {
    /// What kind of thing it is about.
    pub class: String,
    /// Which one.
    pub name: String,
    /// Seconds it took.
    pub seconds: f64,
    /// What came of it.
    pub outcome: Outcome,
}

/// What came of a test case.
pub enum Outcome {
    /// It is right.
    Passed,
    /// It is not.
    Failed {
        /// In what way, such as `G3`.
        kind: String,
        /// One line.
        message: String,
        /// What else helps.
        details: String,
    },
    /// Nothing was found out, for this reason.
    Skipped(String),
}

impl Suite {
    /// The XML file's text.
    pub fn xml(&self) -> String {
        let count = |is: fn(&Outcome) -> bool| self.cases.iter().filter(|case| is(&case.outcome)).count();
        let counts = format!(
            "tests=\"{}\" failures=\"{}\" errors=\"0\" skipped=\"{}\" time=\"{:.3}\"",
            self.cases.len(),
            count(|outcome| matches!(outcome, Outcome::Failed { .. })),
            count(|outcome| matches!(outcome, Outcome::Skipped(_))),
            self.seconds
        );
        let property = |(name, value): &(&str, String)| {
            format!("      <property name=\"{name}\" value=\"{}\"/>\n", escaped(value))
        };
        let properties: String = self.properties.iter().map(property).collect();
        let cases: String = self.cases.iter().map(Case::xml).collect();
        format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"vitruvian {}\" {counts}>\n  \
             <testsuite name=\"{}\" {counts}>\n    <properties>\n{properties}    </properties>\n{cases}  </testsuite>\n\
             </testsuites>\n",
            self.verb,
            escaped(&self.name)
        )
    }
}

impl Case {
    fn xml(&self) -> String {
        let open = format!(
            "    <testcase classname=\"{}\" name=\"{}\" time=\"{:.3}\"",
            escaped(&self.class),
            escaped(&self.name),
            self.seconds
        );
        match &self.outcome {
            Outcome::Passed => format!("{open}/>\n"),
            Outcome::Failed { kind, message, details } => format!(
                "{open}>\n      <failure type=\"{}\" message=\"{}\">{}</failure>\n    </testcase>\n",
                escaped(kind),
                escaped(message),
                escaped(details)
            ),
            Outcome::Skipped(why) => {
                format!("{open}>\n      <skipped message=\"{}\"/>\n    </testcase>\n", escaped(why))
            }
        }
    }
}

/// The test cases of an audit.
///
/// G2 and G3 are failures, as the exit status has it; a node that was not compared is skipped, with the reason.
pub fn of_audit(audit: &Audit) -> Suite {
    Suite {
        verb: "audit",
        name: audit.graph.path.clone(),
        properties: vec![
            ("schema", audit.schema.clone()),
            ("verdict", audit.verdict.to_string()),
            ("graph.sha256", audit.graph.sha256.clone()),
            ("runtime", audit.runtime.clone()),
            ("inputs", audit.inputs.clone()),
        ],
        cases: audit.nodes.iter().map(|node| of_node(audit, node)).collect(),
        seconds: audit.seconds,
    }
}

fn of_node(audit: &Audit, node: &NodeReport) -> Case {
    let outcome = match node.verdict {
        Grade::G0 | Grade::G1 => Outcome::Passed,
        Grade::G2 | Grade::G3 => Outcome::Failed {
            kind: node.verdict.to_string(),
            message: message(node),
            details: details(audit, node),
        },
        Grade::NotComparable => Outcome::Skipped(node.why.clone().unwrap_or("not comparable".into())),
    };
    Case { class: node.op.clone(), name: node.name.clone(), seconds: node.seconds, outcome }
}

fn message(node: &NodeReport) -> String {
    let Some(tensor) = worst_tensor(node) else { return words(node.verdict).to_owned() };
    format!(
        "{}: {} is off by {} csu, {} are possible",
        words(node.verdict),
        plain(&tensor.name),
        tensor.csu_max.map_or("∞".into(), number),
        number(tensor.n_eff)
    )
}

fn details(audit: &Audit, node: &NodeReport) -> String {
    let mut lines = answers::about(node);
    if let Some(first) = audit.first_outside.as_ref().filter(|first| first.node == node.name) {
        lines.push(answers::cause(first));
        lines.extend(answers::worst(first));
    }
    lines.join("\n")
}

/// Text for an attribute or an element: marks as entities; what XML 1.0 cannot hold at all is written as `\u{1b}`.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            // An attribute's line breaks and tabs would be read back as spaces.
            '\t' | '\n' | '\r' => escaped.push_str(&format!("&#{};", u32::from(c))),
            '\u{0}'..'\u{20}' | '\u{fffe}' | '\u{ffff}' => escaped.extend(c.escape_unicode()),
            _ => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::samples;

    #[test]
    fn every_node_is_a_case_and_those_outside_fail() {
        let text = of_audit(&samples::planted()).xml();
        let document = roxmltree::Document::parse(&text).expect("XML");
        let suite =
            document.descendants().find(|element| element.has_tag_name("testsuite")).expect("a suite");
        assert_eq!(
            ["tests", "failures", "skipped"].map(|name| suite.attribute(name)),
            [Some("3"), Some("2"), Some("1")]
        );
        let cases: Vec<_> = suite.children().filter(|child| child.has_tag_name("testcase")).collect();
        let outcome = |case: &roxmltree::Node| {
            let outcome = case.first_element_child()?;
            Some(format!("{} {}", outcome.tag_name().name(), outcome.attribute("message")?))
        };
        let outcomes: Vec<_> = cases.iter().map(outcome).collect();
        assert_eq!(cases[2].attribute("name"), Some("Conv_2"));
        assert_eq!(
            outcomes,
            [
                Some("failure G2, unusual rounding: t0 is off by 2.10 csu, 28.0 are possible".into()),
                Some("skipped attribute \"mode\" is \"wild\"".into()),
                Some("failure G3, not rounding: t2 is off by 8.4e5 csu, 28.0 are possible".into()),
            ]
        );
        assert!(
            cases[2]
                .descendants()
                .any(|node| node.text().is_some_and(|text| text.contains("reflected borders")))
        );
    }

    #[test]
    fn any_name_gives_xml_that_reads_back() {
        let mut audit = samples::clean();
        audit.nodes[0].name = "a<b>&\"'\n\u{1b}[2J\u{0}\u{ffff}]]>ß".into();
        let text = of_audit(&audit).xml();
        let document = roxmltree::Document::parse(&text).expect("XML");
        let case = document.descendants().find(|element| element.has_tag_name("testcase")).expect("a case");
        assert_eq!(case.attribute("name"), Some("a<b>&\"'\n\\u{1b}[2J\\u{0}\\u{ffff}]]>ß"));
    }
}
