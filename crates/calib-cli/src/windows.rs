//! `calib undistort` for wide lenses: virtual views in any direction, each an image with the numbers of its
//! pinhole or cylindrical camera.

use std::path::Path;

use calib_core::{Camera, Distortion, Lens, Pixel, Plane, Window};

use calib_core::floor::{Mount, ViewDirection, lens_reach};

use calib_formats::remap_npy;
use calib_report::camera_lens;
use calib_site::{SiteCamera, Stage};
use clap::ValueEnum;
use image::RgbImage;
use serde_json::json;

use crate::args::{OutputArgs, size};
use crate::files;
use crate::picture;
use crate::stop::CommandError;

/// Mounting of a camera.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum MountArg {
    /// Looks down: four views look outward, and the panorama goes around the camera's axis
    Ceiling,
    /// Looks level: views and panorama have the orientation of the image
    Wall,
}

/// Arguments for virtual views.
#[derive(Debug, clap::Args)]
pub(crate) struct WindowArgs {
    /// Write a flat view with this direction from the camera's axis and this horizontal field of view, in
    /// degrees (repeat for more). As in a site, pitch is positive down and yaw positive to the left; a roll
    /// may follow
    #[arg(long, value_name = "PITCH,YAW,HFOV", value_parser = look, allow_hyphen_values = true, conflicts_with = "crop")]
    look: Vec<ViewDirection>,
    /// Write four flat views around the camera's axis
    #[arg(long, conflicts_with = "crop")]
    quadrants: bool,
    /// Write a cylindrical panorama
    #[arg(long, conflicts_with = "crop")]
    panorama: bool,
    /// Mounting of the camera, for --quadrants and --panorama; by default wall if the pitch is known and at
    /// most 45°, otherwise ceiling
    #[arg(long, value_enum)]
    mount: Option<MountArg>,
    /// Size of a view [default: 1280x720, 2400x800 for --panorama]
    #[arg(long, value_name = "WxH", value_parser = size)]
    size: Option<[u32; 2]>,
    /// Also write the map from every view to the raw image (NPY, for cv2.remap)
    #[arg(long)]
    remap: bool,
}

/// Parses a view direction `PITCH,YAW,HFOV[,ROLL]` in degrees, such as 45,-90,80.
fn look(text: &str) -> Result<ViewDirection, String> {
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
    let direction = ViewDirection { pitch, yaw, roll, hfov };
    Window::flat(direction, [1, 1]).map(|_| direction).ok_or_else(wrong)
}

/// View with its name; the name is empty for a single view.
type NamedWindow = (String, Window);

impl WindowArgs {
    /// Whether any view is requested.
    pub(crate) fn is_requested(&self) -> bool {
        !self.look.is_empty() || self.quadrants || self.panorama
    }

    /// Refuses arguments that have no effect because no view is requested.
    pub(crate) fn check(&self) -> Result<(), CommandError> {
        let alone =
            [("--mount", self.mount.is_some()), ("--size", self.size.is_some()), ("--remap", self.remap)];
        match alone.into_iter().find(|(_, is_given)| *is_given && !self.is_requested()) {
            Some((name, _)) => {
                Err(CommandError::Usage(format!("{name} requires --look, --quadrants or --panorama")))
            }
            None => Ok(()),
        }
    }

    fn windows(&self, mount: Mount, reach: f64) -> Option<Vec<NamedWindow>> {
        let sized = |usual: [u32; 2]| self.size.unwrap_or(usual).map(|side| side as usize);
        let usual = sized([1280, 720]);
        let mut found: Vec<NamedWindow> = Vec::new();
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

/// Returns the lens and the focal length of a camera, in pixels.
fn lens_and_focal(entry: &SiteCamera) -> Result<(Lens, f64), CommandError> {
    let lens = camera_lens(entry);
    let own = (lens.distortion != Distortion::None).then_some(lens.focal);
    let focal = entry.solution.as_ref().map(|solution| solution.focal_px).or(own);
    let unknown = || {
        format!("the focal length of camera \"{}\" is unknown; run calib solve to see the reason", entry.id)
    };
    Ok((lens, focal.ok_or_else(|| CommandError::Unsolved(unknown()))?))
}

/// Writes every view with the numbers of its camera.
pub(crate) fn run(
    args: &WindowArgs,
    output: &OutputArgs,
    entry: &SiteCamera,
    image: &RgbImage,
) -> Result<(), CommandError> {
    let (lens, focal) = lens_and_focal(entry)?;
    let camera = entry.camera();
    let mount = match (args.mount, &camera) {
        (Some(MountArg::Ceiling), _) => Mount::Ceiling,
        (Some(MountArg::Wall), _) => Mount::Wall,
        (None, Some(camera)) => Mount::from_pitch(camera.pitch),
        (None, None) => Mount::Ceiling,
    };
    let (width, height) = image.dimensions();
    let reach = lens_reach(&lens, focal, [f64::from(width), f64::from(height)]);
    let windows = args.windows(mount, reach).ok_or_else(|| {
        CommandError::Usage(format!(
            "the lens of camera \"{}\" does not allow a panorama; use --look or --quadrants",
            entry.id
        ))
    })?;
    if windows.len() > 1 && output.is_stdout() {
        return Err(CommandError::Usage("several views cannot be written to stdout; give -o FILE".into()));
    }
    let (lens, camera) = (&lens, camera.as_ref());
    let views = windows
        .iter()
        .map(|(name, window)| (output.path_for(name), View { window, lens, focal, camera, entry, reach }));
    let views: Vec<(String, View<'_>)> = views.collect();
    // Every view and file is checked before the first is written.
    for (file, window) in &views {
        window.check([width, height])?;
        let extensions: &[&str] = if args.remap { &["json", "remap.npy"] } else { &["json"] };
        let others = extensions.iter().map(|extension| companion_path(file, extension));
        let others = others.filter(|_| !output.is_stdout());
        std::iter::once(file.clone()).chain(others).try_for_each(|file| output.check_path_free(&file))?;
    }
    views.iter().try_for_each(|(file, window)| window.write(args, output, file, image))
}

/// Returns the path of a file that accompanies an image.
fn companion_path(file: &str, extension: &str) -> String {
    Path::new(file).with_extension(extension).to_string_lossy().into_owned()
}

/// Virtual view of one camera, with the lens and the entry of this camera.
struct View<'a> {
    window: &'a Window,
    lens: &'a Lens,
    focal: f64,
    camera: Option<&'a Camera>,
    entry: &'a SiteCamera,
    /// Largest angle between the optical axis and a ray of the image, in radians.
    reach: f64,
}

impl View<'_> {
    fn write(
        &self,
        args: &WindowArgs,
        output: &OutputArgs,
        file: &str,
        image: &RgbImage,
    ) -> Result<(), CommandError> {
        let size = [image.width(), image.height()].map(|side| side as usize);
        let [width, height] = self.window.size;
        let too_large =
            || anyhow::anyhow!("an image of {width} x {height} pixels is too large; give a smaller --size");
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
        output.write_to(file, &picture::encode(&picture, file)?)?;
        output.write_to(&companion_path(file, "json"), numbers.as_bytes())?;
        if args.remap {
            let npy = remap_npy(self.window.size.map(|side| side as u32), |pixel| self.to_raw(pixel));
            output.write_to(&companion_path(file, "remap.npy"), &npy)?;
        }
        let Pixel { u, v } = self.window.principal_point;
        let kind = if self.window.is_round { "focal length (cylindrical)" } else { "focal length" };
        files::print_message(format_args!(
            "{file}: {kind} {:.2} px, principal point {u:.2}, {v:.2} px",
            self.window.focal
        ));
        Ok(())
    }

    /// Returns the raw pixel that a pixel of the view shows; `None` outside the lens.
    fn to_raw(&self, pixel: Pixel) -> Option<Pixel> {
        self.window.raw(self.lens, self.focal, pixel)
    }

    /// Refuses a view that contains no part of the raw image.
    fn check(&self, [width, height]: [u32; 2]) -> Result<(), CommandError> {
        /// Number of samples along each side of the view.
        const SAMPLES: u32 = 24;
        let [w, h] = self.window.size.map(|side| side as f64 / f64::from(SAMPLES));
        let within =
            |p: Pixel| p.u >= 0.0 && p.v >= 0.0 && p.u <= f64::from(width) && p.v <= f64::from(height);
        let at = |i: u32| Pixel::new(w * (f64::from(i % SAMPLES) + 0.5), h * (f64::from(i / SAMPLES) + 0.5));
        if (0..SAMPLES * SAMPLES).any(|i| self.to_raw(at(i)).is_some_and(within)) {
            return Ok(());
        }
        let (id, reach) = (&self.entry.id, self.reach.to_degrees());
        Err(CommandError::Usage(format!(
            "a requested view is outside the image of camera \"{id}\", which reaches only {reach:.0}\u{b0} \
             from the axis of the lens; choose a direction closer to the axis"
        )))
    }

    /// Returns the numbers of the view's camera, with the keys of the table of `calib export`.
    fn numbers(&self, image: &RgbImage) -> serde_json::Value {
        let window = self.window;
        // The world coordinates of a camera that is not placed are arbitrary.
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
    fn view_directions_are_in_degrees() {
        let direction = look("45,-90, 80").unwrap();
        assert!((direction.pitch - 0.25 * std::f64::consts::PI).abs() < 1e-12);
        assert!((direction.yaw + 0.5 * std::f64::consts::PI).abs() < 1e-12 && direction.roll == 0.0);
        assert!((look("0,0,90,30").unwrap().roll - 30.0_f64.to_radians()).abs() < 1e-12);
        for wrong in ["", "45", "45,0", "0,0,0", "0,0,171", "0,0,nan", "inf,0,90", "0,0,90,0,0", "a,b,c"] {
            assert!(look(wrong).is_err(), "{wrong}");
        }
    }
}
