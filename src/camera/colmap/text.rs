//! Reads `cameras.txt` and `images.txt`: numbers and names separated by spaces, comment lines that begin with `#`.

use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::str::FromStr;

use anyhow::{Context, Result, anyhow, ensure};

use super::models::{Intrinsics, Model};
use super::photograph::Photograph;
use crate::files::{describe, open_regular};

/// Reads all cameras, by their ids.
pub(super) fn cameras(path: &Path) -> Result<HashMap<u32, Intrinsics>> {
    let mut lines = Lines::open(path)?;
    let mut cameras = HashMap::new();
    while let Some(line) = lines.content()? {
        let (id, intrinsics) = camera(line).with_context(|| format!("line {}", lines.number))?;
        ensure!(cameras.insert(id, intrinsics).is_none(), "line {}: camera {id} is there twice", lines.number);
    }
    Ok(cameras)
}

/// `id model width height parameters...`
fn camera(line: &str) -> Result<(u32, Intrinsics)> {
    let mut words = line.split_ascii_whitespace();
    let id = number(words.next(), "an id")?;
    let model = Model::by_name(words.next().context("it has no camera model")?)?;
    let size_px = [number(words.next(), "a width")?, number(words.next(), "a height")?];
    // More than any model has; the model rejects the count.
    let parameters: Result<Vec<f64>> = words.take(100).map(|word| number(Some(word), "a parameter")).collect();
    Ok((id, model.intrinsics(size_px, &parameters?)?))
}

/// Reads the photographs in the order of the file, and the count that its comments state, if they do.
pub(super) fn images(path: &Path) -> Result<(Vec<Photograph>, Option<usize>)> {
    let mut lines = Lines::open(path)?;
    let mut images = Vec::new();
    while let Some(line) = lines.content()? {
        images.push(image(line).with_context(|| format!("line {}", lines.number))?);
        // The line of its points. It may be empty, and missing at the end of the file.
        if let Some(line) = lines.line()? {
            ensure!(are_points(line), "line {}: expected the points of an image (x y id each)", lines.number);
        }
    }
    Ok((images, lines.announced))
}

/// `id w x y z translation... camera name`
fn image(line: &str) -> Result<Photograph> {
    let mut rest = line;
    let mut word = || {
        let (word, after) = rest.split_once(|c: char| c.is_ascii_whitespace()).unwrap_or((rest, ""));
        rest = after.trim_ascii_start();
        Some(word).filter(|word| !word.is_empty())
    };
    let _id: u32 = number(word(), "an id")?;
    let mut numbers = [0.0; 7];
    for value in &mut numbers {
        *value = number(word(), "a number of a pose")?;
    }
    let [w, x, y, z, translation @ ..] = numbers;
    let camera = number(word(), "the id of a camera")?;
    ensure!(!rest.is_empty(), "it has no name");
    Ok(Photograph { name: rest.to_owned(), rotation: [w, x, y, z], translation, camera })
}

/// True if the line may be a list of points. If lists of points were left out, it is the next photograph instead.
fn are_points(line: &str) -> bool {
    let is_whole = line.split_ascii_whitespace().count().is_multiple_of(3);
    is_whole && line.split_ascii_whitespace().last().is_none_or(|id| id.parse::<i64>().is_ok())
}

fn number<T: FromStr>(word: Option<&str>, what: &str) -> Result<T> {
    let word = word.with_context(|| format!("the line ends where {what} is expected"))?;
    word.parse().map_err(|_| {
        let short: String = word.chars().take(40).collect();
        anyhow!("'{}' is not {what}", short.escape_debug())
    })
}

fn announced(comment: &str) -> Option<usize> {
    let (_, count) = comment.split_once("Number of images:")?;
    count.split(',').next()?.trim().parse().ok()
}

/// Lines of a file without the spaces around them.
struct Lines {
    reader: BufReader<File>,
    bytes: Vec<u8>,
    text: String,
    /// Number of the last line that was read, from 1 on.
    number: u64,
    /// The count in a comment like `# Number of images: 12, ...`.
    announced: Option<usize>,
}

impl Lines {
    fn open(path: &Path) -> Result<Self> {
        let reader = BufReader::with_capacity(1 << 16, open_regular(path)?);
        Ok(Self { reader, bytes: Vec::new(), text: String::new(), number: 0, announced: None })
    }

    fn line(&mut self) -> Result<Option<&str>> {
        self.bytes.clear();
        self.number += 1;
        let count =
            self.reader.read_until(b'\n', &mut self.bytes).map_err(|e| anyhow!("cannot be read: {}", describe(&e)))?;
        self.text = String::from_utf8_lossy(&self.bytes).into_owned();
        Ok((count > 0).then(|| self.text.trim_ascii()))
    }

    /// The next line that is neither empty nor a comment.
    fn content(&mut self) -> Result<Option<&str>> {
        loop {
            let has_content = match self.line()? {
                None => return Ok(None),
                Some(line) => !line.is_empty() && !line.starts_with('#'),
            };
            if has_content {
                return Ok(Some(self.text.trim_ascii()));
            }
            self.announced = self.announced.or_else(|| announced(&self.text));
        }
    }
}
