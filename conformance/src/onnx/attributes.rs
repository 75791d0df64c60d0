//! The attributes of a node, with ONNX's defaults and nothing guessed.

use super::message::{AttributeKind, AttributeProto, NodeProto};
use super::structure::quoted;
use super::typed_tensor::TypedTensor;

/// A node's attributes; the errors name the attribute.
///
/// # Panics
/// All that read a value, when the attribute is of another kind; [`walk::evaluate`](super::walk::evaluate) makes an error of
/// it.
#[derive(Clone, Copy, Debug)]
pub struct Attributes<'a>(&'a [AttributeProto]);

impl<'a> Attributes<'a> {
    /// The attributes of a node.
    ///
    /// # Errors
    /// When it has one that is not in `known`, or one twice, or one whose value a function's call should have given: a
    /// meaning that is not understood must not be passed over.
    pub fn of(node: &'a NodeProto, known: &[&str]) -> Result<Self, String> {
        for (place, attribute) in node.attribute.iter().enumerate() {
            let name = attribute.name.as_deref().unwrap_or_default();
            if !known.contains(&name) {
                return Err(format!("attribute {} is not understood; known are {known:?}", quoted(name)));
            }
            if node.attribute[..place].iter().any(|other| other.name == attribute.name) {
                return Err(format!("attribute \"{name}\" is given twice"));
            }
            if attribute.ref_attr_name.as_deref().is_some_and(|reference| !reference.is_empty()) {
                return Err(format!("attribute \"{name}\" refers to a function's, and this is none"));
            }
        }
        Ok(Self(&node.attribute))
    }

    fn get(&self, name: &str) -> Option<&'a AttributeProto> {
        self.0.iter().find(|attribute| attribute.name.as_deref() == Some(name))
    }

    /// An attribute of this kind; containers of before 2018 do not say the kind.
    fn of_kind(&self, name: &str, kind: AttributeKind) -> Option<&'a AttributeProto> {
        let attribute = self.get(name)?;
        let said = attribute.kind.unwrap_or_default();
        assert!(
            said == kind as i32 || said == AttributeKind::Undefined as i32,
            "attribute \"{name}\" is of kind {said}, {kind:?} ({}) was expected",
            kind as i32
        );
        Some(attribute)
    }

    /// Whether there is one of this name.
    pub fn has(&self, name: &str) -> bool {
        self.get(name).is_some()
    }

    /// A list of integers of either sign, if it is given.
    pub fn integers(&self, name: &str) -> Option<Vec<i64>> {
        self.of_kind(name, AttributeKind::Ints).map(|attribute| attribute.ints.clone())
    }

    /// A list of numbers, if it is given.
    pub fn floats(&self, name: &str) -> Option<&'a [f32]> {
        self.of_kind(name, AttributeKind::Floats).map(|attribute| &attribute.floats[..])
    }

    /// An integer.
    pub fn int(&self, name: &str, default: i64) -> i64 {
        // An integer of 0 may be left out of the container.
        self.of_kind(name, AttributeKind::Int).map_or(default, |attribute| attribute.i.unwrap_or(0))
    }

    /// A count or an index.
    ///
    /// # Errors
    /// When it is negative.
    pub fn count(&self, name: &str, default: usize) -> Result<usize, String> {
        let value = self.int(name, default as i64);
        usize::try_from(value).map_err(|_| format!("attribute \"{name}\" is {value}, a count was expected"))
    }

    /// A flag: 0 or 1.
    ///
    /// # Errors
    /// When it is neither.
    pub fn flag(&self, name: &str, default: bool) -> Result<bool, String> {
        match self.int(name, i64::from(default)) {
            0 => Ok(false),
            1 => Ok(true),
            value => Err(format!("attribute \"{name}\" is {value}, 0 or 1 was expected")),
        }
    }

    /// A number. ONNX keeps it as f32; the default is given as ONNX gives it.
    pub fn float(&self, name: &str, default: f32) -> f64 {
        f64::from(
            self.of_kind(name, AttributeKind::Float).map_or(default, |attribute| attribute.f.unwrap_or(0.0)),
        )
    }

    /// A text.
    ///
    /// # Errors
    /// When it is not UTF-8.
    pub fn text(&self, name: &str, default: &'a str) -> Result<&'a str, String> {
        self.of_kind(name, AttributeKind::String).map_or(Ok(default), |attribute| {
            std::str::from_utf8(attribute.s.as_deref().unwrap_or_default())
                .map_err(|_| format!("attribute \"{name}\" is not UTF-8"))
        })
    }

    /// A list of texts, if it is given.
    ///
    /// # Errors
    /// When one is not UTF-8.
    pub fn texts(&self, name: &str) -> Result<Option<Vec<&'a str>>, String> {
        let Some(attribute) = self.get(name) else { return Ok(None) };
        let texts: Result<_, _> = attribute.strings.iter().map(|text| std::str::from_utf8(text)).collect();
        texts.map(Some).map_err(|_| format!("attribute \"{name}\" is not UTF-8"))
    }

    /// One count per axis, or `default` on each.
    ///
    /// # Errors
    /// When there are not as many as axes, or one is negative.
    pub fn counts(&self, name: &str, axes: usize, default: usize) -> Result<Vec<usize>, String> {
        let Some(attribute) = self.of_kind(name, AttributeKind::Ints) else { return Ok(vec![default; axes]) };
        let counts: Option<Vec<usize>> = attribute.ints.iter().map(|&value| value.try_into().ok()).collect();
        counts.filter(|counts| counts.len() == axes).ok_or_else(|| {
            format!("attribute \"{name}\" is {:?}, {axes} counts were expected", attribute.ints)
        })
    }

    /// Paddings before and after each axis; ONNX lists all before, then all after.
    ///
    /// # Errors
    /// As [`Attributes::counts`], and when `auto_pad` asks for paddings that are computed.
    pub fn paddings(&self, axes: usize) -> Result<Vec<[usize; 2]>, String> {
        let auto = self.text("auto_pad", "NOTSET")?;
        if auto != "NOTSET" {
            return Err(format!("attribute \"auto_pad\" is {auto}, NOTSET was expected"));
        }
        let pads = self.counts("pads", 2 * axes, 0)?;
        Ok((0..axes).map(|axis| [pads[axis], pads[axes + axis]]).collect())
    }

    /// A constant tensor.
    ///
    /// # Errors
    /// When it is missing or cannot be read.
    pub fn tensor(&self, name: &str) -> Result<TypedTensor, String> {
        let tensor = self.of_kind(name, AttributeKind::Tensor).and_then(|attribute| attribute.t.as_deref());
        TypedTensor::read(tensor.ok_or_else(|| format!("attribute \"{name}\" holds no tensor"))?)
    }
}
