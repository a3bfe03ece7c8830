//! Help texts: the short one is a summary, with a line for each option, grouped by task.

use super::completions::commands;
use crate::common::program::ok;

/// Lines of a short help text.
const MOST_LINES: usize = 100;

/// The options that a help text lists, with their lines.
fn options(help: &str) -> Vec<&str> {
    let is_option = |line: &&str| line.trim_start().starts_with('-') && line.starts_with("  ");
    help.lines().filter(is_option).collect()
}

#[test]
fn short_help_has_one_line_for_each_option() {
    for command in commands() {
        let help = ok(&[&command, "-h"]);
        assert!(help.lines().count() <= MOST_LINES, "{command} -h: {} lines", help.lines().count());
        let (listed, _) = help.split_once("Examples:").unwrap_or((&help, ""));
        let (_, listed) = listed.split_once("Options:").unwrap();
        for line in listed.lines() {
            let is_heading = line.ends_with(':') && !line.starts_with(' ');
            let is_option = line.trim_start().starts_with('-') && line.starts_with("  ");
            let is_aside = !line.starts_with("  ");
            assert!(line.is_empty() || is_heading || is_option || is_aside, "{command} -h: {line}");
            assert!(line.len() <= 100, "{command} -h: {line}");
        }
        for line in options(listed) {
            let text = line.trim_start().split_once("  ").map_or("", |(_, text)| text.trim());
            assert!(!text.is_empty(), "{command} -h: {line}");
        }
    }
}

#[test]
fn options_of_render_are_grouped_by_task_and_end_with_examples() {
    let help = ok(&["render", "-h"]);
    let headings = ["Output", "Cameras", "Many pictures", "Levels of detail", "Accuracy", "Device", "Reports"];
    for heading in headings {
        assert!(help.contains(&format!("\n{heading}:\n")), "{heading}: {help}");
    }
    let (_, examples) = help.split_once("\nExamples:\n").unwrap();
    assert_eq!(examples.lines().filter(|line| line.starts_with("  smalto render ")).count(), 5);
    let (short, long) = (options(&help).len(), ok(&["render", "--help"]));
    assert!(short < options(&long).len() && long.contains("--key-bits") && !help.contains("--key-bits"));
}
