//! Pairs of text and binary files, grouped into records.

use std::borrow::Cow;

use crate::drawing::DXF_SENTINEL;
use crate::error::PlanError;

/// Largest file, in bytes.
const MAX_BYTES: usize = 128 << 20;
/// Largest number of pairs; each needs 32 bytes of memory.
const MAX_PAIRS: usize = 16_000_000;
/// Largest number of damaged lines that are skipped.
const MAX_DAMAGED_LINES: usize = 1000;

/// Group code and value.
#[derive(Clone, Debug)]
pub(super) struct Pair<'a> {
    pub(super) code: i32,
    pub(super) value: Cow<'a, str>,
}

/// Pair with code 0 and the pairs up to the next one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Record<'a> {
    /// Value of the first pair, such as LINE.
    pub(super) kind: &'a str,
    pub(super) pairs: &'a [Pair<'a>],
}

impl<'a> Record<'a> {
    /// Returns the first value with this code.
    pub(super) fn text(&self, code: i32) -> Option<&'a str> {
        self.pairs.iter().find(|pair| pair.code == code).map(|pair| pair.value.as_ref())
    }

    /// Returns the first value with this code as a finite number.
    pub(super) fn number(&self, code: i32) -> Option<f64> {
        self.text(code).and_then(number)
    }

    /// Returns the first value with this code as an integer.
    pub(super) fn integer(&self, code: i32) -> Option<i64> {
        self.text(code).and_then(integer)
    }

    /// Returns all values with this code as numbers.
    pub(super) fn numbers(&self, code: i32) -> Vec<f64> {
        self.pairs.iter().filter(|pair| pair.code == code).filter_map(|pair| number(&pair.value)).collect()
    }
}

/// Returns a finite number of moderate size. Other numbers would overflow in later products.
pub(super) fn number(text: &str) -> Option<f64> {
    text.trim().parse::<f64>().ok().filter(|value| value.abs() < 1e15)
}

pub(super) fn integer(text: &str) -> Option<i64> {
    text.trim().parse::<i64>().ok()
}

/// Pairs of a file, and the number of damaged lines.
pub(super) struct Pairs<'a> {
    pub(super) pairs: Vec<Pair<'a>>,
    pub(super) damaged_lines: usize,
}

impl<'a> Pairs<'a> {
    /// Reads the pairs of a text or binary file.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, PlanError> {
        if bytes.len() > MAX_BYTES {
            return Err(too_large());
        }
        match bytes.strip_prefix(DXF_SENTINEL) {
            Some(rest) => Ok(Self { pairs: binary_pairs(rest)?, damaged_lines: 0 }),
            None => text_pairs(bytes),
        }
    }

    /// Groups the pairs into records.
    pub(super) fn records(&self) -> Vec<Record<'_>> {
        let starts: Vec<usize> = self
            .pairs
            .iter()
            .enumerate()
            .filter(|(_, pair)| pair.code == 0)
            .map(|(index, _)| index)
            .collect();
        let ends = starts.iter().skip(1).copied().chain([self.pairs.len()]);
        starts
            .iter()
            .zip(ends)
            .map(|(&start, end)| Record {
                kind: self.pairs[start].value.as_ref(),
                pairs: &self.pairs[start + 1..end],
            })
            .collect()
    }
}

fn too_large() -> PlanError {
    let reason =
        format!("it exceeds {} MiB or {MAX_PAIRS} values; save only the layers of the plan", MAX_BYTES >> 20);
    PlanError::Limit { kind: "DXF", reason }
}

/// Reads alternating lines of codes and values. A line without a number in the place of a code is skipped.
fn text_pairs(bytes: &[u8]) -> Result<Pairs<'_>, PlanError> {
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut lines = bytes.split(|&byte| byte == b'\n');
    let (mut pairs, mut damaged_lines) = (Vec::new(), 0);
    while let Some(line) = lines.next() {
        let Some(code) = std::str::from_utf8(line).ok().and_then(|code| code.trim().parse::<i32>().ok())
        else {
            damaged_lines += usize::from(!line.trim_ascii().is_empty());
            if damaged_lines > MAX_DAMAGED_LINES {
                return Err(PlanError::Damaged {
                    kind: "DXF",
                    reason: "its lines are not pairs of a code and a value".into(),
                });
            }
            continue;
        };
        let Some(value) = lines.next() else { break };
        let value = text(value.strip_suffix(b"\r").unwrap_or(value));
        let value = match value {
            Cow::Borrowed(value) if code == 0 || code == 2 => Cow::Borrowed(value.trim()),
            other => other,
        };
        if pairs.len() == MAX_PAIRS {
            return Err(too_large());
        }
        pairs.push(Pair { code, value });
    }
    Ok(Pairs { pairs, damaged_lines })
}

/// Returns a value as text: UTF-8, or the Western code page of older versions.
fn text(bytes: &[u8]) -> Cow<'_, str> {
    match std::str::from_utf8(bytes) {
        Ok(text) => Cow::Borrowed(text),
        Err(_) => Cow::Owned(bytes.iter().map(|&byte| char::from(byte)).collect()),
    }
}

/// Reads pairs of a binary file up to its end or the first damaged pair. Codes have two bytes, in files before
/// release 13 one.
fn binary_pairs(bytes: &[u8]) -> Result<Vec<Pair<'_>>, PlanError> {
    // The file starts with the code 0 and the text SECTION.
    let is_old = bytes.get(1).is_some_and(|&byte| byte != 0);
    let mut reader = Bytes { rest: bytes };
    let mut pairs = Vec::new();
    while let Some(pair) = reader.pair(is_old) {
        if pairs.len() == MAX_PAIRS {
            return Err(too_large());
        }
        pairs.push(pair);
    }
    Ok(pairs)
}

/// Unread bytes of a binary file.
struct Bytes<'a> {
    rest: &'a [u8],
}

impl<'a> Bytes<'a> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.rest.split_first_chunk::<N>()?;
        self.rest = rest;
        Some(*taken)
    }

    fn pair(&mut self, is_old: bool) -> Option<Pair<'a>> {
        let code = if is_old {
            match self.take::<1>()?[0] {
                255 => i32::from(i16::from_le_bytes(self.take()?)),
                code => i32::from(code),
            }
        } else {
            i32::from(i16::from_le_bytes(self.take()?))
        };
        let value = match code {
            10..=59 | 110..=149 | 210..=239 | 460..=469 | 1010..=1059 => {
                Cow::Owned(f64::from_le_bytes(self.take()?).to_string())
            }
            60..=79 | 170..=179 | 270..=289 | 370..=389 | 400..=409 | 1060..=1070 => {
                Cow::Owned(i16::from_le_bytes(self.take()?).to_string())
            }
            90..=99 | 420..=429 | 440..=459 | 1071 => {
                Cow::Owned(i32::from_le_bytes(self.take()?).to_string())
            }
            160..=169 => Cow::Owned(i64::from_le_bytes(self.take()?).to_string()),
            290..=299 => Cow::Owned(self.take::<1>()?[0].to_string()),
            310..=319 | 1004 => {
                let [length] = self.take::<1>()?;
                self.rest = self.rest.get(usize::from(length)..)?;
                Cow::Borrowed("")
            }
            _ => {
                let end = self.rest.iter().position(|&byte| byte == 0)?;
                let (value, rest) = self.rest.split_at(end);
                self.rest = &rest[1..];
                text(value)
            }
        };
        Some(Pair { code, value })
    }
}
