//! `--video`: a video of the pictures, made by ffmpeg, or the ffmpeg command that makes it of numbered pictures.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};

use super::Args;
use super::buffer_pool::Rgb8;
use super::outputs::{Layer, Outputs, Shot, frames_of};
use crate::cli::cameras::Fps;
use crate::cli::{Usage, remark, size_text};
use crate::files::{check_absent, check_writable, write_checked};
use crate::pixels::{self, VIDEO_KINDS, has_ffmpeg, is_video, video_padding};
use crate::rules::Background;

/// A video file to write.
pub(super) struct Video {
    pub file: PathBuf,
    /// Width and height of all frames.
    size: [u32; 2],
    fps: Fps,
}

/// A video on its way through ffmpeg, which takes the frames in their order.
pub(super) struct Encoder {
    video: pixels::Video,
    /// The number of the next frame.
    next: usize,
    /// Frames that are complete before those ahead of them.
    waiting: BTreeMap<usize, Rgb8>,
}

/// Parses the file of `--video`.
pub(super) fn parse_file(text: &str) -> Result<PathBuf> {
    let file = PathBuf::from(text);
    anyhow::ensure!(is_video(&file), "expected a name that ends in .{}", VIDEO_KINDS.join(", ."));
    Ok(file)
}

/// The file of `--video VIDEO` if ffmpeg can make it. Otherwise says that pictures are written instead.
pub(super) fn file(args: &Args) -> Result<Option<&Path>> {
    let Some(Some(file)) = &args.video else { return Ok(None) };
    let others = [
        ("output", args.output.is_some()),
        ("layers", args.layers != [Layer::Colour]),
        ("format", args.format.is_some()),
        ("certificate", args.certificate.is_some()),
        ("resume", args.resume),
        ("shard", args.shard.is_some()),
        ("verify", args.verify),
        ("reference", args.reference),
    ];
    if let Some((other, _)) = others.iter().find(|(_, is_given)| *is_given) {
        return Err(Usage(format!("--video VIDEO cannot be combined with --{other}")).into());
    }
    if args.no_clobber {
        check_absent(file)?;
    }
    check_writable(file)?;
    if has_ffmpeg() {
        return Ok(Some(file));
    }
    remark(&format!("note: there is no ffmpeg: pictures are written to {}", frames_of(file).display()));
    Ok(None)
}

impl Video {
    /// The video of `shots`, which must be of one size.
    pub fn new(args: &Args, file: &Path, shots: &[Shot], fps: Fps) -> Result<Self> {
        let size = check_frames(args, shots)?;
        Ok(Self { file: file.to_owned(), size, fps })
    }

    /// Writes the file, from the frames that `draw` hands to ffmpeg.
    pub fn write<T>(&self, draw: impl FnOnce(Encoder) -> Result<T>) -> Result<T> {
        let ending = self.file.extension().unwrap_or_default().to_string_lossy();
        // ffmpeg itself writes the temporary file.
        write_checked(&self.file, &format!(".{ending}"), |_| Ok(()), |part| draw(self.start(part)?))
    }

    /// Starts ffmpeg. It writes to `part`.
    fn start(&self, part: &Path) -> Result<Encoder> {
        let video = pixels::Video::start(part, self.size, &self.fps.to_string())?;
        Ok(Encoder { video, next: 0, waiting: BTreeMap::new() })
    }
}

impl Encoder {
    /// Takes frame `number`, of 8-bit red, green and blue.
    pub fn add(&mut self, number: usize, frame: Rgb8) -> Result<()> {
        self.waiting.insert(number, frame);
        while let Some(mut frame) = self.waiting.remove(&self.next) {
            self.video.add(frame.bytes())?;
            self.next += 1;
        }
        Ok(())
    }

    /// Waits until ffmpeg has written the file.
    pub fn finish(self) -> Result<()> {
        self.video.finish()
    }
}

/// The size of all frames. Fails if they are not of one size, or transparent.
fn check_frames(args: &Args, shots: &[Shot]) -> Result<[u32; 2]> {
    let refuse = |why: String| Err(Usage(format!("--video {why}")).into());
    if args.background == Background::Transparent {
        return refuse("cannot be transparent: --background must be a colour".to_owned());
    }
    let size = shots[0].camera.size_px;
    match shots.iter().find(|shot| shot.camera.size_px != size) {
        Some(other) => {
            let (size, other) = (size_text(size), size_text(other.camera.size_px));
            refuse(format!("needs pictures of one size, not {size} and {other}: set --size"))
        }
        None => Ok(size),
    }
}

/// The command that makes a video of `shots`. Fails if their files cannot be frames of a video.
pub(super) fn command(args: &Args, outputs: &Outputs, shots: &[Shot], fps: &Fps) -> Result<String> {
    if !outputs.has(Layer::Colour) || outputs.kind().holds_floats() {
        let why = "needs colours as PNG: --layers must include colour, and --format must be png or png16";
        return Err(Usage(format!("--video {why}")).into());
    }
    let size = check_frames(args, shots)?;
    let frames = outputs.layer_folder(Layer::Colour).context("the pictures of a video are not in a folder")?;
    let file = match &args.video {
        Some(Some(file)) => file.clone(),
        _ => video_file(outputs.folder().unwrap_or(&frames)),
    };
    line(&frames, &file, size, fps)
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
    words.extend(video_padding(size_px).iter().map(|word| (*word).to_owned()));
    words.extend(["-c:v", "libx264", "-pix_fmt", "yuv420p"].map(str::to_owned));
    words.push(plain(video)?);
    shlex::try_join(words.iter().map(String::as_str)).context("the name of the folder cannot be quoted for a shell")
}

/// The path in a form that ffmpeg does not take for an option or a URL.
fn plain(path: &Path) -> Result<String> {
    pixels::plain_for_ffmpeg(path).context("--video")
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
