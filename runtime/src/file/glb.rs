//! Binary glTF 2.0: one mesh with normals and, if given, vertex colours, for viewers.
//!
//! # References
//! Khronos, glTF 2.0 specification: §4.4 (GLB), §3.6.2 (accessors), §3.7.2 (meshes).

use std::collections::BTreeMap;
use std::path::Path;

use gltf_json::accessor::{ComponentType, GenericComponentType, Type};
use gltf_json::buffer::Target;
use gltf_json::mesh::{Mode, Primitive, Semantic};
use gltf_json::validation::Checked::Valid;
use gltf_json::validation::USize64;
use gltf_json::{Accessor, Buffer, Index, Node, Root, Scene, Value};

use super::atomic;
use crate::error::{Error, Result};
use crate::mesh::Mesh;

/// Writes a mesh atomically with POSITION, NORMAL and, if `colors` are given, COLOR_0.
///
/// glTF's axes are those of the world frame (+Y up, metres). Colours are given as displayed (sRGB) and stored linear,
/// as the format asks.
///
/// # Errors
/// The mesh has no faces or too many for the format's 4 GiB, or as [`atomic::write`].
///
/// # Panics
/// If there are not as many colours as vertices, or a face names no vertex.
pub fn write(path: &Path, mesh: &Mesh, colors: Option<&[[u8; 3]]>) -> Result<()> {
    let bytes = encode(mesh, colors).map_err(|message| Error::file(path, message))?;
    atomic::write(path, &bytes)
}

/// The file's bytes; see [`write`].
fn encode(mesh: &Mesh, colors: Option<&[[u8; 3]]>) -> std::result::Result<Vec<u8>, String> {
    if let Some(colors) = colors {
        let (c, v) = (colors.len(), mesh.vertices.len());
        assert_eq!(c, v, "glb: {c} colours for {v} vertices");
    }
    let (Some((low, high)), false) = (mesh.bounds(), mesh.faces.is_empty()) else {
        return Err("a mesh without faces cannot be written as GLB".into());
    };
    let mut file = Contents::default();
    let mut attributes = BTreeMap::new();
    let positions = file.vectors(&mesh.vertices, Some((low, high)));
    attributes.insert(Valid(Semantic::Positions), positions);
    // A vertex without a direction still needs a unit vector.
    let normals: Vec<[f32; 3]> =
        mesh.vertex_normals().into_iter().map(|n| if n == [0.0; 3] { [0.0, 1.0, 0.0] } else { n }).collect();
    attributes.insert(Valid(Semantic::Normals), file.vectors(&normals, None));
    if let Some(colors) = colors {
        let linear: Vec<[f32; 3]> = colors.iter().map(|c| c.map(linear)).collect();
        attributes.insert(Valid(Semantic::Colors(0)), file.vectors(&linear, None));
    }
    let indices = file.indices(&mesh.faces);
    let json = file.root(attributes, indices)?;
    assemble(json.into_bytes(), file.binary)
}

/// The sRGB transfer function's inverse (IEC 61966-2-1).
fn linear(byte: u8) -> f32 {
    let s = f32::from(byte) / 255.0;
    if s <= 0.04045 { s / 12.92 } else { ((s + 0.055) / 1.055).powf(2.4) }
}

#[derive(Default)]
struct Contents {
    binary: Vec<u8>,
    views: Vec<gltf_json::buffer::View>,
    accessors: Vec<Accessor>,
}

impl Contents {
    fn vectors(&mut self, values: &[[f32; 3]], bounds: Option<([f32; 3], [f32; 3])>) -> Index<Accessor> {
        let bytes = values.iter().flatten().flat_map(|x| x.to_le_bytes());
        let component = GenericComponentType(ComponentType::F32);
        self.accessor(bytes, values.len(), component, Type::Vec3, Target::ArrayBuffer, bounds)
    }

    fn indices(&mut self, faces: &[[u32; 3]]) -> Index<Accessor> {
        let bytes = faces.iter().flatten().flat_map(|x| x.to_le_bytes());
        let component = GenericComponentType(ComponentType::U32);
        self.accessor(bytes, 3 * faces.len(), component, Type::Scalar, Target::ElementArrayBuffer, None)
    }

    fn accessor(
        &mut self,
        bytes: impl Iterator<Item = u8>,
        count: usize,
        component: GenericComponentType,
        kind: Type,
        target: Target,
        bounds: Option<([f32; 3], [f32; 3])>,
    ) -> Index<Accessor> {
        let offset = self.binary.len();
        self.binary.extend(bytes);
        let view = gltf_json::buffer::View {
            buffer: Index::new(0),
            byte_length: USize64::from(self.binary.len() - offset),
            byte_offset: Some(USize64::from(offset)),
            byte_stride: None,
            name: None,
            target: Some(Valid(target)),
            extensions: None,
            extras: Default::default(),
        };
        let view = Index::push(&mut self.views, view);
        let value = |v: [f32; 3]| Value::from(v.to_vec());
        let accessor = Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Valid(component),
            type_: Valid(kind),
            min: bounds.map(|(low, _)| value(low)),
            max: bounds.map(|(_, high)| value(high)),
            name: None,
            normalized: false,
            sparse: None,
            extensions: None,
            extras: Default::default(),
        };
        Index::push(&mut self.accessors, accessor)
    }

    fn root(
        &self,
        attributes: BTreeMap<gltf_json::validation::Checked<Semantic>, Index<Accessor>>,
        indices: Index<Accessor>,
    ) -> std::result::Result<String, String> {
        let mut root = Root {
            accessors: self.accessors.clone(),
            buffer_views: self.views.clone(),
            asset: gltf_json::Asset { generator: Some("vitruvian".into()), ..Default::default() },
            ..Default::default()
        };
        root.push(Buffer {
            byte_length: USize64::from(self.binary.len()),
            name: None,
            uri: None,
            extensions: None,
            extras: Default::default(),
        });
        // Skin and cloth: without metal and highlights. The format's default is a mirror of metal.
        let mut material = gltf_json::Material::default();
        material.pbr_metallic_roughness.metallic_factor = gltf_json::material::StrengthFactor(0.0);
        material.pbr_metallic_roughness.roughness_factor = gltf_json::material::StrengthFactor(1.0);
        let material = root.push(material);
        let mesh = root.push(gltf_json::Mesh {
            name: Some("body".into()),
            primitives: vec![Primitive {
                attributes,
                indices: Some(indices),
                material: Some(material),
                mode: Valid(Mode::Triangles),
                targets: None,
                extensions: None,
                extras: Default::default(),
            }],
            weights: None,
            extensions: None,
            extras: Default::default(),
        });
        let node = root.push(Node { mesh: Some(mesh), ..Default::default() });
        let scene =
            root.push(Scene { name: None, nodes: vec![node], extensions: None, extras: Default::default() });
        root.scene = Some(scene);
        gltf_json::serialize::to_string(&root).map_err(|e| format!("cannot be written as glTF: {e}"))
    }
}

/// Header, JSON chunk (padded with spaces) and binary chunk (padded with zeros), each a multiple of four bytes.
fn assemble(mut json: Vec<u8>, mut binary: Vec<u8>) -> std::result::Result<Vec<u8>, String> {
    json.resize(json.len().next_multiple_of(4), b' ');
    binary.resize(binary.len().next_multiple_of(4), 0);
    let length = |n: usize| u32::try_from(n).map_err(|_| "the mesh is larger than GLB's 4 GiB".to_string());
    let mut out = b"glTF".to_vec();
    out.extend(2u32.to_le_bytes());
    out.extend(length(12 + 8 + json.len() + 8 + binary.len())?.to_le_bytes());
    for (kind, chunk) in [(b"JSON", &json), (b"BIN\0", &binary)] {
        out.extend(length(chunk.len())?.to_le_bytes());
        out.extend(kind);
        out.extend(chunk);
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::{cube, sphere};
    use gltf_json::validation::Validate;

    /// The document and binary chunk of a GLB, split by the lengths that it declares.
    fn split(bytes: &[u8]) -> (Root, &[u8]) {
        let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
        assert_eq!((&bytes[..4], word(4), word(8)), (&b"glTF"[..], 2, bytes.len()));
        let json = word(12);
        assert_eq!(&bytes[16..20], b"JSON");
        assert_eq!((json % 4, &bytes[24 + json..28 + json]), (0, &b"BIN\0"[..]));
        assert_eq!(28 + json + word(20 + json), bytes.len());
        (gltf_json::deserialize::from_slice(&bytes[20..20 + json]).unwrap(), &bytes[28 + json..])
    }

    #[test]
    fn the_document_is_valid_and_its_accessors_hold_the_mesh() {
        for (mesh, colors) in [(sphere(0.5, [1.0, 2.0, 3.0], 9), true), (cube(), false)] {
            let colors = colors.then(|| vec![[255, 0, 128]; mesh.vertices.len()]);
            let bytes = encode(&mesh, colors.as_deref()).unwrap();
            let (root, binary) = split(&bytes);
            let mut faults = Vec::new();
            root.validate(&root, gltf_json::Path::new, &mut |path, error| faults.push((path(), error)));
            assert_eq!(faults, []);
            let read = |index: Index<Accessor>| -> Vec<[u8; 4]> {
                let accessor = &root.accessors[index.value()];
                let view = &root.buffer_views[accessor.buffer_view.unwrap().value()];
                let start = view.byte_offset.unwrap().0 as usize;
                let words = binary[start..start + view.byte_length.0 as usize].chunks_exact(4);
                words.map(|w| [w[0], w[1], w[2], w[3]]).collect()
            };
            let primitive = &root.meshes[0].primitives[0];
            let floats = |s| -> Vec<f32> {
                read(primitive.attributes[&Valid(s)]).into_iter().map(f32::from_le_bytes).collect()
            };
            assert_eq!(floats(Semantic::Positions), mesh.vertices.as_flattened());
            let indices: Vec<u32> =
                read(primitive.indices.unwrap()).into_iter().map(u32::from_le_bytes).collect();
            assert_eq!(indices, mesh.faces.as_flattened());
            for n in floats(Semantic::Normals).chunks(3) {
                assert!((n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5);
            }
            let (low, high) = mesh.bounds().unwrap();
            let position = &root.accessors[primitive.attributes[&Valid(Semantic::Positions)].value()];
            assert_eq!(position.min, Some(Value::from(low.to_vec())));
            assert_eq!(position.max, Some(Value::from(high.to_vec())));
            if colors.is_some() {
                assert_eq!(floats(Semantic::Colors(0))[..2], [1.0, 0.0]);
            }
        }
    }

    #[test]
    fn an_empty_mesh_is_refused() {
        assert!(encode(&Mesh::default(), None).unwrap_err().contains("without faces"));
    }
}
