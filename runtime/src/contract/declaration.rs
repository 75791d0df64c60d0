//! The keys a graph declares: its metadata, completed by the side file.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::contract::Kind;
use crate::error::{Error, Result};

/// What every key of ours begins with inside a graph.
const PREFIX: &str = "vitruvian.";

/// What the keys begin with that say what the graph calls a tensor.
const TENSORS: &str = "tensors.";

/// The only version of the contract there is.
const VERSION: &str = "1";

/// The keys of a graph, without the prefix.
pub(super) struct Declaration {
    path: PathBuf,
    keys: BTreeMap<String, String>,
}

/// A key as messages name it.
pub(super) fn item(key: &str) -> String {
    format!("metadata \"{PREFIX}{key}\"")
}

impl Declaration {
    /// Collects the keys from the metadata and from `GRAPH.toml`, if there is one, and checks the version.
    pub(super) fn read(path: &Path, metadata: &BTreeMap<String, String>) -> Result<Declaration> {
        let mut keys = side_file(&path.with_extension("toml"))?;
        let ours = metadata.iter().filter_map(|(key, value)| Some((key.strip_prefix(PREFIX)?, value)));
        keys.extend(ours.map(|(key, value)| (key.to_string(), value.trim().to_string())));
        let declaration = Declaration { path: path.to_path_buf(), keys };
        match declaration.keys.get("version").map(String::as_str) {
            None | Some(VERSION) => Ok(declaration),
            Some(other) => {
                Err(declaration.fault("version", &format!("found {other:?}, expected {VERSION:?}")))
            }
        }
    }

    pub(super) fn fault(&self, key: &str, message: &str) -> Error {
        Error::Graph { path: self.path.clone(), item: item(key), message: message.to_string() }
    }

    /// The graph's own names of tensors, by the names of the contract: the keys `tensors.NAME`.
    pub(super) fn tensor_names(&self) -> BTreeMap<String, String> {
        let named = self.keys.iter().filter_map(|(key, own)| Some((key.strip_prefix(TENSORS)?, own)));
        named.map(|(name, own)| (name.to_string(), own.clone())).collect()
    }

    fn get(&self, key: &str, expected: &str) -> Result<&str> {
        self.keys.get(key).map(String::as_str).ok_or_else(|| {
            let side = self.path.with_extension("toml");
            self.fault(
                key,
                &format!(
                    "it is missing, expected {expected}; export it, or write {key} = … into {}",
                    side.display()
                ),
            )
        })
    }

    /// Reads a value or says what was found and what was expected.
    fn parse<T>(&self, key: &str, expected: &str, read: impl FnOnce(&str) -> Option<T>) -> Result<T> {
        let found = self.get(key, expected)?;
        read(found).ok_or_else(|| self.fault(key, &format!("found {found:?}, expected {expected}")))
    }

    pub(super) fn kind(&self) -> Result<Kind> {
        let known = Kind::ALL.map(|kind| format!("{:?}", kind.name())).join(", ");
        self.parse("kind", &format!("one of {known}"), |text| {
            Kind::ALL.into_iter().find(|kind| kind.name() == text)
        })
    }

    pub(super) fn count(&self, key: &str, largest: usize) -> Result<usize> {
        let expected = format!("a whole number from 1 to {largest}");
        self.parse(key, &expected, |text| text.parse().ok().filter(|count| (1..=largest).contains(count)))
    }

    pub(super) fn number(&self, key: &str) -> Result<f64> {
        self.parse(key, "a number", number)
    }

    pub(super) fn optional_number(&self, key: &str) -> Result<Option<f64>> {
        if self.keys.contains_key(key) { self.number(key).map(Some) } else { Ok(None) }
    }

    pub(super) fn three_numbers(&self, key: &str) -> Result<[f32; 3]> {
        self.parse(key, "three numbers \"r,g,b\"", |text| {
            let numbers: Option<Vec<f32>> =
                text.split(',').map(|part| Some(number(part.trim())? as f32)).collect();
            numbers?.try_into().ok()
        })
    }

    pub(super) fn boolean(&self, key: &str) -> Result<bool> {
        self.parse(key, "\"true\" or \"false\"", |text| text.parse().ok())
    }

    /// `None` for the word, `Some` for a number of metres.
    pub(super) fn word_or_metres(&self, key: &str, word: &str) -> Result<Option<f64>> {
        let expected = format!("{word:?} or a number of metres");
        self.parse(key, &expected, |text| if text == word { Some(None) } else { number(text).map(Some) })
    }
}

fn number(text: &str) -> Option<f64> {
    text.parse().ok().filter(|number: &f64| number.is_finite())
}

/// The keys of a side file as the strings they would be in the graph; none if there is no such file.
fn side_file(path: &Path) -> Result<BTreeMap<String, String>> {
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(BTreeMap::new()),
        Err(source) => return Err(Error::Io { path: path.to_path_buf(), source }),
    };
    let refuse = |message: String| Error::File { path: path.to_path_buf(), message };
    let table: toml::Table = text.parse().map_err(|error: toml::de::Error| {
        refuse(format!("it is not TOML: {}", error.message().replace('\n', " ")))
    })?;
    let word = |value: &toml::Value| match value {
        toml::Value::String(text) => Some(text.trim().to_string()),
        toml::Value::Integer(number) => Some(number.to_string()),
        toml::Value::Float(number) => Some(number.to_string()),
        toml::Value::Boolean(truth) => Some(truth.to_string()),
        _ => None,
    };
    let entry = |(key, value): (String, toml::Value)| {
        let text = match &value {
            toml::Value::Array(values) => {
                values.iter().map(word).collect::<Option<Vec<_>>>().map(|words| words.join(","))
            }
            single => word(single),
        };
        match text {
            Some(text) => Ok((key, text)),
            None => Err(refuse(format!(
                "{key} is a {}, expected a string, a number or a list of numbers",
                value.type_str()
            ))),
        }
    };
    // The one table within the table, [tensors], becomes the keys tensors.NAME.
    let flat = table.into_iter().flat_map(|(key, value)| match value {
        toml::Value::Table(names) if format!("{key}.") == TENSORS => {
            names.into_iter().map(|(name, own)| (format!("{TENSORS}{name}"), own)).collect()
        }
        value => vec![(key, value)],
    });
    flat.map(entry).collect()
}
