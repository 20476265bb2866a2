//! Codec, times and positions of the frames of a file.

use std::io::{Read, Seek, SeekFrom};

use crate::error::VideoError;

/// Largest number of frames of a file.
pub(crate) const MAX_FRAMES: usize = 10_000_000;
/// Largest number of bytes of one packet.
const MAX_PACKET_BYTES: u64 = 1 << 28;

/// Source of bytes with a position.
pub(crate) trait Source: Read + Seek {}

impl<T: Read + Seek> Source for T {}

/// Codec of a stream, with its parameter sets outside the packets.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Codec {
    /// H.264; with the record `avcC`, or with start codes in the packets.
    H264(Option<Vec<u8>>),
    /// H.265; with the record `hvcC`, or with start codes in the packets.
    H265(Option<Vec<u8>>),
    /// Motion JPEG: every packet is an image.
    MotionJpeg,
}

impl Codec {
    /// Whether a packet contains a frame that needs no other frame, by the types of its units.
    pub(crate) fn is_key(&self, packet: &[u8]) -> bool {
        let (record, size_at) = match self {
            Self::MotionJpeg => return true,
            Self::H264(record) => (record, 4),
            Self::H265(record) => (record, 21),
        };
        // Number of bytes of a length before each unit; without a record, units have start codes.
        let length_size = record.as_ref().map(|record| record.get(size_at).map_or(4, |byte| (byte & 3) + 1));
        let mut rest = packet;
        while let Some(unit) = next_unit(&mut rest, length_size) {
            let is_key = match self {
                // Parameter sets, and frames of the type IDR.
                Self::H264(_) => matches!(unit & 31, 5 | 7),
                _ => matches!(unit >> 1 & 63, 16..=21 | 32..=34),
            };
            if is_key {
                return true;
            }
        }
        false
    }
}

/// Returns the first byte of the next unit, and removes the unit, or its start code, from `rest`.
fn next_unit(rest: &mut &[u8], length_size: Option<u8>) -> Option<u8> {
    match length_size.map(usize::from) {
        Some(size) => {
            let length = rest.get(..size)?.iter().fold(0_usize, |sum, &byte| sum << 8 | usize::from(byte));
            let first = *rest.get(size)?;
            *rest = rest.get(size + length.max(1)..).unwrap_or_default();
            Some(first)
        }
        None => {
            let at = rest.windows(3).position(|three| three == [0, 0, 1])?;
            *rest = rest.get(at + 3..)?;
            rest.first().copied()
        }
    }
}

/// Compressed frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Packet {
    /// Time at which the frame is shown, in seconds from the start of the video.
    pub(crate) time_s: f64,
    /// Whether decoding can start at this packet.
    pub(crate) is_key: bool,
    /// Position in the file and length, in bytes. In Matroska, the position is the number of the frame.
    pub(crate) bytes: [u64; 2],
}

/// Video stream of a file.
#[derive(Clone, Debug)]
pub(crate) struct Stream {
    pub(crate) codec: Codec,
    /// Packets in decoding order.
    pub(crate) packets: Vec<Packet>,
    /// Clockwise rotation for display, in quarter turns.
    pub(crate) quarter_turns: u8,
    /// Width of a pixel divided by its height.
    pub(crate) pixel_width_by_height: f64,
}

impl Packet {
    /// Reads the data of the packet.
    pub(crate) fn read(&self, source: &mut dyn Source) -> Result<Vec<u8>, VideoError> {
        let [from, length] = self.bytes;
        if length > MAX_PACKET_BYTES {
            return Err(VideoError::Broken(format!("a frame of {length} bytes is too large")));
        }
        source.seek(SeekFrom::Start(from))?;
        let mut data = Vec::new();
        source.take(length).read_to_end(&mut data)?;
        Ok(data)
    }
}

impl Stream {
    /// Removes the packets before the first key frame, and shifts the times so that they start at 0. Fails if
    /// there are no packets, or more than [`MAX_FRAMES`].
    pub(crate) fn checked(mut self) -> Result<Self, VideoError> {
        if self.packets.len() > MAX_FRAMES {
            return Err(VideoError::TooManyFrames);
        }
        let first = self.packets.iter().position(|packet| packet.is_key).unwrap_or(0);
        self.packets.drain(..first);
        let start = self.packets.iter().map(|packet| packet.time_s).fold(f64::INFINITY, f64::min);
        self.packets.iter_mut().for_each(|packet| packet.time_s -= start);
        if self.packets.is_empty() { Err(VideoError::NoFrames) } else { Ok(self) }
    }
}

/// Returns the file's length, in bytes, and moves to its start.
pub(crate) fn length(source: &mut dyn Source) -> Result<u64, VideoError> {
    let length = source.seek(SeekFrom::End(0))?;
    source.rewind()?;
    Ok(length)
}

/// Reads bytes at a position of the file.
pub(crate) fn bytes_at<const N: usize>(source: &mut dyn Source, at: u64) -> Result<[u8; N], VideoError> {
    let mut bytes = [0; N];
    source.seek(SeekFrom::Start(at))?;
    source.read_exact(&mut bytes).map_err(|_| VideoError::Broken("it is incomplete".into()))?;
    Ok(bytes)
}
