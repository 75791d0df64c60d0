//! The folder of exported graphs: where it is, and what is in it.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::read_bytes;

use crate::failure::Result;

/// Where the graphs lie in the source tree and in an installation.
const PLACE: &str = "models/exported";

/// ONNX files end at 2 GiB.
const MAX_BYTES: u64 = 1 << 31;

/// The folder of graphs: `given`, or the first `models/exported` from the current folder upwards, or from the
/// executable's.
pub fn find(given: Option<&Path>) -> Result<PathBuf> {
    if let Some(folder) = given {
        if folder.is_dir() {
            return Ok(folder.to_owned());
        }
        return Err(Error::Missing {
            component: "the models folder",
            message: format!(
                "{} is no folder; give --models the folder of the exported graphs",
                folder.display()
            ),
        }
        .into());
    }
    let starts = [std::env::current_dir().ok(), std::env::current_exe().ok()];
    let found = starts
        .iter()
        .flatten()
        .flat_map(|start| start.ancestors())
        .map(|a| a.join(PLACE))
        .find(|p| p.is_dir());
    found.ok_or_else(|| {
        Error::Missing {
            component: "the models folder",
            message: format!(
                "there is no {PLACE} in the current folder, beside the executable, or above them; give --models DIR, or run `make models`"
            ),
        }
        .into()
    })
}

/// Name, size and SHA-256 of the graphs that a reconstruction uses.
pub fn describe(folder: &Path, refine: bool) -> Result<Vec<Value>> {
    let mut names = vec!["mf_pifu_encoder.onnx", "mf_pifu_query.onnx"];
    if refine {
        names.extend(["vsr_encoder.onnx", "vsr_query.onnx"]);
    }
    names.into_iter().map(|name| describe_file(&folder.join(name))).collect()
}

/// Name, size and SHA-256 of one graph.
pub fn describe_file(path: &Path) -> Result<Value> {
    let bytes = read_bytes(path, MAX_BYTES)?;
    let digest: String = Sha256::digest(&bytes).iter().map(|byte| format!("{byte:02x}")).collect();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    Ok(json!({ "file": name, "bytes": bytes.len(), "sha256": digest }))
}
