//! The file that a scene is written to: its format, checks before the work, and the write itself.

use std::path::Path;
use std::sync::atomic::Ordering;

use anyhow::{Result, ensure};

use crate::cli::sink::Sink;
use crate::cli::{REPORTS_TO_STDOUT, Usage, progress, remark};
use crate::files::{check_absent, check_binary_writable, is_stdout};
use crate::formats::{FORMATS, LOD_META, Loss, SceneFile, Writer, WrittenFile, in_folder, write_file};
use crate::measure::prune::Written;
use crate::scene::Gaussians;

/// The form of the file that is written.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::cli) enum Target {
    Scene(SceneFile),
    /// A page file.
    Pages,
}

/// The values of `--format`: name, help and target. A SOG in a folder is selected by its file name alone.
pub(in crate::cli) fn formats() -> impl Iterator<Item = (&'static str, &'static str, Target)> {
    let written = FORMATS.iter().filter_map(|format| Some((format.name, format.help, Target::from(format.write?))));
    written.filter(|(_, _, target)| *target != Target::Scene(SceneFile::SogFolder))
}

impl From<Writer> for Target {
    fn from(writer: Writer) -> Self {
        match writer {
            Writer::Scene(file) => Self::Scene(file),
            Writer::Pages => Self::Pages,
        }
    }
}

impl Target {
    /// The format of the output: by `--format` or its name, and `--spz-version`. Fails if these disagree.
    pub fn of(output: &Path, format: Option<Self>, spz_version: Option<u32>) -> Result<Self, Usage> {
        let mut target = Self::named(output, format)?;
        match (&mut target, spz_version) {
            (Self::Scene(SceneFile::Spz { version }), Some(wanted)) => *version = wanted,
            (_, Some(_)) => return Err(Usage("--spz-version needs an .spz file to write".to_owned())),
            (_, None) => {}
        }
        Ok(target)
    }

    fn named(output: &Path, format: Option<Self>) -> Result<Self, Usage> {
        match (Writer::of(output).map(Self::from), format) {
            (Ok(named), None) => Ok(named),
            (Ok(named), Some(format)) if named != format => {
                Err(Usage(format!("--format: {} has the name of another format", output.display())))
            }
            (_, Some(format)) => Ok(format),
            (Err(_), None) if output.extension().is_none() => {
                Err(Usage(format!("{}: its name does not say which format it has: add --format", output.display())))
            }
            (Err(problem), None) => Err(Usage(format!("{problem:#}"))),
        }
    }

    /// Fails before anything is read if the output is one of the inputs or cannot be written. If it is standard output,
    /// nothing else is printed there.
    pub fn check<'i>(
        self,
        output: &Path,
        inputs: impl IntoIterator<Item = &'i Path>,
        no_clobber: bool,
        json: Option<&Sink>,
    ) -> Result<()> {
        if let Some(input) = inputs.into_iter().find(|input| is_same(input, output)) {
            return Err(Usage(format!("{} is both an input and the output", input.display())).into());
        }
        if is_stdout(output) {
            if self == Self::Pages {
                let why = "a page file cannot go to standard output: it is not written in one piece";
                return Err(Usage(why.to_owned()).into());
            }
            let takes_stdout = json.is_some_and(|sink| sink.file().is_none_or(is_stdout));
            if takes_stdout {
                return Err(Usage("the scene and --json cannot both go to standard output".to_owned()).into());
            }
            REPORTS_TO_STDOUT.store(true, Ordering::Relaxed);
        }
        json.map_or(Ok(()), Sink::check)?;
        if no_clobber {
            check_absent(output)?;
        }
        match self {
            Self::Scene(SceneFile::SogFolder) => Ok(()),
            Self::Scene(_) | Self::Pages => Ok(check_binary_writable(output)?),
        }
    }
}

/// Writes Gaussians in a format, and prints a warning for properties that the format lacks.
pub(in crate::cli) fn write_scene(
    output: &Path,
    kind: SceneFile,
    gaussians: Gaussians,
    is_antialiased: bool,
) -> Result<Written> {
    if is_antialiased && !kind.says_antialiased() {
        remark(&format!(
            "warning: {}: the format cannot record that the scene was trained with antialiasing",
            output.display()
        ));
    }
    let sh_degree = kept_degree(output, kind, gaussians.sh_degree());
    let left_out = Loss::left_out(&gaussians, sh_degree);
    let arranged = kind.arranged(&gaussians)?;
    let transparent = gaussians.len() - arranged.len();
    ensure!(!arranged.is_empty(), "the format rounds the opacity of all {} Gaussians to 0", gaussians.len());
    drop(gaussians);
    if let Some([least, most]) = kind.log_scales() {
        // Half of the step of SPZ, and more than that of compressed PLY.
        let is_held = |scale: &f32| (least - 0.03..=most + 0.03).contains(&scale.ln());
        let clamped = arranged.scales().iter().filter(|scales| !scales.iter().all(is_held)).count();
        if clamped > 0 {
            remark(&format!(
                "note: {}: {clamped} of {} Gaussians have a scale outside of e^{least} to e^{most}, the range of the \
                 format, and are clamped",
                output.display(),
                arranged.len()
            ));
        }
    }
    let bar = progress::Bar::new("reading back");
    let written = write_file(output, kind, &arranged, is_antialiased, &|fraction| bar.set(fraction))?;
    let WrittenFile { format, bytes, mut loss } = written;
    loss.extend(left_out);
    let file = output.display().to_string();
    Ok(Written { file, format, bytes, gaussians: arranged.len(), sh_degree, transparent, loss })
}

/// The SH degree of a scene of this degree that a format keeps. Prints a warning if it is lower.
pub(super) fn kept_degree(output: &Path, kind: SceneFile, sh_degree: u32) -> u32 {
    let kept = sh_degree.min(kind.most_sh_degree());
    if kept < sh_degree {
        remark(&format!(
            "warning: {}: the format holds spherical harmonics up to degree {kept} only",
            output.display()
        ));
    }
    kept
}

/// True if the scene `input`, a file or a folder, is in the file `output`.
pub fn is_same(input: &Path, output: &Path) -> bool {
    let Ok(output) = output.canonicalize() else { return false };
    let scene = in_folder(input);
    let files = [scene.clone(), scene.join("meta.json"), scene.join(LOD_META)];
    files.iter().any(|file| file.canonicalize().is_ok_and(|f| f == output))
}
