//! `cargo xtask notices`: the notices of everything that is linked into the programs, made by cargo-about
//! from the crates' own licence files. They are committed; a test compares them with Cargo.lock.

use std::process::Command;

use anyhow::bail;

use crate::tools;
use crate::workspace::root;

/// A program's crate, and where its notices are.
const PROGRAMS: [(&str, &str); 5] = [
    ("crates/calib-app/Cargo.toml", "crates/calib-app/assets/THIRD-PARTY.txt"),
    ("crates/calib-cli/Cargo.toml", "crates/calib-cli/THIRD-PARTY.txt"),
    ("crates/calib-js/Cargo.toml", "crates/calib-js/THIRD-PARTY.txt"),
    ("crates/calib-py/Cargo.toml", "crates/calib-py/THIRD-PARTY.txt"),
    ("crates/calib-c/Cargo.toml", "crates/calib-c/THIRD-PARTY.txt"),
];

const ABOUT: tools::Tool = tools::Tool {
    name: "cargo-about",
    is_there: || tools::runs("target/tools/bin/cargo-about", &["--version"]),
    install: &[&[
        "cargo",
        "install",
        "--quiet",
        "--locked",
        "--root",
        "target/tools",
        "cargo-about@0.9.3",
        "--features",
        "cli",
    ]],
};

/// Writes the notices of every program.
pub(crate) fn run() -> anyhow::Result<()> {
    if !tools::ready(&ABOUT, true) {
        bail!("cargo-about could not be installed");
    }
    for (manifest, notices) in PROGRAMS {
        let mut about = Command::new(root().join("target/tools/bin/cargo-about"));
        about.args(["generate", "--locked", "--config", "crates/xtask/notices.toml"]);
        about.args(["--manifest-path", manifest, "--output-file", notices, "crates/xtask/notices.hbs"]);
        if !about.current_dir(root()).status()?.success() {
            bail!("cargo-about failed for {manifest}");
        }
        let path = root().join(notices);
        std::fs::write(&path, grouped(&std::fs::read_to_string(&path)?))?;
        println!("wrote {notices}");
    }
    Ok(())
}

/// Between two notices.
const RULE: &str = "================================================================================";
/// Between whom a notice is for and its text.
const LINE: &str = "--------------------------------------------------------------------------------";
/// The last words of the terms of the Apache licence; an appendix says how it is applied, and by whom.
const END_OF_TERMS: &str = "END OF TERMS AND CONDITIONS";
/// What the appendix leaves open, unless somebody filled it.
const UNFILLED: [&str; 2] = ["[yyyy] [name of copyright owner]", "{yyyy} {name of copyright owner}"];

/// The notices with each text once, for all whose copies differ in white space or in an appendix that nobody filled.
fn grouped(notices: &str) -> String {
    let mut sections = notices.split(&format!("{RULE}\n"));
    let mut whole = sections.next().unwrap_or_default().to_owned();
    let mut groups: Vec<(String, &str, Vec<&str>, &str)> = Vec::new();
    for section in sections {
        let Some((head, text)) = section.split_once(&format!("{LINE}\n")) else { continue };
        let (title, packages) = head.split_once('\n').unwrap_or((head, ""));
        let key = key(text);
        match groups.iter_mut().find(|(other, own, ..)| *other == key && *own == title) {
            Some((_, _, all, _)) => all.extend(packages.lines()),
            None => groups.push((key, title, packages.lines().collect(), text)),
        }
    }
    for (_, title, mut packages, text) in groups {
        packages.sort_unstable();
        packages.dedup();
        let text = text.trim_matches('\n');
        whole.push_str(&format!("{RULE}\n{title}\n{}\n{LINE}\n{text}\n\n", packages.join("\n")));
    }
    whole.trim_end().to_owned() + "\n"
}

/// What two copies of one text have in common.
fn key(text: &str) -> String {
    let is_filled = text.contains(END_OF_TERMS) && !UNFILLED.iter().any(|open| text.contains(open));
    let (terms, appendix) = text.split_once(END_OF_TERMS).unwrap_or((text, ""));
    let is_by_somebody = is_filled && appendix.contains("Copyright");
    let of = if is_by_somebody { text } else { terms };
    of.split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_there_once_for_all_whose_copies_are_alike() {
        let notice =
            |package: &str, text: &str| format!("{RULE}\nApache, for\n  {package} 1\n{LINE}\n{text}\n");
        let of = |owner: &str| format!("the terms\n{END_OF_TERMS}\nAPPENDIX\nCopyright {owner}");
        let all = [
            notice("a", &of("[yyyy] [name of copyright owner]")),
            notice("b", "The  terms"),
            notice("c", &of("2020 Somebody")),
            notice("d", "other terms"),
        ];
        let once = grouped(&format!("Notices\n\n{}", all.concat()));
        assert_eq!(once.matches(LINE).count(), 3, "{once}");
        assert!(once.contains("  a 1\n  b 1\n") && once.contains("2020 Somebody"), "{once}");
        assert_eq!(grouped(&once), once);
    }
}
