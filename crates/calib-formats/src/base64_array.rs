//! Arrays of numbers in base64, as OpenCV's `FileStorage` writes them with the flag `BASE64`.
//!
//! The decoded bytes are a header and the elements in little-endian order. The header has 24 characters: the
//! number of channels (absent: 1) and the letter of the element type, padded with spaces.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// Beginning of a base64 text in JSON. YAML and XML mark it by a tag or an attribute instead.
pub(crate) const PREFIX: &str = "$base64$";
/// Length of the header, in bytes.
const HEADER_BYTES: usize = 24;

/// Decodes a text, with or without the prefix. An error describes the expected content.
pub(crate) fn numbers(text: &str) -> Result<Vec<f64>, &'static str> {
    let text = text.trim_start();
    let plain: String = text.strip_prefix(PREFIX).unwrap_or(text).split_whitespace().collect();
    let bytes = STANDARD.decode(plain).map_err(|_| "numbers, or a complete base64 text of OpenCV")?;
    let wrong_header = "a base64 text whose header names an element type, such as \"1d\"";
    let (header, data) = bytes.split_at_checked(HEADER_BYTES).ok_or(wrong_header)?;
    let header = std::str::from_utf8(header).map_err(|_| wrong_header)?;
    let kind = header.trim_matches([' ', '\0']).trim_start_matches(|c: char| c.is_ascii_digit());
    match kind {
        "u" => elements(data, |[byte]| f64::from(byte)),
        "c" => elements(data, |bytes| f64::from(i8::from_le_bytes(bytes))),
        "w" => elements(data, |bytes| f64::from(u16::from_le_bytes(bytes))),
        "s" => elements(data, |bytes| f64::from(i16::from_le_bytes(bytes))),
        "i" => elements(data, |bytes| f64::from(i32::from_le_bytes(bytes))),
        "f" => elements(data, |bytes| f64::from(f32::from_le_bytes(bytes))),
        "d" => elements(data, f64::from_le_bytes),
        _ => Err("a base64 text with one element type: u, c, w, s, i, f or d"),
    }
}

fn elements<const N: usize>(data: &[u8], number: impl Fn([u8; N]) -> f64) -> Result<Vec<f64>, &'static str> {
    let (elements, []) = data.as_chunks::<N>() else {
        return Err("a base64 text of whole numbers of elements");
    };
    Ok(elements.iter().map(|&bytes| number(bytes)).collect())
}
