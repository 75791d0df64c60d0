//! The JSON Schema of an audit's report, from the types that write it.

use schemars::generate::SchemaSettings;
use vitruvian_conformance::audit::report::Audit;

/// The schema as the file docs/audit.schema.json has it.
///
/// Made for what is written: every field is there, and what is absent is null.
pub fn text() -> String {
    let schema =
        SchemaSettings::draft2020_12().for_serialize().into_generator().into_root_schema_for::<Audit>();
    serde_json::to_string_pretty(&schema).expect("a schema is JSON")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_schema_is_what_the_types_say() {
        let published = include_str!("../../docs/audit.schema.json");
        assert_eq!(
            published.trim_end(),
            text(),
            "run: cargo run --release --example audit_schema > docs/audit.schema.json"
        );
    }
}
