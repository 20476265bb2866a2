//! Plain English: riddling phrases per 1,000 words of comments in each crate, and in user-facing strings.
//!
//! The rules and the glossary are in `docs/glossary.md`. The patterns find comments that start with a free
//! relative, data that speak, words outside the glossary, and sentences of more than 28 words. A hit is not
//! always wrong, therefore comments have a small budget. Strings that users read must have no hit.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use calib_core::outcome::Code;
use calib_tests::root;
use regex::Regex;

/// Largest number of phrases per 1,000 words of comments in a crate. It only goes down.
const COMMENT_BUDGET: f64 = 4.0;

/// Words above which a sentence counts as a phrase.
const MAX_SENTENCE_WORDS: usize = 28;

/// Number of lines that a failure prints.
const WORST_LINES: usize = 40;

/// Phrases that neither comments nor user-facing strings use.
const PHRASES: &[&str] = &[
    // Free relatives and riddles.
    r"\bwhatever\b|\bwhoever\b|\bwhosoever\b|\bwhomever\b",
    r"\bthat which\b|\bthose (which|that|who|whose|of|in|with|by|from|at|on)\b",
    r"\bthe ones? (that|which|of|who|with|in|from)\b",
    r"\b(of|from|to|after|before) which\b",
    r"\bwhat (is|are|was|were|it|they|the|a|an|has|have|no|such)\b",
    r"\b(so|as) (many|much) (as|of)\b|\bby so (many|much)\b|\bof so (many|much)\b",
    r"\bsuch (a one|as one|as is|as are)\b",
    // Data do not speak, stand or believe.
    r"\b(tells?|told|telling)\b",
    r"\b(bears?|bore|borne) (it |them )?out\b|\bhangs? together\b|\bhas a (voice|say)\b",
    r"\b(leaves?|left|leaving|stays?) open\b",
    r"\bnothing (tells|says|knows)\b|\bnobody knows\b|\bknows? (of|nothing|no)\b|\b(it|they|file|data|lines?) says?\b",
    r"\bbelie(f|fs|ve|ved|ves|ving)\b",
    r"\bstands? (otherwise|anew|there|as|in the)\b|\bwhere it (lies|stands)\b",
    r"\b(became|comes?|came) of (it|them|the|a|every)\b|\bbecomes? of\b",
    // Words outside the glossary.
    r"\bset aside\b|\bput aside\b|\bthere (is|are|was|were) none\b|\bwhere there is (one|none|no)\b",
    r"\bbends?\b|\bbent\b|\bstraightened\b|\banew\b|\ball the same\b|\bby itself\b|\bbesides\b",
    r"\bas it (was|were|does|did)\b|\bthe same of\b|\bin the hand\b|\bput into words\b",
    r"\bof (its|their) own\b|\bof (ours|theirs)\b|\bor else\b",
];

/// Starts of a doc comment that name nothing.
const STARTS: &str = r"^(what|where|of|by|in|how|so many|so much|those|that|whoever|whose|who|as many|to which|besides|nor|nothing|none)\b";

/// A text of a source file, with its line.
struct Text {
    line: usize,
    is_doc: bool,
    text: String,
}

/// Returns the Rust sources below `folder`.
fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && path.file_name().is_some_and(|name| name != "target") {
            sources(&path, found);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
}

/// Returns the comment blocks of a source, without code examples and code spans.
fn comments(source: &str) -> Vec<Text> {
    let mut blocks: Vec<Text> = Vec::new();
    let (mut previous, mut in_example) = (None, false);
    for (index, line) in source.lines().enumerate() {
        let trimmed = line.trim_start();
        let marker = ["///", "//!", "//"].into_iter().find(|marker| trimmed.starts_with(marker));
        let Some(marker) = marker else {
            (previous, in_example) = (None, false);
            continue;
        };
        let text = trimmed[marker.len()..].trim();
        if previous != Some(marker) {
            blocks.push(Text { line: index + 1, is_doc: marker == "///", text: String::new() });
            previous = Some(marker);
        }
        if text.starts_with("```") {
            in_example = !in_example;
        } else if !in_example {
            let block = blocks.last_mut().unwrap();
            // A new paragraph or list item ends the sentence.
            if text.is_empty() || text.starts_with("- ") || text.starts_with('|') {
                block.text.push_str(" . ");
            }
            block.text.push_str(text);
            block.text.push(' ');
        }
    }
    let span = Regex::new("`[^`]*`").unwrap();
    blocks.iter_mut().for_each(|block| block.text = span.replace_all(&block.text, "X").into_owned());
    blocks
}

/// Returns the string literals of the code of a source that read as text: three words or more, outside its
/// tests.
fn strings(source: &str) -> Vec<Text> {
    let code = source.split("#[cfg(test)]").next().unwrap_or_default();
    let literal = Regex::new(r#""((?:[^"\\]|\\.)*)""#).unwrap();
    let code = code.lines().enumerate().filter(|(_, line)| !line.trim_start().starts_with("//"));
    let texts = code.flat_map(|(index, line)| {
        let found = literal.captures_iter(line).map(|capture| capture[1].to_owned()).collect::<Vec<_>>();
        found.into_iter().map(move |text| Text { line: index + 1, is_doc: false, text })
    });
    texts.filter(|text| text.text.split_whitespace().filter(|word| is_word(word)).count() >= 3).collect()
}

fn is_word(text: &str) -> bool {
    text.len() > 1 && text.chars().all(|letter| letter.is_alphabetic() || ",.;:'\u{2019}".contains(letter))
}

/// Counts the phrases of one text.
struct Counter {
    start: Regex,
    phrases: Vec<Regex>,
}

impl Counter {
    fn new() -> Self {
        let pattern = |pattern: &&str| Regex::new(&format!("(?i){pattern}")).unwrap();
        Self { start: pattern(&STARTS), phrases: PHRASES.iter().map(pattern).collect() }
    }

    /// Returns the phrases that a text contains, and its sentences that are too long.
    fn phrases(&self, text: &Text) -> Vec<String> {
        let mut found: Vec<String> = Vec::new();
        if text.is_doc
            && let Some(start) = self.start.find(text.text.trim_start_matches([' ', '.']))
        {
            found.push(format!("starts with {:?}", start.as_str()));
        }
        let phrases = self.phrases.iter().flat_map(|phrase| phrase.find_iter(&text.text));
        found.extend(phrases.map(|phrase| phrase.as_str().to_owned()));
        let sentences = text.text.split_inclusive(['.', ':', ';', '?', '!']);
        let lengths = sentences.map(|sentence| sentence.split_whitespace().count());
        found.extend(
            lengths.filter(|&words| words > MAX_SENTENCE_WORDS).map(|words| format!("{words} words")),
        );
        found
    }
}

/// The phrases of one crate.
#[derive(Default)]
struct Tally {
    phrases: usize,
    words: usize,
    lines: Vec<String>,
}

impl Tally {
    fn new(folder: &Path, counter: &Counter, texts: fn(&str) -> Vec<Text>) -> Self {
        let (mut files, mut tally) = (Vec::new(), Self::default());
        sources(folder, &mut files);
        files.sort();
        for path in files {
            for text in texts(&std::fs::read_to_string(&path).unwrap()) {
                let phrases = counter.phrases(&text);
                tally.words += text.text.split_whitespace().count();
                tally.phrases += phrases.len();
                if !phrases.is_empty() {
                    let name = path.strip_prefix(root()).unwrap_or(&path).display();
                    tally.lines.push(format!("{name}:{}: {phrases:?} {}", text.line, text.text.trim()));
                }
            }
        }
        tally
    }

    fn per_thousand(&self) -> f64 {
        1000.0 * self.phrases as f64 / self.words.max(1) as f64
    }
}

/// Returns the folders of the sources of every crate, by name.
fn crates() -> Vec<(String, PathBuf)> {
    let folders = std::fs::read_dir(root().join("crates")).unwrap().map(|entry| entry.unwrap().path());
    let mut found: Vec<(String, PathBuf)> = folders
        .filter(|path| path.join("src").is_dir())
        .map(|path| (path.file_name().unwrap().to_string_lossy().into_owned(), path))
        .collect();
    found.push(("tests".to_owned(), root().join("tests")));
    found.sort();
    found
}

#[test]
fn comments_are_plain_english() {
    let counter = Counter::new();
    let mut report = String::new();
    for (name, folder) in crates() {
        let tally = Tally::new(&folder, &counter, comments);
        println!("{name}: {:.1} phrases per 1,000 words ({} words)", tally.per_thousand(), tally.words);
        if tally.per_thousand() > COMMENT_BUDGET {
            writeln!(report, "{name}: {:.1} phrases per 1,000 words", tally.per_thousand()).unwrap();
            tally.lines.iter().take(WORST_LINES).for_each(|line| writeln!(report, "  {line}").unwrap());
        }
    }
    assert!(report.is_empty(), "{report}");
}

#[test]
fn strings_for_users_are_plain_english() {
    let counter = Counter::new();
    // Development commands are not for users.
    let folders = crates().into_iter().filter(|(name, _)| name != "xtask" && name != "tests");
    let lines: Vec<String> =
        folders.flat_map(|(_, folder)| Tally::new(&folder.join("src"), &counter, strings).lines).collect();
    assert!(lines.is_empty(), "{} strings:\n{}", lines.len(), lines.join("\n"));
}

#[test]
fn counter_finds_riddles_and_accepts_plain_sentences() {
    let counter = Counter::new();
    let doc = |text: &str| Text { line: 1, is_doc: true, text: text.to_owned() };
    for riddle in [
        "What the lines leave open.",
        "Of a table of so many rows, if that is known.",
        "How well the camera is known, nothing tells.",
        "Parameters that edges tell less of.",
    ] {
        assert!(!counter.phrases(&doc(riddle)).is_empty(), "{riddle}");
    }
    for plain in [
        "Returns the focal length, in pixels.",
        "Largest accepted reprojection error, in pixels.",
        "The lines do not determine the pitch. Draw two vertical lines.",
    ] {
        assert_eq!(counter.phrases(&doc(plain)), Vec::<String>::new(), "{plain}");
    }
}

/// Returns the anchor of a heading, as mdBook and code hosts form it.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

#[test]
fn links_of_the_guide_have_targets() {
    let blocks = Regex::new("(?s)```.*?```").unwrap();
    let read = |path: &Path| blocks.replace_all(&std::fs::read_to_string(path).unwrap(), "").into_owned();
    let files = std::fs::read_dir(root().join("docs/src")).unwrap().map(|entry| entry.unwrap().path());
    let mut pages: Vec<PathBuf> =
        files.filter(|path| path.extension().is_some_and(|extension| extension == "md")).collect();
    let others = ["README.md", "CONTRIBUTING.md", "crates/README.md", "crates/calib-formats/README.md"];
    pages.extend(others.map(|name| root().join(name)));
    let link = Regex::new(r"\]\(([^)\s]+)\)").unwrap();
    let (mut wrong, mut count) = (Vec::new(), 0);
    for page in &pages {
        let text = read(page);
        for target in link.captures_iter(&text).map(|found| found[1].to_owned()) {
            if target.contains("://") || target.starts_with("mailto:") {
                continue;
            }
            count += 1;
            let (file, wanted) = target.split_once('#').unwrap_or((&target, ""));
            let path = if file.is_empty() { page.clone() } else { page.parent().unwrap().join(file) };
            let is_page = path.extension().is_some_and(|extension| extension == "md");
            let has_anchor = || {
                let text = read(&path);
                let headings = text.lines().filter(|line| line.starts_with('#'));
                headings.map(|line| anchor(line.trim_start_matches('#'))).any(|anchor| anchor == wanted)
            };
            if !path.exists() || is_page && !wanted.is_empty() && !has_anchor() {
                wrong.push(format!("{}: {target}", page.display()));
            }
        }
    }
    assert!(count > 100 && wrong.is_empty(), "{count} links:\n{}", wrong.join("\n"));
}

#[test]
fn files_that_the_architecture_names_exist() {
    let text = std::fs::read_to_string(root().join("crates/README.md")).unwrap();
    let name = Regex::new(r"`([\w/.-]+\.(?:rs|py|pyi))`").unwrap();
    let named: BTreeSet<&str> =
        name.captures_iter(&text).map(|found| found.get(1).unwrap().as_str()).collect();
    let mut paths = Vec::new();
    collect(&root().join("crates"), &mut paths);
    collect(&root().join("tests"), &mut paths);
    let exists = |name: &&str| paths.iter().any(|path| path.ends_with(name));
    let missing: Vec<&str> = named.iter().copied().filter(|name| !exists(name)).collect();
    assert!(named.len() > 60 && missing.is_empty(), "{} names, missing: {missing:?}", named.len());
}

/// Collects the files of a folder and its folders.
fn collect(folder: &Path, paths: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => collect(&path, paths),
            false => paths.push(path),
        }
    }
}

#[test]
fn every_finding_has_an_entry_in_the_guide() {
    let text = std::fs::read_to_string(root().join("docs/src/findings.md")).unwrap();
    let headings: BTreeSet<&str> = text.lines().filter_map(|line| line.strip_prefix("### ")).collect();
    let missing: Vec<&str> =
        Code::ALL.iter().map(|code| code.as_str()).filter(|code| !headings.contains(code)).collect();
    assert!(missing.is_empty(), "{missing:?}");
}
