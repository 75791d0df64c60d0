//! Running the command, and the files that the tests begin with.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;
use vitruvian_runtime::file;
use vitruvian_runtime::mesh::Mesh;

/// How a run ended.
#[derive(Debug)]
pub struct Outcome {
    /// The exit status.
    pub status: i32,
    /// Standard output.
    pub out: String,
    /// Standard error.
    pub err: String,
}

impl Outcome {
    /// The run, if it ended well.
    pub fn done(self) -> Outcome {
        assert_eq!(self.status, 0, "{}", self.err);
        self
    }

    /// Standard output as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_str(&self.out).unwrap_or_else(|error| panic!("{error}: {}", self.out))
    }
}

/// Runs `vitruvian` with these words in the source tree's root.
pub fn vitruvian<S: AsRef<std::ffi::OsStr>>(words: &[S]) -> Outcome {
    let run = Command::new(env!("CARGO_BIN_EXE_vitruvian"))
        .args(words)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("the built command starts");
    Outcome {
        status: run.status.code().expect("it ends by itself"),
        out: String::from_utf8(run.stdout).expect("UTF-8"),
        err: String::from_utf8(run.stderr).expect("UTF-8"),
    }
}

/// A path as a word of a command.
pub fn word(path: &Path) -> &str {
    path.to_str().expect("a temporary path is UTF-8")
}

/// An empty folder that goes when the test ends.
pub fn folder() -> TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

/// The committed graphs.
pub fn models() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("models/exported")
}

/// A capture of the mannequin in `folder`, with the truth.
pub fn capture(folder: &Path) -> PathBuf {
    vitruvian(&["synthesize", "-o", word(folder), "--count", "1", "--seed", "20"]).done();
    folder.join("0000")
}

/// Everything below a folder, sorted.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).expect("a folder") {
        let path = entry.expect("an entry").path();
        if path.is_dir() { found.extend(files(&path)) } else { found.push(path) }
    }
    found.sort();
    found
}

/// A sphere of `rings` latitudes with outward faces, written to `path`.
pub fn sphere(path: &Path, radius: f64, centre: [f64; 3], rings: u32) {
    let sectors = 2 * rings;
    let at = |theta: f64, phi: f64| {
        let unit = [theta.sin() * phi.cos(), theta.cos(), -theta.sin() * phi.sin()];
        std::array::from_fn(|a| (centre[a] + radius * unit[a]) as f32)
    };
    let mut mesh = Mesh { vertices: vec![at(0.0, 0.0)], faces: Vec::new() };
    for ring in 1..rings {
        for sector in 0..sectors {
            mesh.vertices.push(at(
                PI * f64::from(ring) / f64::from(rings),
                2.0 * PI * f64::from(sector) / f64::from(sectors),
            ));
        }
    }
    mesh.vertices.push(at(PI, 0.0));
    let last = mesh.vertices.len() as u32 - 1;
    let number = |ring: u32, sector: u32| 1 + (ring - 1) * sectors + sector % sectors;
    for s in 0..sectors {
        mesh.faces.push([0, number(1, s), number(1, s + 1)]);
        for r in 1..rings - 1 {
            mesh.faces.push([number(r, s), number(r + 1, s), number(r + 1, s + 1)]);
            mesh.faces.push([number(r, s), number(r + 1, s + 1), number(r, s + 1)]);
        }
        mesh.faces.push([number(rings - 1, s), last, number(rings - 1, s + 1)]);
    }
    file::mesh::write(path, file::mesh::Format::of(path).expect("a mesh's extension"), &mesh, None)
        .expect("a writable folder");
}
