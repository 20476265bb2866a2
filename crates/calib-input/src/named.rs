//! When a still was taken, by its name.

use jiff::Timestamp;

/// The time (RFC 3339) that the name of a still says, such as `2026-05-01T080000Z` or `20260501_0800`: of UTC, as names
/// of files have no zone.
#[must_use]
pub fn time_in_name(name: &str) -> Option<String> {
    let times = (0..name.len())
        .filter(|&start| begins_a_number(name, start))
        .filter_map(|start| time_at(&name[start..]));
    times.map(|time| time.to_string()).next()
}

fn begins_a_number(name: &str, start: usize) -> bool {
    let is_digit = |at: usize| name.as_bytes().get(at).is_some_and(u8::is_ascii_digit);
    is_digit(start) && !(start > 0 && is_digit(start - 1))
}

/// A time at the start of a text: year, month and day, then hour and minute, then seconds if there are any.
fn time_at(text: &str) -> Option<Timestamp> {
    let mut rest = text;
    let mut number = |digits: usize| {
        let skipped = rest.trim_start_matches(['-', '_', ':', '.', 'T', ' ']);
        // One separator at most.
        if rest.len() - skipped.len() > 1 {
            return None;
        }
        let found = skipped.get(..digits).filter(|part| part.bytes().all(|byte| byte.is_ascii_digit()))?;
        rest = &skipped[digits..];
        found.parse::<u32>().ok()
    };
    let (year, month, day) = (number(4)?, number(2)?, number(2)?);
    let (hour, minute) = (number(2)?, number(2)?);
    let second = number(2);
    // What else stands there, as 1080p, is another number.
    let ends = !rest.starts_with(|next: char| next.is_alphanumeric() && next != 'Z');
    let second = second.filter(|&second| ends && second < 60).unwrap_or(0);
    let is_of_now = (1990..2200).contains(&year);
    let text = format!("{year:04}-{month:02}-{day:02}T{hour:02}:{minute:02}:{second:02}Z");
    text.parse().ok().filter(|_| is_of_now)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_when_stills_were_taken() {
        for name in
            ["door-2026-05-01T083005Z", "door_20260501_083005", "20260501083005", "cam12 2026-05-01 08.30.05"]
        {
            assert_eq!(time_in_name(name).as_deref(), Some("2026-05-01T08:30:05Z"), "{name}");
        }
        assert_eq!(time_in_name("door_20260501-0830").as_deref(), Some("2026-05-01T08:30:00Z"));
        for name in [
            "door_20260501_0830_1080p",
            "door_20260501_0830_720p",
            "door_20260501_0830_99",
            "door_20260501_0830-é",
        ] {
            assert_eq!(time_in_name(name).as_deref(), Some("2026-05-01T08:30:00Z"), "{name}");
        }
        for name in ["door", "shop-1", "20261301_083000", "12345678901234567", "2026-05-01", "tür-2026"] {
            assert_eq!(time_in_name(name), None, "{name}");
        }
    }
}
