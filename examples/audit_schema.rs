//! Prints the JSON Schema of an audit's report: `cargo run --release --example audit_schema > docs/audit.schema.json`.

fn main() {
    println!("{}", vitruvian::audit::schema::text());
}
