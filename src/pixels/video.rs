//! Videos, made by the ffmpeg that is installed.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

use anyhow::{Context, Result, bail};

use crate::files::write_own;
use crate::threads;

/// The kinds of video files, by their endings.
pub const VIDEO_KINDS: [&str; 4] = ["mp4", "mkv", "mov", "webm"];

const FFMPEG: &str = "ffmpeg";

/// A video that ffmpeg writes of the frames that it is given.
pub struct Video {
    ffmpeg: Child,
    /// Reads what it says, so that it never waits for a reader.
    errors: Option<JoinHandle<String>>,
}

/// True if the ending of a file is that of a video.
pub fn is_video(file: &Path) -> bool {
    file.extension().is_some_and(|ending| VIDEO_KINDS.iter().any(|kind| ending.eq_ignore_ascii_case(kind)))
}

/// True if there is an ffmpeg.
pub fn has_ffmpeg() -> bool {
    let mut version = Command::new(FFMPEG);
    let found = version.arg("-version").stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).status();
    found.is_ok_and(|status| status.success())
}

/// Arguments of ffmpeg that make both sides even: yuv420p stores colour for blocks of 2x2 pixels.
pub fn video_padding(size: [u32; 2]) -> &'static [&'static str] {
    if size.iter().any(|side| side % 2 == 1) { &["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"] } else { &[] }
}

/// The path in a form that ffmpeg does not take for an option or a URL.
///
/// # Errors
/// If it is not UTF-8.
pub fn plain_for_ffmpeg(path: &Path) -> Result<String> {
    let text = path.to_str().with_context(|| format!("{} is not UTF-8", path.display()))?;
    let is_plain = path.is_absolute() || !(text.starts_with('-') || text.contains(':'));
    Ok(if is_plain { text.to_owned() } else { format!("./{text}") })
}

impl Video {
    /// Starts ffmpeg, which writes to `file`: an existing file, whose name may be removed while ffmpeg runs. `size` is
    /// the width and height of every frame in pixels, `rate` the frames a second, as a number or a fraction.
    ///
    /// # Errors
    /// If there is no ffmpeg, or `file` cannot be opened.
    pub fn start(file: &Path, size: [u32; 2], rate: &str) -> Result<Self> {
        let mut ffmpeg = Command::new(FFMPEG);
        ffmpeg.args(["-loglevel", "error", "-y", "-f", "rawvideo", "-pixel_format", "rgb24"]);
        ffmpeg.args(["-video_size", &format!("{}x{}", size[0], size[1]), "-framerate", rate, "-i", "-"]);
        ffmpeg.args(video_padding(size));
        // The codec that the kind of file takes.
        ffmpeg.args(["-pix_fmt", "yuv420p"]);
        if cfg!(unix) {
            // By its name, ffmpeg would make the file again after a signal has removed it.
            let ending = file.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
            ffmpeg.args(["-f", if ending == "mkv" { "matroska" } else { &ending }, "/dev/stdout"]);
            ffmpeg.stdout(write_own(file)?);
        } else {
            ffmpeg.arg(plain_for_ffmpeg(file)?).stdout(Stdio::null());
        }
        let started = ffmpeg.stdin(Stdio::piped()).stderr(Stdio::piped()).spawn();
        let mut video = Self { ffmpeg: started.context("cannot start ffmpeg")?, errors: None };
        if let Some(mut errors) = video.ffmpeg.stderr.take() {
            video.errors = Some(threads::spawn(move || {
                let mut said = Vec::new();
                _ = errors.read_to_end(&mut said);
                String::from_utf8_lossy(&said).into_owned()
            })?);
        }
        Ok(video)
    }

    /// Takes the next frame: 8-bit red, green and blue, row by row from the top.
    ///
    /// # Errors
    /// What ffmpeg says if it has failed.
    pub fn add(&mut self, frame: &[u8]) -> Result<()> {
        let pipe = self.ffmpeg.stdin.as_mut().context("ffmpeg has no input")?;
        match pipe.write_all(frame) {
            Ok(()) => Ok(()),
            Err(_) => bail!(self.failure()),
        }
    }

    /// Waits until ffmpeg has written the file.
    ///
    /// # Errors
    /// What ffmpeg says if it has failed.
    pub fn finish(mut self) -> Result<()> {
        drop(self.ffmpeg.stdin.take());
        let status = self.ffmpeg.wait().context("ffmpeg cannot be waited for")?;
        if status.success() { Ok(()) } else { bail!(self.failure()) }
    }

    /// What ffmpeg says of its failure.
    fn failure(&mut self) -> String {
        _ = self.ffmpeg.wait();
        let said = self.errors.take().and_then(|errors| errors.join().ok()).unwrap_or_default();
        let reason = said.lines().rfind(|line| !line.trim().is_empty()).unwrap_or("it ended early");
        format!("ffmpeg failed: {reason}")
    }
}

impl Drop for Video {
    fn drop(&mut self) {
        // It has ended, unless the caller failed.
        _ = self.ffmpeg.kill();
        _ = self.ffmpeg.wait();
    }
}
