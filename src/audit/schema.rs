//! The JSON Schemas of the reports, from the types that write them.

use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use vitruvian_conformance::audit::report::{Audit, PassesReport};
use vitruvian_conformance::audit::variant::report::{DiffReport, PlanReport};

/// Files of `docs/`, each with the text of its schema.
///
/// Made for what is written: every field is there, and what is absent is null.
pub fn files() -> [(&'static str, String); 4] {
    [
        ("audit.schema.json", text::<Audit>()),
        ("audit.diff.schema.json", text::<DiffReport>()),
        ("audit.plan.schema.json", text::<PlanReport>()),
        ("audit.passes.schema.json", text::<PassesReport>()),
    ]
}

fn text<T: JsonSchema>() -> String {
    let schema = SchemaSettings::draft2020_12().for_serialize().into_generator().into_root_schema_for::<T>();
    format!("{}\n", serde_json::to_string_pretty(&schema).expect("a schema is JSON"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_schemas_are_what_the_types_say() {
        for (file, text) in files() {
            let path = format!("{}/docs/{file}", env!("CARGO_MANIFEST_DIR"));
            let published = std::fs::read_to_string(&path).unwrap_or_default();
            assert!(published == text, "docs/{file}: run cargo run --release --example audit_schema");
        }
    }
}
