//! Wavefront OBJ: positions and faces.
//!
//! # Why not tobj for reading?
//! It renumbers vertices in order of use, drops unused ones and splits the mesh at every material, so that a
//! closed surface with two materials comes back torn, and a truth mesh loses its correspondence with the body's
//! vertices. Extreme indices overflow in it. The tests use it to judge what is written here.

use std::io::Write;
use std::path::Path;

use super::atomic;
use crate::error::{Error, Result};
use crate::mesh::Mesh;

/// Larger files (about ten million vertices) are refused.
const MAX_BYTES: u64 = 1 << 30;

/// Writes vertices and faces atomically; coordinates carry as many digits as bring the same f32 back.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(path: &Path, mesh: &Mesh) -> Result<()> {
    atomic::write_with(path, |out| {
        for v in &mesh.vertices {
            writeln!(out, "v {} {} {}", v[0], v[1], v[2])?;
        }
        for f in &mesh.faces {
            writeln!(out, "f {} {} {}", u64::from(f[0]) + 1, u64::from(f[1]) + 1, u64::from(f[2]) + 1)?;
        }
        Ok(())
    })
}

/// Reads all objects of `path` as one mesh, every vertex at its place in the file.
///
/// Polygons become fans of triangles. Normals, texture coordinates, vertex colours, materials, groups, points
/// and lines are passed over.
///
/// # Errors
/// The file cannot be read, is larger than 1 GiB, holds no faces, or has a line that cannot be read or names a
/// vertex that it does not hold; the message gives the line's number.
pub fn read(path: &Path) -> Result<Mesh> {
    parse(&super::read_bytes(path, MAX_BYTES)?).map_err(|message| Error::file(path, message))
}

/// As [`read`], from bytes.
///
/// # Errors
/// One sentence with what was found and what was expected.
pub fn parse(bytes: &[u8]) -> std::result::Result<Mesh, String> {
    let mut mesh = Mesh::default();
    let mut face_lines = Vec::new();
    for (number, line) in logical_lines(bytes) {
        // Names and comments may be in any encoding; the lines that matter are plain ASCII.
        let Ok(text) = std::str::from_utf8(&line) else { continue };
        let text = text.split('#').next().unwrap_or("");
        let mut words = text.split_ascii_whitespace();
        match words.next() {
            Some("v") => {
                let mut v = [0.0f32; 3];
                for x in &mut v {
                    let value = words.next().and_then(|w| w.parse::<f32>().ok()).filter(|x| x.is_finite());
                    *x = value.ok_or_else(|| {
                        format!(
                            "line {number}: expected v and three finite numbers, found \"{}\"",
                            text.trim()
                        )
                    })?;
                }
                mesh.vertices.push(v);
            }
            // A face may stand before its vertices, but its negative indices count from where it stands.
            Some("f") => {
                let corners: Option<Vec<i64>> = words.map(|w| corner(w, mesh.vertices.len())).collect();
                let corners = corners.filter(|c| c.len() >= 3).ok_or_else(|| {
                    format!(
                        "line {number}: expected f and at least three vertex numbers, found \"{}\"",
                        text.trim()
                    )
                })?;
                face_lines.push((number, corners));
            }
            _ => {}
        }
    }
    let count = mesh.vertices.len();
    for (number, corners) in face_lines {
        let mut face = Vec::with_capacity(corners.len());
        for index in corners {
            let valid = u32::try_from(index).ok().filter(|&i| (i as usize) < count);
            face.push(valid.ok_or_else(|| {
                format!(
                    "line {number}: the face names vertex {}, but there are {count}",
                    index.saturating_add(1)
                )
            })?);
        }
        mesh.faces.extend((1..face.len() - 1).map(|i| [face[0], face[i], face[i + 1]]));
    }
    if mesh.faces.is_empty() {
        return Err(format!("holds {count} vertices and no faces; expected a Wavefront OBJ surface"));
    }
    Ok(mesh)
}

/// The zero-based vertex of a corner `v`, `v/vt`, `v//vn` or `v/vt/vn`; negative numbers count back from `count`.
fn corner(word: &str, count: usize) -> Option<i64> {
    let number: i64 = word.split('/').next()?.parse().ok()?;
    match number {
        0 => None,
        1.. => Some(number - 1),
        _ => number.checked_add(i64::try_from(count).ok()?),
    }
}

/// Lines with their numbers from 1; a backslash at the end joins a line to the next.
fn logical_lines(bytes: &[u8]) -> impl Iterator<Item = (usize, Vec<u8>)> {
    let mut lines = bytes.split(|&b| b == b'\n').enumerate();
    std::iter::from_fn(move || {
        let (number, first) = lines.next()?;
        let mut line = first.strip_suffix(b"\r").unwrap_or(first).to_vec();
        while line.last() == Some(&b'\\') {
            line.pop();
            let Some((_, next)) = lines.next() else { break };
            line.push(b' ');
            line.extend(next.strip_suffix(b"\r").unwrap_or(next));
        }
        Some((number + 1, line))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::{cube, sphere};
    use proptest::prelude::*;

    #[test]
    fn writing_then_reading_returns_the_same_bits_here_and_in_tobj() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        for mesh in [cube(), sphere(1.0 / 3.0, [0.1, 1e-7, -1e5], 8)] {
            write(&path, &mesh).unwrap();
            assert_eq!(read(&path).unwrap(), mesh);
            let (models, _) = tobj::load_obj(&path, &tobj::LoadOptions::default()).unwrap();
            let judged = &models[0].mesh;
            for (ours, theirs) in mesh.faces.iter().flatten().zip(&judged.indices) {
                let at = 3 * *theirs as usize;
                assert_eq!(mesh.vertices[*ours as usize], judged.positions[at..at + 3]);
            }
            assert_eq!(judged.indices.len(), 3 * mesh.faces.len());
        }
    }

    #[test]
    fn polygons_fan_negative_numbers_count_back_and_materials_do_not_split() {
        let text = b"# caf\xe9\nmtllib x.mtl\nv 0 0 0\nv 1 0 0 1.0\nv 1 1 0 0.5 0.5 0.5\r\nv 0 1 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2//1 \\\n3/2 4\nusemtl b\nf -4 -2 -1\n";
        let mesh = parse(text).unwrap();
        assert_eq!(mesh.vertices.len(), 4);
        assert_eq!(mesh.faces, [[0, 1, 2], [0, 2, 3], [0, 2, 3]]);
    }

    #[test]
    fn faults_name_the_line() {
        let fault = |text: &str| parse(text.as_bytes()).unwrap_err();
        assert!(fault("v 0 0\n").contains("line 1"));
        assert!(fault("v 0 0 nan\n").contains("line 1"));
        assert!(fault("v 0 0 0\nf 1 1\n").contains("line 2"));
        assert!(fault("v 0 0 0\nf 1 1 2\n").contains("names vertex 2, but there are 1"));
        assert!(fault("v 0 0 0\nf 1 1 0\n").contains("line 2"));
        assert!(fault("v 0 0 0\nf -2 1 1\n").contains("line 2"));
        assert!(fault("f 9223372036854775807 1 -9223372036854775808\n").contains("line 1"));
        assert!(fault("PNG and so on").contains("no faces"));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(
            bytes in proptest::collection::vec(any::<u8>(), 0..200),
            lines in proptest::collection::vec("[vf#\\\\]{1} ?[-0-9/. e]{0,20}", 0..20),
        ) {
            let _ = parse(&bytes);
            if let Ok(mesh) = parse(lines.join("\n").as_bytes()) {
                prop_assert!(mesh.check().is_ok());
            }
        }
    }
}
