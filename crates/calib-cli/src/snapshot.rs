//! Snapshots from the addresses of cameras. User name and password come from the environment or from a file.

use std::path::PathBuf;
use std::time::Duration;

use calib_video::{Credentials, Snapshot, SnapshotErrorKind, SnapshotOptions};

use crate::args::OutputArgs;
use crate::files::print_message;
use crate::stop::CommandError;

/// Name of the environment variable with the user's name.
const USER: &str = "CALIB_CAMERA_USER";
/// Name of the environment variable with the password.
const PASSWORD: &str = "CALIB_CAMERA_PASSWORD";

/// Arguments for the address of a camera.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct SnapshotArgs {
    /// File with the user name on its first line and the password on its second [default: the environment
    /// variables `CALIB_CAMERA_USER` and `CALIB_CAMERA_PASSWORD`]
    #[arg(long, value_name = "FILE")]
    pub(crate) credentials: Option<PathBuf>,
    /// Maximum time for a snapshot, in seconds
    #[arg(long, value_name = "S", default_value = "15", value_parser = clap::value_parser!(u64).range(1..=600))]
    timeout: u64,
    /// Accept any HTTPS certificate; cameras often have certificates that no authority has signed
    #[arg(long)]
    insecure: bool,
}

/// Writes the snapshot of an address.
pub(crate) fn run(address: &str, args: &SnapshotArgs, output: &OutputArgs) -> Result<(), CommandError> {
    let snapshot = read(address, args)?;
    print_pixel_aspect("", snapshot.pixel_aspect);
    // A JPEG stays as the camera sent it.
    match &snapshot.jpeg {
        Some(jpeg) if output.is_jpeg()? => output.write(jpeg),
        _ => output.write_image(&snapshot.image),
    }
}

/// Prints how to enter the pixel aspect of a video, if its pixels are not square. `camera` begins the message.
pub(crate) fn print_pixel_aspect(camera: &str, aspect: f64) {
    if (aspect - 1.0).abs() > 1e-3 {
        print_message(format_args!(
            "calib: {camera}the pixels of this video are not square; enter \"pixel_aspect\": {aspect:.4} in the lens of the \
             camera"
        ));
    }
}

/// Reads the snapshot of an address.
pub(crate) fn read(address: &str, args: &SnapshotArgs) -> Result<Snapshot, CommandError> {
    let options = SnapshotOptions {
        credentials: read_credentials(args)?,
        timeout: Duration::from_secs(args.timeout),
        accepts_any_certificate: args.insecure,
    };
    calib_video::snapshot(address, &options).map_err(|error| match error.kind {
        SnapshotErrorKind::Invalid => CommandError::Invalid(error.to_string()),
        SnapshotErrorKind::NoCredentials => CommandError::Failed(anyhow::anyhow!(
            "{error}; set {USER} and {PASSWORD}, or add --credentials FILE"
        )),
        SnapshotErrorKind::Failed => CommandError::Failed(error.into()),
    })
}

/// Reads name and password from the file or from the environment.
fn read_credentials(args: &SnapshotArgs) -> Result<Option<Credentials>, CommandError> {
    let Some(path) = &args.credentials else {
        let variable = |name| std::env::var(name).ok();
        return Ok(
            variable(USER).map(|user| Credentials { user, password: variable(PASSWORD).unwrap_or_default() })
        );
    };
    let text = std::fs::read_to_string(path).map_err(|error| CommandError::invalid(path.display(), error))?;
    let mut lines = text.lines();
    match (lines.next(), lines.next()) {
        (Some(user), Some(password)) => {
            Ok(Some(Credentials { user: user.trim().into(), password: password.trim_end().into() }))
        }
        _ => {
            let what = "expected the user name on the first line and the password on the second";
            Err(CommandError::invalid(path.display(), what))
        }
    }
}
