//! Frames of a video by time, and the median of several frames.

use std::io::Read as _;
use std::panic::{AssertUnwindSafe, catch_unwind};

use calib_image::EmptyScene;
use image::{RgbImage, imageops};

use crate::error::VideoError;
use crate::stream::{Packet, Source, Stream};
use crate::{avi, decoder, matroska, mp4};

/// Container of a video.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Container {
    Mp4,
    Matroska,
    Avi,
}

/// Video of a file.
pub struct Video {
    source: Box<dyn Source>,
    container: Container,
    stream: Stream,
}

impl std::fmt::Debug for Video {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Video").field("container", &self.container).field("stream", &self.stream).finish()
    }
}

/// Median of several frames of a video.
#[derive(Clone, Debug)]
pub struct Median {
    /// Image without the objects that move.
    pub scene: EmptyScene,
    /// Times of the frames, in seconds.
    pub times_s: Vec<f64>,
}

/// Largest memory of the packets or images that are in memory at once, in bytes.
const MAX_BYTES: u64 = 2 << 30;

/// Frames to decode from a group of packets.
struct Request {
    packets: Vec<Packet>,
    /// Times at which the frames of the group are shown, ascending.
    shown: Vec<f64>,
    /// Numbers of the frames in display order, ascending.
    numbers: Vec<usize>,
}

/// Packets from a key frame to the next one.
///
/// Frames that follow a key frame in the file can be shown before it. Some of them also need frames of the previous
/// group. They are decoded with that group, which therefore also contains the next key frame and these frames.
struct Group {
    packets: Vec<Packet>,
    /// Time of the next key frame, in seconds.
    end_s: f64,
}

/// Whether a file is a video, from its first bytes.
#[must_use]
pub fn is_video(beginning: &[u8]) -> bool {
    container_of(beginning).is_some()
}

fn container_of(beginning: &[u8]) -> Option<Container> {
    let has = |at: usize, name: &[u8]| beginning.get(at..at + name.len()) == Some(name);
    let is_box = [b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip"].iter().any(|name| has(4, &name[..]));
    // Images in the container of MP4.
    let is_image =
        [b"heic", b"heix", b"mif1", b"avif"].iter().any(|name| has(8, &name[..])) && has(4, b"ftyp");
    match () {
        () if has(0, b"RIFF") && has(8, b"AVI ") => Some(Container::Avi),
        () if has(0, &[0x1A, 0x45, 0xDF, 0xA3]) => Some(Container::Matroska),
        () if is_box && !is_image => Some(Container::Mp4),
        () => None,
    }
}

/// Runs a part of the reading; a panic of a library becomes an error of the file.
pub(crate) fn without_panic<T>(read: impl FnOnce() -> Result<T, VideoError>) -> Result<T, VideoError> {
    catch_unwind(AssertUnwindSafe(read))
        .unwrap_or_else(|_| Err(VideoError::Broken("its data are inconsistent".into())))
}

impl Video {
    /// Opens a video. The file is read in parts.
    ///
    /// # Errors
    ///
    /// Fails if the file is not a video with a supported codec, or is damaged.
    pub fn open(file: impl std::io::Read + std::io::Seek + 'static) -> Result<Self, VideoError> {
        let mut source: Box<dyn Source> = Box::new(file);
        let mut beginning = Vec::new();
        source.as_mut().take(16).read_to_end(&mut beginning)?;
        let container = container_of(&beginning).ok_or(VideoError::NotVideo)?;
        let stream = without_panic(|| match container {
            Container::Mp4 => mp4::read(source.as_mut()),
            Container::Matroska => matroska::read(source.as_mut()),
            Container::Avi => avi::read(source.as_mut()),
        })?;
        Ok(Self { source, container, stream })
    }

    /// Returns the number of frames.
    #[must_use]
    pub fn frame_count(&self) -> usize {
        self.stream.packets.len()
    }

    /// Returns the duration of the video, in seconds; the last frame is shown as long as an average frame.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        let last = self.stream.packets.iter().map(|packet| packet.time_s).fold(0.0, f64::max);
        let count = self.frame_count() as f64;
        if count > 1.0 { last * count / (count - 1.0) } else { last }
    }

    /// Returns the pixel aspect of the frames, as in `lens.pixel_aspect`: the vertical focal length in pixels divided
    /// by the horizontal one.
    #[must_use]
    pub fn pixel_aspect(&self) -> f64 {
        let aspect = self.stream.pixel_width_by_height;
        // A rotation by a quarter turn exchanges width and height.
        if self.stream.quarter_turns % 2 == 1 { aspect.recip() } else { aspect }
    }

    /// Returns the frame that is shown at a time, in seconds, with the time when it appears.
    ///
    /// # Errors
    ///
    /// Fails if the time is outside the video, or the frame cannot be decoded.
    pub fn frame_at(&mut self, time_s: f64) -> Result<(f64, RgbImage), VideoError> {
        let duration_s = self.duration_s();
        if !(0.0..=duration_s).contains(&time_s) {
            return Err(VideoError::OutsideVideo { time_s, duration_s });
        }
        let frames = self.frames_at(&[time_s], &mut |_| true)?;
        frames.into_iter().next().ok_or(VideoError::NoFrames)
    }

    /// Computes the median of `count` frames, evenly spaced over the video.
    ///
    /// `progress` gets the share of the work done, 0 to 1, and returns whether to continue.
    ///
    /// # Errors
    ///
    /// Fails if no frame can be decoded, or `progress` stops the work.
    pub fn median(
        &mut self,
        count: usize,
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Median, VideoError> {
        let mut frames = self.frames_at(&self.spread_times(count), progress)?;
        let size = frames.first().map(|(_, image)| image.dimensions()).ok_or(VideoError::NoFrames)?;
        // The size may change within a recording.
        frames.retain(|(_, image)| image.dimensions() == size);
        let times_s = frames.iter().map(|(time, _)| *time).collect();
        let images: Vec<RgbImage> = frames.into_iter().map(|(_, image)| image).collect();
        Ok(Median { scene: EmptyScene::new(&images), times_s })
    }

    /// Returns the times of `count` frames, in seconds, evenly spaced over the video. Frames that are quick to decode
    /// are preferred.
    #[must_use]
    pub fn spread_times(&self, count: usize) -> Vec<f64> {
        let count = count.clamp(1, self.frame_count().max(1));
        let packets = &self.stream.packets;
        let keys: Vec<Packet> = packets.iter().filter(|packet| packet.is_key).copied().collect();
        // Key frames need no other frame to be decoded.
        let shown = shown_times(if keys.len() >= count { &keys } else { packets });
        (0..count).filter_map(|i| shown.get((2 * i + 1) * shown.len() / (2 * count)).copied()).collect()
    }

    /// Returns the frames that are shown at these times, in seconds and in ascending order. Each frame is returned
    /// once, with the time when it appears.
    ///
    /// `progress` gets the share of the work done, 0 to 1, and returns whether to continue.
    ///
    /// # Errors
    ///
    /// Fails if no frame can be decoded, the frames need too much memory, or `progress` stops the work.
    pub fn frames_at(
        &mut self,
        times_s: &[f64],
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> Result<Vec<(f64, RgbImage)>, VideoError> {
        let requests = self.requests(times_s);
        // A Matroska file is read in one pass.
        let whole = match self.container {
            Container::Matroska => {
                let packets: Vec<Packet> =
                    requests.iter().flat_map(|request| request.packets.iter().copied()).collect();
                check_memory(&packets)?;
                let source = self.source.as_mut();
                Some(without_panic(|| matroska::read_packets(source, &packets))?)
            }
            _ => None,
        };
        let (mut found, mut last_error) = (Vec::new(), VideoError::NoFrames);
        for (index, request) in requests.iter().enumerate() {
            let data = match &whole {
                Some(whole) => request.packets.iter().map(|packet| whole[&packet.bytes[0]].clone()).collect(),
                None => self.read_packets(&request.packets)?,
            };
            let share = |part: f64| (index as f64 + part) / requests.len() as f64;
            let mut decoded = |part: f64| progress(share(part));
            match self.frames_of(request, &data, &mut found, &mut decoded) {
                Err(error @ (VideoError::Memory | VideoError::Cancelled)) => return Err(error),
                Err(error) => last_error = error,
                Ok(()) => {}
            }
            if !progress((index + 1) as f64 / requests.len() as f64) {
                return Err(VideoError::Cancelled);
            }
        }
        if found.is_empty() { Err(last_error) } else { Ok(found) }
    }

    /// Returns the decoding requests for the frames that are shown at these times, in seconds and in ascending order.
    fn requests(&self, times_s: &[f64]) -> Vec<Request> {
        let (mut requests, mut asked) = (Vec::new(), 0);
        for Group { mut packets, end_s } in self.groups() {
            let until = asked + times_s[asked..].iter().take_while(|time| **time < end_s).count();
            let shown = shown_times(&packets);
            let number = |time: &f64| shown.partition_point(|start| *start <= time + 1e-9).saturating_sub(1);
            let mut numbers: Vec<usize> = times_s[asked..until].iter().map(number).collect();
            numbers.dedup();
            asked = until;
            if numbers == [0] {
                // The first frame is a key frame, which needs no other frame.
                packets.truncate(1);
            }
            if !numbers.is_empty() {
                requests.push(Request { packets, shown, numbers });
            }
        }
        requests
    }

    /// Reads the data of packets by their positions.
    fn read_packets(&mut self, packets: &[Packet]) -> Result<Vec<Vec<u8>>, VideoError> {
        check_memory(packets)?;
        packets.iter().map(|packet| packet.read(self.source.as_mut())).collect()
    }

    /// Returns the groups of packets: each starts with a key frame.
    fn groups(&self) -> Vec<Group> {
        let runs: Vec<&[Packet]> = self.stream.packets.chunk_by(|_, next| !next.is_key).collect();
        let group = |index: usize| {
            let key = runs[index][0];
            let is_own = |packet: &&Packet| index == 0 || packet.time_s >= key.time_s;
            let mut packets: Vec<Packet> = runs[index].iter().filter(is_own).copied().collect();
            let next = runs.get(index + 1).copied().unwrap_or_default();
            let leading = |packet: &&Packet| packet.is_key || packet.time_s < next[0].time_s;
            packets.extend(next.iter().take_while(leading));
            Group { packets, end_s: next.first().map_or(f64::INFINITY, |key| key.time_s) }
        };
        (0..runs.len()).map(group).collect()
    }

    /// Decodes the requested frames and appends them to `found` with their times, in seconds. Fails
    /// if `progress` returns false.
    fn frames_of(
        &self,
        Request { shown, numbers, .. }: &Request,
        data: &[Vec<u8>],
        found: &mut Vec<(f64, RgbImage)>,
        progress: &mut dyn FnMut(f64) -> bool,
    ) -> Result<(), VideoError> {
        let mut is_cancelled = false;
        let (turns, last) = (self.stream.quarter_turns, numbers.last().copied().unwrap_or(0));
        let result = without_panic(|| {
            decoder::decode(&self.stream.codec, data, &mut |index, image| {
                if numbers.contains(&index) {
                    let image = turned(image()?, turns);
                    if (found.len() + 1) as u64 * image.as_raw().len() as u64 > MAX_BYTES {
                        return Err(VideoError::Memory);
                    }
                    found.push((shown[index.min(shown.len() - 1)], image));
                }
                is_cancelled = index < last && !progress(index as f64 / (last + 1) as f64);
                if index >= last || is_cancelled { Err(VideoError::Cancelled) } else { Ok(()) }
            })
        });
        match result {
            Err(VideoError::Cancelled) if !is_cancelled => Ok(()),
            other => other,
        }
    }
}

/// Checks that packets fit in memory.
fn check_memory(packets: &[Packet]) -> Result<(), VideoError> {
    let total: u64 = packets.iter().map(|packet| packet.bytes[1]).sum();
    if total > MAX_BYTES { Err(VideoError::Memory) } else { Ok(()) }
}

/// Returns the times at which the frames of a group are shown, ascending.
fn shown_times(group: &[Packet]) -> Vec<f64> {
    let mut times: Vec<f64> = group.iter().map(|packet| packet.time_s).collect();
    times.sort_by(f64::total_cmp);
    times
}

/// Rotates an image clockwise by quarter turns.
fn turned(image: RgbImage, quarter_turns: u8) -> RgbImage {
    match quarter_turns {
        1 => imageops::rotate90(&image),
        2 => imageops::rotate180(&image),
        3 => imageops::rotate270(&image),
        _ => image,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_not_videos_are_refused() {
        for data in [&b""[..], b"RIFF....WEBP", b"....ftypheic", &[0; 64]] {
            let error = Video::open(std::io::Cursor::new(data.to_vec())).unwrap_err();
            assert!(matches!(error, VideoError::NotVideo), "{error}");
        }
    }
}
