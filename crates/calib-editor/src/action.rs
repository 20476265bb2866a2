//! Requests of a view to the editor: every change of the document, of the selection, and of the current tool.

use std::path::PathBuf;
use std::sync::Arc;

use calib_core::{Annotation, ImageCircle, MarkKind, Placement};

use calib_core::single::Known;

use calib_site::{ControlPointEntry, Distance, GroundPoint, LensEntry, Link, Mark, Plan, Site};
use image::RgbImage;

use crate::command::{Cameras, Gesture, Lines, Nudge, Proposing, Selection};
use crate::hit::Part;
use crate::images::Images;
use crate::newer::NewerAction;
use crate::period::Period;
use crate::planes::PlaneAction;
use crate::proposed::{AutomaticResult, CalibrationDecision};
use crate::session::RulerSettings;
use crate::tools::{Pane, Pointer};

/// Site to be opened.
#[derive(Clone, Debug)]
pub struct Opened {
    /// The site.
    pub site: Site,
    /// Source of the images of the site.
    pub images: Images,
    /// File of the site, if it has one.
    pub path: Option<PathBuf>,
    /// Whether the site differs from its file, for example when it is restored after a crash.
    pub is_unsaved: bool,
}

/// Image that was read, to be used as the image of a camera or as the floor plan.
#[derive(Clone, Debug, PartialEq)]
pub struct NewImage {
    /// Name of the image in the site.
    pub image: String,
    /// Name of the image for the operator.
    pub title: String,
    /// Width and height of the image, in pixels.
    pub size: [u32; 2],
    /// Image circle of a fisheye lens, if detected: the image is black outside it.
    pub image_circle: Option<ImageCircle>,
    /// Pixel aspect `fy / fx` from the metadata of the video of the image; `None` for square pixels.
    pub pixel_aspect: Option<f64>,
}

/// Component of a camera's placement that can be fixed separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlacementNumber {
    /// World x of the camera position.
    X,
    /// World y of the camera position.
    Y,
    /// Rotation of the camera about the vertical.
    Rotation,
    /// Height of the camera above the floor.
    Height,
}

/// Request to the editor. Each change of the site is one undo step.
#[derive(Clone, Debug)]
pub enum Action {
    /// Opens a site and closes the current one.
    Open(Box<Opened>),
    /// Records that the site was written to a file. Relative image paths then start at the folder of the
    /// file.
    Saved {
        /// Path of the file.
        path: PathBuf,
        /// Folder to which image paths become relative; `None` without a file system.
        folder: Option<PathBuf>,
    },
    /// Replaces the site by a changed version, as one undo step.
    Change {
        /// Changed site.
        site: Box<Site>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Replaces image names in the site by the ids of stored images: pairs of the name and the id.
    Attach(Vec<(String, String)>),
    /// Shows a note in the status line.
    Note(String),
    /// Adds an error message to the message that is shown.
    AddError(String),
    /// Shows an error message and discards the previous one.
    SetError(String),
    /// Closes the error message.
    CloseError,

    /// Passes a pointer event on a canvas to the current tool.
    Pointer(Pointer),
    /// Cancels the current gesture and restores the site.
    CancelGesture,
    /// Applies a command to the current gesture.
    Gesture(Gesture),
    /// Selects the tool with this index in [`TOOLS`](crate::TOOLS).
    SelectTool(usize),
    /// Sets the kind of mark that the mark tool creates, and selects the tool.
    MarkKind(MarkKind),
    /// Sets the quantity of the tool *Measure* and the height of its points. A measurement in progress is discarded if
    /// the quantity changes.
    Ruler(RulerSettings),
    /// Discards the two points that were measured on the plan, after their distance was entered.
    ClearMeasurement,

    /// Selects the camera with this index.
    SelectCamera(usize),
    /// Selects the camera with this index and only this part of its image.
    SelectOn(usize, Part),
    /// Selects only this part of the selected camera's image.
    Select(Part),
    /// Adds a part to the selection, or removes it if it is selected.
    SelectMore(Part),
    /// Selects a camera and the part at a pixel of its image, unless the part is already selected. Without a part
    /// there, clears the selection.
    SelectAt {
        /// Index of the camera.
        camera: usize,
        /// Position in the image, in raw pixels.
        at: [f64; 2],
        /// Search radius, in raw pixels.
        near: f64,
    },
    /// Applies a command to the selected parts. Moving lines onto edges needs the image of the camera.
    Selection(Selection, Option<Arc<RgbImage>>),
    /// Moves, rotates or scales the selection by a small step.
    Nudge {
        /// Direction and kind of the step.
        step: Nudge,
        /// Whether the step is ten times as large.
        coarse: bool,
        /// Canvas with the keyboard focus.
        pane: Option<Pane>,
    },
    /// Applies a command to the annotations of the selected camera.
    Lines(Lines),

    /// Applies the result of an automatic calibration or placement.
    Automatic(AutomaticResult),
    /// Applies a decision of the operator about the automatic calibration of the selected camera.
    DecideCalibration(CalibrationDecision),
    /// Applies a command to the automatic calibration of the selected camera.
    Proposing(Proposing),

    /// Applies an action on newer images.
    Newer(NewerAction),

    /// Applies a command to the list of cameras.
    Cameras(Cameras),
    /// Adds a camera with this image.
    AddCamera {
        /// Image of the camera.
        image: NewImage,
        /// Whether the image was opened together with the last added image: both are then one undo step.
        joins_last: bool,
    },
    /// Replaces the image of a calibration period. Annotations keep their pixel coordinates.
    ReplaceImage(Period, NewImage),
    /// Sets the opacity of the replaced image over the new one, 0 to 1; `None` hides it.
    BlendReplacedImage(Option<f32>),
    /// Scales the annotations of the camera from the size of the replaced image to the size of the new one.
    RescaleToImage,
    /// Changes the id of the selected camera and all references to it.
    Rename(String),
    /// Sets the name of the selected camera; an empty text removes the name.
    Name(String),

    /// Changes an annotation of the selected camera.
    Annotate {
        /// Index of the annotation in the camera.
        index: usize,
        /// Changed annotation.
        annotation: Box<Annotation>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Changes the known lens parameters of the selected camera.
    Lens {
        /// Changed lens entry.
        lens: Box<LensEntry>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Changes the prior on the height of the selected camera above the floor.
    Height {
        /// Height with its standard deviation, in metres; `None` removes the prior.
        known: Option<Known>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Shows another solution that fits the lines equally well. The index (0 or 1) selects which of the two shown
    /// solutions is replaced. The number is the horizontal field of view of the new one, in degrees.
    ShowView(usize, f64),
    /// Sets a prior on the focal length, in pixels, to choose among solutions that fit equally well.
    SetFocalPrior(f64),

    /// Places a camera in the world.
    Place {
        /// Index of the camera.
        camera: usize,
        /// New placement of the camera.
        placement: Placement,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Fixes or unfixes the placement of the selected camera.
    TogglePlacementFixed,
    /// Fixes or unfixes one component of the placement of the selected camera.
    ToggleNumberFixed(PlacementNumber),
    /// Removes the placement of the selected camera.
    RemovePlacement,
    /// Loads an image as the floor plan. Position and scale, with a note on their source, come from a world file
    /// or a drawing, if there is one.
    LoadPlan(NewImage, Option<Box<(Plan, String)>>),
    /// Sets the position and scale of the plan from a world file with this name.
    ApplyWorldFile(Plan, String),
    /// Changes the position and scale of the plan.
    SetPlan {
        /// Changed plan.
        plan: Plan,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Applies an action on points with known coordinates.
    Points(PointAction),
    /// Changes the link with this index.
    SetLink(usize, Box<Link>),
    /// Changes a mark of the site.
    SetMark {
        /// Index of the mark.
        index: usize,
        /// Changed mark.
        mark: Box<Mark>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Applies an action on planes other than the floor, or on the annotations on them.
    Planes(PlaneAction),
    /// Replaces the measured distances of the site.
    SetDistances(Vec<Distance>),

    /// Imports lenses and cameras that were read from files of another program, with notes for the operator.
    Import(Box<Site>, Vec<String>),
    /// Applies the result of a joint solve: the site that was the input, and the solved site.
    Refined(Box<(Site, Site)>),
    /// Sets the largest duration of a joint solve that runs after every gesture, in milliseconds.
    SetMaxJointSolveMs(f64),
    /// Sets the saved version of the site to compare with; `None` ends the comparison.
    Compare(Option<Box<Site>>),
    /// Pauses or resumes solving.
    TogglePause,
    /// Switches snapping to round numbers on the plan on or off.
    ToggleSnap,
    /// Switches the unit of lengths.
    ToggleUnits,
}

/// Action on control points, and on ground points, which wait for a click in an image.
#[derive(Clone, Debug)]
pub enum PointAction {
    /// Chooses the ground point that the next click in an image marks, and the tool for it; `None` for no point.
    Choose(Option<String>),
    /// Adds or changes a ground point, and chooses it.
    SetGroundPoint(Box<GroundPoint>),
    /// Removes the ground point with this id. Its control points stay.
    RemoveGroundPoint(String),
    /// Changes the control point with this index in the selected camera.
    SetControl(usize, Box<ControlPointEntry>),
    /// Sets the projected grid of the site, an EPSG code; `None` for no grid.
    SetGrid(Option<String>),
}
