//! What Zstandard frames can unpack to, from the headers of their blocks (RFC 8878, 3.1.1).
//!
//! The size that a frame states is compared with what came out only when all of it has.

/// Most that a block unpacks to.
const BLOCK: u64 = 128 << 10;
const FRAME: u32 = 0xFD2F_B528;

/// An upper bound of the bytes that whole frames unpack to. What is no frame ends the walk, as it ends decoding.
pub(super) fn unpacked(mut bytes: &[u8]) -> u64 {
    let mut all = 0_u64;
    while let Some((magic, rest)) = number(bytes, 4) {
        let after = match magic as u32 {
            FRAME => frame(rest, &mut all),
            // Frames that are skipped state their length.
            0x184D_2A50..=0x184D_2A5F => number(rest, 4).and_then(|(length, rest)| rest.get(length..)),
            _ => None,
        };
        let Some(after) = after else { break };
        bytes = after;
    }
    all
}

/// What follows a frame; `all` grows by what its blocks unpack to.
fn frame<'a>(bytes: &'a [u8], all: &mut u64) -> Option<&'a [u8]> {
    let (&about, rest) = bytes.split_first()?;
    let is_single = about & 0x20 != 0;
    let window = usize::from(!is_single);
    let dictionary = [0, 1, 2, 4][usize::from(about & 3)];
    let size = [usize::from(is_single), 2, 4, 8][usize::from(about >> 6)];
    let mut rest = rest.get(window + dictionary + size..)?;
    loop {
        let (head, block) = number(rest, 3)?;
        let (is_last, kind, length) = (head & 1 == 1, head >> 1 & 3, head >> 3);
        // Plain, one byte over and over, packed.
        let (stored, unpacked) = match kind {
            0 => (length, length as u64),
            1 => (1, length as u64),
            _ => (length, BLOCK),
        };
        *all = all.saturating_add(unpacked);
        rest = block.get(stored..)?;
        if is_last {
            let checksum = if about & 4 == 0 { 0 } else { 4 };
            return rest.get(checksum..);
        }
    }
}

/// A little-endian number of so many bytes, and what follows.
fn number(bytes: &[u8], count: usize) -> Option<(usize, &[u8])> {
    let (head, rest) = bytes.split_at_checked(count)?;
    Some((head.iter().rev().fold(0, |number, &byte| number << 8 | usize::from(byte)), rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_frame_unpacks_to_more_than_its_bound() {
        let motley: Vec<u8> = (0..300_000_u32).map(|i| (i.wrapping_mul(i) / 7) as u8).collect();
        for plain in [&[][..], b"short", &motley, &vec![0; 5 << 20]] {
            let mut packed = zstd::encode_all(plain, 3).unwrap_or_default();
            let bound = unpacked(&packed);
            assert!((plain.len() as u64..=plain.len() as u64 + 2 * BLOCK).contains(&bound), "{bound}");
            packed.extend_from_within(..);
            assert_eq!(unpacked(&packed), 2 * bound, "frames follow each other");
        }
        assert_eq!(unpacked(b"not a frame"), 0);
    }
}
