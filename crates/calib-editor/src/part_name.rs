//! What the operator calls what they selected.

use std::collections::BTreeSet;

use crate::hit::Part;
use crate::session::Session;

impl Session {
    /// What the operator calls a part: V2, corner 3, control point 7, M1.
    #[must_use]
    pub fn part_name(&self, part: Part) -> String {
        let Some(entry) = self.entry() else { return String::new() };
        let named = |id: Option<&String>, what: &str, index: usize| {
            id.cloned().unwrap_or_else(|| format!("{what} {}", index + 1))
        };
        match part {
            Part::Vertex { annotation, segment, .. } | Part::Line { annotation, segment } => {
                calib_core::single::line_name(&entry.annotations, annotation, segment)
            }
            Part::Corner(corner) => format!("corner {} of the field", corner + 1),
            Part::Field => "the field".into(),
            Part::Control(i) => {
                named(entry.control_points.get(i).and_then(|p| p.id.as_ref()), "control point", i)
            }
            Part::Link { link, .. } => {
                named(self.site.links.get(link).and_then(|l| l.id.as_ref()), "link", link)
            }
            Part::Pin { mark, .. } => {
                format!(
                    "pin of {}",
                    named(self.site.marks.get(mark).and_then(|m| m.id.as_ref()), "mark", mark)
                )
            }
            Part::Mark(mark) => named(self.site.marks.get(mark).and_then(|m| m.id.as_ref()), "mark", mark),
        }
    }

    /// The names of what is selected, for the name of a step.
    #[must_use]
    pub fn selection_name(&self) -> String {
        let names: BTreeSet<String> = self.selection.iter().map(|&part| self.part_name(part)).collect();
        match names.len() {
            0 => "nothing".into(),
            1..=3 => names.into_iter().collect::<Vec<_>>().join(", "),
            count => format!("{count} things"),
        }
    }
}
