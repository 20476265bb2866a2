//! What cameras have in common, as the document has it: links, marks, and measured distances.

use serde::{Deserialize, Serialize};

use crate::bounded_list;
use crate::site_solution::ElementSolution;
use crate::solution::document;
use calib_core::camera::{Pixel, WorldPoint};
use calib_core::floor::MarkKind;
use calib_core::single::Known;

document! {
    /// Evidence shared by cameras: a point, a post, or a line of the floor.
    struct Link {
        /// By which others refer to it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Not used; its residual is reported all the same.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Never rejected as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// What it is; a point if absent.
        #[serde(default)]
        kind: LinkKind,
        /// Height of a point above the floor or its plane, in metres; 0 if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        height_m: Option<f64>,
        /// The plane it stands on; the floor if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        plane: Option<String>,
        /// Length of a post, in metres.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        length_m: Option<Known>,
        /// Where every camera shows it.
        #[serde(deserialize_with = "bounded_list::items")]
        seen: Vec<LinkSeen>,
        /// What solving found out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<ElementSolution>,
    }

    /// Where one camera shows a link: `px` of a point, `foot` and `head` of a post, `segment` of a line.
    struct LinkSeen {
        /// Id of the camera.
        camera: String,
        /// Of a point, raw pixel.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        px: Option<Pixel>,
        /// Of a post, raw pixel.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        foot: Option<Pixel>,
        /// Of a post, raw pixel.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        head: Option<Pixel>,
        /// Of a line, raw pixels.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        segment: Option<Vec<Pixel>>,
        /// Standard deviation of each coordinate, in pixels; that of the camera's drawings if absent.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        sigma_px: Option<f64>,
    }

    /// A virtual element of known shape.
    struct Mark {
        /// By which others refer to it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Not used; its residual is reported all the same.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Never rejected as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// What it looks like.
        kind: MarkKind,
        /// Where its foot or centre is, in metres.
        at_m: WorldPoint,
        /// Turn about the vertical, counter-clockwise, in degrees.
        #[serde(default)]
        turn_deg: f64,
        /// Its size, in metres; what the numbers mean, the kind says.
        size_m: Vec<f64>,
        /// Holds the mark in a joint solve.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        fixed: bool,
        /// Pixels that show its named points.
        #[serde(default, deserialize_with = "bounded_list::items", skip_serializing_if = "Vec::is_empty")]
        seen: Vec<MarkSeen>,
        /// What solving found out.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        solution: Option<ElementSolution>,
    }

    /// A pixel that shows a named point of a mark.
    struct MarkSeen {
        /// Id of the camera.
        camera: String,
        /// Name of the point, as the kind has it.
        point: String,
        /// Raw pixel.
        px: Pixel,
    }

    /// A known distance between two links or marks.
    struct Distance {
        /// By which others refer to it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        id: Option<String>,
        /// What the operator calls it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        name: Option<String>,
        /// Not used.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        off: bool,
        /// Never rejected as an outlier.
        #[serde(default, skip_serializing_if = "std::ops::Not::not")]
        keep: bool,
        /// Ids of two links or marks.
        between: [String; 2],
        /// In metres.
        length_m: Known,
    }
}

/// What a link is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "snake_case")]
pub enum LinkKind {
    /// One point of the scene.
    #[default]
    Point,
    /// Something plumb, from foot to head.
    Post,
    /// One line of the floor; the views need not overlap.
    Line,
}

impl Link {
    /// A link of this kind, seen like this.
    #[must_use]
    pub const fn new(id: Option<String>, kind: LinkKind, seen: Vec<LinkSeen>) -> Self {
        Self {
            id,
            name: None,
            off: false,
            keep: false,
            kind,
            height_m: None,
            plane: None,
            length_m: None,
            seen,
            solution: None,
        }
    }
}

impl LinkSeen {
    /// What this camera is to show, still without a pixel.
    #[must_use]
    pub fn new(camera: impl Into<String>) -> Self {
        Self { camera: camera.into(), px: None, foot: None, head: None, segment: None, sigma_px: None }
    }
}
