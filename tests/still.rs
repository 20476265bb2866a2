//! `calib still`: frames of a video, and snapshots from a simulated camera, a small server in this program.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::{TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, channel};

use calib_tests::Scratch;
use image::codecs::jpeg::JpegEncoder;
use image::{Rgb, RgbImage};

fn picture() -> RgbImage {
    RgbImage::from_fn(64, 48, |x, y| Rgb([(4 * x) as u8, (5 * y) as u8, 90]))
}

fn jpeg() -> Vec<u8> {
    let mut bytes = Vec::new();
    picture().write_with_encoder(JpegEncoder::new(&mut bytes)).unwrap();
    bytes
}

/// Starts a simulated camera. `answer` gets the path and the header `Authorization` of each request. Returns the
/// address of the camera without scheme, and the requests.
fn camera(
    answer: impl Fn(&str, Option<&str>) -> Vec<u8> + Send + 'static,
) -> (String, Receiver<(String, Option<String>)>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (sender, requests) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream: TcpStream = stream.unwrap();
            let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
            let Some(Ok(first)) = lines.next() else { continue };
            let path = first.split(' ').nth(1).unwrap().to_owned();
            let mut authorization = None;
            for line in lines.map_while(Result::ok).take_while(|line| !line.is_empty()) {
                if let Some((name, value)) = line.split_once(": ")
                    && name.eq_ignore_ascii_case("authorization")
                {
                    authorization = Some(value.to_owned());
                }
            }
            let bytes = answer(&path, authorization.as_deref());
            // A test may ignore the requests, and a client may not read the whole answer.
            let _ = sender.send((path, authorization));
            let _ = stream.write_all(&bytes);
        }
    });
    (address, requests)
}

fn response(status: &str, headers: &str, body: &[u8]) -> Vec<u8> {
    let length = body.len();
    let head = format!("HTTP/1.1 {status}\r\nContent-Length: {length}\r\nConnection: close\r\n{headers}\r\n");
    [head.as_bytes(), body].concat()
}

#[test]
fn a_snapshot_stays_as_the_camera_sent_it() {
    let (address, _) = camera(|_, _| response("200 OK", "", &jpeg()));
    let scratch = Scratch::new();
    scratch.calib(&["still", &format!("http://{address}/snap"), "-o", "a.jpg"]).expect_code(0);
    assert_eq!(std::fs::read(scratch.path("a.jpg")).unwrap(), jpeg());
    scratch.calib(&["still", &format!("http://{address}/snap"), "-o", "a.png"]).expect_code(0);
    assert_eq!(image::open(scratch.path("a.png")).unwrap().into_rgb8().dimensions(), (64, 48));
    let run = scratch.calib(&["still", &format!("http://{address}/snap"), "-o", "a.png"]).expect_code(1);
    assert!(run.stderr.contains("--force"), "{}", run.stderr);
}

#[test]
fn all_cameras_of_a_list_are_written() {
    let (address, requests) = camera(|path, authorization| match (path, authorization) {
        ("/a", _) => response("200 OK", "", &jpeg()),
        ("/b", Some("Basic YWRtaW46c2VjcmV0")) => response("200 OK", "", &jpeg()),
        ("/b", _) => response("401 Unauthorized", "WWW-Authenticate: Basic realm=\"camera\"\r\n", b""),
        _ => response("404 Not Found", "", b""),
    });
    let scratch = Scratch::new();
    std::fs::create_dir(scratch.path("lists")).unwrap();
    std::fs::write(scratch.path("lists/b.txt"), "admin\nsecret\n").unwrap();
    let list = |cameras: &[[&str; 2]]| {
        let entry = |&[id, rest]: &[&str; 2]| {
            let (path, more) = rest.split_once(' ').unwrap_or((rest, ""));
            format!("[[cameras]]\nid = \"{id}\"\naddress = \"http://{address}/{path}\"\n{more}\n")
        };
        std::fs::write(scratch.path("lists/cameras.toml"), cameras.iter().map(entry).collect::<String>())
            .unwrap();
    };
    let still = ["still", "--all", "lists/cameras.toml", "-o", "today"];
    list(&[["a", "a"], ["b", "b credentials = \"b.txt\""]]);
    let run = scratch.calib(&still).expect_code(0);
    assert!(run.stderr.contains("2 of 2 snapshots") && !run.stderr.contains("secret"), "{}", run.stderr);
    for id in ["a", "b"] {
        assert_eq!(std::fs::read(scratch.path(&format!("today/{id}.jpg"))).unwrap(), jpeg());
    }
    assert_eq!(requests.try_iter().filter(|(path, _)| path == "/b").count(), 2);
    // A camera that fails is named, and the others are written.
    list(&[["missing", "none"], ["c", "a"]]);
    let run = scratch.calib(&still).expect_code(1);
    assert!(run.stderr.contains("missing: ") && run.stderr.contains("404"), "{}", run.stderr);
    assert!(scratch.path("today/c.jpg").exists() && !scratch.path("today/missing.jpg").exists());
    // Ids become file names, and files are not replaced silently.
    let run = scratch.calib(&still).expect_code(1);
    assert!(run.stderr.contains("--force"), "{}", run.stderr);
    for (id, words) in [("../x", "file name"), ("", "empty")] {
        list(&[[id, "a"]]);
        let run = scratch.calib(&still).expect_code(3);
        assert!(run.stderr.contains(words), "{}", run.stderr);
    }
    list(&[["a", "a"], ["A", "a"]]);
    assert!(scratch.calib(&still).expect_code(3).stderr.contains("listed twice"));
    list(&[["a", "a password = \"hidden\""]]);
    let run = scratch.calib(&still).expect_code(3);
    assert!(run.stderr.contains("line 4") && !run.stderr.contains("hidden"), "{}", run.stderr);
    std::fs::write(scratch.path("lists/cameras.toml"), "cameras = [\"http://admin:hidden@10.0.0.1\"]")
        .unwrap();
    let run = scratch.calib(&still).expect_code(3);
    assert!(!run.stderr.contains("hidden"), "{}", run.stderr);
    // An image of an earlier day does not remain for a camera that fails.
    list(&[["a", "none"]]);
    let run = scratch.calib(&[&still[..], &["--force"]].concat()).expect_code(1);
    assert!(run.stderr.contains("404") && !scratch.path("today/a.jpg").exists(), "{}", run.stderr);
    assert!(
        scratch
            .calib(&["still", "--all", "lists/cameras.toml", "-o", "-"])
            .expect_code(2)
            .stderr
            .contains("folder")
    );
}

#[test]
fn basic_and_digest_authentication_are_answered_and_never_printed() {
    let basic = "WWW-Authenticate: Basic realm=\"camera\"\r\n";
    let digest = "WWW-Authenticate: Digest realm=\"camera\", qop=\"auth\", nonce=\"abc\", algorithm=MD5\r\n";
    for (challenge, scheme) in [(basic, "Basic YWRtaW46c2VjcmV0"), (digest, "Digest username=\"admin\"")] {
        let (address, requests) = camera(move |_, authorization| match authorization {
            Some(value) if value.starts_with(scheme) => response("200 OK", "", &jpeg()),
            _ => response("401 Unauthorized", challenge, b""),
        });
        let scratch = Scratch::new();
        std::fs::write(scratch.path("secrets"), "admin\nsecret\n").unwrap();
        let url = format!("http://{address}/snap?channel=1");
        scratch.calib(&["still", &url, "-o", "a.jpg", "--credentials", "secrets"]).expect_code(0);
        let seen: Vec<_> = requests.try_iter().collect();
        assert_eq!((seen.len(), &seen[0].1), (2, &None), "{seen:?}");
        if scheme.starts_with("Digest") {
            let header = seen[1].1.as_deref().unwrap();
            assert!(header.contains("uri=\"/snap?channel=1\"") && !header.contains("secret"), "{header}");
        }
        // A name in the address is used, and is not part of a message.
        let wrong = format!("http://admin:hidden@{address}/snap");
        let run = scratch.calib(&["still", &wrong, "-o", "b.jpg"]);
        assert!(!run.stderr.contains("hidden") && !run.stderr.contains("admin"), "{}", run.stderr);
        let run = scratch.calib(&["still", &url, "-o", "c.jpg"]).expect_code(1);
        assert!(run.stderr.contains("CALIB_CAMERA_USER"), "{}", run.stderr);
        assert!(!scratch.path("c.jpg").exists());
    }
}

#[test]
fn secrets_stay_with_their_host() {
    let (other, requests) =
        camera(|_, _| response("401 Unauthorized", "WWW-Authenticate: Basic realm=\"other\"\r\n", b""));
    let target = other.replace("127.0.0.1", "localhost");
    let (address, _) =
        camera(move |_, _| response("302 Found", &format!("Location: http://{target}/x\r\n"), b""));
    let scratch = Scratch::new();
    scratch.calib(&["still", &format!("http://admin:hidden@{address}/"), "-o", "a.jpg"]).expect_code(1);
    let seen: Vec<_> = requests.try_iter().collect();
    assert!(seen.iter().all(|(_, authorization)| authorization.is_none()), "{seen:?}");
}

#[test]
fn other_answers_are_explained() {
    let (address, _) = camera(|path, _| match path {
        "/page" => response("200 OK", "", b"<html>log in</html>"),
        "/loop" => response("302 Found", "Location: /loop\r\n", b""),
        _ => response("404 Not Found", "", b""),
    });
    let scratch = Scratch::new();
    let say = |source: &str, code| scratch.calib(&["still", source, "-o", "a.png"]).expect_code(code).stderr;
    assert!(say(&format!("http://{address}/page"), 3).contains("not an image"));
    assert!(say(&format!("http://{address}/nothing"), 1).contains("404"));
    assert!(say(&format!("http://{address}/loop"), 1).contains("redirects"));
    assert!(say("ftp://127.0.0.1/1", 3).contains("ffmpeg"));
    for secret in [format!("http://{address}/nothing?pwd=hidden"), "http://admin:hid/den@127.0.0.1/".into()] {
        let run = scratch.calib(&["still", &secret, "-o", "a.png"]);
        assert!(!run.stderr.contains("hidden") && !run.stderr.contains("hid/den"), "{}", run.stderr);
    }
    let run = scratch.calib(&["still", &format!("http://{address}/"), "-o", "a.png", "--median", "5"]);
    assert!(run.expect_code(2).stderr.contains("video files"));
    assert!(!scratch.path("a.png").exists());
}

/// Returns an AVI file with motion JPEG: its lists of headers and frames.
fn avi(frames: &[RgbImage], frames_per_second: u32) -> Vec<u8> {
    let chunk = |name: &[u8; 4], body: &[u8]| {
        let padding = vec![0; body.len() % 2];
        [&name[..], &(body.len() as u32).to_le_bytes(), body, &padding].concat()
    };
    let list = |name: &[u8; 4], body: &[u8]| chunk(b"LIST", &[&name[..], body].concat());
    let mut header = b"vidsMJPG".to_vec();
    header.extend([0; 12]);
    header.extend(1_u32.to_le_bytes());
    header.extend(frames_per_second.to_le_bytes());
    header.extend([0; 28]);
    let headers = list(b"hdrl", &list(b"strl", &chunk(b"strh", &header)));
    let encoded = |frame: &RgbImage| {
        let mut bytes = Vec::new();
        frame.write_with_encoder(JpegEncoder::new_with_quality(&mut bytes, 90)).unwrap();
        chunk(b"00dc", &bytes)
    };
    let movi = list(b"movi", &frames.iter().flat_map(encoded).collect::<Vec<u8>>());
    chunk(b"RIFF", &[b"AVI ".to_vec(), headers, movi].concat())
}

#[test]
fn the_median_of_a_clip_calibrates_as_the_empty_shop() {
    let demo = calib_demo::demo_site();
    let (_, truth) = &demo.truth[0];
    let size = demo.site.cameras[0].size_px;
    let empty = calib_demo::render(truth, size);
    let frame = |number: u32| {
        let mut image = empty.clone();
        let (left, top) = (number * size[0] / 15, size[1] / 3);
        for (x, y) in (0..size[1] / 2).flat_map(|y| (0..100).map(move |x| (left + x, top + y))) {
            if x < size[0] {
                image.put_pixel(x, y, Rgb([180, 40, 40]));
            }
        }
        image
    };
    let frames: Vec<RgbImage> = (0..15).map(frame).collect();
    let scratch = Scratch::new();
    std::fs::write(scratch.path("clip.avi"), avi(&frames, 5)).unwrap();
    let run = scratch.calib(&["still", "clip.avi", "-o", "still.png", "--median", "15"]).expect_code(0);
    assert!(run.stderr.contains("median of 15 of 15 frames"), "{}", run.stderr);
    let still = image::open(scratch.path("still.png")).unwrap().into_rgb8();
    let off = still.as_raw().iter().zip(empty.as_raw()).map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>();
    assert!(off / (still.as_raw().len() as f64) < 2.0, "{off}");
    let run = scratch.calib(&["propose", "still.png", "--format", "json"]).expect_code(0);
    let focal = run.json()["cameras"][0]["focal_px"].as_f64().unwrap();
    assert!((focal / truth.focal - 1.0).abs() < 0.02, "{focal}, expected {}", truth.focal);
    scratch.calib(&["still", "clip.avi", "-o", "one.png", "--at", "00:01.0"]).expect_code(0);
    let one = image::open(scratch.path("one.png")).unwrap().into_rgb8();
    let [r, g, _] = one.get_pixel(5 * size[0] / 15 + 50, size[1] / 2).0;
    assert!(r > 140 && g < 90, "{r} {g}");
    let run = scratch.calib(&["still", "clip.avi", "-o", "late.png", "--at", "9"]).expect_code(3);
    assert!(run.stderr.contains("lasts 3.00 s"), "{}", run.stderr);
}

/// Returns the brightness of a pixel in the first frame of the clips of `calib-video`: a gradient, and a white
/// square.
fn expected_brightness(x: u32, y: u32) -> u8 {
    if (24..40).contains(&y) && x < 16 { 235 } else { (40 + x + y / 2) as u8 }
}

/// Starts a camera with a video stream (RTSP over TCP). It sends the key frame of a clip in H.264, once. With
/// `digest`, it requires a password. Returns its address without scheme, and the headers `Authorization`.
fn video_camera(digest: bool) -> (String, Receiver<String>) {
    let clip: &[u8] = include_bytes!("../crates/calib-video/tests/clips/h264.mp4");
    let at = clip.windows(4).position(|four| four == b"mdat").unwrap() + 4;
    let length = |at: usize| u32::from_be_bytes(clip[at..at + 4].try_into().unwrap()) as usize;
    let key = at + 4 + length(at);
    let key_frame = clip[key + 4..key + 4 + length(key)].to_vec();
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap().to_string();
    let (sender, seen) = channel();
    std::thread::spawn(move || {
        for stream in listener.incoming() {
            let mut stream = stream.unwrap();
            let mut lines = BufReader::new(stream.try_clone().unwrap()).lines();
            while let Some(Ok(first)) = lines.next() {
                let header = |name: &str, lines: &[String]| {
                    let found = lines.iter().find_map(|line| line.strip_prefix(&format!("{name}: ")));
                    found.unwrap_or_default().to_owned()
                };
                let head: Vec<String> =
                    lines.by_ref().map_while(Result::ok).take_while(|line| !line.is_empty()).collect();
                let (number, secret) = (header("CSeq", &head), header("Authorization", &head));
                // A test may ignore the headers.
                let _ = sender.send(secret.clone());
                let sdp = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=camera\r\nt=0 0\r\nm=video 0 RTP/AVP 96\r\n\
                           a=rtpmap:96 H264/90000\r\na=fmtp:96 packetization-mode=1;\
                           sprop-parameter-sets=Z2QACqzZRiaEAAADAAQAAAMAIDxIllg=,aOvg7LIs\r\na=control:track1\r\n";
                let answer = match first.split(' ').next().unwrap() {
                    _ if digest && secret.is_empty() => {
                        "401 Unauthorized\r\nWWW-Authenticate: Digest realm=\"camera\", nonce=\"abc\""
                            .to_owned()
                    }
                    "DESCRIBE" if first.contains("/none") => "404 Not Found".to_owned(),
                    "DESCRIBE" => {
                        format!("200 OK\r\nContent-Type: application/sdp\r\nContent-Length: {}", sdp.len())
                    }
                    "SETUP" => {
                        "200 OK\r\nSession: 1\r\nTransport: RTP/AVP/TCP;unicast;interleaved=0-1".to_owned()
                    }
                    _ => "200 OK\r\nSession: 1".to_owned(),
                };
                let body = if answer.contains("sdp") { sdp } else { "" };
                write!(stream, "RTSP/1.0 {answer}\r\nCSeq: {number}\r\n\r\n{body}").unwrap();
                if first.starts_with("PLAY") && !first.contains("/silent") {
                    // RTP: version 2; the last packet of a frame of type 96; number, time and source.
                    let rtp = [&[0x80, 0x80 | 96, 0, 1, 0, 0, 0, 9, 0, 0, 0, 7][..], &key_frame].concat();
                    let head = [b'$', 0, (rtp.len() >> 8) as u8, rtp.len() as u8];
                    stream.write_all(&[&head[..], &rtp].concat()).unwrap();
                }
            }
        }
    });
    (address, seen)
}

#[test]
fn the_key_frame_of_a_video_stream_is_read() {
    let scratch = Scratch::new();
    let (address, _) = video_camera(false);
    scratch.calib(&["still", &format!("rtsp://{address}/stream1"), "-o", "a.png"]).expect_code(0);
    let image = image::open(scratch.path("a.png")).unwrap().into_rgb8();
    assert_eq!(image.dimensions(), (96, 64));
    let mut off: Vec<u8> = image
        .enumerate_pixels()
        .map(|(x, y, pixel)| pixel.0[1].abs_diff(expected_brightness(x, y)))
        .collect();
    off.sort_unstable();
    assert!(off[off.len() * 99 / 100] <= 12, "{off:?}");
    let run = scratch.calib(&["still", &format!("rtsp://{address}/none"), "-o", "b.png"]).expect_code(1);
    assert!(run.stderr.contains("404"), "{}", run.stderr);
    let silent = format!("rtsp://{address}/silent?password=hidden");
    let run = scratch.calib(&["still", &silent, "-o", "b.png", "--timeout", "1"]).expect_code(1);
    assert!(run.stderr.contains("1 s") && !run.stderr.contains("hidden"), "{}", run.stderr);
    assert!(!scratch.path("b.png").exists());
}

#[test]
fn a_video_stream_gets_the_password_as_a_digest() {
    let scratch = Scratch::new();
    let (address, seen) = video_camera(true);
    let run = scratch.calib(&["still", &format!("rtsp://{address}/"), "-o", "a.png"]).expect_code(1);
    assert!(run.stderr.contains("CALIB_CAMERA_USER"), "{}", run.stderr);
    let url = format!("rtsp://admin:hidden@{address}/");
    let run = scratch.calib(&["still", &url, "-o", "a.png"]).expect_code(0);
    assert!(!run.stderr.contains("hidden"), "{}", run.stderr);
    let headers: Vec<String> = seen.try_iter().filter(|header| !header.is_empty()).collect();
    assert!(headers.len() >= 3, "{headers:?}");
    let is_digest = |header: &String| header.starts_with("Digest ") && !header.contains("hidden");
    assert!(headers.iter().all(is_digest), "{headers:?}");
}
