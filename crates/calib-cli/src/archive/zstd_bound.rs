//! Upper bound of the decompressed size of Zstandard frames, from their block headers (RFC 8878, 3.1.1).
//!
//! The size stated in a frame's header is not sufficient: a decoder compares it only after it has
//! decompressed everything.

/// Maximum decompressed size of a block, in bytes.
const MAX_BLOCK_BYTES: u64 = 128 << 10;
const FRAME_MAGIC: u32 = 0xFD2F_B528;

/// Returns an upper bound of the decompressed size of complete frames, in bytes. Frames after invalid data are not
/// counted, because the decoder also stops there.
pub(super) fn decompressed_size(mut bytes: &[u8]) -> u64 {
    let mut all = 0_u64;
    while let Some((magic, rest)) = parse_number(bytes, 4) {
        let after = match magic as u32 {
            FRAME_MAGIC => skip_frame(rest, &mut all),
            // Skippable frames state their length.
            0x184D_2A50..=0x184D_2A5F => parse_number(rest, 4).and_then(|(length, rest)| rest.get(length..)),
            _ => None,
        };
        let Some(after) = after else { break };
        bytes = after;
    }
    all
}

/// Returns the bytes after a frame, and adds an upper bound of the decompressed size of its blocks to `all`.
fn skip_frame<'a>(bytes: &'a [u8], all: &mut u64) -> Option<&'a [u8]> {
    let (&about, rest) = bytes.split_first()?;
    let is_single = about & 0x20 != 0;
    let window = usize::from(!is_single);
    let dictionary = [0, 1, 2, 4][usize::from(about & 3)];
    let size = [usize::from(is_single), 2, 4, 8][usize::from(about >> 6)];
    let mut rest = rest.get(window + dictionary + size..)?;
    loop {
        let (head, block) = parse_number(rest, 3)?;
        let (is_last, kind, length) = (head & 1 == 1, head >> 1 & 3, head >> 3);
        // Block types: raw, run of one byte, compressed.
        let (stored, unpacked) = match kind {
            0 => (length, length as u64),
            1 => (1, length as u64),
            _ => (length, MAX_BLOCK_BYTES),
        };
        *all = all.saturating_add(unpacked);
        rest = block.get(stored..)?;
        if is_last {
            let checksum = if about & 4 == 0 { 0 } else { 4 };
            return rest.get(checksum..);
        }
    }
}

/// Parses a little-endian number of `count` bytes, and returns it with the remaining bytes.
fn parse_number(bytes: &[u8], count: usize) -> Option<(usize, &[u8])> {
    let (head, rest) = bytes.split_at_checked(count)?;
    Some((head.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte)), rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_do_not_exceed_their_bound() {
        let motley: Vec<u8> = (0..300_000_u32).map(|i| (i.wrapping_mul(i) / 7) as u8).collect();
        for plain in [&[][..], b"short", &motley, &vec![0; 5 << 20]] {
            let mut packed = zstd::encode_all(plain, 3).unwrap_or_default();
            let bound = decompressed_size(&packed);
            assert!(
                (plain.len() as u64..=plain.len() as u64 + 2 * MAX_BLOCK_BYTES).contains(&bound),
                "{bound}"
            );
            packed.extend_from_within(..);
            assert_eq!(decompressed_size(&packed), 2 * bound, "frames follow each other");
        }
        assert_eq!(decompressed_size(b"not a frame"), 0);
    }
}
