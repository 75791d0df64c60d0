//! Files in and out: meshes, arrays, body models and their parameters, keypoints; every reader is bounded and every write atomic.

pub mod atomic;
pub mod body;
pub mod glb;
pub mod keypoints;
pub mod mesh;
pub mod npy;
pub mod npz;
pub mod obj;
pub mod params;
pub mod ply;

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// All bytes of `path`, or an error if there are more than `limit`.
///
/// # Errors
/// The file cannot be read, or is larger than `limit` bytes.
pub fn read_bytes(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let file = File::open(path).map_err(|e| Error::io(path, e))?;
    let mut bytes = Vec::new();
    // One byte beyond the limit tells a file that fills it from one that exceeds it; the size that the system
    // reports is not trusted, since pipes and devices report none.
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(|e| Error::io(path, e))?;
    if bytes.len() as u64 > limit {
        return Err(Error::file(
            path,
            format!("is larger than the {limit} bytes that are read from such a file"),
        ));
    }
    Ok(bytes)
}

/// As [`read_bytes`], as UTF-8 text without a byte order mark.
///
/// # Errors
/// As [`read_bytes`], or the bytes are no UTF-8.
pub fn read_text(path: &Path, limit: u64) -> Result<String> {
    let text = String::from_utf8(read_bytes(path, limit)?).map_err(|e| {
        Error::file(path, format!("is no UTF-8 text (byte {})", e.utf8_error().valid_up_to()))
    })?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_larger_than_the_limit_is_refused_and_one_that_fills_it_is_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, [7; 10]).unwrap();
        assert_eq!(read_bytes(&path, 10).unwrap(), [7; 10]);
        assert!(read_bytes(&path, 9).unwrap_err().to_string().contains("larger than the 9 bytes"));
    }
}
