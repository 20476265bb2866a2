//! Key frames of video streams by RTSP, over TCP.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Duration;

use futures::StreamExt as _;
use image::RgbImage;
use retina::client::{PlayOptions, Session, SessionOptions, SetupOptions, Transport};
use retina::codec::{CodecItem, FrameFormat, ParametersRef};
use url::Url;

use crate::address::{Credentials, Snapshot, SnapshotError};
use crate::decoder;
use crate::error::VideoError;
use crate::stream::Codec;
use crate::video::without_panic;

/// Reads the next key frame of a stream. `timeout` is the maximum time for all steps.
pub(crate) fn read(
    address: &str,
    credentials: Option<&Credentials>,
    timeout: Duration,
) -> Result<Snapshot, SnapshotError> {
    let failed = |what: &dyn std::fmt::Display| SnapshotError::failed(address, what);
    let contradiction = || failed(&"sends video data that cannot be decoded; try again");
    let frame = catch_unwind(AssertUnwindSafe(|| {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
        let runtime = runtime.map_err(|error| failed(&error))?;
        let steps = async { tokio::time::timeout(timeout, key_frame(address, credentials)).await };
        let frame = runtime.block_on(steps);
        // The connection is closed at once: cameras end the session then.
        runtime.shutdown_background();
        let seconds = timeout.as_secs();
        let late = |_| failed(&format!("sent no complete image within {seconds} s; check the address"));
        frame.map_err(late)?
    }));
    let frame = frame.unwrap_or_else(|_| Err(contradiction()))?;
    let image = frame.decode().map_err(|error| failed(&format!("its video {error}")))?;
    Ok(Snapshot { image, jpeg: None, pixel_aspect: frame.pixel_aspect })
}

/// Compressed frame that can be decoded alone.
struct KeyFrame {
    codec: Codec,
    data: Vec<u8>,
    /// Pixel aspect `fy / fx`: the width of a pixel divided by its height.
    pixel_aspect: f64,
}

impl KeyFrame {
    fn decode(&self) -> Result<RgbImage, VideoError> {
        let mut first = None;
        without_panic(|| {
            decoder::decode(&self.codec, std::slice::from_ref(&self.data), &mut |index, image| {
                if index == 0 {
                    first = Some(image()?);
                }
                Ok(())
            })
        })?;
        first.ok_or(VideoError::NoFrames)
    }
}

/// Number of damaged packets after which the stream is not read further.
const MAX_DAMAGED_PACKETS: usize = 1000;

/// Returns the error of a camera's answer, or of the connection.
fn error_of(address: &str, has_credentials: bool, error: &retina::Error) -> SnapshotError {
    let what = match error.status_code() {
        Some(401) if !has_credentials => return SnapshotError::without_credentials(address),
        Some(401) => {
            "rejected the user name or password, or uses an unsupported authentication method".into()
        }
        Some(403) => "denied access (403); check the permissions of this user in the camera".into(),
        Some(404) => "has no stream with this name (404); check the address".into(),
        Some(code @ (454 | 461)) => {
            format!("does not send its video over TCP ({code}); allow RTSP over TCP in the camera")
        }
        Some(code) => format!("responded with error {code}; check the address"),
        None => error.to_string(),
    };
    SnapshotError::failed(address, what)
}

/// Opens a session, and waits for the next key frame of its first video.
async fn key_frame(address: &str, credentials: Option<&Credentials>) -> Result<KeyFrame, SnapshotError> {
    let failed = |error: retina::Error| error_of(address, credentials.is_some(), &error);
    let url = Url::parse(address).map_err(|error| SnapshotError::invalid(address, error))?;
    let creds = credentials.map(|Credentials { user, password }| retina::client::Credentials {
        username: user.clone(),
        password: password.clone(),
    });
    let options = SessionOptions::default().creds(creds).user_agent("calib".into());
    let mut session = Session::describe(url, options).await.map_err(failed)?;
    let codec_of = |name: &str| match name {
        "h264" => Some(Codec::H264(None)),
        "h265" => Some(Codec::H265(None)),
        "jpeg" => Some(Codec::MotionJpeg),
        _ => None,
    };
    let videos = session.streams().iter().enumerate().filter(|(_, stream)| stream.media() == "video");
    let names: Vec<(usize, String)> =
        videos.map(|(index, stream)| (index, stream.encoding_name().to_owned())).collect();
    let found = names.iter().find_map(|(index, name)| Some((*index, codec_of(name)?)));
    let (index, codec) = found.ok_or_else(|| {
        let what = match names.first() {
            None => "has no video; enter the address of a video stream".to_owned(),
            Some((_, name)) => {
                format!(
                    "sends video with the codec {name}, which is not supported; set H.264, H.265 or motion JPEG in the \
                     camera"
                )
            }
        };
        SnapshotError::failed(address, what)
    })?;
    let transport = Transport::Tcp(retina::client::TcpTransportOptions::default());
    let setup = SetupOptions::default().transport(transport).frame_format(FrameFormat::SIMPLE);
    session.setup(index, setup).await.map_err(failed)?;
    let session = session.play(PlayOptions::default()).await.map_err(failed)?;
    let mut frames = session.demuxed().map_err(failed)?;
    let mut damaged = 0;
    loop {
        match frames.next().await {
            Some(Ok(CodecItem::VideoFrame(frame))) if frame.is_random_access_point() => {
                let parameters = match frames.streams()[index].parameters() {
                    Some(ParametersRef::Video(parameters)) => parameters.pixel_aspect_ratio(),
                    _ => None,
                };
                let pixel_aspect = parameters.filter(|&(w, h)| w > 0 && h > 0);
                let pixel_aspect = pixel_aspect.map_or(1.0, |(w, h)| f64::from(w) / f64::from(h));
                return Ok(KeyFrame { codec, data: frame.into_data(), pixel_aspect });
            }
            Some(Ok(_)) => {}
            // The first packets may belong to a frame whose beginning was not received.
            Some(Err(_)) if damaged < MAX_DAMAGED_PACKETS => damaged += 1,
            Some(Err(error)) => return Err(failed(error)),
            None => {
                return Err(SnapshotError::failed(address, "ended the stream before an image was complete"));
            }
        }
    }
}
