//! A site in words: what hangs together, which cameras disagree most, what is to be done.

use std::fmt::Write as _;

use calib_core::Code;

use calib_site::{Overlap, Scale, SiteSolution, Warning};

use crate::words::{distance, few};

/// Components, scale and loops in a line.
#[must_use]
pub fn together(solution: &SiteSolution) -> Option<String> {
    let mut groups: Vec<&Vec<String>> = solution.components.iter().collect();
    groups.sort_by_key(|group| std::cmp::Reverse(group.len()));
    let (largest, apart) = groups.split_first()?;
    let all: usize = groups.iter().map(|group| group.len()).sum();
    let mut line = if apart.is_empty() {
        match all {
            1 => "one camera".into(),
            _ => format!("{all} cameras hang together"),
        }
    } else {
        let names: Vec<String> = apart.iter().map(|group| few(group.iter().map(String::as_str))).collect();
        let names: Vec<String> =
            apart.iter().zip(names).map(|(g, n)| if g.len() > 1 { format!("({n})") } else { n }).collect();
        format!(
            "{} of {all} cameras hang together, apart from them {}",
            largest.len(),
            few(names.iter().map(String::as_str))
        )
    };
    match solution.scale {
        Some(Scale::Known) => line.push_str("; scale known"),
        Some(Scale::Unknown) => line.push_str("; scale unknown"),
        None => {}
    }
    if let Some(gap) = solution.loop_closure_m {
        let _ = write!(line, "; loops {} apart before the joint fit", distance(gap));
    }
    Some(line)
}

/// Pairs of cameras, the worst first: by what was measured, then by what is predicted.
#[must_use]
pub fn worst_first(overlaps: &[Overlap]) -> Vec<&Overlap> {
    let mut sorted: Vec<&Overlap> = overlaps.iter().collect();
    let key = |pair: &Overlap| (pair.floor_rms_m.unwrap_or(-1.0), pair.floor_sigma_m.unwrap_or(-1.0));
    sorted.sort_by(|a, b| {
        let (a, b) = (key(a), key(b));
        b.0.total_cmp(&a.0).then(b.1.total_cmp(&a.1))
    });
    sorted
}

/// Warnings that ask for the same.
#[derive(Clone, Debug)]
pub struct WarningKind<'a> {
    /// Of all of them.
    pub code: Code,
    /// A few, and how many more there are.
    pub messages: Vec<String>,
    /// What is asked for.
    pub advice: &'a str,
}

/// Warnings by what they ask for.
#[must_use]
pub fn kinds(warnings: &[Warning]) -> Vec<WarningKind<'_>> {
    const MESSAGES: usize = 4;
    let mut kinds: Vec<WarningKind> = Vec::new();
    for Warning { code, message, advice } in warnings {
        match kinds.iter_mut().find(|kind| kind.code == *code && kind.advice == advice) {
            Some(kind) => kind.messages.push(message.clone()),
            None => kinds.push(WarningKind { code: *code, messages: vec![message.clone()], advice }),
        }
    }
    for WarningKind { messages, .. } in &mut kinds {
        if messages.len() > MESSAGES {
            let more = format!("and {} more", messages.len() - (MESSAGES - 1));
            messages.truncate(MESSAGES - 1);
            messages.push(more);
        }
    }
    kinds
}
