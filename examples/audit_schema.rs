//! Writes the JSON Schemas of the audit's reports into `docs/`: `cargo run --release --example audit_schema`.

fn main() -> std::io::Result<()> {
    for (file, text) in vitruvian::audit::schema::files() {
        std::fs::write(format!("{}/docs/{file}", env!("CARGO_MANIFEST_DIR")), text)?;
    }
    Ok(())
}
