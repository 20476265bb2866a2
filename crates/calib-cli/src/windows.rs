//! `calib undistort` of wide lenses: windows that look anywhere, each an image with its pinhole camera beside it.

use std::path::Path;

use calib_core::{Camera, Distortion, Lens, Pixel, Plane, Window};

use calib_core::floor::{Look, Mount, lens_reach};

use calib_formats::remap_npy;
use calib_report::lens_of;
use calib_site::{SiteCamera, Stage};
use clap::ValueEnum;
use image::RgbImage;
use serde_json::json;

use crate::args::{OutputArgs, size};
use crate::files;
use crate::picture;
use crate::stop::Stop;

/// How a camera hangs.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum MountArg {
    /// It looks down: four windows look outward, and the panorama goes round its axis
    Ceiling,
    /// It looks level: windows and panorama are upright as its image is
    Wall,
}

/// Windows that are asked for.
#[derive(Debug, clap::Args)]
pub(crate) struct WindowArgs {
    /// A flat window instead, of any lens: where it looks from the camera's own axis, and how wide it is, in degrees; may be
    /// given again. As in a site, pitch is positive down and yaw positive to the left; a roll may follow
    #[arg(long, value_name = "PITCH,YAW,HFOV", value_parser = look, allow_hyphen_values = true, conflicts_with = "crop")]
    look: Vec<Look>,
    /// Four flat windows round the camera's axis
    #[arg(long, conflicts_with = "crop")]
    quadrants: bool,
    /// All round, unrolled: a cylinder
    #[arg(long, conflicts_with = "crop")]
    panorama: bool,
    /// How the camera hangs, for --quadrants and --panorama; by default a ceiling where it is known to look down
    #[arg(long, value_enum)]
    mount: Option<MountArg>,
    /// Size of a window [default: 1280x720, 2400x800 for --panorama]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Write the map from every window to the raw image, too (NPY, for cv2.remap)
    #[arg(long)]
    remap: bool,
}

/// A look, such as 45,-90,80.
fn look(text: &str) -> Result<Look, String> {
    let wrong = || {
        "expected PITCH,YAW,HFOV or PITCH,YAW,HFOV,ROLL in degrees, such as 45,-90,80; HFOV up to 170"
            .to_owned()
    };
    let parts: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let parts = parts.ok_or_else(wrong)?;
    let (&[pitch, yaw, hfov], roll) = match parts.split_first_chunk::<3>() {
        Some((first, [])) => (first, 0.0),
        Some((first, &[roll])) => (first, roll),
        _ => return Err(wrong()),
    };
    let [pitch, yaw, hfov, roll] = [pitch, yaw, hfov, roll].map(f64::to_radians);
    let asked = Look { pitch, yaw, roll, hfov };
    Window::flat(asked, [1, 1]).map(|_| asked).ok_or_else(wrong)
}

/// A window with its name, which is empty where it is the only one.
type Named = (String, Window);

impl WindowArgs {
    /// Whether any window is asked for.
    pub(crate) fn is_asked(&self) -> bool {
        !self.look.is_empty() || self.quadrants || self.panorama
    }

    /// Refuses what would do nothing.
    pub(crate) fn check(&self) -> Result<(), Stop> {
        let alone =
            [("--mount", self.mount.is_some()), ("--size", self.size.is_some()), ("--remap", self.remap)];
        match alone.into_iter().find(|(_, is_given)| *is_given && !self.is_asked()) {
            Some((name, _)) => {
                Err(Stop::Usage(format!("{name} needs --look, --quadrants or --panorama beside it")))
            }
            None => Ok(()),
        }
    }

    fn windows(&self, mount: Mount, reach: f64) -> Option<Vec<Named>> {
        let sized = |usual: [u32; 2]| self.size.unwrap_or(usual).map(|side| side as usize);
        let usual = sized([1280, 720]);
        let mut found: Vec<Named> = Vec::new();
        for (index, &look) in self.look.iter().enumerate() {
            found.push((format!("look-{}", index + 1), Window::flat(look, usual)?));
        }
        if self.quadrants {
            let four = Window::quadrants(mount, usual)?.into_iter().enumerate();
            found.extend(four.map(|(index, window)| (format!("quadrant-{}", index + 1), window)));
        }
        if self.panorama {
            found.push(("panorama".into(), Window::panorama(mount, reach, sized([2400, 800]))?));
        }
        if let [(name, _)] = &mut found[..] {
            name.clear();
        }
        Some(found)
    }
}

/// The lens and focal of a camera whose windows are asked for.
fn seen_through(entry: &SiteCamera) -> Result<(Lens, f64), Stop> {
    let lens = lens_of(entry);
    let own = (lens.distortion != Distortion::None).then_some(lens.focal);
    let focal = entry.solution.as_ref().map(|solution| solution.focal_px).or(own);
    let unknown =
        || Stop::Unsolved(format!("camera \"{}\": nothing tells its focal: solve it first", entry.id));
    Ok((lens, focal.ok_or_else(unknown)?))
}

/// Writes every window, and beside it the camera that it is.
pub(crate) fn run(
    args: &WindowArgs,
    output: &OutputArgs,
    entry: &SiteCamera,
    image: &RgbImage,
) -> Result<(), Stop> {
    let (lens, focal) = seen_through(entry)?;
    let camera = entry.camera();
    let mount = match (args.mount, &camera) {
        (Some(MountArg::Ceiling), _) => Mount::Ceiling,
        (Some(MountArg::Wall), _) => Mount::Wall,
        (None, Some(camera)) => Mount::of_pitch(camera.pitch),
        (None, None) => Mount::Ceiling,
    };
    let (width, height) = image.dimensions();
    let reach = lens_reach(&lens, focal, [f64::from(width), f64::from(height)]);
    let windows = args.windows(mount, reach).ok_or_else(|| Stop::Usage("a window has no size".into()))?;
    if windows.len() > 1 && output.is_stdout() {
        return Err(Stop::Usage("several windows are several files: -o FILE names them".into()));
    }
    let (lens, camera) = (&lens, camera.as_ref());
    let seen = windows
        .iter()
        .map(|(name, window)| (output.named(name), Seen { window, lens, focal, camera, entry, reach }));
    let seen: Vec<(String, Seen<'_>)> = seen.collect();
    // All of them or none.
    for (file, window) in &seen {
        window.check([width, height])?;
        let extensions: &[&str] = if args.remap { &["json", "remap.npy"] } else { &["json"] };
        let others = extensions.iter().map(|extension| beside(file, extension));
        let others = others.filter(|_| !output.is_stdout());
        std::iter::once(file.clone()).chain(others).try_for_each(|file| output.check_named(&file))?;
    }
    seen.iter().try_for_each(|(file, window)| window.write(args, output, file, image))
}

/// The name of what stands beside an image.
fn beside(file: &str, extension: &str) -> String {
    Path::new(file).with_extension(extension).to_string_lossy().into_owned()
}

/// A window of one camera.
struct Seen<'a> {
    window: &'a Window,
    lens: &'a Lens,
    focal: f64,
    camera: Option<&'a Camera>,
    entry: &'a SiteCamera,
    /// Radians from the axis.
    reach: f64,
}

impl Seen<'_> {
    fn write(
        &self,
        args: &WindowArgs,
        output: &OutputArgs,
        file: &str,
        image: &RgbImage,
    ) -> Result<(), Stop> {
        let size = [image.width(), image.height()].map(|side| side as usize);
        let [width, height] = self.window.size;
        let too_large = || anyhow::anyhow!("an image of {width} x {height} pixels cannot be made");
        let map = self.window.remap(self.lens, self.focal, size).ok_or_else(too_large)?;
        let mut bytes = vec![0; 3 * width * height];
        if !map.apply_into(image.as_raw(), &mut bytes) {
            return Err(too_large().into());
        }
        let picture = RgbImage::from_raw(width as u32, height as u32, bytes).ok_or_else(too_large)?;
        if output.is_stdout() {
            return output.write_image(&picture);
        }
        let numbers = format!("{:#}\n", self.numbers(image));
        output.write_named(file, &picture::encoded(&picture, file)?)?;
        output.write_named(&beside(file, "json"), numbers.as_bytes())?;
        if args.remap {
            let npy = remap_npy(self.window.size.map(|side| side as u32), |pixel| self.raw(pixel));
            output.write_named(&beside(file, "remap.npy"), &npy)?;
        }
        let Pixel { u, v } = self.window.principal_point;
        let kind = if self.window.is_round { "pixels for a radian" } else { "focal" };
        files::say(format_args!(
            "{file}: {kind} {:.2} px, principal point {u:.2}, {v:.2}",
            self.window.focal
        ));
        Ok(())
    }

    fn raw(&self, pixel: Pixel) -> Option<Pixel> {
        self.window.raw(self.lens, self.focal, pixel)
    }

    /// Refuses a window that none of the raw image is in.
    fn check(&self, [width, height]: [u32; 2]) -> Result<(), Stop> {
        const STEPS: u32 = 24;
        let [w, h] = self.window.size.map(|side| side as f64 / f64::from(STEPS));
        let within =
            |p: Pixel| p.u >= 0.0 && p.v >= 0.0 && p.u <= f64::from(width) && p.v <= f64::from(height);
        let at = |i: u32| Pixel::new(w * (f64::from(i % STEPS) + 0.5), h * (f64::from(i / STEPS) + 0.5));
        if (0..STEPS * STEPS).any(|i| self.raw(at(i)).is_some_and(within)) {
            return Ok(());
        }
        let (id, reach) = (&self.entry.id, self.reach.to_degrees());
        Err(Stop::Usage(format!("camera \"{id}\" sees nothing there: up to {reach:.0}\u{b0} off its axis")))
    }

    /// The window as a camera: its numbers, under the names that the table of `calib export` has for them.
    fn numbers(&self, image: &RgbImage) -> serde_json::Value {
        let window = self.window;
        // Of a camera that nothing places the world is its own.
        let is_placed = self.entry.solution.as_ref().is_some_and(|solution| solution.stage > Stage::Partial);
        let placed = self.camera.filter(|_| is_placed);
        let pinhole = placed.and_then(|camera| window.camera(camera));
        let mut numbers = json!({
            "format": "calib-window", "version": 1, "units": "m, px", "pixel_origin": "corner",
            "camera_id": self.entry.id,
            "of_image_px": [image.width(), image.height()],
            "kind": if window.is_round { "cylinder" } else { "pinhole" },
            "width": window.size[0], "height": window.size[1],
            "focal_px": window.focal,
            "principal_point_px": <[f64; 2]>::from(window.principal_point),
            "window_from_camera": window.window_from_camera().concat(),
        });
        if let Some(pinhole) = pinhole {
            numbers["undistorted_px_from_world"] = json!(pinhole.projection_matrix().concat());
            numbers["floor_from_undistorted_px"] =
                json!(pinhole.homography_plane_from_pixel(&Plane::FLOOR).concat());
        }
        numbers
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn looks_are_angles_in_degrees() {
        let asked = look("45,-90, 80").unwrap();
        assert!((asked.pitch - 0.25 * std::f64::consts::PI).abs() < 1e-12);
        assert!((asked.yaw + 0.5 * std::f64::consts::PI).abs() < 1e-12 && asked.roll == 0.0);
        assert!((look("0,0,90,30").unwrap().roll - 30.0_f64.to_radians()).abs() < 1e-12);
        for wrong in ["", "45", "45,0", "0,0,0", "0,0,171", "0,0,nan", "inf,0,90", "0,0,90,0,0", "a,b,c"] {
            assert!(look(wrong).is_err(), "{wrong}");
        }
    }
}
