//! Actions on automatic calibrations: accept, change, dismiss.

use std::sync::Arc;

use calib_core::Kind;
use calib_image::{AutomaticCalibration, Confidence, SitePlacement};
use calib_site::counted;

use crate::command::Proposing;
use crate::editor::Editor;
use crate::period::Period;
use crate::proposed::{AutomaticResult, CalibrationDecision, PendingCalibration, PendingGroup};

impl Editor {
    /// Applies the result of an automatic calibration or placement.
    pub(super) fn apply_automatic(&mut self, result: AutomaticResult) {
        match result {
            AutomaticResult::Calibration(of, calibration) => {
                self.set_automatic_calibration(&of, &calibration);
            }
            AutomaticResult::Calibrations(found) => self.set_automatic_calibrations(found),
            AutomaticResult::Placement(found) => self.place_by_colours(&found),
        }
    }

    /// Stores an automatic calibration as undecided. It replaces an earlier one of the same calibration
    /// period.
    fn set_automatic_calibration(&mut self, of: &Period, proposal: &AutomaticCalibration) {
        self.cancel();
        let Some(entry) = self.session.site.cameras.iter().find(|entry| of.matches(entry)) else { return };
        let camera = &of.camera;
        let proposed = PendingCalibration::new(entry, proposal);
        let note = match (proposed.count(), proposed.confidence) {
            (0, Confidence::None) => {
                Some(format!("No lines were detected in the image of {camera}. Draw lines by hand."))
            }
            (0, _) => Some(format!("All detected lines of {camera} are already annotated.")),
            // No note: the status line shows the available keys while the automatic calibration is undecided.
            _ => None,
        };
        let all = Arc::make_mut(&mut self.session.pending.proposed);
        all.retain(|known| known.of != *of);
        all.push(proposed);
        self.session.pending.picked_line = None;
        self.session.commit(format!("calibrate {camera} automatically"));
        self.session.note = note;
    }

    /// Accepts the automatic calibrations of several images as one undo step. Calibrations with the confidence
    /// `none` stay undecided. Cameras that were annotated or removed meanwhile stay unchanged.
    fn set_automatic_calibrations(&mut self, found: Vec<(Period, AutomaticCalibration)>) {
        self.cancel();
        let mut count = 0;
        for (of, calibration) in found {
            let Some(index) = of.index(&self.session.site) else { continue };
            let entry = &mut self.session.site.cameras[index];
            if !entry.annotations.is_empty() {
                continue;
            }
            let pending = PendingCalibration::new(entry, &calibration);
            let all = Arc::make_mut(&mut self.session.pending.proposed);
            all.retain(|known| known.of != of);
            if pending.confidence == Confidence::None {
                all.push(pending);
            } else {
                *entry = pending.with_groups(entry, |_| true);
                count += 1;
            }
        }
        self.session.pending.picked_line = None;
        self.session.commit(format!("calibrate {} automatically", counted(count, "image", "images")));
    }

    /// Applies the placements that were estimated from the colours of the images, as one undo step.
    fn place_by_colours(&mut self, found: &SitePlacement) {
        let count = found.cameras.iter().filter(|camera| camera.placement.is_some()).count();
        if count > 0 {
            self.session.site = found.write_into(std::mem::take(&mut self.session.site));
            self.session.commit(format!("place {} by matching colours", counted(count, "camera", "cameras")));
        }
    }

    /// Applies a command to the automatic calibration of the selected camera. A command for one group applies to the
    /// group of the selected line, otherwise to the group to decide first ([`crate::Preview::next`]).
    pub(super) fn proposing(&mut self, command: Proposing) {
        let mut group = || self.selected_group();
        let action = match command {
            // The view runs these commands, because it has the decoded images.
            Proposing::Propose | Proposing::CalibrateAll => None,
            Proposing::AcceptProposed => Some(CalibrationDecision::AcceptAll),
            Proposing::DismissProposed => Some(CalibrationDecision::Dismiss),
            Proposing::AcceptGroup => group().map(CalibrationDecision::Accept),
            Proposing::FlipGroup => group().map(CalibrationDecision::Flip),
            Proposing::DeleteGroup => group().map(CalibrationDecision::Delete),
        };
        if let Some(action) = action {
            self.decide_calibration(action);
        }
    }

    fn selected_group(&mut self) -> Option<usize> {
        let picked = self.session.pending.picked_line.map(|(group, _)| group);
        picked.or_else(|| self.find_preview()?.next)
    }

    pub(super) fn decide_calibration(&mut self, action: CalibrationDecision) {
        self.cancel();
        match action {
            CalibrationDecision::SelectLine(picked) => self.session.pending.picked_line = picked,
            CalibrationDecision::AcceptAll => self.accept_all(),
            CalibrationDecision::Decide { other } => {
                self.change_proposed(|own| own.decide(other));
                self.session.commit("choose one of two solutions");
            }
            CalibrationDecision::Accept(group) => {
                self.accept(|index| index == group, "accept the detected lines:");
            }
            CalibrationDecision::Flip(group) => {
                self.change_group(group, "change the kind of", PendingGroup::flip);
            }
            CalibrationDecision::SetDirection(group, direction) => {
                self.change_group(group, "change the direction of", |group| {
                    (group.kind, group.direction) = (Kind::Parallel, direction);
                });
            }
            CalibrationDecision::Delete(group) => {
                self.change_group(group, "delete", |group| group.lines.clear());
            }
            CalibrationDecision::RejectLine(group, line) => {
                self.change_group(group, "reject one of", |group| group.reject_line(line));
            }
            CalibrationDecision::Dismiss => self.dismiss_proposed(),
        }
    }

    fn accept_all(&mut self) {
        let is_believed =
            self.session.proposed().is_some_and(|proposed| proposed.confidence != Confidence::None);
        if is_believed {
            self.accept(|_| true, "accept all detected lines of");
        } else {
            let has_rival = self.session.proposed().is_some_and(|proposed| proposed.alternative.is_some());
            let note = if has_rival {
                "Two solutions fit the edges equally well. Choose one, or accept the correct groups."
            } else {
                "The result is uncertain. Check the groups and accept the correct ones."
            };
            self.session.note = Some(note.into());
        }
    }

    /// Accepts the groups that `which` selects by index. The other groups stay undecided. If no groups
    /// remain, the automatic calibration is removed.
    fn accept(&mut self, which: impl Fn(usize) -> bool, verb: &str) {
        let Some(proposed) = self.session.proposed().cloned() else { return };
        let chosen = || (0..proposed.groups.len()).filter(|&group| which(group));
        let name = match chosen().collect::<Vec<_>>()[..] {
            [] => return,
            [one] if proposed.groups.len() > 1 => format!("{verb} {}", proposed.groups[one].title()),
            _ => format!("accept all detected lines of {}", proposed.of.camera),
        };
        if let Some(entry) = self.session.entry_mut() {
            *entry = proposed.with_groups(entry, &which);
        }
        self.change_proposed(|own| {
            let mut index = 0..;
            own.groups.retain(|_| !index.next().is_some_and(&which));
        });
        self.session.commit(name);
    }

    fn change_group(&mut self, group: usize, verb: &str, change: impl FnOnce(&mut PendingGroup)) {
        let title =
            self.session.proposed().and_then(|own| own.groups.get(group)).map(|own| own.title().to_owned());
        let Some(title) = title else { return };
        self.change_proposed(|own| {
            if let Some(group) = own.groups.get_mut(group) {
                change(group);
            }
            own.groups.retain(|group| !group.lines.is_empty());
        });
        self.session.commit(format!("{verb} the detected lines: {title}"));
    }

    /// Changes the automatic calibration of the selected camera, and removes it if it has no groups left.
    fn change_proposed(&mut self, change: impl FnOnce(&mut PendingCalibration)) {
        let Some(of) = self.session.entry().map(Period::from_camera) else { return };
        let all = Arc::make_mut(&mut self.session.pending.proposed);
        if let Some(own) = all.iter_mut().find(|own| own.of == of) {
            change(own);
        }
        all.retain(|own| own.of != of || !own.groups.is_empty());
        self.session.pending.picked_line = None;
    }

    fn dismiss_proposed(&mut self) {
        let Some(of) = self.session.proposed().map(|own| own.of.clone()) else { return };
        Arc::make_mut(&mut self.session.pending.proposed).retain(|own| own.of != of);
        self.session.pending.picked_line = None;
        self.session.commit(format!("discard the detected lines of {}", of.camera));
    }
}
