//! An audit as JUnit XML: a test case for each node, for the tables that CI services make.

use vitruvian_conformance::audit::report::{Audit, Grade, NodeReport};

use super::answers;
use super::figures::{number, plain};
use super::terminal::{words, worst_tensor};

/// The XML file's text.
///
/// G2 and G3 are failures, as the exit status has it; a node that was not compared is skipped, with the reason.
pub fn xml(audit: &Audit) -> String {
    let count = |grades: &[Grade]| audit.nodes.iter().filter(|node| grades.contains(&node.verdict)).count();
    let (failures, skipped) = (count(&[Grade::G2, Grade::G3]), count(&[Grade::NotComparable]));
    let counts = format!(
        "tests=\"{}\" failures=\"{failures}\" errors=\"0\" skipped=\"{skipped}\" time=\"{:.3}\"",
        audit.nodes.len(),
        audit.seconds
    );
    let properties = [
        ("schema", audit.schema.clone()),
        ("verdict", audit.verdict.to_string()),
        ("graph.sha256", audit.graph.sha256.clone()),
        ("runtime", audit.runtime.clone()),
        ("inputs", audit.inputs.clone()),
    ];
    let properties: String = properties
        .iter()
        .map(|(name, value)| format!("      <property name=\"{name}\" value=\"{}\"/>\n", escaped(value)))
        .collect();
    let cases: String = audit.nodes.iter().map(|node| case(audit, node)).collect();
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites name=\"vitruvian audit\" {counts}>\n  \
         <testsuite name=\"{}\" {counts}>\n    <properties>\n{properties}    </properties>\n{cases}  </testsuite>\n</testsuites>\n",
        escaped(&audit.graph.path)
    )
}

fn case(audit: &Audit, node: &NodeReport) -> String {
    let open = format!(
        "    <testcase classname=\"{}\" name=\"{}\" time=\"{:.3}\"",
        escaped(&node.op),
        escaped(&node.name),
        node.seconds
    );
    match node.verdict {
        Grade::G0 | Grade::G1 => format!("{open}/>\n"),
        Grade::G2 | Grade::G3 => format!(
            "{open}>\n      <failure type=\"{}\" message=\"{}\">{}</failure>\n    </testcase>\n",
            node.verdict,
            escaped(&message(node)),
            escaped(&details(audit, node))
        ),
        Grade::NotComparable => format!(
            "{open}>\n      <skipped message=\"{}\"/>\n    </testcase>\n",
            escaped(node.why.as_deref().unwrap_or("not comparable"))
        ),
    }
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
        let text = xml(&samples::planted());
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
        let text = xml(&audit);
        let document = roxmltree::Document::parse(&text).expect("XML");
        let case = document.descendants().find(|element| element.has_tag_name("testcase")).expect("a case");
        assert_eq!(case.attribute("name"), Some("a<b>&\"'\n\\u{1b}[2J\\u{0}\\u{ffff}]]>ß"));
    }
}
