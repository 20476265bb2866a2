//! Windows onto the images of fisheyes.

use calib_core::{Lens, Pixel};

use calib_core::floor::{Mount, lens_reach};
use calib_editor::{Pane, hit};

use super::{App, Looking, Place};
use crate::canvas::Bend;

impl App {
    /// The lens and focal of a camera, if it is a fisheye, with how it hangs: under a ceiling, while nothing tells.
    fn fisheye(&self, camera: usize) -> Option<(Lens, f64, Mount)> {
        let session = self.editor.session();
        let pose = session.solved.pose(camera);
        let lens = hit::lens_of(&session.site, camera, pose).filter(|lens| lens.distortion.is_wide())?;
        let mount = pose.map_or(Mount::Ceiling, |pose| Mount::of_pitch(pose.pitch));
        Some((lens, pose.map_or(lens.focal, |pose| pose.focal), mount))
    }

    /// Whether a camera is a fisheye, which windows are for.
    #[must_use]
    pub fn is_fisheye(&self, camera: usize) -> bool {
        self.fisheye(camera).is_some()
    }

    /// The window that a fisheye is looked at through.
    pub(crate) fn window(&self, camera: usize) -> Option<Bend> {
        let (lens, focal, mount) = self.fisheye(camera)?;
        let size = self.editor.session().site.cameras.get(camera)?.size();
        let ahead = Looking::Toward([0.0, 0.0, 1.0]);
        let looking =
            if self.looking == Looking::Whole && self.layers.straight { ahead } else { self.looking };
        let window = looking.window(mount, lens_reach(&lens, focal, size))?;
        Some(Bend::Window { lens, focal, window })
    }

    /// Looks at the image in hand through another window: shown whole at first.
    pub(crate) fn look(&mut self, looking: Looking) {
        self.looking = looking;
        let own = Pane::Image(self.editor.session().camera);
        self.panes.views.remove(&(Place::Main, own));
    }

    /// Turns the window towards what a pixel of the image in hand shows.
    pub(crate) fn look_at(&mut self, pixel: Pixel) {
        let camera = self.editor.session().camera;
        let Some((lens, focal, _)) = self.fisheye(camera) else { return };
        if let Some([x, y, z]) = lens.bearing(pixel) {
            self.look(Looking::Toward([x / focal, y / focal, z]));
        }
    }
}
