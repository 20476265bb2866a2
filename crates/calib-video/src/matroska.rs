//! Streams of Matroska and `WebM` files.
//!
//! The library returns the data of a frame, and not its position. Therefore the packets of this container are
//! counted from the start of the file, and read in one pass.

use std::collections::BTreeMap;

use matroska_demuxer::{Frame, MatroskaFile, TrackType};

use crate::error::VideoError;
use crate::stream::{Codec, MAX_FRAMES, Packet, Source, Stream};

/// Reads the first video stream. The position of a packet is its number among all frames of the file.
pub(crate) fn read(source: &mut dyn Source) -> Result<Stream, VideoError> {
    source.rewind()?;
    let mut file = MatroskaFile::open(source).map_err(broken)?;
    let track = file.tracks().iter().find(|track| track.track_type() == TrackType::Video);
    let track = track.ok_or(VideoError::NoVideoTrack)?;
    let record = track.codec_private().map(<[u8]>::to_vec);
    let codec = match track.codec_id() {
        "V_MPEG4/ISO/AVC" => Codec::H264(record),
        "V_MPEGH/ISO/HEVC" => Codec::H265(record),
        "V_MJPEG" => Codec::MotionJpeg,
        other => return Err(VideoError::Codec(format!("\"{}\"", other.escape_debug()))),
    };
    let pixel_width_by_height = track.video().map_or(1.0, |video| {
        let [w, h] = [video.pixel_width(), video.pixel_height()].map(|side| side.get() as f64);
        match (video.display_width(), video.display_height()) {
            (Some(shown_w), Some(shown_h)) => shown_w.get() as f64 * h / (shown_h.get() as f64 * w),
            _ => 1.0,
        }
    });
    let number = track.track_number().get();
    let seconds = file.info().timestamp_scale().get() as f64 * 1e-9;
    let (mut packets, mut frame, mut index) = (Vec::new(), Frame::default(), 0);
    while file.next_frame(&mut frame).map_err(broken)? {
        if frame.track == number {
            // Block groups have no mark for key frames.
            let is_key = frame.is_keyframe.unwrap_or_else(|| codec.is_key(&frame.data));
            let time_s = frame.timestamp as f64 * seconds;
            packets.push(Packet { time_s, is_key, bytes: [index, frame.data.len() as u64] });
        }
        index += 1;
        if packets.len() > MAX_FRAMES {
            return Err(VideoError::TooManyFrames);
        }
    }
    Stream { codec, packets, quarter_turns: 0, pixel_width_by_height }.checked()
}

/// Reads the data of packets in one pass, by their positions.
pub(crate) fn read_packets(
    source: &mut dyn Source,
    packets: &[Packet],
) -> Result<BTreeMap<u64, Vec<u8>>, VideoError> {
    source.rewind()?;
    let mut file = MatroskaFile::open(source).map_err(broken)?;
    let mut data: BTreeMap<u64, Vec<u8>> =
        packets.iter().map(|packet| (packet.bytes[0], Vec::new())).collect();
    let last = data.last_key_value().map_or(0, |(index, _)| *index);
    let (mut frame, mut index) = (Frame::default(), 0);
    while index <= last && file.next_frame(&mut frame).map_err(broken)? {
        if let Some(wanted) = data.get_mut(&index) {
            *wanted = std::mem::take(&mut frame.data);
        }
        index += 1;
    }
    Ok(data)
}

fn broken(error: matroska_demuxer::DemuxError) -> VideoError {
    VideoError::Broken(error.to_string())
}
