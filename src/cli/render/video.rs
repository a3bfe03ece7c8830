//! `--video`: the command that makes a film of numbered pictures. It is printed, not run.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::outputs::{Layer, Outputs};
use super::{Args, Shot};
use crate::cli::cameras::DEFAULT_FPS;
use crate::cli::{Usage, size_text};
use crate::rules::Background;

/// Fails if the pictures of `shots` make no film; else the command that makes one.
pub(super) fn command(args: &Args, outputs: &Outputs, shots: &[Shot]) -> Result<String> {
    let refuse = |why: String| Err(Usage(format!("--video {why}")).into());
    if !outputs.has(Layer::Colour) || outputs.kind().holds_floats() {
        return refuse("is made of colours as PNG: --layers has to have them, and --format is png or png16".to_owned());
    }
    if args.background == Background::Transparent {
        return refuse("is not transparent: --background has to be a colour".to_owned());
    }
    let size = shots[0].camera.size_px;
    if let Some(other) = shots.iter().find(|shot| shot.camera.size_px != size) {
        let (size, other) = (size_text(size), size_text(other.camera.size_px));
        return refuse(format!("needs pictures of one size, not {size} and {other}: --size makes them so"));
    }
    let frames = outputs.layer_folder(Layer::Colour).context("the pictures of a film lie in a folder")?;
    line(&frames, &film(outputs.folder().unwrap_or(&frames)), size, args.film.fps().unwrap_or(DEFAULT_FPS))
}

/// The film of a folder lies beside it.
fn film(folder: &Path) -> PathBuf {
    match folder.file_name() {
        Some(name) => {
            let mut name = name.to_owned();
            name.push(".mp4");
            folder.with_file_name(name)
        }
        None => PathBuf::from("video.mp4"),
    }
}

/// The command in words that a shell leaves as they are.
fn line(frames: &Path, film: &Path, size_px: [u32; 2], fps: f64) -> Result<String> {
    // ffmpeg reads % in a folder's name as the start of a number.
    let folder = plain(frames)?.replace('%', "%%");
    let mut words = vec!["ffmpeg".to_owned(), "-framerate".to_owned(), fps.to_string()];
    words.extend(["-i".to_owned(), format!("{}/%05d.png", folder.trim_end_matches('/'))]);
    if size_px.iter().any(|side| side % 2 == 1) {
        // Colours are kept for two by two pixels.
        words.extend(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"].map(str::to_owned));
    }
    words.extend(["-c:v", "libx264", "-pix_fmt", "yuv420p"].map(str::to_owned));
    words.push(plain(film)?);
    shlex::try_join(words.iter().map(String::as_str)).context("the folder's name cannot be written for a shell")
}

/// A path that ffmpeg takes for nothing but a path: not for an option, not for an address.
fn plain(path: &Path) -> Result<String> {
    let text = path.to_str().with_context(|| format!("--video: {} is not UTF-8", path.display()))?;
    let is_plain = path.is_absolute() || !(text.starts_with('-') || text.contains(':'));
    Ok(if is_plain { text.to_owned() } else { format!("./{text}") })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line_for(folder: &str, size_px: [u32; 2], fps: f64) -> String {
        let folder = Path::new(folder);
        line(folder, &film(folder), size_px, fps).unwrap()
    }

    #[test]
    fn a_film_is_one_command() {
        assert_eq!(
            line_for("renders", [64, 48], 30.0),
            "ffmpeg -framerate 30 -i 'renders/%05d.png' -c:v libx264 -pix_fmt yuv420p renders.mp4"
        );
        assert_eq!(
            line_for("out/", [63, 48], 29.97),
            "ffmpeg -framerate 29.97 -i 'out/%05d.png' -vf 'pad=ceil(iw/2)*2:ceil(ih/2)*2' -c:v libx264 \
             -pix_fmt yuv420p out.mp4"
        );
    }

    #[test]
    fn paths_are_quoted_and_stay_paths() {
        let words = |folder: &str| shlex::split(&line_for(folder, [2, 2], 30.0)).unwrap();
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
