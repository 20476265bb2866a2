//! Requests of a view: every change of the document or of the editor's state outside it.

use std::path::PathBuf;
use std::sync::Arc;

use calib_core::{Annotation, ImageCircle, MarkKind, Placement};

use calib_core::single::Known;

use calib_image::AutomaticCalibration;
use calib_site::{ControlPointEntry, Distance, LensEntry, Link, Mark, Plan, Site};
use image::RgbImage;

use crate::command::{Cameras, Gesture, Lines, Nudge, Proposing, Selection};
use crate::hit::Part;
use crate::images::Images;
use crate::newer::NewerAction;
use crate::period::Period;
use crate::planes::PlaneAction;
use crate::proposed::CalibrationDecision;
use crate::tools::{Pane, Pointer};

/// Site to be opened.
#[derive(Clone, Debug)]
pub struct Opened {
    /// The site.
    pub site: Site,
    /// Source of its images.
    pub images: Images,
    /// Its file, if it has one.
    pub path: Option<PathBuf>,
    /// Whether it differs from its file, for example after a crash.
    pub is_unsaved: bool,
}

/// Image file that was read, to be used as the image of a camera or as the floor plan.
#[derive(Clone, Debug, PartialEq)]
pub struct NewImage {
    /// Name of the image in the site.
    pub image: String,
    /// Name of the image for the operator.
    pub title: String,
    /// Size, in pixels.
    pub size: [u32; 2],
    /// Image circle of a fisheye: the image is black outside it.
    pub image_circle: Option<ImageCircle>,
}

/// Number of a camera's placement that can be fixed separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlacementNumber {
    /// x of the camera position.
    X,
    /// y of the camera position.
    Y,
    /// Rotation about the vertical.
    Rotation,
    /// Height above the floor.
    Height,
}

/// Request to the editor. Each change of the site is one undo step.
#[derive(Clone, Debug)]
pub enum Action {
    /// Opens a site and closes the current one.
    Open(Box<Opened>),
    /// Records that the site was written to its file. Relative image paths then start at its folder.
    Saved {
        /// File that was written.
        path: PathBuf,
        /// Base folder of image paths, if there is a file system.
        folder: Option<PathBuf>,
    },
    /// Replaces the site by a changed one, as one undo step.
    Change {
        /// Changed site.
        site: Box<Site>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Stores images under new names: pairs of the name in the site and the stored name.
    Attach(Vec<(String, String)>),
    /// Shows a note in the status line.
    Note(String),
    /// Adds an error to the error that is shown.
    AddError(String),
    /// Shows an error and discards the previous one.
    SetError(String),
    /// Closes the error message.
    CloseError,

    /// Passes a pointer event on a canvas to the current tool.
    Pointer(Pointer),
    /// Cancels the current gesture and restores the site.
    CancelGesture,
    /// Applies a command to the current gesture.
    Gesture(Gesture),
    /// Selects a tool by its index in the list.
    SelectTool(usize),
    /// Sets the kind of mark that the mark tool creates, and selects the tool.
    MarkKind(MarkKind),
    /// Records that the distance measured on the plan was entered.
    ClearMeasurement,

    /// Selects a camera.
    SelectCamera(usize),
    /// Selects a camera and only this part of it.
    SelectOn(usize, Part),
    /// Selects only this part of the selected camera.
    Select(Part),
    /// Adds a part to the selection, or removes it.
    SelectMore(Part),
    /// Selects the part at a pixel of a camera's image, unless it is already selected.
    SelectAt {
        /// Index of the camera.
        camera: usize,
        /// Position, in pixels.
        at: [f64; 2],
        /// Search radius, in pixels.
        near: f64,
    },
    /// Applies a command to the selected parts. The image, if available, is used to move lines onto edges.
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
    /// Applies a command to lines.
    Lines(Lines),

    /// Stores the automatic calibration of a camera's image.
    SetAutomaticCalibration(Period, Box<AutomaticCalibration>),
    /// Applies a decision about the automatic calibration of the selected camera.
    DecideCalibration(CalibrationDecision),
    /// Applies a command to the automatic calibration.
    Proposing(Proposing),

    /// Applies an action on newer images.
    Newer(NewerAction),

    /// Applies a command to the list of cameras.
    Cameras(Cameras),
    /// Adds a camera for an image.
    AddCamera(NewImage),
    /// Replaces the image of a camera. Annotations keep their pixel coordinates.
    ReplaceImage(Period, NewImage),
    /// Sets the opacity of the replaced image, 0 to 1.
    BlendReplacedImage(f32),
    /// Hides the replaced image.
    HideReplacedImage,
    /// Scales the annotations of the replaced image to the size of the new one.
    RescaleToImage,
    /// Changes the id of the selected camera and all references to it.
    Rename(String),
    /// Sets the name of the selected camera, or removes it if empty.
    Name(String),

    /// Changes an annotation of the selected camera.
    Annotate {
        /// Index of the annotation.
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
    /// Changes the prior on the height of the selected camera.
    Height {
        /// Height with its standard deviation, in metres.
        known: Option<Known>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Shows another camera that fits equally well: the first or second one shown, with this horizontal field
    /// of view in degrees.
    ShowView(usize, f64),
    /// Sets a prior on the focal length, in pixels, to choose among cameras that fit equally well.
    SetFocalPrior(f64),

    /// Places a camera on the floor.
    Place {
        /// Index of the camera.
        camera: usize,
        /// Placement of the camera.
        placement: Placement,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Fixes or unfixes the placement of the selected camera.
    TogglePlacementFixed,
    /// Fixes or unfixes one number of the placement of the selected camera.
    ToggleNumberFixed(PlacementNumber),
    /// Removes the placement of the selected camera.
    RemovePlacement,
    /// Loads an image as the floor plan, positioned by the world file if there is one.
    LoadPlan(NewImage, Option<Plan>),
    /// Positions the plan by the world file of this name.
    ApplyWorldFile(Plan, String),
    /// Changes the position and scale of the plan.
    SetPlan {
        /// Changed plan.
        plan: Plan,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Changes a control point of the selected camera.
    SetControl(usize, Box<ControlPointEntry>),
    /// Changes a link.
    SetLink(usize, Box<Link>),
    /// Changes a mark.
    SetMark {
        /// Index of the mark.
        index: usize,
        /// Changed mark.
        mark: Box<Mark>,
        /// Name of the undo step, as shown after "Undo".
        name: String,
    },
    /// Changes a plane other than the floor, or the annotations on it.
    Planes(PlaneAction),
    /// Changes the measured distances.
    SetDistances(Vec<Distance>),

    /// Imports lenses and cameras from files of another program, with notes for the operator.
    Import(Box<Site>, Vec<String>),
    /// Applies a joint solution: the site that was solved, and the result.
    Refined(Box<(Site, Site)>),
    /// Sets the largest duration of a joint solve that runs after every gesture, in milliseconds.
    SetMaxJointSolveMs(f64),
    /// Sets the saved version to compare with, or none.
    Compare(Option<Box<Site>>),
    /// Pauses or resumes solving.
    TogglePause,
    /// Switches snapping to round numbers on the plan on or off.
    ToggleSnap,
    /// Switches the unit of lengths.
    ToggleUnits,
}
