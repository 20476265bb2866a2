#![allow(missing_docs, clippy::all)]
use calib_core::*; use calib_image::proposal::*; use std::io::Read as _;
fn main() {
    let which: usize = std::env::args().nth(1).unwrap().parse().unwrap();
    let file = std::fs::File::open("/work/shared/real/rooms/segments.json.gz").unwrap();
    let mut text = String::new(); flate2::read::GzDecoder::new(file).read_to_string(&mut text).unwrap();
    let d: serde_json::Value = serde_json::from_str(&text).unwrap();
    let pp: Vec<f64> = d["principal_point_px"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let f = d["focal_px"].as_f64().unwrap();
    let truth: std::collections::BTreeMap<String, [f64;2]> = std::fs::read_to_string("/tmp/truth.txt").unwrap().lines().map(|l| { let f: Vec<&str> = l.split(' ').collect(); (f[0].to_string(), [f[1].parse::<f64>().unwrap(), f[2].parse::<f64>().unwrap()]) }).collect();
    let start = std::time::Instant::now();
    for (i, (id, im)) in d["images"].as_object().unwrap().iter().enumerate() {
        if which < 2 && i % 2 != which { continue }
        let segments: Vec<LineSegment> = im["segments"].as_array().unwrap().iter().map(|s| { let s: Vec<f64> = s.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
            LineSegment { ends: [Pixel::new(s[0],s[1]), Pixel::new(s[2],s[3])], sigma: LineSegment::DETECTED } }).collect();
        let &[roll, pitch] = truth.get(id).unwrap_or(&[f64::NAN, f64::NAN]);
        let known = std::env::var("BEND").is_err();
        let still = Still { segments, size: [640, 480], principal_point: Some(Pixel::new(pp[0], pp[1])), lens: known.then(|| Lens::pinhole(Pixel::new(pp[0], pp[1]))) };
        let p = Proposal::new(&still);
        let k1 = p.camera.as_ref().and_then(|c| c.lens.as_ref()).and_then(|l| l.distortion.as_ref()).and_then(|d| d.k1);
        match &p.solution { Some(s) => println!("R {id} {} {} {} {} {} {} {} {}", p.verdict.name(), p.focal_sigma_rel.unwrap(), (s.focal_px/f).ln(), s.pitch_deg.unwrap()-pitch, s.roll_deg.unwrap()-roll, s.sigma.as_ref().and_then(|s| s.focal_px).unwrap_or(f64::NAN)/s.focal_px, k1.unwrap_or(0.0), p.reasons.len()), None => println!("N {id} {:?}", p.reasons) }
    }
    println!("time {:?}", start.elapsed());
}
