//! Stanford PLY: written binary little-endian, read in all three formats.
//!
//! # References
//! Turk, "The PLY Polygon File Format" (1994): a text header of elements and their properties, then their values in
//! that order, as text or packed.

use std::io::Write;
use std::path::Path;

use super::atomic;
use crate::error::{Error, Result};
use crate::mesh::Mesh;

/// Larger files (about ten million vertices) are refused.
const MAX_BYTES: u64 = 1 << 30;

/// Longer headers are no headers.
const MAX_HEADER_LINES: usize = 1000;

/// A mesh with the colours that a file may carry.
#[derive(Clone, Debug, PartialEq)]
pub struct Colored {
    /// The surface.
    pub mesh: Mesh,
    /// V colours (red, green, blue), if the file has 8-bit ones.
    pub colors: Option<Vec<[u8; 3]>>,
}

/// Writes a mesh atomically, binary little-endian, with one colour per vertex if given.
///
/// # Errors
/// As [`atomic::write`].
///
/// # Panics
/// If there are not as many colours as vertices.
pub fn write(path: &Path, mesh: &Mesh, colors: Option<&[[u8; 3]]>) -> Result<()> {
    if let Some(colors) = colors {
        let (c, v) = (colors.len(), mesh.vertices.len());
        assert_eq!(c, v, "ply: {c} colours for {v} vertices");
    }
    atomic::write_with(path, |out| {
        writeln!(out, "ply\nformat binary_little_endian 1.0\nelement vertex {}", mesh.vertices.len())?;
        writeln!(out, "property float x\nproperty float y\nproperty float z")?;
        if colors.is_some() {
            writeln!(out, "property uchar red\nproperty uchar green\nproperty uchar blue")?;
        }
        writeln!(
            out,
            "element face {}\nproperty list uchar uint vertex_indices\nend_header",
            mesh.faces.len()
        )?;
        for (i, v) in mesh.vertices.iter().enumerate() {
            for x in v {
                out.write_all(&x.to_le_bytes())?;
            }
            if let Some(colors) = colors {
                out.write_all(&colors[i])?;
            }
        }
        for f in &mesh.faces {
            out.write_all(&[3])?;
            for i in f {
                out.write_all(&i.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

/// Reads the surface of `path`: ASCII or binary, polygons as fans of triangles.
///
/// # Errors
/// The file cannot be read, is larger than 1 GiB, is no PLY with vertices and faces, is truncated, or a face names a
/// vertex that it does not hold.
pub fn read(path: &Path) -> Result<Colored> {
    parse(&super::read_bytes(path, MAX_BYTES)?).map_err(|message| Error::file(path, message))
}

/// As [`read`], from bytes.
///
/// # Errors
/// One sentence with what was found and what was expected.
pub fn parse(bytes: &[u8]) -> std::result::Result<Colored, String> {
    let (header, data) = Header::split(bytes)?;
    let mut values = Values { data, at: 0, encoding: header.encoding };
    let (mut vertices, mut colors, mut faces) = (Vec::new(), Vec::new(), Vec::new());
    let mut seen = [false; 2];
    for element in &header.elements {
        let truncated = |i: usize| {
            format!("ends in {} {i} of {}: it is truncated or damaged", element.name, element.count)
        };
        let position =
            |name: &str| element.properties.iter().position(|p| p.name == name && p.length.is_none());
        match element.name.as_str() {
            "vertex" => {
                let xyz = [position("x"), position("y"), position("z")];
                let [Some(x), Some(y), Some(z)] = xyz else {
                    return Err("its vertices have no properties x, y and z".into());
                };
                let rgb = [position("red"), position("green"), position("blue")];
                let rgb = match rgb {
                    [Some(r), Some(g), Some(b)] if element.properties[r].kind == Kind::U8 => Some([r, g, b]),
                    _ => None,
                };
                let mut row = Vec::new();
                for i in 0..element.count {
                    values.row(element, &mut row).ok_or_else(|| truncated(i))?;
                    let v = [x, y, z].map(|k| row[k] as f32);
                    if v.iter().any(|x| !x.is_finite()) {
                        return Err(format!("vertex {i} is {v:?}; expected three finite numbers"));
                    }
                    vertices.push(v);
                    if let Some(rgb) = rgb {
                        colors.push(rgb.map(|k| row[k] as u8));
                    }
                }
                seen[0] = true;
            }
            "face" => {
                let corners = element.properties.iter().position(|p| {
                    p.length.is_some() && (p.name == "vertex_indices" || p.name == "vertex_index")
                });
                let corners = corners.ok_or("its faces have no list vertex_indices")?;
                for i in 0..element.count {
                    let list = values.list(element, corners).ok_or_else(|| truncated(i))?;
                    if list.len() < 3 {
                        return Err(format!("face {i} has {} corners, expected at least 3", list.len()));
                    }
                    for k in 1..list.len() - 1 {
                        faces.push([list[0], list[k], list[k + 1]]);
                    }
                }
                seen[1] = true;
            }
            _ => {
                let mut row = Vec::new();
                for i in 0..element.count {
                    values.row(element, &mut row).ok_or_else(|| truncated(i))?;
                }
            }
        }
    }
    if seen != [true; 2] || faces.is_empty() {
        return Err(format!(
            "holds {} vertices and {} faces; expected a surface",
            vertices.len(),
            faces.len()
        ));
    }
    let count = vertices.len();
    let index = |x: f64| (x >= 0.0 && x < count as f64 && x.fract() == 0.0).then_some(x as u32);
    let faces = faces
        .iter()
        .map(|f| match f.map(index) {
            [Some(a), Some(b), Some(c)] => Ok([a, b, c]),
            _ => Err(format!("a face names the vertices {f:?}, but there are {count}")),
        })
        .collect::<std::result::Result<_, _>>()?;
    let colors = (!colors.is_empty()).then_some(colors);
    Ok(Colored { mesh: Mesh { vertices, faces }, colors })
}

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Kind {
    fn named(word: &str) -> Option<Kind> {
        Some(match word {
            "char" | "int8" => Kind::I8,
            "uchar" | "uint8" => Kind::U8,
            "short" | "int16" => Kind::I16,
            "ushort" | "uint16" => Kind::U16,
            "int" | "int32" => Kind::I32,
            "uint" | "uint32" => Kind::U32,
            "float" | "float32" => Kind::F32,
            "double" | "float64" => Kind::F64,
            _ => return None,
        })
    }
}

struct Property {
    name: String,
    kind: Kind,
    /// The type of a list's length; `None` for a single value.
    length: Option<Kind>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
}

impl Header {
    fn split(bytes: &[u8]) -> std::result::Result<(Header, &[u8]), String> {
        let mut rest = bytes;
        let mut line = || -> Option<&str> {
            let end = rest.iter().position(|&b| b == b'\n')?;
            let text = std::str::from_utf8(&rest[..end]).ok()?.trim_end();
            rest = &rest[end + 1..];
            Some(text)
        };
        if line() != Some("ply") {
            return Err("is no PLY file (its first line is not \"ply\")".into());
        }
        let (mut encoding, mut elements) = (None, Vec::<Element>::new());
        for _ in 0..MAX_HEADER_LINES {
            let text = line().ok_or("its PLY header does not end")?;
            let wrong = || {
                format!(
                    "its PLY header holds \"{}\", which cannot be read",
                    text.chars().take(60).collect::<String>()
                )
            };
            let words: Vec<&str> = text.split_ascii_whitespace().collect();
            match words[..] {
                ["comment" | "obj_info", ..] | [] => {}
                ["format", name, "1.0"] => {
                    encoding = Some(match name {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::Little,
                        "binary_big_endian" => Encoding::Big,
                        _ => return Err(wrong()),
                    });
                }
                ["element", name, count] => {
                    let count = count.parse().map_err(|_| wrong())?;
                    elements.push(Element { name: name.into(), count, properties: Vec::new() });
                }
                ["property", "list", length, kind, name] => {
                    let (length, kind) = (Kind::named(length), Kind::named(kind));
                    let property = Property {
                        name: name.into(),
                        kind: kind.ok_or_else(wrong)?,
                        length: Some(length.ok_or_else(wrong)?),
                    };
                    elements.last_mut().ok_or_else(wrong)?.properties.push(property);
                }
                ["property", kind, name] => {
                    let kind = Kind::named(kind).ok_or_else(wrong)?;
                    let property = Property { name: name.into(), kind, length: None };
                    elements.last_mut().ok_or_else(wrong)?.properties.push(property);
                }
                ["end_header"] => {
                    let encoding = encoding.ok_or("its PLY header names no format")?;
                    // Without properties an item takes no bytes, and a count could be anything.
                    if let Some(e) = elements.iter().find(|e| e.properties.is_empty() && e.count > 0) {
                        return Err(format!("its element {} has no properties", e.name));
                    }
                    return Ok((Header { encoding, elements }, rest));
                }
                _ => return Err(wrong()),
            }
        }
        Err(format!("its PLY header has more than {MAX_HEADER_LINES} lines"))
    }
}

/// The values after the header, one after the other; every item consumes bytes, so their number bounds the work.
struct Values<'a> {
    data: &'a [u8],
    at: usize,
    encoding: Encoding,
}

impl Values<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let bytes: [u8; N] = self.data.get(self.at..self.at.checked_add(N)?)?.try_into().ok()?;
        self.at += N;
        let mut bytes = bytes;
        if self.encoding == Encoding::Big {
            bytes.reverse();
        }
        Some(bytes)
    }

    fn number(&mut self, kind: Kind) -> Option<f64> {
        if self.encoding == Encoding::Ascii {
            let start = self.at + self.data[self.at..].iter().position(|b| !b.is_ascii_whitespace())?;
            let length = self.data[start..].iter().position(u8::is_ascii_whitespace);
            self.at = length.map_or(self.data.len(), |n| start + n);
            let word = std::str::from_utf8(&self.data[start..self.at]).ok()?;
            // A float is rounded once, from its decimal digits.
            return if kind == Kind::F32 {
                word.parse::<f32>().ok().map(f64::from)
            } else {
                word.parse().ok()
            };
        }
        Some(match kind {
            Kind::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Kind::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Kind::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Kind::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Kind::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Kind::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Kind::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Kind::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    fn items(&mut self, property: &Property) -> Option<Vec<f64>> {
        let count = match property.length {
            None => 1,
            Some(kind) => {
                let n = self.number(kind)?;
                // Every item takes at least one byte: a longer list cannot be there.
                (n >= 0.0 && n <= (self.data.len() - self.at) as f64).then_some(n as usize)?
            }
        };
        (0..count).map(|_| self.number(property.kind)).collect()
    }

    /// The single values of one item in the order of its properties; a list stands as its first entry, or NaN.
    fn row(&mut self, element: &Element, row: &mut Vec<f64>) -> Option<()> {
        row.clear();
        for property in &element.properties {
            match property.length {
                None => row.push(self.number(property.kind)?),
                Some(_) => row.push(self.items(property)?.first().copied().unwrap_or(f64::NAN)),
            }
        }
        Some(())
    }

    /// One list of one item.
    fn list(&mut self, element: &Element, wanted: usize) -> Option<Vec<f64>> {
        let mut found = Vec::new();
        for (i, property) in element.properties.iter().enumerate() {
            let items = self.items(property)?;
            if i == wanted {
                found = items;
            }
        }
        Some(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::{cube, sphere};
    use proptest::prelude::*;

    fn bytes(mesh: &Mesh, colors: Option<&[[u8; 3]]>) -> Vec<u8> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.ply");
        write(&path, mesh, colors).unwrap();
        std::fs::read(path).unwrap()
    }

    #[test]
    fn writing_then_reading_returns_the_same_bits_and_colours() {
        let mesh = sphere(1.0 / 3.0, [0.1, 1e-7, -1e5], 8);
        let colors: Vec<[u8; 3]> = (0..mesh.vertices.len()).map(|i| [i as u8, 7, 255 - i as u8]).collect();
        assert_eq!(parse(&bytes(&mesh, None)).unwrap(), Colored { mesh: mesh.clone(), colors: None });
        let found = parse(&bytes(&mesh, Some(&colors))).unwrap();
        assert_eq!(found, Colored { mesh, colors: Some(colors) });
    }

    #[test]
    fn ascii_and_big_endian_polygons_and_foreign_elements_are_read() {
        let header = |format: &str| {
            format!(
                "ply\r\nformat {format} 1.0\ncomment made by hand\nelement camera 1\nproperty list uchar short q\nelement vertex 4\nproperty double x\nproperty double y\nproperty double z\nproperty float quality\nelement face 1\nproperty uchar flags\nproperty list uchar int vertex_index\nend_header\n"
            )
        };
        let square = Mesh {
            vertices: vec![[0.0; 3], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.1]],
            faces: vec![[0, 1, 2], [0, 2, 3]],
        };
        let ascii = header("ascii") + "2 -5 6\n0 0 0 9\n1 0 0 9\n1 1 0 9\n0 1 1e-1 9\n7 4 0 1 2 3";
        assert_eq!(parse(ascii.as_bytes()).unwrap().mesh, square);
        let mut big = header("binary_big_endian").into_bytes();
        big.extend([2, 0, 5, 0, 6]);
        for v in &square.vertices {
            for x in v {
                big.extend(f64::from(*x).to_be_bytes());
            }
            big.extend(9f32.to_be_bytes());
        }
        big.extend([7, 4]);
        big.extend([0i32, 1, 2, 3].iter().flat_map(|i| i.to_be_bytes()));
        assert_eq!(parse(&big).unwrap().mesh, square);
    }

    #[test]
    fn truncated_and_lying_files_are_refused_by_name() {
        let whole = bytes(&cube(), None);
        assert!(parse(&whole[..whole.len() - 1]).unwrap_err().contains("ends in face 11 of 12"));
        let text = String::from_utf8_lossy(&whole[..200]).into_owned();
        let header = &text[..text.find("end_header\n").unwrap() + 11];
        let lie = header.replace("vertex 8", "vertex 99999999999999");
        let mut bytes = lie.into_bytes();
        bytes.extend(&whole[header.len()..]);
        assert!(parse(&bytes).unwrap_err().contains("truncated"));
        let mut stray = whole.clone();
        let last = stray.len() - 4;
        stray[last..].copy_from_slice(&8u32.to_le_bytes());
        assert!(parse(&stray).unwrap_err().contains("names the vertices"));
        assert!(parse(b"OFF\n").unwrap_err().contains("no PLY"));
    }

    proptest! {
        #[test]
        fn damaged_files_never_panic(at in any::<usize>(), to in any::<u8>(), cut in any::<usize>()) {
            let mut whole = bytes(&cube(), None);
            let n = whole.len();
            whole[at % n] = to;
            let _ = parse(&whole);
            whole.truncate(cut % n);
            let _ = parse(&whole);
        }
    }
}
