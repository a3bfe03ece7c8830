//! The table of knobs, which command line, `trade`, panels and documents read.

use super::setting::{Setting, Value};
use super::{Options, Storage};
use crate::quantities;
use crate::rules::{ALPHA_MIN, Footprint, LISTED_ALPHA, Order, Response};

/// The values that a knob accepts.
#[derive(Clone, Copy, Debug)]
pub enum Kind {
    Number {
        /// Both ends are accepted.
        range: [f32; 2],
        /// The range of a slider.
        usual: [f32; 2],
        /// Small values are written as fractions, such as 1/255.
        is_fraction: bool,
    },
    /// Both ends are accepted.
    Count([u32; 2]),
    Name(fn() -> Vec<&'static str>),
    Flag,
}

/// The part of the options to which a knob belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Group {
    /// The rules of the picture: pictures by different rules differ in exact arithmetic, too.
    Rules,
    /// Accuracy, for speed or memory.
    Accuracy,
    /// The way in which the same picture is computed.
    Path,
}

/// The effect of a value on a scene, compared with the values before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effect {
    /// The frame is computed in the same way.
    None,
    /// The picture is the same; time or memory differ.
    Exact,
    /// The picture differs.
    Changed,
}

/// Properties of a scene on which the effect of a knob depends.
#[derive(Clone, Copy, Debug)]
pub struct Held {
    /// Highest degree of spherical harmonics in the scene.
    pub sh_degree: u32,
    /// The file held spherical harmonics as bytes, so 8 bits lose nothing.
    pub has_sh_bytes: bool,
    /// The file held scales and opacities as bytes, so 8 bits lose nothing.
    pub has_shape_bytes: bool,
}

/// A setting of [`Options`] that command line, panels and measurements know by name.
#[derive(Debug)]
pub struct Knob {
    /// Name on the command line, in panels and in reports.
    pub name: &'static str,
    /// Placeholder for a value in help texts.
    pub value_name: &'static str,
    /// One line, then after an empty line the rest, if there is more to say.
    pub help: &'static str,
    pub group: Group,
    pub kind: Kind,
    /// Values that `trade` tries, the most exact first.
    pub steps: &'static [Value],
    /// `trade` also combines the steps with those of other knobs. Otherwise it tries them alone.
    pub is_searched: bool,
    pub effect: fn(Value, &Held) -> Effect,
    pub get: fn(&Options) -> Value,
    /// Panics if the value is of another kind than `get` returns.
    pub set: fn(&mut Options, Value),
}

/// Every knob. A new one costs a field of [`Options`] and an entry here.
pub static KNOBS: [Knob; 18] = [
    Knob {
        name: "near",
        value_name: "DISTANCE",
        help: "Distance up to which nothing is drawn, in world units [default: 0.2]\n\nThe near plane. The default is \
               the preset's, mostly 0.2; less if a small scene without cameras needs it.",
        group: Group::Rules,
        kind: Kind::Number { range: [POSITIVE, f32::MAX], usual: [0.001, 10.0], is_fraction: false },
        steps: &[Value::Number(0.01)],
        is_searched: false,
        effect: |_, _| Effect::Changed,
        get: |options| options.rules.near.value(),
        set: |options, value| options.rules.near = Setting::of(value),
    },
    Knob {
        name: "response",
        value_name: "RULE",
        help: "Weight of a Gaussian at a pixel of a pinhole [default: screen]\n\nscreen (the value of its projection: \
               EWA splatting, as scenes are trained) or ray (the greatest value along the pixel's ray, in the order by \
               distance). Cameras with lenses are drawn along rays by both.",
        group: Group::Rules,
        kind: Kind::Name(|| names(&Response::NAMES)),
        steps: &[Value::Name("screen"), Value::Name("ray")],
        is_searched: false,
        effect: |_, _| Effect::Changed,
        get: |options| options.rules.response.value(),
        set: |options, value| options.rules.response = Setting::of(value),
    },
    Knob {
        name: "order",
        value_name: "KEY",
        help: "Sort key of splats [default: the preset's, mostly depth]\n\ndepth (view z), distance (from the camera) \
               or per-pixel (the depth at which the Gaussian is densest along the ray; only with --reference).",
        group: Group::Rules,
        kind: Kind::Name(|| names(&Order::NAMES)),
        steps: &[],
        is_searched: false,
        effect: |_, _| Effect::Changed,
        get: |options| options.rules.order.value(),
        set: |options, value| options.rules.order = Setting::of(value),
    },
    Knob {
        name: "extent",
        value_name: "RULE",
        help: "Footprint of a splat [default: the preset's, mostly exact]\n\nexact (until its alpha falls below \
               --alpha-min), three-sigma (the same, at most three standard deviations) or three-sigma-squares (all \
               tiles of the square of three standard deviations).",
        group: Group::Rules,
        kind: Kind::Name(|| names(&Footprint::NAMES)),
        steps: &[Value::Name("exact"), Value::Name("three-sigma"), Value::Name("three-sigma-squares")],
        is_searched: false,
        effect: |_, _| Effect::Changed,
        get: |options| options.rules.extent.value(),
        set: |options, value| options.rules.extent = Setting::of(value),
    },
    Knob {
        name: "alpha-min",
        value_name: "ALPHA",
        help: "Skip contributions below this alpha, at least 1e-12 [default: the preset's, 1/255 in exact]",
        group: Group::Rules,
        kind: Kind::Number { range: [LISTED_ALPHA, 1.0], usual: [1e-6, 1.0], is_fraction: true },
        steps: &[
            Value::Number(ALPHA_MIN),
            Value::Number(1.0 / 192.0),
            Value::Number(1.0 / 128.0),
            Value::Number(1.0 / 64.0),
        ],
        is_searched: true,
        effect: |_, _| Effect::Changed,
        get: |options| options.rules.alpha_min.value(),
        set: |options, value| options.rules.alpha_min = Setting::of(value),
    },
    Knob {
        name: "antialiased",
        value_name: "BOOL",
        help: "Antialiasing, true or false [default: as the scene was trained]\n\nThat of Mip-Splatting: the opacity \
               of a splat becomes lower as the low-pass filter widens it.",
        group: Group::Rules,
        kind: Kind::Flag,
        steps: &[Value::Flag(false), Value::Flag(true)],
        is_searched: false,
        effect: |_, _| Effect::Changed,
        get: |options| options.rules.antialiased.value(),
        set: |options, value| options.rules.antialiased = Setting::of(value),
    },
    Knob {
        name: "stop",
        value_name: "T",
        help: "Finish a pixel once its transmittance is below T, from 0 to 1\n\nNo colour changes by more than this \
               fraction of the brightest.",
        group: Group::Accuracy,
        kind: Kind::Number { range: [0.0, 1.0], usual: [0.0, 1.0], is_fraction: true },
        steps: &[
            Value::Number(0.0),
            Value::Number(1e-3),
            Value::Number(ALPHA_MIN),
            Value::Number(1e-2),
            Value::Number(1.0 / 32.0),
        ],
        is_searched: true,
        effect: |value, _| if value == Value::Number(0.0) { Effect::None } else { Effect::Changed },
        get: |options| options.stop.value(),
        set: |options, value| options.stop = Setting::of(value),
    },
    Knob {
        name: "key-bits",
        value_name: "8..32",
        help: "Sort by this many of the most significant bits of the depth\n\nFewer if the scene needs fewer.",
        group: Group::Accuracy,
        kind: Kind::Count([8, 32]),
        steps: &[Value::Count(32), Value::Count(24), Value::Count(16)],
        is_searched: true,
        effect: |value, _| if value == Value::Count(32) { Effect::None } else { Effect::Changed },
        get: |options| options.key_bits.value(),
        set: |options, value| options.key_bits = Setting::of(value),
    },
    Knob {
        name: "sh-degree",
        value_name: "0..4",
        help: "Leave out spherical harmonics above this degree",
        group: Group::Accuracy,
        kind: Kind::Count([0, 4]),
        steps: &[Value::Count(4), Value::Count(3), Value::Count(2), Value::Count(1), Value::Count(0)],
        is_searched: true,
        effect: |value, held| match value {
            Value::Count(degree) if degree < held.sh_degree => Effect::Changed,
            _ => Effect::None,
        },
        get: |options| options.sh_degree.value(),
        set: |options, value| options.sh_degree = Setting::of(value),
    },
    Knob {
        name: "sh-storage",
        value_name: "FORMAT",
        help: "Number format of spherical harmonics in GPU memory\n\nlossless takes the fewest bits that keep all \
               values of the file.",
        group: Group::Accuracy,
        kind: Kind::Name(|| names(&Storage::NAMES)),
        steps: STORAGES,
        is_searched: true,
        effect: |value, held| storage_effect(value, held.has_sh_bytes),
        get: |options| options.sh_storage.value(),
        set: |options, value| options.sh_storage = Setting::of(value),
    },
    Knob {
        name: "shape-storage",
        value_name: "FORMAT",
        help: "Number format of rotations, scales and opacities in GPU memory",
        group: Group::Accuracy,
        kind: Kind::Name(|| names(&Storage::NAMES)),
        steps: STORAGES,
        is_searched: true,
        effect: |value, held| storage_effect(value, held.has_shape_bytes),
        get: |options| options.shape_storage.value(),
        set: |options, value| options.shape_storage = Setting::of(value),
    },
    Knob {
        name: "scale",
        value_name: "0..1",
        help: "Draw at this fraction of the width and height, then enlarge",
        group: Group::Accuracy,
        kind: Kind::Number { range: [POSITIVE, 1.0], usual: [0.05, 1.0], is_fraction: false },
        steps: &[Value::Number(1.0), Value::Number(0.75), Value::Number(0.5)],
        is_searched: true,
        effect: |value, _| if value == Value::Number(1.0) { Effect::None } else { Effect::Changed },
        get: |options| options.scale.value(),
        set: |options, value| options.scale = Setting::of(value),
    },
    Knob {
        name: "lod-error",
        value_name: "ERROR",
        help: "Error that one merged node may make: 100 is coarse, 1 is fine\n\nThe sum over its pixels of the change \
               in 8-bit steps. For page files with levels, a lod-meta.json or a .rad with a tree [default: 0, \
               everything is drawn].",
        group: Group::Accuracy,
        kind: Kind::Number { range: [0.0, 1e6], usual: [0.0, 64.0], is_fraction: false },
        steps: &[Value::Number(0.0)],
        is_searched: false,
        effect: |value, _| if value == Value::Number(0.0) { Effect::None } else { Effect::Changed },
        get: |options| options.lod_error.value(),
        set: |options, value| options.lod_error = Setting::of(value),
    },
    Knob {
        name: "lod-psnr",
        value_name: "DB",
        help: "Draw the fewest Gaussians that keep a PSNR of DB\n\nThe PSNR to the picture of all Gaussians is \
               estimated from 64 or more patches of 64x64 pixels, and kept with one standard error to spare. `view` \
               keeps it at rest. In place of --lod-error, for page files with levels, a lod-meta.json or a .rad \
               with a tree [default: 0, no limit].",
        group: Group::Accuracy,
        kind: Kind::Number { range: [0.0, 100.0], usual: [0.0, 60.0], is_fraction: false },
        steps: &[Value::Number(0.0)],
        is_searched: false,
        effect: |value, _| if value == Value::Number(0.0) { Effect::None } else { Effect::Changed },
        get: |options| options.lod_psnr.value(),
        set: |options, value| options.lod_psnr = Setting::of(value),
    },
    Knob {
        name: "splats",
        value_name: "COUNT",
        help: "Draw about COUNT Gaussians at most, like 60K or 3M\n\nThe Gaussians whose merging changes the picture \
               least are merged first. For page files with levels, a lod-meta.json or a .rad with a tree \
               [default: 0, no limit].",
        group: Group::Accuracy,
        kind: Kind::Count([0, u32::MAX]),
        steps: &[Value::Count(0)],
        is_searched: false,
        effect: |value, _| if value == Value::Count(0) { Effect::None } else { Effect::Changed },
        get: |options| options.splats.value(),
        set: |options, value| options.splats = Setting::of(value),
    },
    Knob {
        name: "lod-fade",
        value_name: "OCTAVES",
        help: "Fade nodes in over this range of errors, so that nothing pops\n\nA node whose error exceeds the limit \
               by less than this many powers of two is drawn in part [default: 0, no fade; of view: 0.5].",
        group: Group::Accuracy,
        kind: Kind::Number { range: [0.0, 4.0], usual: [0.0, 1.0], is_fraction: false },
        steps: &[Value::Number(0.0)],
        is_searched: false,
        effect: |value, _| if value == Value::Number(0.0) { Effect::None } else { Effect::Changed },
        get: |options| options.lod_fade.value(),
        set: |options, value| options.lod_fade = Setting::of(value),
    },
    Knob {
        name: "lod-occlusion",
        value_name: "OCTAVES",
        help: "Draw what is hidden coarser, by this many powers of two\n\nThe error limits of groups of nodes behind \
               what is seen are higher. `view` and `serve` know what is hidden from the last frame. `render` and \
               `bench` draw each view twice, and as a whole on one device. On the fast path [default: 0; of view: 2].",
        group: Group::Accuracy,
        kind: Kind::Number { range: [0.0, 16.0], usual: [0.0, 8.0], is_fraction: false },
        steps: &[Value::Number(0.0)],
        is_searched: false,
        effect: |value, _| if value == Value::Number(0.0) { Effect::None } else { Effect::Changed },
        get: |options| options.lod_occlusion.value(),
        set: |options, value| options.lod_occlusion = Setting::of(value),
    },
    Knob {
        name: "portable",
        value_name: "BOOL",
        help: "Use only what works on every device: the portable path",
        group: Group::Path,
        kind: Kind::Flag,
        steps: &[Value::Flag(false), Value::Flag(true)],
        is_searched: false,
        effect: |_, _| Effect::Exact,
        get: |options| options.portable.value(),
        set: |options, value| options.portable = Setting::of(value),
    },
];

/// The least number above 0.
const POSITIVE: f32 = 0.0_f32.next_up();

const STORAGES: &[Value] = &[Value::Name("lossless"), Value::Name("f32"), Value::Name("f16"), Value::Name("u8")];

/// 32-bit floats lose nothing. Where the file held bytes, all other formats keep these bytes.
fn storage_effect(value: Value, has_bytes: bool) -> Effect {
    match value {
        Value::Name("f32") => Effect::Exact,
        Value::Name("f16" | "u8") if !has_bytes => Effect::Changed,
        _ => Effect::None,
    }
}

impl Knob {
    /// True if it changes only pictures of files with levels of detail.
    pub fn is_of_levels(&self) -> bool {
        self.name.starts_with("lod-") || self.name == "splats"
    }

    /// The knob with this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        KNOBS.iter().find(|knob| knob.name == name)
    }

    /// Reads a value as it is written on the command line.
    ///
    /// # Errors
    /// Describes the expected values if `text` is none of them.
    pub fn parse(&self, text: &str) -> Result<Value, String> {
        match self.kind {
            Kind::Number { range: [low, high], .. } => match text.parse::<f32>() {
                Ok(number) if (low..=high).contains(&number) => Ok(Value::Number(number)),
                _ => Err(match (low == POSITIVE, high < f32::MAX) {
                    (true, false) => "expected a number above 0".to_owned(),
                    (true, true) => format!("expected a number above 0, at most {high}"),
                    (false, _) => format!("expected a number from {low} to {high}"),
                }),
            },
            Kind::Count([low, high]) => {
                let count = quantities::count(text).and_then(|count| u32::try_from(count).ok());
                let count = count.filter(|count| (low..=high).contains(count)).map(Value::Count);
                let example = if high >= 1000 { ", like 500 or 60K" } else { "" };
                count.ok_or_else(|| format!("expected a whole number from {low} to {high}{example}"))
            }
            Kind::Name(names) => match names().into_iter().find(|name| *name == text) {
                Some(name) => Ok(Value::Name(name)),
                None => Err(format!("expected {}", names().join(", "))),
            },
            Kind::Flag => text.parse().map(Value::Flag).map_err(|_| "expected true or false".to_owned()),
        }
    }

    /// The options with this knob turned to `value`.
    pub fn turned(&self, options: &Options, value: Value) -> Options {
        let mut turned = *options;
        (self.set)(&mut turned, value);
        turned
    }

    /// The knob and a value as reports name them: "stop 1/255".
    pub fn title(&self, value: Value) -> String {
        let value = match (value, self.kind) {
            (Value::Number(number), Kind::Number { is_fraction: true, .. }) => fraction(number),
            (value, _) => value.to_string(),
        };
        format!("{} {value}", self.name)
    }
}

/// 1/255 or 0.001, whichever is shorter to read.
fn fraction(value: f32) -> String {
    let inverse = 1.0 / f64::from(value);
    if inverse < 1000.0 && (inverse - inverse.round()).abs() < 1e-3 && inverse.round() != 100.0 {
        return format!("1/{}", inverse.round());
    }
    value.to_string()
}

fn names<T>(table: &[(&'static str, T)]) -> Vec<&'static str> {
    table.iter().map(|(name, _)| *name).collect()
}
