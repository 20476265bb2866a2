//! Damaged copies of a small PDF: each gives a drawing or an error, in a limited time.

#![cfg(feature = "pdf")]

use std::time::{Duration, Instant};

use calib_plan::{View, read};
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

/// Number of damaged copies.
const COPIES: usize = 10_000;
/// Longest accepted time for one copy. The undamaged document takes about a millisecond.
const MAX_TIME: Duration = Duration::from_secs(10);

/// Returns a page of 400 x 300 points with walls, a scale as text and a small image.
fn document() -> Vec<u8> {
    let content = "q 2 w 40 40 m 360 40 l 360 260 l 40 260 l h S Q\n0.5 g 100 100 60 40 re f\n\
                   BT /F1 12 Tf 50 20 Td (Scale 1:100) Tj ET\nq 50 0 0 50 200 150 cm /I1 Do Q\n";
    let objects = [
        "<< /Type /Catalog /Pages 2 0 R >>".to_owned(),
        "<< /Type /Pages /Kids [3 0 R] /Count 1 >>".to_owned(),
        "<< /Type /Page /Parent 2 0 R /MediaBox [0 0 400 300] /Contents 4 0 R\n\
         /Resources << /Font << /F1 5 0 R >> /XObject << /I1 6 0 R >> >> >>"
            .to_owned(),
        format!("<< /Length {} >>\nstream\n{content}endstream", content.len()),
        "<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>".to_owned(),
        "<< /Type /XObject /Subtype /Image /Width 2 /Height 2 /BitsPerComponent 8 /ColorSpace /DeviceGray\n\
         /Filter /ASCIIHexDecode /Length 9 >>\nstream\n00FF80C0>\nendstream"
            .to_owned(),
    ];
    let (mut text, mut offsets) = ("%PDF-1.4\n".to_owned(), Vec::new());
    for (index, object) in objects.iter().enumerate() {
        offsets.push(text.len());
        text += &format!("{} 0 obj\n{object}\nendobj\n", index + 1);
    }
    let start = text.len();
    text += &format!("xref\n0 {}\n0000000000 65535 f \n", offsets.len() + 1);
    offsets.iter().for_each(|offset| text += &format!("{offset:010} 00000 n \n"));
    text += &format!("trailer\n<< /Size {} /Root 1 0 R >>\nstartxref\n{start}\n%%EOF\n", offsets.len() + 1);
    text.into_bytes()
}

#[test]
fn damaged_documents_are_errors() {
    let whole = document();
    assert!(matches!(read(&whole, &View::default()), Some(Ok(_))));
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut readable = 0;
    for copy in 0..COPIES {
        let mut bytes = whole.clone();
        for _ in 0..random.random_range(1..4) {
            let at = random.random_range(8..bytes.len());
            match random.random_range(0..3) {
                0 => bytes[at] = random.random(),
                1 => bytes[at] = b'0' + random.random_range(0..10_u8),
                _ => {
                    bytes.remove(at);
                }
            }
        }
        let start = Instant::now();
        // The result is a drawing or an error; a panic fails the test.
        readable += usize::from(matches!(read(&bytes, &View::default()), Some(Ok(_))));
        let time = start.elapsed();
        assert!(time < MAX_TIME, "copy {copy}: {time:?}");
    }
    assert!(readable > COPIES / 4, "only {readable} copies are readable: the damage is too coarse");
}
