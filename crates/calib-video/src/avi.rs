//! Streams of AVI files: the list `hdrl` describes the streams, and the lists `movi` contain their packets.

use crate::error::VideoError;
use crate::stream::{Codec, MAX_FRAMES, Packet, Source, Stream, bytes_at, length};

/// Largest number of chunks of a file.
const MAX_CHUNKS: usize = 30_000_000;
/// Number of bytes of a packet that are searched for the types of its units.
const KEY_BYTES: u64 = 512;
/// Largest depth of nested lists.
const MAX_DEPTH: usize = 6;

/// Reads the first video stream.
pub(crate) fn read(source: &mut dyn Source) -> Result<Stream, VideoError> {
    let size = length(source)?;
    let mut walk = Walk { source, chunks: 0, streams: 0, video: None, frame_s: 0.0, packets: Vec::new() };
    walk.chunks_between([0, size], 0)?;
    let Some(Video { codec, .. }) = walk.video else { return Err(VideoError::NoVideoTrack) };
    let codec = match &codec.to_ascii_uppercase()[..] {
        b"MJPG" | b"JPEG" | b"AVRN" | b"LJPG" => Codec::MotionJpeg,
        b"H264" | b"X264" | b"AVC1" => Codec::H264(None),
        b"H265" | b"HEVC" | b"HVC1" => Codec::H265(None),
        other => {
            return Err(VideoError::Codec(format!("\"{}\"", String::from_utf8_lossy(other).escape_debug())));
        }
    };
    let frame_s = if walk.frame_s > 0.0 { walk.frame_s } else { 0.04 };
    let mut packets = Vec::new();
    for (index, bytes) in walk.packets.into_iter().enumerate() {
        // An empty chunk repeats the frame before it.
        if bytes[1] > 0 {
            let beginning = Packet { time_s: 0.0, is_key: false, bytes: [bytes[0], bytes[1].min(KEY_BYTES)] };
            let is_key = codec == Codec::MotionJpeg || codec.is_key(&beginning.read(walk.source)?);
            packets.push(Packet { time_s: index as f64 * frame_s, is_key, bytes });
        }
    }
    Stream { codec, packets, quarter_turns: 0, pixel_width_by_height: 1.0 }.checked()
}

/// First video stream of the file.
struct Video {
    /// Number of the stream.
    index: usize,
    /// Name of the codec.
    codec: [u8; 4],
}

/// Walk over all chunks of a file.
struct Walk<'a> {
    source: &'a mut dyn Source,
    /// Number of chunks so far.
    chunks: usize,
    /// Number of streams so far.
    streams: usize,
    video: Option<Video>,
    /// Duration of a frame, in seconds.
    frame_s: f64,
    /// Positions and lengths of the packets of the video stream, in bytes.
    packets: Vec<[u64; 2]>,
}

impl Walk<'_> {
    /// Reads all chunks in a range of the file. The last chunk may be cut off.
    fn chunks_between(&mut self, [mut at, end]: [u64; 2], depth: usize) -> Result<(), VideoError> {
        while at + 8 <= end {
            self.chunks += 1;
            if self.chunks > MAX_CHUNKS || depth > MAX_DEPTH || self.packets.len() > MAX_FRAMES {
                return Err(VideoError::TooManyFrames);
            }
            let header: [u8; 8] = bytes_at(self.source, at)?;
            let size = u64::from(u32::from_le_bytes([header[4], header[5], header[6], header[7]]));
            let until = (at + 8 + size).min(end);
            match &header[..4] {
                b"RIFF" | b"LIST" if at + 12 <= end => self.chunks_between([at + 12, until], depth + 1)?,
                b"strh" => self.stream_header(at + 8)?,
                name if self.is_packet(name) && until - at - 8 == size => {
                    self.packets.push([at + 8, size]);
                }
                _ => {}
            }
            at = until + size % 2;
        }
        Ok(())
    }

    /// Reads the header of a stream: its type, its codec, and the duration of a frame as a fraction.
    fn stream_header(&mut self, at: u64) -> Result<(), VideoError> {
        let header: [u8; 28] = bytes_at(self.source, at)?;
        let text = |k: usize| [header[k], header[k + 1], header[k + 2], header[k + 3]];
        let index = self.streams;
        self.streams += 1;
        if &text(0) == b"vids" && self.video.is_none() {
            let [scale, rate] = [20, 24].map(|k| f64::from(u32::from_le_bytes(text(k))));
            self.frame_s = if rate > 0.0 { scale / rate } else { 0.0 };
            self.video = Some(Video { index, codec: text(4) });
        }
        Ok(())
    }

    /// Whether a chunk is a packet of the video stream. Its name is the number of the stream, then `dc` (compressed)
    /// or `db`.
    fn is_packet(&self, name: &[u8]) -> bool {
        let Some(Video { index, .. }) = &self.video else { return false };
        let number = format!("{index:02}");
        name.starts_with(number.as_bytes()) && matches!(&name[2..], b"dc" | b"db")
    }
}
