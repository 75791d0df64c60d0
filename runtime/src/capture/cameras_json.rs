//! `cameras.json`: `{"cameras":[{"name","width","height","K","R","t","distortion"}]}`.

use std::path::Path;

use serde_json::{Map, Value};

use super::camera::{Camera, Extrinsics};
use crate::error::{Error, Result};
use crate::file;

/// A rig of thousands of cameras fits; anything larger is not a cameras file.
const MAX_BYTES: u64 = 16 << 20;

const KEYS: [&str; 7] = ["name", "width", "height", "K", "R", "t", "distortion"];

/// What people write for the keys above: read as data they would silently mean "no distortion", "no extrinsics".
const MISNOMERS: [(&str, &str); 9] = [
    ("k", "K"),
    ("intrinsics", "K"),
    ("intrinsic", "K"),
    ("r", "R"),
    ("T", "t"),
    ("dist", "distortion"),
    ("D", "distortion"),
    ("distortions", "distortion"),
    ("dist_coeffs", "distortion"),
];

/// Reads the cameras of `path`, in the file's order.
///
/// "R" and "t" may be absent together (unknown extrinsics), "distortion" may be absent (pinhole).
///
/// # Errors
/// The file cannot be read, is no JSON, or a camera in it fails [`Camera::check`]; the message names the camera.
pub fn read(path: &Path) -> Result<Vec<Camera>> {
    let text = file::read_text(path, MAX_BYTES)?;
    parse(path, &text)
}

/// As [`read`], from text; `path` is named in errors only.
///
/// # Errors
/// As [`read`].
pub fn parse(path: &Path, text: &str) -> Result<Vec<Camera>> {
    let root: Value = serde_json::from_str(&null_for_nan(text))
        .map_err(|e| Error::file(path, format!("not valid JSON: {e}")))?;
    let expected = "expected {\"cameras\": [{\"name\", \"width\", \"height\", \"K\", …}, …]}";
    let list = root
        .get("cameras")
        .and_then(Value::as_array)
        .ok_or_else(|| Error::file(path, format!("holds no list \"cameras\"; {expected}")))?;
    if list.is_empty() {
        return Err(Error::file(path, format!("its list \"cameras\" is empty; {expected}")));
    }
    let mut cameras: Vec<Camera> = Vec::with_capacity(list.len());
    for (i, entry) in list.iter().enumerate() {
        let entry = entry
            .as_object()
            .ok_or_else(|| Error::file(path, format!("cameras[{i}] is no object; {expected}")))?;
        let name = match entry.get("name") {
            Some(Value::String(name)) => name.clone(),
            _ => return Err(Error::file(path, format!("cameras[{i}] has no text \"name\"; {expected}"))),
        };
        let camera = camera(name.clone(), entry).and_then(|c| c.check().map(|()| c));
        let camera = camera.map_err(|message| Error::camera(path, &name, message))?;
        if cameras.iter().any(|c| c.name == name) {
            return Err(Error::camera(path, &name, "two cameras have this name: give each its own"));
        }
        cameras.push(camera);
    }
    Ok(cameras)
}

fn camera(name: String, entry: &Map<String, Value>) -> std::result::Result<Camera, String> {
    for (wrong, right) in MISNOMERS {
        if entry.contains_key(wrong) {
            return Err(format!("has a key \"{wrong}\", which nothing reads; write it as \"{right}\""));
        }
    }
    let whole = |key: &str| match entry.get(key) {
        None => {
            Err(format!("has no \"{key}\"; expected the image's {key} in pixels (keys: {})", KEYS.join(", ")))
        }
        Some(value) => value
            .as_u64()
            .and_then(|n| u32::try_from(n).ok())
            .ok_or_else(|| format!("\"{key}\" is {}; expected a whole number of pixels", brief(value))),
    };
    let (width, height) = (whole("width")?, whole("height")?);
    let k = matrix(entry, "K")?
        .ok_or("has no \"K\"; expected the 3×3 intrinsic matrix [[f_x,0,c_x],[0,f_y,c_y],[0,0,1]]")?;
    let extrinsics = match (matrix(entry, "R")?, numbers::<3>(entry, "t")?) {
        (Some(r), Some(t)) => Some(Extrinsics { r, t }),
        (None, None) => None,
        (Some(_), None) => return Err("has \"R\" but no \"t\"; give both, or neither if unknown".into()),
        (None, Some(_)) => return Err("has \"t\" but no \"R\"; give both, or neither if unknown".into()),
    };
    let distortion = numbers::<5>(entry, "distortion")?.unwrap_or_default();
    Ok(Camera { name, width, height, k, extrinsics, distortion })
}

/// The 3×3 matrix at `key` (`None` if the key is absent or null).
fn matrix(entry: &Map<String, Value>, key: &str) -> std::result::Result<Option<[[f64; 3]; 3]>, String> {
    let Some(value) = entry.get(key).filter(|v| !v.is_null()) else { return Ok(None) };
    let wrong = || format!("\"{key}\" is {}; expected three rows of three numbers", brief(value));
    let rows = value.as_array().filter(|rows| rows.len() == 3).ok_or_else(wrong)?;
    let mut m = [[0.0; 3]; 3];
    for (i, row) in rows.iter().enumerate() {
        let row = row.as_array().filter(|row| row.len() == 3).ok_or_else(wrong)?;
        for (j, x) in row.iter().enumerate() {
            m[i][j] = number(x).ok_or_else(wrong)?;
        }
    }
    Ok(Some(m))
}

fn numbers<const N: usize>(
    entry: &Map<String, Value>,
    key: &str,
) -> std::result::Result<Option<[f64; N]>, String> {
    let Some(value) = entry.get(key).filter(|v| !v.is_null()) else { return Ok(None) };
    let wrong = || format!("\"{key}\" is {}; expected {N} numbers", brief(value));
    let list = value.as_array().filter(|list| list.len() == N).ok_or_else(wrong)?;
    let mut out = [0.0; N];
    for (o, x) in out.iter_mut().zip(list) {
        *o = number(x).ok_or_else(wrong)?;
    }
    Ok(Some(out))
}

/// A number, or NaN for the `null` that stands for one (see [`null_for_nan`]); [`Camera::check`] refuses it by name.
fn number(value: &Value) -> Option<f64> {
    if value.is_null() { Some(f64::NAN) } else { value.as_f64() }
}

fn brief(value: &Value) -> String {
    let text = value.to_string();
    match text.char_indices().nth(60) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text,
    }
}

/// Replaces the bare words NaN, Infinity and -Infinity by null.
///
/// They are no JSON, but Python writes them; read as null they can be reported with the camera's name instead
/// of a byte position.
fn null_for_nan(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    let mut in_string = false;
    while let Some(c) = rest.chars().next() {
        if in_string {
            let end = if c == '\\' {
                rest.char_indices().nth(2).map_or(rest.len(), |(i, _)| i)
            } else {
                c.len_utf8()
            };
            in_string = c != '"';
            out.push_str(&rest[..end]);
            rest = &rest[end..];
            continue;
        }
        if let Some(word) = ["NaN", "-Infinity", "Infinity"].iter().find(|w| rest.starts_with(**w)) {
            out.push_str("null");
            rest = &rest[word.len()..];
            continue;
        }
        in_string = c == '"';
        out.push(c);
        rest = &rest[c.len_utf8()..];
    }
    out
}

/// The text of a `cameras.json`; numbers survive reading bit for bit.
///
/// "R", "t" and "distortion" are left out where they are unknown or zero.
pub fn to_text(cameras: &[Camera]) -> String {
    let lines: Vec<String> = cameras
        .iter()
        .map(|c| {
            let mut fields = vec![
                format!("\"name\": {}", Value::from(c.name.as_str())),
                format!("\"width\": {}, \"height\": {}", c.width, c.height),
                format!("\"K\": {}", serde_json::json!(c.k)),
            ];
            if let Some(e) = &c.extrinsics {
                fields.push(format!("\"R\": {}", serde_json::json!(e.r)));
                fields.push(format!("\"t\": {}", serde_json::json!(e.t)));
            }
            if !c.is_pinhole() {
                fields.push(format!("\"distortion\": {}", serde_json::json!(c.distortion)));
            }
            format!("    {{{}}}", fields.join(",\n     "))
        })
        .collect();
    format!("{{\n  \"cameras\": [\n{}\n  ]\n}}\n", lines.join(",\n"))
}

#[cfg(test)]
mod tests {
    use super::super::camera::tests::camera;
    use super::*;
    use proptest::prelude::*;

    fn error(text: &str) -> String {
        parse(Path::new("cameras.json"), text).expect_err("a fault was planted").to_string()
    }

    #[test]
    fn writing_then_reading_returns_the_same_bits() {
        let mut second = camera([3.0, 0.1, 1.0 / 3.0]);
        second.name = "left \"side\" é".into();
        second.distortion = [0.1, -0.02, 1e-17, 0.0, 1.0 / 3.0];
        let mut third = camera([0.0, 1.0, -3.0]);
        third.name = "back".into();
        third.extrinsics = None;
        let cameras = vec![camera([0.1, 0.7, 2.9]), second, third];
        assert_eq!(parse(Path::new("x"), &to_text(&cameras)).unwrap(), cameras);
    }

    #[test]
    fn faults_name_the_camera_and_the_key() {
        let good = to_text(&[camera([0.0, 1.0, 3.0])]);
        assert!(error(&good.replace("\"K\"", "\"Q\"")).contains("camera \"front\": has no \"K\""));
        assert!(error(&good.replace("161.0", "NaN")).contains("camera \"front\": K[0][2] is NaN"));
        assert!(error(&good.replace("161.0", "-Infinity")).contains("camera \"front\": K[0][2] is NaN"));
        assert!(error(&good.replace("161.0", "\"161\"")).contains("three rows of three numbers"));
        assert!(error(&good.replace("\"t\"", "\"T\"")).contains("write it as \"t\""));
        assert!(error(&good.replace("\"R\"", "\"Rotation\"")).contains("has \"t\" but no \"R\""));
        assert!(error(&good.replace("320", "320.5")).contains("whole number"));
        assert!(error("{}").contains("no list \"cameras\""));
        assert!(error("{\"cameras\": []}").contains("empty"));
        assert!(error("{\"cameras\": [{}]}").contains("cameras[0] has no text \"name\""));
        let twice = to_text(&[camera([0.0, 1.0, 3.0]), camera([0.0, 1.0, 3.0])]);
        assert!(error(&twice).contains("two cameras"));
    }

    #[test]
    fn the_word_nan_inside_a_name_is_left_alone() {
        let mut c = camera([0.0, 1.0, 3.0]);
        c.name = "NaN \\\" Infinity".replace('\\', "");
        assert_eq!(parse(Path::new("x"), &to_text(std::slice::from_ref(&c))).unwrap(), vec![c]);
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in ".{0,200}", cut in 0usize..700, junk in any::<u8>()) {
            let _ = parse(Path::new("x"), &text);
            let mut bytes = to_text(&[camera([0.0, 1.0, 3.0])]).into_bytes();
            let at = cut % bytes.len();
            bytes[at] = junk;
            let _ = parse(Path::new("x"), &String::from_utf8_lossy(&bytes));
            bytes.truncate(at);
            let _ = parse(Path::new("x"), &String::from_utf8_lossy(&bytes));
        }
    }
}
