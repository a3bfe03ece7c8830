//! `--video`: the ffmpeg command that makes a video of numbered pictures. It is printed, not run.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::Args;
use super::outputs::{Layer, Outputs, Shot};
use crate::cli::cameras::Fps;
use crate::cli::{Usage, size_text};
use crate::rules::Background;

/// The command that makes a video of `shots`. Fails if their files cannot be frames of a video.
pub(super) fn command(args: &Args, outputs: &Outputs, shots: &[Shot]) -> Result<String> {
    let refuse = |why: String| Err(Usage(format!("--video {why}")).into());
    if !outputs.has(Layer::Colour) || outputs.kind().holds_floats() {
        return refuse(
            "needs colours as PNG: --layers must include colour, and --format must be png or png16".to_owned(),
        );
    }
    if args.background == Background::Transparent {
        return refuse("cannot be transparent: --background must be a colour".to_owned());
    }
    let size = shots[0].camera.size_px;
    if let Some(other) = shots.iter().find(|shot| shot.camera.size_px != size) {
        let (size, other) = (size_text(size), size_text(other.camera.size_px));
        return refuse(format!("needs pictures of one size, not {size} and {other}: set --size"));
    }
    let frames = outputs.layer_folder(Layer::Colour).context("the pictures of a video are not in a folder")?;
    line(&frames, &video_file(outputs.folder().unwrap_or(&frames)), size, &args.film.fps())
}

/// The video file, next to the folder of its pictures.
fn video_file(folder: &Path) -> PathBuf {
    match folder.file_name() {
        Some(name) => {
            let mut name = name.to_owned();
            name.push(".mp4");
            folder.with_file_name(name)
        }
        None => PathBuf::from("video.mp4"),
    }
}

/// The command, quoted for a shell.
fn line(frames: &Path, video: &Path, size_px: [u32; 2], fps: &Fps) -> Result<String> {
    // ffmpeg takes % in a path for the start of a number format.
    let folder = plain(frames)?.replace('%', "%%");
    let mut words = vec!["ffmpeg".to_owned(), "-framerate".to_owned(), fps.to_string()];
    words.extend(["-i".to_owned(), format!("{}/%05d.png", folder.trim_end_matches('/'))]);
    if size_px.iter().any(|side| side % 2 == 1) {
        // yuv420p stores colour for blocks of 2x2 pixels.
        words.extend(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"].map(str::to_owned));
    }
    words.extend(["-c:v", "libx264", "-pix_fmt", "yuv420p"].map(str::to_owned));
    words.push(plain(video)?);
    shlex::try_join(words.iter().map(String::as_str)).context("the name of the folder cannot be quoted for a shell")
}

/// The path in a form that ffmpeg does not take for an option or a URL.
fn plain(path: &Path) -> Result<String> {
    let text = path.to_str().with_context(|| format!("--video: {} is not UTF-8", path.display()))?;
    let is_plain = path.is_absolute() || !(text.starts_with('-') || text.contains(':'));
    Ok(if is_plain { text.to_owned() } else { format!("./{text}") })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line_for(folder: &str, size_px: [u32; 2], fps: &str) -> String {
        let folder = Path::new(folder);
        line(folder, &video_file(folder), size_px, &fps.parse().unwrap()).unwrap()
    }

    #[test]
    fn a_video_is_one_command() {
        assert_eq!(
            line_for("renders", [64, 48], "30"),
            "ffmpeg -framerate 30 -i 'renders/%05d.png' -c:v libx264 -pix_fmt yuv420p renders.mp4"
        );
        assert_eq!(
            line_for("out/", [63, 48], "30000/1001"),
            "ffmpeg -framerate 30000/1001 -i 'out/%05d.png' -vf 'pad=ceil(iw/2)*2:ceil(ih/2)*2' -c:v libx264 \
             -pix_fmt yuv420p out.mp4"
        );
    }

    #[test]
    fn paths_are_quoted_and_stay_paths() {
        let words = |folder: &str| shlex::split(&line_for(folder, [2, 2], "30")).unwrap();
        let names = |folder: &str| [words(folder)[4].clone(), words(folder)[9].clone()];
        assert_eq!(names("my views/it's"), ["my views/it's/%05d.png", "my views/it's.mp4"]);
        assert_eq!(names("100%"), ["100%%/%05d.png", "100%.mp4"]);
        assert_eq!(names("-a"), ["./-a/%05d.png", "./-a.mp4"]);
        assert_eq!(names("a:b"), ["./a:b/%05d.png", "./a:b.mp4"]);
        assert_eq!(names("/a:b"), ["/a:b/%05d.png", "/a:b.mp4"]);
        assert_eq!(names(".."), ["../%05d.png", "video.mp4"]);
        assert_eq!(names("/"), ["/%05d.png", "video.mp4"]);
    }
}
