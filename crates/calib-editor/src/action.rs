//! Everything that changes the document, or what the editor holds beside it.

use std::path::PathBuf;
use std::sync::Arc;

use calib_core::{Annotation, ImageCircle, MarkKind, Placement};

use calib_core::single::Known;

use calib_image::Proposal;
use calib_site::{ControlPointEntry, Distance, LensEntry, Link, Mark, Plan, Site};
use image::RgbImage;

use crate::command::{Cameras, Gesture, Lines, Nudge, Proposing, Selection};
use crate::hit::Part;
use crate::images::Images;
use crate::newer::OnNewer;
use crate::period::Period;
use crate::planes::Planes;
use crate::proposed::OnProposed;
use crate::tools::{Pane, Pointer};

/// A site to be opened.
#[derive(Clone, Debug)]
pub struct Opened {
    /// The site.
    pub site: Site,
    /// Where its images come from.
    pub images: Images,
    /// Its file, if it has one.
    pub path: Option<PathBuf>,
    /// It differs from its file, as work that a crash left does.
    pub is_unsaved: bool,
}

/// A picture that was read, to become a still or the plan.
#[derive(Clone, Debug, PartialEq)]
pub struct NewStill {
    /// What the site is to call it.
    pub image: String,
    /// What the operator calls it.
    pub title: String,
    /// In pixels.
    pub size: [u32; 2],
    /// The disc outside of which it is black, of a fisheye's.
    pub image_circle: Option<ImageCircle>,
}

/// A number of a camera's place.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlaceNumber {
    /// x of where it stands.
    X,
    /// y of where it stands.
    Y,
    /// How it is turned.
    Turn,
    /// How high it is.
    Height,
}

/// Something that the editor is to do. What changes a site is one gesture, which undo takes back.
#[derive(Clone, Debug)]
pub enum Action {
    /// Opens a site in place of the one that is open.
    Open(Box<Opened>),
    /// The site was written to its file; where images lie beside it, that is its folder.
    Saved {
        /// The file.
        path: PathBuf,
        /// What its images are looked for beside, if files have folders.
        folder: Option<PathBuf>,
    },
    /// Puts a changed site in place of what it was, as one gesture.
    Change {
        /// What it is to be.
        site: Box<Site>,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Images that the site names came in: the name in the site, and that under which they are stored.
    Attach(Vec<(String, String)>),
    /// Something to be read in the status line.
    Note(String),
    /// One more thing went wrong: one error does not hide another.
    Complain(String),
    /// Something went wrong; what was said before is past.
    Fail(String),
    /// The error was read.
    CloseError,

    /// What the pointer did on a canvas goes to the tool in hand.
    Pointer(Pointer),
    /// Ends a gesture that is under way; the site is as it was before it.
    Drop,
    /// A command on the gesture in hand.
    Gesture(Gesture),
    /// Puts a tool in the hand, by its index in the list.
    TakeTool(usize),
    /// Which mark the tool of marks makes; it is taken in hand.
    MarkKind(MarkKind),
    /// The length that was measured on the plan has been entered.
    MeasuredDone,

    /// Takes a camera in hand.
    Choose(usize),
    /// Takes a camera in hand, and selects a part of it and nothing else.
    SelectOn(usize, Part),
    /// Selects a part of the camera in hand and nothing else.
    Select(Part),
    /// Selects a part, or no longer; what was selected stays.
    SelectMore(Part),
    /// Selects what is at a pixel of a camera's image, unless it belongs to what is selected.
    SelectAt {
        /// The camera.
        camera: usize,
        /// The pixel.
        at: [f64; 2],
        /// How near to it, in pixels.
        near: f64,
    },
    /// A command on what is selected; lines are pulled onto the edges of `still`, if it is there.
    Selection(Selection, Option<Arc<RgbImage>>),
    /// A small step.
    Nudge {
        /// Which.
        step: Nudge,
        /// Ten times as large.
        coarse: bool,
        /// The canvas it is meant for.
        pane: Option<Pane>,
    },
    /// A command on lines.
    Lines(Lines),

    /// The still of the camera of this id proposes this.
    Propose(Period, Box<Proposal>),
    /// Decides on what the still of the camera in hand proposes.
    OnProposed(OnProposed),
    /// A command on what is proposed.
    Proposing(Proposing),

    /// Does something with newer stills.
    Newer(OnNewer),

    /// A command on the list of cameras.
    Cameras(Cameras),
    /// A still becomes a camera.
    AddCamera(NewStill),
    /// Another still of a camera: what is drawn stays where it is, in pixels.
    ReplaceStill(Period, NewStill),
    /// How much of the still that was replaced shows.
    BlendOldStill(f32),
    /// The still that was replaced is no longer of interest.
    ForgetOldStill,
    /// Brings what is drawn on the replaced still to the size of the new one.
    RescaleToStill,
    /// Gives the camera in hand another id, everywhere.
    Rename(String),
    /// Gives the camera in hand a name, or none.
    Name(String),

    /// Changes a drawn line.
    Annotate {
        /// Its index.
        index: usize,
        /// What it is to be.
        annotation: Box<Annotation>,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Changes what is known of the lens.
    Lens {
        /// What is known from now on.
        lens: Box<LensEntry>,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Changes what is known of the height of the camera in hand.
    Height {
        /// What is known from now on, in metres.
        known: Option<Known>,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Shows another member of the family of cameras that fit as well: the first or second of those shown,
    /// its horizontal field of view in degrees.
    ShowView(usize, f64),
    /// Believes a focal, in pixels, of the family of cameras that fit as well.
    UseFocal(f64),

    /// Places a camera.
    Place {
        /// Which.
        camera: usize,
        /// Where.
        placement: Placement,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Holds the camera in hand where it is, or lets it go.
    HoldPlace,
    /// Holds one number of the place of the camera in hand by itself, or releases it.
    HoldNumber(PlaceNumber),
    /// Forgets where the camera in hand stands.
    ForgetPlace,
    /// A picture becomes the plan; it lies as a world file tells, if there is one.
    LoadPlan(NewStill, Option<Plan>),
    /// The plan lies as the file of this name tells.
    LayPlan(Plan, String),
    /// Changes how the plan lies.
    SetPlan {
        /// How it lies from now on.
        plan: Plan,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Changes a control point of the camera in hand.
    SetControl(usize, Box<ControlPointEntry>),
    /// Changes a link.
    SetLink(usize, Box<Link>),
    /// Changes a mark.
    SetMark {
        /// Its index.
        index: usize,
        /// What it is to be.
        mark: Box<Mark>,
        /// What this does, as it reads after "Undo".
        name: String,
    },
    /// Changes a plane besides the floor, or what lies on one.
    Planes(Planes),
    /// Changes what was measured.
    SetDistances(Vec<Distance>),

    /// Takes the lenses and cameras that files of another program hold; what there is to be known of them.
    Import(Box<Site>, Vec<String>),
    /// Takes over what refining the first gave: the second.
    Refined(Box<(Site, Site)>),
    /// How long a joint solve may take to be done on the way, after every gesture, in milliseconds.
    JointMayTake(f64),
    /// A saved version to compare with, or none.
    Compare(Option<Box<Site>>),
    /// Solving waits, or goes on.
    Pause,
    /// What is dragged on the plan snaps to round numbers, or no longer.
    Snap,
    /// Lengths are shown in the other unit.
    Feet,
}
