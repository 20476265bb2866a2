//! Reader that turns JSON, YAML, XML and TOML into one tree of values, with the position of every error.

use std::cell::RefCell;
use std::collections::{BTreeSet, HashSet};
use std::rc::Rc;

use saphyr::{LoadableYamlNode as _, Scalar, Yaml};
use serde_json::{Map, Number, Value};

use crate::base64_array;
use crate::file::File;
use crate::file::{FormatError, Problem, quoted};

/// Largest accepted size of a text, in bytes. The tree of a text needs many times the memory of the text.
const MAX_TREE_BYTES: usize = 16 << 20;
/// Largest accepted nesting depth of brackets or blocks.
const MAX_DEPTH: usize = 64;
/// Largest accepted number of elements in an XML text.
const MAX_NODES: u32 = 1_000_000;

/// Syntax of a text file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Syntax {
    Json,
    Yaml,
    Xml,
    Toml,
}

impl Syntax {
    /// Returns the syntax from the first character: JSON, XML, otherwise YAML. A YAML file may begin like a
    /// JSON file.
    pub(crate) fn detect(file: &File) -> Result<Self, FormatError> {
        let is_yaml = matches!(file.extension().as_str(), "yaml" | "yml");
        Ok(match file.as_text()?.trim_start().chars().next() {
            Some('{' | '[') if !is_yaml => Self::Json,
            Some('<') => Self::Xml,
            _ => Self::Yaml,
        })
    }

    /// Parses all documents of a text. Only YAML has several; they are separated by `---`.
    pub(crate) fn parse_all(self, file: &File) -> Result<Vec<Value>, FormatError> {
        if self != Self::Yaml {
            return Ok(vec![self.parse(file)?]);
        }
        let documents = yaml_documents(file, self.checked_text(file)?)?;
        if documents.is_empty() {
            return Err(FormatError::new(&file.name, Problem::Empty));
        }
        Ok(documents)
    }

    /// Returns the text of a file if it is within the limits.
    fn checked_text(self, file: &File) -> Result<&str, FormatError> {
        let text = file.as_text()?;
        if text.len() > MAX_TREE_BYTES {
            let (found, most) = (format!("{} bytes", text.len()), format!("at most {MAX_TREE_BYTES}"));
            return Err(FormatError::expected(&file.name, found, most));
        }
        if text.trim().is_empty() {
            return Err(FormatError::new(&file.name, Problem::Empty));
        }
        if self != Self::Xml && depth(text) > MAX_DEPTH {
            return Err(FormatError::new(&file.name, Problem::DeepBrackets { most: MAX_DEPTH }));
        }
        Ok(text)
    }

    /// Parses a text of this syntax.
    pub(crate) fn parse(self, file: &File) -> Result<Value, FormatError> {
        let text = self.checked_text(file)?;
        let at = |problem: Problem| FormatError::new(&file.name, problem);
        let wrong = |syntax: &'static str, why: String| at(Problem::Syntax { syntax, why });
        match self {
            Self::Json => serde_json::from_str(text).map_err(|error| wrong("JSON", error.to_string())),
            Self::Yaml => {
                let documents = yaml_documents(file, text)?;
                let count = documents.len();
                <[Value; 1]>::try_from(documents)
                    .map(|[document]| document)
                    .map_err(|_| wrong("YAML", format!("found {count} documents, expected one")))
            }
            Self::Toml => toml::from_str::<toml::Table>(text)
                .map_err(|error| wrong("TOML", first_line(&error.to_string()).to_owned()))
                .and_then(|table| {
                    serde_json::to_value(table)
                        .map_err(|error| at(Problem::Unrepresentable { why: error.to_string() }))
                }),
            Self::Xml => from_xml(xml(file)?.root_element(), 0).ok_or_else(|| at(Problem::DeepElements)),
        }
    }
}

/// Parses the documents of a YAML text, without the empty ones. A message that ROS prints ends with a
/// separator.
fn yaml_documents(file: &File, text: &str) -> Result<Vec<Value>, FormatError> {
    let wrong = |why: String| FormatError::new(&file.name, Problem::Syntax { syntax: "YAML", why });
    let documents = Yaml::load_from_str(without_directives(text))
        .map_err(|error| wrong(first_line(&error.to_string()).to_owned()))?;
    let documents = documents.iter().filter(|document| !matches!(document, Yaml::Value(Scalar::Null)));
    let value =
        |document| from_yaml(document).ok_or_else(|| wrong("a key that is a list or a mapping".into()));
    documents.map(value).collect()
}

/// Parses an XML text of limited size.
pub(crate) fn xml(file: &File) -> Result<roxmltree::Document<'_>, FormatError> {
    let text = file.as_text()?;
    if text.len() > MAX_TREE_BYTES {
        let (found, most) = (format!("{} bytes", text.len()), format!("at most {MAX_TREE_BYTES}"));
        return Err(FormatError::expected(&file.name, found, most));
    }
    let options = roxmltree::ParsingOptions { nodes_limit: MAX_NODES, ..Default::default() };
    roxmltree::Document::parse_with_options(text, options).map_err(|error| {
        FormatError::new(&file.name, Problem::Syntax { syntax: "XML", why: error.to_string() })
    })
}

fn first_line(text: &str) -> &str {
    text.lines().next().unwrap_or_default()
}

/// Removes leading lines with `%` directives from a YAML text. OpenCV's directive is not valid YAML, and
/// older versions of OpenCV do not end it with `---`.
fn without_directives(mut text: &str) -> &str {
    while let Some((_, rest)) = text.split_once('\n').filter(|(line, _)| line.starts_with('%')) {
        text = rest;
    }
    text
}

/// Estimates the nesting depth of a YAML or JSON text: the larger of the depth of brackets and the
/// depth of blocks, from markers (`- - - 1`) and indentation.
fn depth(text: &str) -> usize {
    /// Number of columns of indentation that count as one level of blocks.
    const COLUMNS: usize = 8;
    let blocks = text.lines().map(|line| {
        let marks = line.bytes().take_while(|c| matches!(c, b' ' | b'-' | b'?' | b':'));
        let (all, spaces) = marks.fold((0, 0), |(all, spaces), c| (all + 1, spaces + usize::from(c == b' ')));
        (all - spaces).saturating_sub("---".len()).max(all / COLUMNS)
    });
    let blocks = blocks.max().unwrap_or(0);
    let (mut now, mut most) = (0_usize, 0);
    for byte in text.bytes() {
        match byte {
            b'[' | b'{' => now += 1,
            b']' | b'}' => now = now.saturating_sub(1),
            _ => {}
        }
        most = most.max(now);
    }
    most.max(blocks)
}

/// Converts YAML to JSON: tags are dropped, and numbers that are not finite become null. Returns `None` if a
/// key is a list or a mapping.
fn from_yaml(yaml: &Yaml) -> Option<Value> {
    Some(match yaml {
        Yaml::Value(Scalar::Null) | Yaml::Alias(_) | Yaml::BadValue => Value::Null,
        Yaml::Value(Scalar::Boolean(value)) => Value::Bool(*value),
        Yaml::Value(Scalar::Integer(value)) => Value::from(*value),
        Yaml::Value(Scalar::FloatingPoint(value)) => Value::from(**value),
        Yaml::Value(Scalar::String(text)) | Yaml::Representation(text, ..) => Value::from(text.as_ref()),
        Yaml::Sequence(items) => Value::Array(items.iter().map(from_yaml).collect::<Option<_>>()?),
        Yaml::Tagged(_, value) => return from_yaml(value),
        Yaml::Mapping(entries) => {
            let entry = |(key, value): (&Yaml, &Yaml)| {
                let key = match from_yaml(key)? {
                    Value::String(key) => key,
                    Value::Array(_) | Value::Object(_) => return None,
                    other => other.to_string(),
                };
                Some((key, from_yaml(value)?))
            };
            Value::Object(entries.iter().map(entry).collect::<Option<_>>()?)
        }
    })
}

/// Converts an XML element: child elements become keys, and a text of numbers becomes a number or a list of
/// numbers.
fn from_xml(element: roxmltree::Node, level: usize) -> Option<Value> {
    if level > MAX_DEPTH {
        return None;
    }
    let mut object = Map::new();
    for child in element.children().filter(roxmltree::Node::is_element) {
        object.insert(child.tag_name().name().to_owned(), from_xml(child, level + 1)?);
    }
    if !object.is_empty() {
        return Some(Value::Object(object));
    }
    let text = element.text().unwrap_or_default().trim();
    let numbers: Option<Vec<Value>> = text.split_whitespace().map(number).collect();
    Some(match numbers {
        Some(mut one) if one.len() == 1 => one.remove(0),
        Some(many) if !many.is_empty() => Value::Array(many),
        _ => Value::String(text.trim_matches('"').to_owned()),
    })
}

fn number(text: &str) -> Option<Value> {
    Some(Value::Number(Number::from_f64(text.parse().ok()?)?))
}

/// Value of the tree, with its position in the file.
#[derive(Clone, Debug)]
pub(crate) struct Node<'a> {
    value: &'a Value,
    place: String,
    /// Addresses of the values that were read. All values inside them count as read.
    read: Rc<RefCell<HashSet<usize>>>,
}

impl<'a> Node<'a> {
    pub(crate) fn root(file: &File, value: &'a Value) -> Self {
        Self { value, place: format!("{}: ", file.name), read: Rc::default() }
    }

    fn child(&self, value: &'a Value, key: &dyn std::fmt::Display) -> Self {
        Self { value, place: format!("{}/{key}", self.place), read: Rc::clone(&self.read) }
    }

    /// Marks the value and all values inside it as read.
    pub(crate) fn mark_read(&self) {
        self.read.borrow_mut().insert(address(self.value));
    }

    /// Returns a sentence that lists the keys of the file that were not read; `None` if all keys were read.
    pub(crate) fn unread_keys(&self) -> Option<String> {
        /// Largest number of keys that the sentence lists.
        const MAX_KEYS: usize = 16;
        let mut keys = BTreeSet::new();
        collect_unread(self.value, "", &self.read.borrow(), &mut keys);
        let shown: Vec<&str> = keys.iter().take(MAX_KEYS).map(String::as_str).collect();
        let more = keys.len() - shown.len();
        let more = if more > 0 { format!(" and {more} more") } else { String::new() };
        let file = self.place.trim_end_matches([' ', ':']);
        (!shown.is_empty()).then(|| format!("{file}: not imported: {}{more}", shown.join(", ")))
    }

    pub(crate) fn place(&self) -> &str {
        &self.place
    }

    pub(crate) fn unexpected(&self, wanted: &str) -> FormatError {
        let found = match self.value {
            Value::String(text) => quoted(text),
            Value::Array(items) => {
                format!("a list of {}", calib_site::counted(items.len(), "item", "items"))
            }
            Value::Object(_) => "an object".into(),
            other => other.to_string(),
        };
        FormatError::expected(self.place.trim_end_matches([' ', ':']), found, wanted)
    }

    /// Returns the value of a key; `None` if it is absent or null.
    pub(crate) fn get(&self, key: &str) -> Option<Self> {
        let value = self.value.get(key).filter(|value| !value.is_null())?;
        Some(self.child(value, &key))
    }

    /// Returns the value of the first of these keys that is present.
    pub(crate) fn first_of(&self, keys: &[&str]) -> Option<Self> {
        keys.iter().find_map(|key| self.get(key))
    }

    pub(crate) fn require(&self, keys: &[&str]) -> Result<Self, FormatError> {
        self.first_of(keys).ok_or_else(|| {
            FormatError::new(
                self.place.trim_end_matches([' ', ':']),
                Problem::MissingKey(keys.iter().map(|&key| key.to_owned()).collect()),
            )
        })
    }

    pub(crate) fn number(&self) -> Result<f64, FormatError> {
        self.mark_read();
        let value = self.value.as_f64().filter(|value| value.abs() <= 1e12);
        value.ok_or_else(|| self.unexpected("a number between -1e12 and 1e12"))
    }

    /// Returns whether a flag is set: a boolean, 0 or 1, or a word such as "true" or "no".
    pub(crate) fn flag(&self) -> Result<bool, FormatError> {
        self.mark_read();
        let word = match self.value {
            Value::String(text) => text.trim().to_lowercase(),
            other => other.to_string(),
        };
        match word.as_str() {
            "true" | "yes" | "on" | "y" | "1" | "1.0" => Ok(true),
            "false" | "no" | "off" | "n" | "0" | "0.0" | "" | "null" | "none" => Ok(false),
            _ => Err(self.unexpected("true or false, yes or no, 1 or 0")),
        }
    }

    /// Whether the value is null, empty, false, or a word such as "none".
    pub(crate) fn is_none(&self) -> bool {
        match self.value {
            Value::Null | Value::Bool(false) => true,
            Value::String(text) => {
                matches!(&text.trim().to_lowercase()[..], "" | "none" | "null" | "no" | "~")
            }
            Value::Array(items) => items.is_empty(),
            Value::Object(object) => object.is_empty(),
            _ => false,
        }
    }

    pub(crate) fn is_null(&self) -> bool {
        self.value.is_null()
    }

    pub(crate) fn is_number(&self) -> bool {
        self.value.is_number()
    }

    pub(crate) fn is_object(&self) -> bool {
        self.value.is_object()
    }

    /// Returns the width or height of an image, in whole pixels; fails for any other value.
    pub(crate) fn side(&self) -> Result<u32, FormatError> {
        let value = self.number()?;
        let most = f64::from(calib_site::MAX_SIDE);
        if value.fract() == 0.0 && (1.0..=most).contains(&value) {
            return Ok(value as u32);
        }
        Err(self.unexpected(&format!("a whole number of pixels up to {most}")))
    }

    /// Returns the width and height of an image from a list, in pixels.
    pub(crate) fn sides(&self) -> Result<[u32; 2], FormatError> {
        let sides = self.items()?;
        let [width, height] = &sides[..] else { return Err(self.unexpected("width and height")) };
        Ok([width.side()?, height.side()?])
    }

    pub(crate) fn text(&self) -> Result<&'a str, FormatError> {
        self.mark_read();
        self.value.as_str().ok_or_else(|| self.unexpected("text"))
    }

    /// Whether the value may contain numbers: a list, an object such as an `OpenCV` matrix, or a base64 text.
    pub(crate) fn is_list_or_matrix(&self) -> bool {
        let is_base64 = |text: &str| text.trim_start().starts_with(base64_array::PREFIX);
        self.value.is_array() || self.value.is_object() || self.value.as_str().is_some_and(is_base64)
    }

    pub(crate) fn items(&self) -> Result<Vec<Self>, FormatError> {
        let items = self.value.as_array().ok_or_else(|| self.unexpected("a list"))?;
        Ok(items.iter().enumerate().map(|(i, value)| self.child(value, &i)).collect())
    }

    /// Returns the keys and values of an object, in the order of the keys.
    pub(crate) fn entries(&self) -> Vec<(&'a str, Self)> {
        let Some(object) = self.value.as_object() else { return Vec::new() };
        object.iter().map(|(key, value)| (key.as_str(), self.child(value, key))).collect()
    }

    /// Returns the numbers of a base64 text of `OpenCV`.
    fn base64_numbers(&self, text: &str) -> Result<Vec<f64>, FormatError> {
        self.mark_read();
        let numbers = base64_array::numbers(text).map_err(|expected| self.unexpected(expected))?;
        if !numbers.iter().all(|value| value.abs() <= 1e12) {
            return Err(self.unexpected("numbers between -1e12 and 1e12"));
        }
        Ok(numbers)
    }

    /// Returns numbers from a list, a list of rows, an `OpenCV` matrix, or a base64 text.
    pub(crate) fn numbers(&self) -> Result<Vec<f64>, FormatError> {
        self.mark_read();
        if let Some(data) = self.get("data") {
            // The data of a matrix may be base64; in YAML and XML they have no prefix.
            return match data.value.as_str() {
                Some(text) => data.base64_numbers(text),
                None => data.numbers(),
            };
        }
        if let Some(text) = self.value.as_str().filter(|_| self.is_list_or_matrix()) {
            return self.base64_numbers(text);
        }
        if self.value.is_number() {
            return Ok(vec![self.number()?]);
        }
        let mut numbers = Vec::new();
        for item in self.items()? {
            if item.value.is_array() {
                for cell in item.items()? {
                    numbers.push(cell.number()?);
                }
            } else {
                numbers.push(item.number()?);
            }
        }
        Ok(numbers)
    }

    pub(crate) fn exactly<const N: usize>(&self) -> Result<[f64; N], FormatError> {
        let numbers = self.numbers()?;
        let count = numbers.len();
        numbers.try_into().map_err(|_| {
            let place = self.place.trim_end_matches([' ', ':']);
            FormatError::expected(place, calib_site::counted(count, "number", "numbers"), N)
        })
    }

    pub(crate) fn matrix(&self) -> Result<[[f64; 3]; 3], FormatError> {
        let [a, b, c, d, e, f, g, h, i] = self.exactly()?;
        Ok([[a, b, c], [d, e, f], [g, h, i]])
    }
}

fn address(value: &Value) -> usize {
    std::ptr::from_ref(value).addr()
}

/// Whether a value, or any value inside it, was read. `taken` contains the addresses of the read values.
fn is_read(value: &Value, taken: &HashSet<usize>) -> bool {
    taken.contains(&address(value))
        || match value {
            Value::Array(items) => items.iter().any(|item| is_read(item, taken)),
            Value::Object(object) => object.values().any(|value| is_read(value, taken)),
            _ => false,
        }
}

/// Adds the paths of the keys that were not read to `keys`. Items of one list are merged, and empty values
/// are ignored.
fn collect_unread(value: &Value, place: &str, taken: &HashSet<usize>, keys: &mut BTreeSet<String>) {
    if taken.contains(&address(value)) {
        return;
    }
    let says_nothing = |value: &Value| match value {
        Value::Null => true,
        Value::Array(items) => items.is_empty(),
        Value::Object(object) => object.is_empty(),
        Value::String(text) => text.is_empty(),
        _ => false,
    };
    let mut each = |value: &Value, place: String| {
        if is_read(value, taken) {
            collect_unread(value, &place, taken, keys);
        } else if !says_nothing(value) {
            keys.insert(place);
        }
    };
    match value {
        Value::Object(object) => {
            let below = |key: &String| if place.is_empty() { key.clone() } else { format!("{place}/{key}") };
            object.iter().for_each(|(key, value)| each(value, below(key)));
        }
        Value::Array(items) => items.iter().for_each(|item| each(item, format!("{place}/*"))),
        _ => {}
    }
}

/// Formats a number with the fewest digits that read back exactly, also in YAML 1.1.
pub(crate) fn digits(value: f64) -> String {
    let text = format!("{:?}", if value == 0.0 { 0.0 } else { value });
    let Some((mantissa, exponent)) = text.split_once('e') else { return text };
    let point = if mantissa.contains('.') { "" } else { ".0" };
    let sign = if exponent.starts_with('-') { "" } else { "+" };
    format!("{mantissa}{point}e{sign}{exponent}")
}

pub(crate) fn joined<'a>(values: impl IntoIterator<Item = &'a f64>, between: &str) -> String {
    values.into_iter().map(|&value| digits(value)).collect::<Vec<_>>().join(between)
}

/// Quotes a text; the result is valid in JSON and YAML.
pub(crate) fn quote(text: &str) -> String {
    Value::String(text.to_owned()).to_string()
}

/// Escapes a text for XML and removes control characters.
pub(crate) fn escaped(text: &str) -> String {
    let allowed = |c: &char| !c.is_control();
    text.chars()
        .filter(allowed)
        .collect::<String>()
        .replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

/// Formats a document as indented JSON.
pub(crate) fn pretty(value: &Value) -> String {
    format!("{value:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn yaml(text: &str) -> Result<Value, String> {
        let file = File { name: "a.yaml".into(), bytes: text.as_bytes().to_vec() };
        Syntax::Yaml.parse(&file).map_err(|error| error.to_string())
    }

    #[test]
    fn yaml_is_converted_to_equal_json() {
        let text = "%YAML:1.0\n---\na: !!opencv-matrix {rows: 1, data: [1., -2.5e-3, .nan, 0x10]}\nb: &b [x, true, ~]\nc: *b\n1: \"2\"\n";
        let found = yaml(text).unwrap();
        let expected = serde_json::json!({
            "a": {"rows": 1, "data": [1.0, -2.5e-3, null, 16]}, "b": ["x", true, null], "c": ["x", true, null], "1": "2"
        });
        assert_eq!(found, expected);
    }

    #[test]
    fn hostile_yaml_is_rejected_with_a_reason() {
        let laughs: String =
            (1..12).map(|i| format!("a{i}: &a{i} [{}]\n", format!("*a{}, ", i - 1).repeat(9))).collect();
        let indented: String = (0..2000).map(|i| format!("{}a:\n", " ".repeat(i))).collect();
        for (text, why) in [
            (format!("a0: &a0 [1]\n{laughs}"), "alias"),
            ("- ".repeat(100_000), "brackets"),
            (indented, "brackets"),
            ("a: 1\na: 2\n".into(), "uplicate"),
            ("? [1]\n: 2\n".into(), "key"),
            ("a: 1\n---\nb: 2\n".into(), "documents"),
            ("a: [1".into(), "YAML"),
        ] {
            let error = yaml(&text).unwrap_err();
            assert!(error.contains(why), "{why}: {error}");
        }
    }
}
