//! What a warning of the site as a whole is about, so that it can be shown.

use calib_core::{Finding, Subject};

use calib_core::outcome::WhyNotConnected;

use calib_site::{Names, Report, Site, Warning};

/// What a warning that a joint solve gave the site is about. The results of one come as a document, which has the
/// words alone: of the findings that its numbers allow, it is the one that is told in these words.
#[must_use]
pub fn site_subject(site: &Site, report: &Report, warning: &Warning) -> Option<Subject> {
    let told = |finding: &Finding| {
        finding.code() == warning.code && site.in_english(None, finding, Names::InFile) == *warning
    };
    possible(site, report).find(told).map(|finding| finding.subject())
}

/// The findings that a report of this site may have told.
fn possible<'a>(site: &'a Site, report: &'a Report) -> impl Iterator<Item = Finding> + 'a {
    let index = |id: &String| site.cameras.iter().position(|camera| camera.id == *id);
    let links = report.links.iter().enumerate().map(|(i, found)| (Subject::Link(i), found));
    let marks = report.marks.iter().enumerate().map(|(i, found)| (Subject::Mark(i), found));
    let elements = links.chain(marks).filter_map(move |(element, found)| {
        let seen = found.as_ref()?.residuals.iter().filter(|seen| seen.outlier);
        let worst = seen.max_by(|a, b| a.px.total_cmp(&b.px))?;
        Some(Finding::ElementOutlier { element, worst: Some((index(&worst.camera)?, worst.px)) })
    });
    let distances = (0..site.distances.len()).map(|distance| Finding::DistanceOutlier { distance });
    let sliding = (0..site.cameras.len()).map(|camera| Finding::Sliding { camera });
    let components = report.site.components.iter().map(move |ids| ids.iter().filter_map(index).collect());
    let of_components = components.flat_map(|cameras: Vec<usize>| {
        let why = [WhyNotConnected::TooLittle, WhyNotConnected::Placed, WhyNotConnected::Alone];
        let apart = why.map(|why| Finding::NotConnected { cameras: cameras.clone(), why });
        let unscaled = cameras
            .clone()
            .into_iter()
            .map(move |root| Finding::ScaleUnknown { cameras: cameras.clone(), root });
        apart.into_iter().chain(unscaled).collect::<Vec<_>>()
    });
    elements.chain(distances).chain(sliding).chain(of_components)
}
