//! An audit as one page that needs no network: the data as JSON, and scripts that draw it.

mod drawing;

use serde_json::{Value, json};
use vitruvian_conformance::audit::report::Audit;

use super::answers;
use super::figures::plain;

const FRAME: &str = include_str!("page/page.html");
const STYLE: &str = include_str!("page/page.css");
const SCRIPTS: [&str; 7] = [
    include_str!("page/elements.js"),
    include_str!("page/details.js"),
    include_str!("page/graph.js"),
    include_str!("page/strip.js"),
    include_str!("page/nodes.js"),
    include_str!("page/surface.js"),
    include_str!("page/page.js"),
];

/// The page of a certificate.
pub fn certificate(audit: &Audit) -> String {
    let title = format!("{} · {}", plain(&audit.graph.path), audit.verdict);
    page(
        &title,
        &json!({
            "audit": audit,
            "answers": answers::answers(audit),
            "drawing": drawing::draw(&audit.nodes, &audit.graph.inputs),
            "surfaces": [],
        }),
    )
}

/// A page that shows what `data` has: `title` and `facts` (pairs of name and value), `answers`; `audit` with its `drawing`; `tables`
/// (`title`, `head`, `rows`); `surfaces`, each with a `title`, `vertices` (metres), `faces`, `millimetres` at each vertex, and `y_down`
/// where y points downwards.
pub fn page(title: &str, data: &Value) -> String {
    // One pass over the frame: what is put in is not looked at again.
    let parts = [
        ("<!--title-->", markup(title)),
        ("/*style*/", STYLE.to_owned()),
        ("/*data*/", embedded(data)),
        ("/*script*/", SCRIPTS.concat()),
    ];
    let mut page = String::new();
    let mut rest = FRAME;
    for (mark, part) in &parts {
        let (before, after) = rest.split_once(mark).expect("the frame has every mark once, in this order");
        page += before;
        page += part;
        rest = after;
    }
    page + rest
}

/// JSON that cannot end the script element it stands in: `<`, `>` and `&` as \u escapes, which only occur inside strings.
fn embedded(data: &Value) -> String {
    let json = data.to_string();
    json.replace('<', "\\u003c").replace('>', "\\u003e").replace('&', "\\u0026")
}

fn markup(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::samples;

    /// The JSON between the data element's tags.
    fn data_of(page: &str) -> Value {
        let (_, after) = page.split_once("type=\"application/json\">").expect("the data element");
        serde_json::from_str(after.split_once("</script>").expect("its end").0).expect("JSON")
    }

    #[test]
    fn names_cannot_end_the_data_or_begin_an_element() {
        let mut audit = samples::planted();
        audit.graph.path = "</title><script>alert(1)</script>".into();
        audit.nodes[0].name = "</script><script>alert(1)</script><!--\u{2028}\u{0}".into();
        audit.nodes[1].name = "/*script*/".into();
        let page = certificate(&audit);
        assert_eq!(page.matches("alert(1)").count(), 3, "title, path, name");
        assert_eq!(
            page.matches("<script").count(),
            certificate(&samples::clean()).matches("<script").count()
        );
        assert_eq!(data_of(&page)["audit"], serde_json::to_value(&audit).expect("JSON"));
    }

    #[test]
    fn a_page_names_no_address() {
        let page = certificate(&samples::planted());
        for address in ["http:", "https:", "//cdn", "src=", "@import", "url("] {
            let found = page.replace("http://www.w3.org/2000/svg", "").contains(address);
            assert!(!found, "{address} in the page");
        }
    }
}
