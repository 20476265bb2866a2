//! `cargo xtask notices`: the licence notices of all crates linked into the programs.
//!
//! cargo-about generates them from the crates' own licence files. The notices are committed, and a test
//! compares them with Cargo.lock.

use std::collections::BTreeSet;
use std::process::Command;

use anyhow::bail;

use crate::tools;
use crate::workspace::root;

/// Build target of the web app.
const PAGE_TARGET: &str = "wasm32-unknown-unknown";

/// Manifest of each program, the path of its notices, and its only target; `None` for all targets.
const PROGRAMS: [(&str, &str, Option<&str>); 6] = [
    ("crates/calib-app/Cargo.toml", "crates/calib-app/assets/THIRD-PARTY.txt", None),
    ("crates/calib-app/Cargo.toml", "crates/calib-app/assets/THIRD-PARTY-PAGE.txt", Some(PAGE_TARGET)),
    ("crates/calib-cli/Cargo.toml", "crates/calib-cli/THIRD-PARTY.txt", None),
    ("crates/calib-js/Cargo.toml", "crates/calib-js/THIRD-PARTY.txt", None),
    ("crates/calib-py/Cargo.toml", "crates/calib-py/THIRD-PARTY.txt", None),
    ("crates/calib-c/Cargo.toml", "crates/calib-c/THIRD-PARTY.txt", None),
];

const ABOUT: tools::Tool = tools::Tool {
    name: "cargo-about",
    is_installed: || tools::runs("target/tools/bin/cargo-about", &["--version"]),
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
    if !tools::is_ready(&ABOUT, true) {
        bail!("cargo-about could not be installed");
    }
    for (manifest, notices, target) in PROGRAMS {
        let mut about = Command::new(root().join("target/tools/bin/cargo-about"));
        about.args(["generate", "--locked", "--config", "crates/xtask/notices.toml"]);
        about.args(target.iter().flat_map(|target| ["--target", target]));
        about.args(["--manifest-path", manifest, "--output-file", notices, "crates/xtask/notices.hbs"]);
        if !about.current_dir(root()).status()?.success() {
            bail!("cargo-about failed for {manifest}");
        }
        let path = root().join(notices);
        std::fs::write(&path, merge_notices(&std::fs::read_to_string(&path)?))?;
        println!("wrote {notices}");
    }
    Ok(())
}

/// Separator between two notices.
const NOTICE_SEPARATOR: &str =
    "================================================================================";
/// Separator between the packages of a notice and its text.
const TEXT_SEPARATOR: &str =
    "--------------------------------------------------------------------------------";
/// Last line of the terms of the Apache licence. An appendix with instructions and a copyright line follows
/// it.
const END_OF_TERMS: &str = "END OF TERMS AND CONDITIONS";

/// Licence text, the packages that use it, and the copyright lines below it.
struct Notice<'a> {
    title: &'a str,
    packages: BTreeSet<&'a str>,
    text: &'a str,
    owners: BTreeSet<&'a str>,
}

/// Merges notices with the same text. Copies may differ in white space and in the copyright lines after the
/// terms.
fn merge_notices(notices: &str) -> String {
    let rule = format!("{NOTICE_SEPARATOR}\n");
    let mut sections = notices.split(&rule);
    let mut whole = sections.next().unwrap_or_default().to_owned();
    let mut groups: Vec<(String, Notice)> = Vec::new();
    for section in sections {
        let Some((head, text)) = section.split_once(&format!("{TEXT_SEPARATOR}\n")) else { continue };
        let (title, packages) = head.split_once('\n').unwrap_or((head, ""));
        let (text, after) = text.split_once(END_OF_TERMS).unwrap_or((text, ""));
        let owners = after.lines().map(str::trim).filter(|line| is_owner(line));
        let key = text.split_whitespace().collect::<Vec<_>>().join(" ").to_lowercase();
        let group = groups.iter().position(|(other, notice)| *other == key && notice.title == title);
        let index = group.unwrap_or_else(|| {
            groups.push((key, Notice { title, packages: BTreeSet::new(), text, owners: BTreeSet::new() }));
            groups.len() - 1
        });
        groups[index].1.packages.extend(packages.lines());
        groups[index].1.owners.extend(owners);
    }
    for (_, Notice { title, packages, text, owners }) in groups {
        let lines = |of: BTreeSet<&str>| of.into_iter().map(|line| format!("{line}\n")).collect::<String>();
        let text = text.trim_matches('\n').trim_end();
        let end = if text.contains("TERMS AND CONDITIONS FOR USE") {
            format!("{END_OF_TERMS}\n\n")
        } else {
            String::new()
        };
        whole.push_str(&format!(
            "{NOTICE_SEPARATOR}\n{title}\n{}{TEXT_SEPARATOR}\n{text}\n\n{end}{}\n",
            lines(packages),
            lines(owners)
        ));
    }
    whole.trim_end().to_owned() + "\n"
}

/// Whether a line of a licence text is a real copyright line, and not the placeholder of the template.
fn is_owner(line: &str) -> bool {
    line.starts_with("Copyright") && !line.contains(['[', '{', '<'])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_texts_are_merged_and_all_copyright_owners_are_kept() {
        let notice = |package: &str, text: &str| {
            format!("{NOTICE_SEPARATOR}\nApache, for\n  {package} 1\n{TEXT_SEPARATOR}\n{text}\n")
        };
        let terms = "TERMS AND CONDITIONS FOR USE";
        let of = |owner: &str| format!("{terms}\n{END_OF_TERMS}\nAPPENDIX\nCopyright {owner}");
        let all = [
            notice("b", &of("[yyyy] [name of copyright owner]")),
            notice("a", &of("2020 Somebody")),
            notice("c", &terms.to_lowercase().replace(' ', "  ")),
            notice("d", "other terms\nCopyright a person"),
        ];
        let once = merge_notices(&format!("Notices\n\n{}", all.concat()));
        assert_eq!(once.matches(TEXT_SEPARATOR).count(), 2, "{once}");
        assert!(once.contains("  a 1\n  b 1\n  c 1\n") && once.contains("Copyright 2020 Somebody"), "{once}");
        assert!(once.contains("Copyright a person") && !once.contains("[yyyy]"), "{once}");
        assert_eq!(merge_notices(&once), once);
    }
}
