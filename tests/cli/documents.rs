//! The documents: their links lead somewhere, their commands have the options that they are shown with, and those of
//! docs/start.md run.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use pulldown_cmark::{CodeBlockKind, CowStr, Event, Parser, Tag, TagEnd};

use super::completions::commands;
use crate::common::program::ok;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// The pages of a folder and of the folders inside it.
fn pages(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(pages(&path));
        } else if path.extension().is_some_and(|ending| ending == "md") {
            found.push(path);
        }
    }
    found.sort();
    found
}

fn documents() -> Vec<PathBuf> {
    let mut documents = pages(&root().join("docs"));
    assert!(documents.len() > 10, "{documents:?}");
    let others = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md", "fuzz/README.md", "tests/fixtures/README.md"];
    documents.extend(others.map(|name| root().join(name)));
    documents
}

/// What is tested of a document.
#[derive(Default)]
struct Document {
    /// Links and pictures, as they are written.
    links: Vec<String>,
    /// The names of headings in links.
    headings: BTreeSet<String>,
    /// What follows the fence of a code block, and the block.
    blocks: Vec<(String, String)>,
}

impl Document {
    fn read(file: &Path) -> Self {
        let text = fs::read_to_string(file).unwrap();
        let mut found = Self::default();
        let (mut heading, mut block) = (None, None);
        for event in Parser::new_ext(&text, pulldown_cmark::Options::ENABLE_TABLES) {
            match event {
                Event::Start(Tag::Link { dest_url, .. } | Tag::Image { dest_url, .. }) => {
                    found.links.push(dest_url.into_string());
                }
                Event::Start(Tag::Heading { .. }) => heading = Some(String::new()),
                Event::End(TagEnd::Heading(_)) => found.add_heading(&heading.take().unwrap()),
                Event::Start(Tag::CodeBlock(CodeBlockKind::Fenced(info))) => block = Some((info, String::new())),
                Event::End(TagEnd::CodeBlock) => {
                    found.blocks.extend(block.take().map(|(info, text): (CowStr, _)| (info.into_string(), text)))
                }
                Event::Text(text) | Event::Code(text) => {
                    if let Some((_, lines)) = &mut block {
                        lines.push_str(&text);
                    } else if let Some(heading) = &mut heading {
                        heading.push_str(&text);
                    }
                }
                _ => {}
            }
        }
        found
    }

    /// Adds a heading by the name that GitHub gives it.
    fn add_heading(&mut self, text: &str) {
        let kept = text.to_lowercase().replace(' ', "-");
        let name: String = kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect();
        let numbered = (1..).map(|number| format!("{name}-{number}"));
        let free = std::iter::once(name.clone()).chain(numbered).find(|name| !self.headings.contains(name));
        self.headings.extend(free);
    }

    /// The blocks of a shell that are not marked `ignore`.
    fn shell(&self) -> impl Iterator<Item = &str> {
        self.blocks.iter().filter(|(info, _)| info == "sh").map(|(_, block)| block.as_str())
    }
}

/// What is wrong with the links of a document, one line each.
fn broken(file: &Path) -> Vec<String> {
    let document = Document::read(file);
    let is_broken = |link: &&String| {
        if link.contains("://") || link.starts_with("mailto:") {
            return false;
        }
        let (path, heading) =
            link.split_once('#').map_or((link.as_str(), None), |(path, heading)| (path, Some(heading)));
        let target = if path.is_empty() { file.to_owned() } else { file.parent().unwrap().join(path) };
        let is_page = target.extension().is_some_and(|ending| ending == "md");
        let has = |heading: &str| !is_page || Document::read(&target).headings.contains(heading);
        !target.exists() || heading.is_some_and(|heading| !has(heading))
    };
    document.links.iter().filter(is_broken).map(|link| format!("{}: {link}", file.display())).collect()
}

#[test]
fn links_of_the_documents_lead_to_files_and_headings() {
    let found: Vec<_> = documents().iter().flat_map(|file| broken(file)).collect();
    assert_eq!(found, Vec::<String>::new());
}

#[test]
fn broken_links_are_found() {
    let folder = tempfile::tempdir().unwrap();
    let page = folder.path().join("page.md");
    fs::write(folder.path().join("other.md"), "# A `b`, c\n\n# A `b`, c\n").unwrap();
    let text = "[a](other.md#a-b-c) [b](other.md#a-b-c-1) [c](https://d) ![e](f.png) [g](other.md#h) [i](#j)\n\n# K\n";
    fs::write(&page, text).unwrap();
    let found = broken(&page);
    let ends: Vec<_> = found.iter().map(|line| line.rsplit(' ').next().unwrap()).collect();
    assert_eq!(ends, ["f.png", "other.md#h", "#j"]);
}

#[test]
fn the_summary_lists_every_page() {
    let docs = root().join("docs");
    let summary = docs.join("SUMMARY.md");
    let links = Document::read(&summary).links;
    let listed: BTreeSet<_> = links.iter().map(|link| docs.join(link)).collect();
    let missing: Vec<_> = pages(&docs).into_iter().filter(|page| *page != summary && !listed.contains(page)).collect();
    assert_eq!(missing, Vec::<PathBuf>::new());
}

/// The option that a word of a command line gives, without its value.
fn option(word: &str) -> Option<&str> {
    let name = word.split('=').next().unwrap();
    name.strip_prefix("--").is_some_and(|name| name.starts_with(|c: char| c.is_ascii_lowercase())).then_some(name)
}

#[test]
fn commands_of_the_documents_have_the_options_they_are_shown_with() {
    let helps: BTreeMap<_, _> = commands().into_iter().map(|name| (name.clone(), ok(&[&name, "--help"]))).collect();
    let mut count = 0;
    for file in documents() {
        let document = Document::read(&file);
        let blocks = document.blocks.iter().filter(|(info, _)| info.starts_with("sh")).map(|(_, block)| block);
        let whole: Vec<_> = blocks.map(|block| block.replace("\\\n", " ")).collect();
        for line in whole.iter().flat_map(|block| block.lines()) {
            let command = line.split(" #").next().unwrap().split(" | ").next().unwrap();
            let Some(words) = command.trim().strip_prefix("smalto ") else { continue };
            let mut words = words.split_whitespace();
            let name = words.next().unwrap();
            let help = helps.get(name).unwrap_or_else(|| panic!("{}: {line}: no command {name}", file.display()));
            for option in words.filter_map(option) {
                let is_there = help.split([' ', '\n', ',', '=', '[']).any(|word| word == option);
                assert!(is_there, "{}: {line}: no option {option}", file.display());
                count += 1;
            }
        }
    }
    assert!(count > 100, "{count} options were found");
}

/// Blocks that need a window (`view`), files that a user has, or the half minute that a budget measures, are marked
/// `ignore`.
#[cfg(unix)]
#[test]
fn commands_of_the_start_run() {
    use std::process::Command;
    let folder = tempfile::tempdir().unwrap();
    let program = Path::new(env!("CARGO_BIN_EXE_smalto")).parent().unwrap();
    let path = format!("{}:{}", program.display(), std::env::var("PATH").unwrap());
    let document = Document::read(&root().join("docs/start.md"));
    let mut count = 0;
    for block in document.shell() {
        let mut bash = Command::new("bash");
        bash.args(["-e", "-c", block]).current_dir(folder.path()).env("PATH", &path);
        let output = bash.env("SMALTO_VALIDATION", "1").env("XDG_CACHE_HOME", env!("CARGO_TARGET_TMPDIR")).output();
        let output = output.expect("bash starts");
        assert!(output.status.success(), "{block}{}", String::from_utf8_lossy(&output.stderr));
        count += 1;
    }
    assert!(count >= 8, "{count} blocks ran");
}
