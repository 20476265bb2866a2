//! Lenses and cameras of other programs: what a file has goes to the cameras of its names.

use calib_core::{LensEntry, Pixel, SiteCamera};
use calib_formats::{FORMATS, File, Format, Imported};

use crate::app::App;
use crate::dialog::Chosen;

/// Shapes of images that differ by less than this are the same.
const SHAPE: f64 = 2e-3;

impl App {
    /// Takes what files of another program say about cameras.
    pub(crate) fn import(&mut self, chosen: Vec<Chosen>) {
        let Some(first) = chosen.first().map(|file| file.name.clone()) else { return };
        let read = chosen.into_iter().map(|file| {
            let name = file.name.clone();
            let bytes = file.into_bytes().map_err(|error| format!("{name}: {error}"))?;
            Ok(File { name, bytes })
        });
        let taken = read.collect::<Result<Vec<File>, String>>().and_then(|files| recognised(&files));
        match taken {
            Ok((format, imported)) => self.take_imported(&first, format, imported),
            Err(error) => self.error = Some(error),
        }
    }

    fn take_imported(&mut self, name: &str, format: &Format, Imported { site, notes }: Imported) {
        // A world file alone lays the plan that is there.
        if let (Some(plan), true, Some(_)) = (&site.plan, site.cameras.is_empty(), &self.session.site.plan) {
            self.lay_plan(plan, name);
            return;
        }
        if self.session.site.cameras.is_empty() {
            let folder = self.session.images.clone();
            self.open_site(site, folder, None);
            self.session.note = Some(format!("Read as {}. {}", format.name, notes.join("; ")));
            return;
        }
        let is_alone = site.cameras.len() == 1;
        let (mut lenses, mut added) = (0, 0);
        for camera in site.cameras {
            let known = self.session.site.cameras.iter().position(|own| own.id == camera.id);
            let Some(own) = known.or_else(|| is_alone.then_some(self.session.camera)) else {
                self.session.site.cameras.push(camera);
                added += 1;
                continue;
            };
            let Some(entry) = self.session.site.cameras.get_mut(own) else { continue };
            match scaled(&camera, entry.size_px) {
                Ok(lens) => entry.lens = Some(lens),
                Err(error) => {
                    self.session.revert();
                    self.error = Some(error);
                    return;
                }
            }
            lenses += 1;
        }
        self.session.commit(match (lenses, added) {
            (_, 0) => format!("import {lenses} lenses"),
            (0, _) => format!("import {added} cameras"),
            _ => format!("import {lenses} lenses and {added} cameras"),
        });
        let notes = if notes.is_empty() { String::new() } else { format!(" {}.", notes.join("; ")) };
        self.session.note = Some(format!("{lenses} lenses taken, {added} cameras added.{notes}"));
    }
}

/// The first format that reads the files, by their extensions.
fn recognised(files: &[File]) -> Result<(&'static Format, Imported), String> {
    let extension = |file: &File| {
        file.name.rsplit_once('.').map_or_else(String::new, |(_, extension)| extension.to_lowercase())
    };
    let fits = |format: &&Format| {
        format.imports() && files.iter().any(|file| format.extensions.contains(&extension(file).as_str()))
    };
    let mut wrong = Vec::new();
    for format in FORMATS.iter().filter(fits) {
        match calib_formats::import(format, files) {
            Ok(imported) => return Ok((format, imported)),
            Err(error) => wrong.push(format!("as {}: {error}", format.name)),
        }
    }
    if wrong.is_empty() {
        let known: Vec<&str> =
            FORMATS.iter().filter(|format| format.imports()).map(|format| format.name).collect();
        return Err(format!("No format with this ending is known. Known are {}.", known.join(", ")));
    }
    Err(format!("The files cannot be read. {}", wrong.join("; ")))
}

/// The lens of a camera for images of another size but the same shape.
fn scaled(camera: &SiteCamera, size: [u32; 2]) -> Result<LensEntry, String> {
    let mut lens = camera.lens.clone().unwrap_or_default();
    let ratio = [0, 1].map(|axis| f64::from(size[axis]) / f64::from(camera.size_px[axis].max(1)));
    if (ratio[0] / ratio[1] - 1.0).abs() > SHAPE {
        let [w, h] = camera.size_px;
        return Err(format!(
            "Camera {:?}: its lens was calibrated on images of {w} \u{d7} {h} px, which are not of the shape of this still, {} \u{d7} {} px. Import the lens of the mode in which the still was taken.",
            camera.id, size[0], size[1]
        ));
    }
    scale_lens(&mut lens, ratio[0]);
    Ok(lens)
}

/// Brings a lens to images that are so many times as large.
pub(crate) fn scale_lens(lens: &mut LensEntry, by: f64) {
    if let Some(focal) = &mut lens.focal_px {
        (focal.value, focal.sigma) = (by * focal.value, focal.sigma.map(|sigma| by * sigma));
    }
    lens.principal_point_px = lens.principal_point_px.map(|at| Pixel::new(by * at.u, by * at.v));
    if let Some(focal) = lens.distortion.as_mut().and_then(|distortion| distortion.focal_px.as_mut()) {
        *focal *= by;
    }
}
