//! How the image of a fisheye is looked at: whole, or through a window.

use calib_core::Window;

use calib_core::floor::{Look, Mount};

/// Which window the image of a fisheye is looked at through.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Looking {
    /// None: the image as it is.
    #[default]
    Whole,
    /// One of four round its axis.
    Quadrant(usize),
    /// All round, unrolled.
    Panorama,
    /// One towards a direction in axes of the camera.
    Toward([f64; 3]),
}

impl Looking {
    /// The next one.
    #[must_use]
    pub const fn next(self) -> Self {
        match self {
            Self::Whole | Self::Toward(_) => Self::Quadrant(0),
            Self::Quadrant(index) if index < 3 => Self::Quadrant(index + 1),
            Self::Quadrant(_) => Self::Panorama,
            Self::Panorama => Self::Whole,
        }
    }

    /// The window itself, of a camera that hangs so and sees so far from its axis, in radians.
    pub(crate) fn window(self, mount: Mount, reach: f64) -> Option<Window> {
        const FLAT: [usize; 2] = [1280, 800];
        const ROUND: [usize; 2] = [2400, 800];
        /// As wide as a person takes in.
        const WIDE: f64 = 1.7;
        match self {
            Self::Whole => None,
            Self::Quadrant(index) => Window::quadrants(mount, FLAT)?.get(index).copied(),
            Self::Panorama => Window::panorama(mount, reach, ROUND),
            Self::Toward([0.0, 0.0, _]) => Window::flat(Look { hfov: WIDE, ..Look::default() }, FLAT),
            Self::Toward(direction) => Window::toward(mount, direction, WIDE, FLAT),
        }
    }
}
