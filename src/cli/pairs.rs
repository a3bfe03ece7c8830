//! Every pair of options of every command has an effect together or is refused. A new option fails this test until it
//! is listed here.

use clap::{Arg, Command};

use super::arguments::{command, parse};

/// The options of a command, and pairs that are refused: options, and those that have no effect together with them. All
/// other pairs have an effect together.
struct Pairs {
    command: &'static str,
    /// Arguments that the command cannot do without.
    needed: &'static [&'static str],
    options: &'static [&'static str],
    refused: &'static [(&'static str, &'static str)],
}

const DEVICE: &str = "device memory";
const READING: &str = "up flip sog-level";
const RULES: &str = "near order extent alpha-min antialiased";
const ACCURACY: &str = "stop key-bits sh-degree sh-storage shape-storage scale";
const LEVELS: &str = "lod-error lod-psnr lod-fade lod-occlusion splats";
const BUDGET: &str = "max-error min-psnr";
const PLACE: &str = "eye target camera-up fov";
const LENS: &str = "lens undistort response";

const COMMANDS: [Pairs; 11] = [
    Pairs {
        command: "render",
        needed: &[],
        options: &[
            READING,
            DEVICE,
            RULES,
            ACCURACY,
            LEVELS,
            BUDGET,
            "output format compression layers names size cameras split camera path fps video resume background preset",
            "portable share",
            "reference timings certificate certify-rays dump json no-clobber orbit shard verify place measure-levels",
            PLACE,
            LENS,
        ],
        refused: &[
            ("reference", "device share portable timings dump certificate certify-rays max-error min-psnr"),
            ("reference", "stop key-bits sh-storage shape-storage scale"),
            ("reference", LEVELS),
            ("lod-psnr", "lod-error"),
            (BUDGET, LEVELS),
            ("measure-levels", "reference certificate certify-rays dump verify max-error min-psnr"),
            ("place", "reference portable certificate certify-rays max-error min-psnr"),
            ("max-error", "min-psnr"),
            ("undistort", "lens"),
            ("undistort", PLACE),
            (BUDGET, "preset"),
            (BUDGET, ACCURACY),
            ("path", "cameras camera split dump"),
            ("video", "names dump"),
            ("fps", "dump"),
            (PLACE, "cameras camera split path orbit"),
            ("orbit", "path cameras camera split dump"),
            ("resume", "certificate certify-rays dump"),
            ("shard", "dump max-error min-psnr"),
            ("verify", "device share resume no-clobber certificate certify-rays dump timings max-error min-psnr"),
        ],
    },
    Pairs {
        command: "view",
        needed: &[],
        options: &[
            READING,
            DEVICE,
            RULES,
            ACCURACY,
            LEVELS,
            LENS,
            "cameras camera photographs place size background fullscreen vsync preset compare compare-by look keys",
            "events offscreen screen path target-fps no-panels follow control",
            PLACE,
        ],
        refused: &[
            ("undistort", "lens"),
            ("follow", "offscreen screen path"),
            ("control", "offscreen screen path"),
            ("offscreen", "fullscreen vsync"),
            ("screen", "fullscreen vsync"),
            ("lod-psnr", "lod-error"),
            ("path", "cameras camera fullscreen vsync"),
            (PLACE, "camera path"),
        ],
    },
    Pairs {
        command: "serve",
        needed: &["a.ply"],
        options: &[
            READING,
            DEVICE,
            RULES,
            ACCURACY,
            LEVELS,
            "port host token proxy folder clients cameras camera photographs follow background preset response",
        ],
        refused: &[("lod-psnr", "lod-error")],
    },
    Pairs { command: "info", needed: &[], options: &[READING, "preset json"], refused: &[] },
    Pairs {
        command: "convert",
        needed: &["a.ply", "b.spz"],
        options: &[
            READING,
            "sh-degree transform crop min-opacity spz-version storage host-memory json format no-clobber",
        ],
        refused: &[],
    },
    Pairs {
        command: "lod",
        needed: &["a.ply"],
        options: &[READING, "output level splats keep-levels fit-rounds device format storage host-memory json"],
        refused: &[("level", "splats"), ("keep-levels", "sog-level host-memory fit-rounds device")],
    },
    Pairs {
        command: "prune",
        needed: &["a.ply"],
        options: &[
            READING,
            DEVICE,
            RULES,
            "output format spz-version no-clobber max-error min-psnr cameras split camera size keep-unseen json",
        ],
        refused: &[("max-error", "min-psnr")],
    },
    Pairs {
        command: "bench",
        needed: &[],
        options: &[
            READING,
            DEVICE,
            RULES,
            ACCURACY,
            LEVELS,
            PLACE,
            LENS,
            "cameras split path size warmup frames preset check certificate",
            "json csv plot baseline threshold place measure-levels share",
        ],
        refused: &[
            ("cameras", "path"),
            (PLACE, "cameras split path"),
            ("place", "check certificate"),
            ("undistort", "lens"),
            ("undistort", PLACE),
            ("lod-psnr", "lod-error"),
        ],
    },
    Pairs {
        command: "compare",
        needed: &["a.png", "b.png"],
        options: &[
            "heatmap json ppd partial max-error min-psnr min-ssim max-flip",
            "max-alpha-error max-depth-error max-depth-outliers",
        ],
        refused: &[],
    },
    Pairs {
        command: "trade",
        needed: &[],
        options: &[
            READING,
            DEVICE,
            RULES,
            ACCURACY,
            LEVELS,
            BUDGET,
            LENS,
            "cameras split path parts size oracle-size views warmup frames json plot held-out",
        ],
        refused: &[
            ("cameras", "path"),
            ("undistort", "lens"),
            ("max-error", "min-psnr"),
            (BUDGET, ACCURACY),
            ("held-out", ACCURACY),
            ("held-out", LEVELS),
            (BUDGET, LEVELS),
            ("lod-psnr", "lod-error"),
        ],
    },
    Pairs { command: "doctor", needed: &[], options: &[DEVICE, "json pipelines"], refused: &[] },
];

/// A value that the option takes. Files have different names.
fn sample(arg: &Arg) -> String {
    let possible = arg.get_possible_values();
    if let Some(first) = possible.first() {
        return first.get_name().to_owned();
    }
    let placeholder = arg.get_value_names().and_then(|names| names.first()).map_or("", |name| name.as_str());
    match placeholder {
        "WxH" | "WxH,..." => "8x8",
        "COLOUR" | "X,Y,Z" => "0,0,1",
        "AXIS" => "z",
        "AXES" => "y",
        "STEP" => "scale=2",
        "MODEL[:K,...]" => "FISHEYE",
        "SHAPE" => "sphere=0,0,0,1",
        "3|4" => "3",
        "SIZE" => "64MB",
        "VIDEO" => "a.mp4",
        "K/N" => "1/2",
        "8..32" | "FRAMES" => "8",
        "PATH" => "orbit",
        "ADDRESS" => "127.0.0.1",
        "URL" => "https://hub.example/",
        name if name.contains("FILE") || name.contains("DIR") => return format!("{}.json", arg.get_id()),
        _ => "1",
    }
    .to_owned()
}

fn words(lists: &[&'static str]) -> Vec<&'static str> {
    lists.iter().flat_map(|list| list.split(' ')).collect()
}

impl Pairs {
    fn clap(&self) -> Command {
        let mut all = command();
        all.build();
        all.find_subcommand(self.command).expect("the command exists").clone()
    }

    /// The sentence that refuses these options, with their sample values.
    fn refusal(&self, options: &[&str]) -> Option<String> {
        let clap = self.clap();
        let mut line =
            [&["smalto", self.command], self.needed].concat().iter().map(|s| (*s).to_owned()).collect::<Vec<_>>();
        for option in options {
            let arg = clap.get_arguments().find(|arg| arg.get_long() == Some(option)).expect("the option exists");
            line.push(format!("--{option}"));
            line.extend(arg.get_action().takes_values().then(|| sample(arg)));
        }
        parse(line).err().map(|problem| problem.to_string())
    }

    /// The sentence that refuses these options even with every one that they may need.
    fn refusal_with_needs(&self, options: &[&str]) -> Option<String> {
        let refusal = self.refusal(options)?;
        if let Some((missing, _)) = refusal.strip_prefix("missing: --").and_then(|rest| rest.split_once(' ')) {
            return self.refusal_with_needs(&[options, &[missing]].concat());
        }
        let Some((_, others)) = refusal.split_once(" needs ") else { return Some(refusal) };
        let with = |other: &str| self.refusal_with_needs(&[options, &[other.trim_start_matches("--")]].concat());
        others.split(" or ").map(with).collect::<Option<Vec<_>>>().and_then(|all| all.into_iter().next())
    }
}

#[test]
fn every_option_is_listed() {
    let names: Vec<_> = COMMANDS.iter().map(|pairs| pairs.command).collect();
    let program = command();
    let with_options = program.get_subcommands().filter(|c| c.get_arguments().any(|arg| !arg.is_positional()));
    assert_eq!(with_options.map(Command::get_name).collect::<Vec<_>>(), names);
    for pairs in COMMANDS {
        let clap = pairs.clap();
        let mut found: Vec<_> = clap.get_arguments().filter_map(Arg::get_long).filter(|long| *long != "help").collect();
        let mut listed = words(pairs.options);
        found.sort_unstable();
        listed.sort_unstable();
        assert_eq!(found, listed, "{}", pairs.command);
    }
}

#[test]
fn every_pair_of_options_has_an_effect_or_is_refused_in_a_sentence() {
    let mut wrong = Vec::new();
    for pairs in COMMANDS {
        let options = words(pairs.options);
        let refused = |a: &str, b: &str| {
            let lists = |one: &str, other: &str| {
                let contains = |list: &&'static str, option| words(&[list]).contains(&option);
                pairs.refused.iter().any(|(options, others)| contains(options, one) && contains(others, other))
            };
            lists(a, b) || lists(b, a)
        };
        for (i, a) in options.iter().enumerate() {
            assert_eq!(pairs.refusal_with_needs(&[a]), None, "{} --{a}", pairs.command);
            for b in &options[i + 1..] {
                let refusal = pairs.refusal_with_needs(&[a, b]);
                if refusal.is_some() != refused(a, b) {
                    wrong.push(format!("{} --{a} --{b}: {refusal:?}", pairs.command));
                }
                let sentence = refusal.unwrap_or_default();
                assert!(sentence.lines().count() <= 1 && !sentence.contains("error:"), "{sentence}");
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
