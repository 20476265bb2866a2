//! Streams of MP4 and MOV files.
//!
//! `re_mp4` reads the boxes. It does not end on a box of length 0 inside another box, and it does not check counts.
//! Therefore all boxes are checked first.

use re_mp4::{FourCC, Mp4, StsdBoxContent};

use crate::error::VideoError;
use crate::stream::{Codec, MAX_FRAMES, Packet, Source, Stream, bytes_at, length};

/// Boxes that contain only boxes.
const CONTAINERS: [&[u8; 4]; 12] = [
    b"moov", b"trak", b"mdia", b"minf", b"stbl", b"dinf", b"edts", b"mvex", b"moof", b"traf", b"udta",
    b"mfra",
];
/// Largest depth of boxes.
const MAX_DEPTH: usize = 12;
/// Largest number of boxes of a file.
const MAX_BOXES: usize = 1_000_000;
/// Largest length of a box inside another box, in bytes.
const MAX_TABLE_BYTES: u64 = 1 << 28;

/// Reads the first video stream.
pub(crate) fn read(source: &mut dyn Source) -> Result<Stream, VideoError> {
    let size = length(source)?;
    let mut walk = Walk { source: &mut *source, boxes: 0, frames: 0, pixel_width_by_height: 1.0 };
    walk.boxes_between([0, size], 0)?;
    let pixel_width_by_height = walk.pixel_width_by_height;
    source.rewind()?;
    let file = Mp4::read(&mut *source, size).map_err(|error| VideoError::Broken(error.to_string()))?;
    let is_video = |track: &&re_mp4::Track| {
        track.trak(&file).mdia.hdlr.handler_type == FourCC::from(*b"vide") && !track.samples.is_empty()
    };
    let track = file.tracks().values().find(is_video).ok_or(VideoError::NoVideoTrack)?;
    let record = track.raw_codec_config(&file);
    let codec = match &track.trak(&file).mdia.minf.stbl.stsd.contents {
        StsdBoxContent::Avc1(_) => Codec::H264(record),
        StsdBoxContent::Hvc1(_) | StsdBoxContent::Hev1(_) => Codec::H265(record),
        StsdBoxContent::Unknown(name) if matches!(&name.to_string()[..], "jpeg" | "mjpa" | "mjpb") => {
            Codec::MotionJpeg
        }
        StsdBoxContent::Unknown(name) => return Err(VideoError::Codec(format!("\"{name}\""))),
        StsdBoxContent::Av01(_) => return Err(VideoError::Codec("AV1".into())),
        StsdBoxContent::Vp08(_) => return Err(VideoError::Codec("VP8".into())),
        StsdBoxContent::Vp09(_) => return Err(VideoError::Codec("VP9".into())),
        StsdBoxContent::Mp4a(_) | StsdBoxContent::Tx3g(_) => return Err(VideoError::NoVideoTrack),
    };
    let packet = |sample: &re_mp4::Sample| Packet {
        time_s: sample.composition_timestamp as f64 / sample.timescale.max(1) as f64,
        is_key: sample.is_sync || codec == Codec::MotionJpeg,
        bytes: [sample.offset, sample.size],
    };
    let packets = track.samples.iter().map(packet).collect();
    let matrix = &track.trak(&file).tkhd.matrix;
    // The matrix maps (x, y) to (a x + c y, b x + d y), in units of 1 / 65536.
    let quarter_turns = match [matrix.a.signum(), matrix.b.signum()] {
        [0, 1] => 1,
        [-1, 0] => 2,
        [0, -1] => 3,
        _ => 0,
    };
    Stream { codec, packets, quarter_turns, pixel_width_by_height }.checked()
}

/// Walk over all boxes of a file.
struct Walk<'a> {
    source: &'a mut dyn Source,
    /// Number of boxes so far.
    boxes: usize,
    /// Number of frames of all tables so far.
    frames: usize,
    /// Pixel aspect from the box `pasp`: width of a pixel divided by its height.
    pixel_width_by_height: f64,
}

impl Walk<'_> {
    /// Checks all boxes in a range of the file.
    fn boxes_between(&mut self, [mut at, end]: [u64; 2], depth: usize) -> Result<(), VideoError> {
        while at + 8 <= end {
            self.boxes += 1;
            if self.boxes > MAX_BOXES || depth > MAX_DEPTH {
                return Err(VideoError::Broken("it has too many boxes".into()));
            }
            let header: [u8; 8] = bytes_at(self.source, at)?;
            let [size, name] = [0, 4].map(|k| [header[k], header[k + 1], header[k + 2], header[k + 3]]);
            let (size, body) = match u32::from_be_bytes(size) {
                1 => (u64::from_be_bytes(bytes_at(self.source, at + 8)?), at + 16),
                // Outside other boxes, the length 0 means the rest of the file.
                0 if depth == 0 => return Ok(()),
                size => (u64::from(size), at + 8),
            };
            let label = || String::from_utf8_lossy(&name).escape_debug().to_string();
            if size < body - at || size > end - at {
                if depth == 0 && size > end - at {
                    return Err(VideoError::Broken("it is incomplete".into()));
                }
                return Err(VideoError::Broken(format!("the box \"{}\" has the wrong length", label())));
            }
            if depth > 0 && size > MAX_TABLE_BYTES {
                return Err(VideoError::Broken(format!("the box \"{}\" is too long", label())));
            }
            self.one_box(&name, [body, at + size], depth)?;
            at += size;
        }
        Ok(())
    }

    /// Checks one box, by its name and the range of its body.
    fn one_box(&mut self, name: &[u8; 4], [body, end]: [u64; 2], depth: usize) -> Result<(), VideoError> {
        /// Position of the first box in the body of `stsd`, in bytes: after a version and a count.
        const DESCRIPTIONS: u64 = 8;
        /// Position of the first box in the description of a video sample, in bytes.
        const IN_DESCRIPTION: u64 = 78;
        match name {
            name if CONTAINERS.contains(&name) => self.boxes_between([body, end], depth + 1),
            b"stsd" => self.boxes_between([body + DESCRIPTIONS, end], depth + 1),
            b"avc1" | b"hvc1" | b"hev1" if body + IN_DESCRIPTION < end => {
                self.boxes_between([body + IN_DESCRIPTION, end], depth + 1)
            }
            b"pasp" => {
                let [width, height] = [self.number_at(body)?, self.number_at(body + 4)?];
                if width > 0 && height > 0 {
                    self.pixel_width_by_height = f64::from(width) / f64::from(height);
                }
                Ok(())
            }
            // In `stsz`, a version and a size precede the count of frames; in `trun`, only a version.
            b"stsz" => self.count_frames(body + 8),
            b"trun" => self.count_frames(body + 4),
            _ => Ok(()),
        }
    }

    /// Adds the number of frames that is stored at a position of the file.
    fn count_frames(&mut self, at: u64) -> Result<(), VideoError> {
        self.frames += self.number_at(at)? as usize;
        if self.frames > MAX_FRAMES { Err(VideoError::TooManyFrames) } else { Ok(()) }
    }

    fn number_at(&mut self, at: u64) -> Result<u32, VideoError> {
        Ok(u32::from_be_bytes(bytes_at(self.source, at)?))
    }
}
