//! Text of a CSV table: its encoding, and the separator of its cells.

use std::io::{Cursor, Read};

/// Maximum number of bytes at the start of a table that determine its encoding and separator.
const HEAD_BYTES: usize = 1 << 16;

/// Text of a CSV table in UTF-8.
pub(super) struct CsvText {
    /// Text without a byte order mark.
    pub(super) reader: Box<dyn Read>,
    /// Separator of the cells.
    pub(super) separator: u8,
    /// Notes about an encoding or a separator other than UTF-8 and comma.
    pub(super) notes: Vec<&'static str>,
}

impl CsvText {
    /// Detects the encoding and the separator from the first line.
    pub(super) fn new(from: Box<dyn Read>) -> std::io::Result<Self> {
        let mut notes = Vec::new();
        let (head, bytes) = with_head(from)?;
        let from: Box<dyn Read> = match &head[..] {
            [0xFF, 0xFE, ..] => {
                notes.push("read as UTF-16 text");
                Box::new(Utf16::new(bytes, u16::from_le_bytes))
            }
            [0xFE, 0xFF, ..] => {
                notes.push("read as UTF-16 text");
                Box::new(Utf16::new(bytes, u16::from_be_bytes))
            }
            _ => bytes,
        };
        let (head, reader) = with_head(from)?;
        let separator = separator(&head);
        match separator {
            b';' => notes.push(
                "cells are separated by semicolons; a comma in a number is read as a decimal separator",
            ),
            b'\t' => {
                notes.push("cells are separated by tabs; a comma in a number is read as a decimal separator");
            }
            _ => {}
        }
        Ok(Self { reader, separator, notes })
    }
}

/// Reads until the end of the first line, or until at least [`HEAD_BYTES`] are read. Returns the bytes read, and a
/// reader of the whole text. A pipe can return fewer bytes than a line in one read.
fn with_head(mut from: Box<dyn Read>) -> std::io::Result<(Vec<u8>, Box<dyn Read>)> {
    let mut head = Vec::new();
    let mut part = [0; 4096];
    while head.len() < HEAD_BYTES && !head.contains(&b'\n') {
        match from.read(&mut part)? {
            0 => break,
            count => head.extend_from_slice(&part[..count]),
        }
    }
    Ok((head.clone(), Box::new(Cursor::new(head).chain(from))))
}

/// Returns the separator of a header line: a comma if it contains one outside quotes, otherwise the more
/// frequent of semicolon and tab.
fn separator(head: &[u8]) -> u8 {
    let (mut counts, mut is_quoted) = ([0; 3], false);
    for &byte in head.iter().take_while(|&&byte| byte != b'\n') {
        match byte {
            b'"' => is_quoted = !is_quoted,
            b',' if !is_quoted => counts[0] += 1,
            b';' if !is_quoted => counts[1] += 1,
            b'\t' if !is_quoted => counts[2] += 1,
            _ => {}
        }
    }
    match counts {
        [0, semicolons, tabs] if semicolons > 0 && semicolons >= tabs => b';',
        [0, _, tabs] if tabs > 0 => b'\t',
        _ => b',',
    }
}

/// Returns a number with a decimal comma as text with a decimal point; `None` for other text.
pub(super) fn decimal_point(cell: &[u8]) -> Option<Vec<u8>> {
    let digits = cell.strip_prefix(b"-").unwrap_or(cell);
    let comma = digits.iter().position(|&byte| byte == b',')?;
    let is_whole = |digits: &[u8]| !digits.is_empty() && digits.iter().all(u8::is_ascii_digit);
    if !is_whole(&digits[..comma]) || !is_whole(&digits[comma + 1..]) {
        return None;
    }
    Some(cell.iter().map(|&byte| if byte == b',' { b'.' } else { byte }).collect())
}

/// Reader that converts UTF-16 to UTF-8. Unpaired surrogates become the replacement character.
struct Utf16<R> {
    from: R,
    unit: fn([u8; 2]) -> u16,
    /// High surrogate at the end of the last part; its low surrogate is in the next part.
    high: Option<u16>,
    /// Converted bytes; the first `start` bytes are already read.
    ready: Vec<u8>,
    start: usize,
    is_first: bool,
}

impl<R: Read> Utf16<R> {
    const fn new(from: R, unit: fn([u8; 2]) -> u16) -> Self {
        Self { from, unit, high: None, ready: Vec::new(), start: 0, is_first: true }
    }

    /// Converts the next part. Leaves `ready` empty at the end of the text.
    fn convert(&mut self) -> std::io::Result<()> {
        let mut bytes = Vec::new();
        self.from.by_ref().take(HEAD_BYTES as u64).read_to_end(&mut bytes)?;
        let units = bytes.as_chunks::<2>().0.iter().map(|&pair| (self.unit)(pair));
        let mut units: Vec<u16> = self.high.take().into_iter().chain(units).collect();
        if bytes.len() == HEAD_BYTES && units.last().is_some_and(|unit| (0xD800..0xDC00).contains(unit)) {
            self.high = units.pop();
        }
        let mut text: String =
            char::decode_utf16(units).map(|unit| unit.unwrap_or(char::REPLACEMENT_CHARACTER)).collect();
        if std::mem::take(&mut self.is_first) {
            text = text.trim_start_matches('\u{feff}').to_owned();
        }
        (self.ready, self.start) = (text.into_bytes(), 0);
        Ok(())
    }
}

impl<R: Read> Read for Utf16<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if self.start == self.ready.len() {
            self.convert()?;
        }
        let count = buffer.len().min(self.ready.len() - self.start);
        buffer[..count].copy_from_slice(&self.ready[self.start..self.start + count]);
        self.start += count;
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn separator_is_that_of_the_header() {
        for (head, expected) in [
            ("camera,u,v\n1;2;3", b','),
            ("camera;u;v\n1,5;2;3", b';'),
            ("camera\tu\tv\n", b'\t'),
            ("\"a;b\",c\n", b','),
            ("one\n", b','),
        ] {
            assert_eq!(separator(head.as_bytes()), expected, "{head}");
        }
    }

    #[test]
    fn utf_16_of_any_length_becomes_utf_8() {
        // Pairs of surrogates fall on the border between two parts.
        for shift in 0..2 {
            let text = format!("{}{}", "a".repeat(shift), "\u{1F4F7}ü,".repeat(20_000));
            for (unit, mark) in
                [(u16::to_le_bytes as fn(u16) -> [u8; 2], [0xFF, 0xFE]), (u16::to_be_bytes, [0xFE, 0xFF])]
            {
                let bytes: Vec<u8> = mark.into_iter().chain(text.encode_utf16().flat_map(unit)).collect();
                let mut found = CsvText::new(Box::new(Cursor::new(bytes))).unwrap();
                let mut read = String::new();
                found.reader.read_to_string(&mut read).unwrap();
                assert!(read == text, "the text differs");
                assert_eq!(found.notes.len(), 1);
            }
        }
    }

    #[test]
    fn only_numbers_get_a_decimal_point() {
        assert_eq!(decimal_point(b"-960,5").as_deref(), Some(&b"-960.5"[..]));
        for text in ["960.5", "a,b", "1,2,3", ",5", "5,", "1 000,5", ""] {
            assert_eq!(decimal_point(text.as_bytes()), None, "{text}");
        }
    }
}
