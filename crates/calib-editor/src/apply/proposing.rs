//! Actions on automatic calibrations: accept, change, dismiss.

use std::sync::Arc;

use calib_core::Kind;
use calib_image::{Proposal, Verdict};

use crate::command::Proposing;
use crate::editor::Editor;
use crate::period::Period;
use crate::proposed::{OnProposed, Proposed, ProposedGroup};

impl Editor {
    /// Shows the automatic calibration of a camera's image instead of an earlier one.
    pub(super) fn propose(&mut self, of: &Period, proposal: &Proposal) {
        self.cancel();
        let Some(entry) = self.session.site.cameras.iter().find(|entry| of.is_of(entry)) else { return };
        let camera = &of.camera;
        let proposed = Proposed::new(entry, proposal);
        let note = match (proposed.count(), proposed.verdict) {
            (0, Verdict::None) => Some(format!("The still of {camera} proposes nothing.")),
            (0, _) => Some(format!("What the still of {camera} proposes is drawn already.")),
            // The status line shows the available keys as long as the automatic calibration is undecided.
            _ => None,
        };
        let all = Arc::make_mut(&mut self.session.proposed);
        all.retain(|known| known.of != *of);
        all.push(proposed);
        self.session.picked = None;
        self.session.commit(format!("propose lines on {camera}"));
        self.session.note = note;
    }

    /// Applies a command to the selected group, or to the group that reduces the floor error most.
    pub(super) fn proposing(&mut self, command: Proposing) {
        let mut group = || self.group_in_hand();
        let action = match command {
            // The view runs this command, because it has the pixels.
            Proposing::Propose => None,
            Proposing::AcceptProposed => Some(OnProposed::AcceptAll),
            Proposing::DismissProposed => Some(OnProposed::Dismiss),
            Proposing::AcceptGroup => group().map(OnProposed::Accept),
            Proposing::FlipGroup => group().map(OnProposed::Flip),
            Proposing::DeleteGroup => group().map(OnProposed::Delete),
        };
        if let Some(action) = action {
            self.on_proposed(action);
        }
    }

    fn group_in_hand(&mut self) -> Option<usize> {
        let picked = self.session.picked.map(|(group, _)| group);
        picked.or_else(|| self.find_preview()?.next)
    }

    pub(super) fn on_proposed(&mut self, action: OnProposed) {
        self.cancel();
        match action {
            OnProposed::Pick(picked) => self.session.picked = picked,
            OnProposed::AcceptAll => self.accept_all(),
            OnProposed::Decide { other } => {
                self.change_proposed(|own| own.decide(other));
                self.session.commit("say which of two cameras it is");
            }
            OnProposed::Accept(group) => self.accept(|index| index == group, "accept the proposed"),
            OnProposed::Flip(group) => self.change_group(group, "flip", ProposedGroup::flip),
            OnProposed::Turn(group, direction) => self.change_group(group, "turn", |group| {
                (group.kind, group.direction) = (Kind::Parallel, direction);
            }),
            OnProposed::Delete(group) => self.change_group(group, "delete", |group| group.lines.clear()),
            OnProposed::LeaveOut(group, line) => {
                self.change_group(group, "leave out one of", |group| group.leave_out(line));
            }
            OnProposed::Dismiss => self.dismiss_proposed(),
        }
    }

    fn accept_all(&mut self) {
        let is_believed = self.session.proposed().is_some_and(|proposed| proposed.verdict != Verdict::None);
        if is_believed {
            self.accept(|_| true, "accept all that is proposed on");
        } else {
            let has_rival = self.session.proposed().is_some_and(|proposed| proposed.alternative.is_some());
            let note = if has_rival {
                "Two cameras explain the edges alike: say which it is, or accept the groups that are right."
            } else {
                "Nothing of it is sure: look at the groups, and accept those that are right."
            };
            self.session.note = Some(note.into());
        }
    }

    /// Accepts groups. The other groups stay undecided; if none remain, the automatic calibration is removed.
    fn accept(&mut self, which: impl Fn(usize) -> bool, verb: &str) {
        let Some(proposed) = self.session.proposed().cloned() else { return };
        let chosen = || (0..proposed.groups.len()).filter(|&group| which(group));
        let name = match chosen().collect::<Vec<_>>()[..] {
            [] => return,
            [one] if proposed.groups.len() > 1 => format!("{verb} {}", proposed.groups[one].title()),
            _ => format!("accept all that is proposed on {}", proposed.of.camera),
        };
        if let Some(entry) = self.session.entry_mut() {
            *entry = proposed.drawn(entry, &which);
        }
        self.change_proposed(|own| {
            let mut index = 0..;
            own.groups.retain(|_| !index.next().is_some_and(&which));
        });
        self.session.commit(name);
    }

    fn change_group(&mut self, group: usize, verb: &str, change: impl FnOnce(&mut ProposedGroup)) {
        let title =
            self.session.proposed().and_then(|own| own.groups.get(group)).map(|own| own.title().to_owned());
        let Some(title) = title else { return };
        self.change_proposed(|own| {
            if let Some(group) = own.groups.get_mut(group) {
                change(group);
            }
            own.groups.retain(|group| !group.lines.is_empty());
        });
        self.session.commit(format!("{verb} the proposed {title}"));
    }

    /// Changes the automatic calibration of the selected camera, and removes it if it has no groups left.
    fn change_proposed(&mut self, change: impl FnOnce(&mut Proposed)) {
        let Some(of) = self.session.entry().map(Period::of) else { return };
        let all = Arc::make_mut(&mut self.session.proposed);
        if let Some(own) = all.iter_mut().find(|own| own.of == of) {
            change(own);
        }
        all.retain(|own| own.of != of || !own.groups.is_empty());
        self.session.picked = None;
    }

    fn dismiss_proposed(&mut self) {
        let Some(of) = self.session.proposed().map(|own| own.of.clone()) else { return };
        Arc::make_mut(&mut self.session.proposed).retain(|own| own.of != of);
        self.session.picked = None;
        self.session.commit(format!("dismiss what is proposed on {}", of.camera));
    }
}
