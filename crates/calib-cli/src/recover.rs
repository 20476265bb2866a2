//! Cameras that moved, calibrated anew from what was drawn on their old stills.

use calib_image::{Became, recovered};
use calib_report::few;
use calib_site::{NewStill, Site};
use jiff::Timestamp;

use crate::compare::{Compared, still};
use crate::files::{SiteFile, say};
use crate::pulse::Pulse;
use crate::site_file::beside;
use crate::stop::Stop;

/// Writes the site with every camera that moved recovered; one that cannot be stays as it is, and is named.
pub(crate) fn write(
    file: &SiteFile,
    compared: &[Compared],
    since: Option<Timestamp>,
    output: &str,
    force: bool,
) -> Result<(), Stop> {
    // Paths are those of the file that is written.
    let mut site = file.seen_from(&file.site, output);
    let mut count = 0;
    let has_changed =
        |of: &&Compared| of.last().is_some_and(|seen| seen.comparison.became != Became::Unchanged);
    for of in compared.iter().filter(has_changed) {
        match of_camera(file, &site, of, since, output)? {
            Ok(with) => {
                site = with;
                count += 1;
            }
            Err(why) => say(format_args!("calib: camera \"{}\" is not recovered: {why}", of.id)),
        }
    }
    if count == 0 {
        say(format_args!("calib: no camera was recovered; {output} is not written"));
        return Ok(());
    }
    crate::files::write(output, site.to_json().as_bytes(), force)
}

/// The site with one camera recovered, or why that would be a guess; an error where its stills cannot be read.
fn of_camera(
    file: &SiteFile,
    site: &Site,
    of: &Compared,
    since: Option<Timestamp>,
    output: &str,
) -> Result<Result<Site, String>, Stop> {
    let Some(seen) = of.last() else { return Ok(Err("it has no newer still".into())) };
    let Some(since) = since.or_else(|| of.since().and_then(|seen| seen.time)) else {
        return Ok(Err("the name of its still says no time; give --since TIME".into()));
    };
    let entry = &file.site.cameras[of.index];
    let (old, new) = (file.camera_image(entry)?, still(entry, &seen.path)?);
    let newer = NewStill { image: beside(&seen.path, output), since: since.to_string() };
    let pulse = Pulse::new("solving");
    let found = recovered(site, of.index, &seen.comparison, [&old, &new], &newer);
    drop(pulse);
    Ok(found.map_err(|refusal| refusal.to_string()).map(|found| {
        if !found.left_out.is_empty() {
            let names = few(found.left_out.iter().map(String::as_str));
            say(format_args!("calib: camera \"{}\": not on the new still, left out: {names}", of.id));
        }
        found.site
    }))
}
