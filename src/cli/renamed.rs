//! Former spellings of options, which are still understood: a note on stderr says the present one.

use std::ffi::{OsStr, OsString};

/// A former spelling of an option of some commands.
struct Renamed {
    commands: &'static [&'static str],
    former: &'static str,
    present: &'static str,
    /// The present form of a former value; `None` if the value is not a former one.
    value: fn(&str) -> Option<String>,
}

const SCENES: &[&str] = &["render", "view", "serve", "info", "convert", "lod", "prune", "bench", "trade"];

const RENAMED: [Renamed; 5] = [
    Renamed { commands: &["convert", "lod"], former: "--memory", present: "--host-memory", value: megabytes },
    Renamed { commands: &["prune"], former: "--psnr", present: "--min-psnr", value: same },
    Renamed { commands: &["view"], former: "--fps", present: "--target-fps", value: same },
    Renamed { commands: SCENES, former: "--lod", present: "--sog-level", value: same },
    Renamed { commands: &["bench", "trade"], former: "--path", present: "--path", value: keyframes },
];

fn same(value: &str) -> Option<String> {
    Some(value.to_owned())
}

/// A number without a unit was one of megabytes.
fn megabytes(value: &str) -> Option<String> {
    let has_unit = value.is_empty() || value.contains(|c: char| !c.is_ascii_digit());
    Some(if has_unit { value.to_owned() } else { format!("{value}MiB") })
}

fn keyframes(value: &str) -> Option<String> {
    value.strip_prefix("keyframes:").map(str::to_owned)
}

/// The arguments of a command, which follow the name of the program, in present spelling, and a note on each former
/// one.
pub(super) fn in_present_spelling(arguments: Vec<OsString>) -> (Vec<OsString>, Vec<String>) {
    let command = arguments.get(1).and_then(|name| name.to_str()).unwrap_or_default().to_owned();
    let (mut present, mut notes) = (Vec::new(), Vec::new());
    let mut rest = arguments.into_iter();
    while let Some(argument) = rest.next() {
        // Behind `--` there are no options.
        if argument == "--" {
            present.push(argument);
            present.extend(rest);
            break;
        }
        let text = argument.to_str().unwrap_or_default();
        let (name, attached) = text.split_once('=').map_or((text, None), |(name, value)| (name, Some(value)));
        let of_command = |renamed: &&Renamed| renamed.former == name && renamed.commands.contains(&command.as_str());
        let Some(renamed) = RENAMED.iter().find(of_command) else {
            present.push(argument);
            continue;
        };
        let next = if attached.is_none() { rest.next() } else { None };
        let value = attached.map(OsStr::new).or(next.as_deref());
        let readable = value.and_then(OsStr::to_str);
        match (readable.and_then(renamed.value), value) {
            // The value is no former one, or not text.
            (None, Some(value)) => {
                let name = if readable.is_none() { renamed.present } else { renamed.former };
                present.extend([OsString::from(name), value.to_owned()]);
            }
            (None, None) => present.push(renamed.present.into()),
            (Some(now), _) => {
                let given = readable.unwrap_or_default();
                notes.push(format!("note: {name} {given} is now spelled {} {now}", renamed.present));
                present.push(format!("{}={now}", renamed.present).into());
            }
        }
    }
    (present, notes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn former_spellings_become_present_ones_with_a_note() {
        let present = |line: &str| {
            let (present, notes) = in_present_spelling(line.split(' ').map(OsString::from).collect());
            (present.join(OsStr::new(" ")).into_string().unwrap(), notes)
        };
        for (line, expected, note) in [
            ("smalto convert a b --memory 64", "smalto convert a b --host-memory=64MiB", "--host-memory 64MiB"),
            ("smalto lod a --memory=2GB -o b", "smalto lod a --host-memory=2GB -o b", "--host-memory 2GB"),
            ("smalto prune --psnr 50", "smalto prune --min-psnr=50", "--psnr 50 is now spelled --min-psnr 50"),
            ("smalto bench --path keyframes:a.json", "smalto bench --path=a.json", "--path a.json"),
            ("smalto info a --lod 1", "smalto info a --sog-level=1", "--sog-level 1"),
        ] {
            let (found, notes) = present(line);
            assert_eq!(found, expected);
            assert!(notes.len() == 1 && notes[0].contains(note), "{notes:?}");
        }
        for line in [
            "smalto render --memory 64",
            "smalto bench --path orbit",
            "smalto render --fps 5",
            "smalto convert -- --psnr",
        ] {
            assert_eq!(present(line), (line.to_owned(), Vec::new()));
        }
        assert_eq!(present("smalto prune --psnr").0, "smalto prune --min-psnr");
    }
}
