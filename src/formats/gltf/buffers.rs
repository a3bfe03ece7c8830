//! The buffers of a glTF file: in the file, in data URIs, or in files beside it.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use percent_encoding::percent_decode_str;
use serde::Deserialize;

use crate::formats::input::Input;
use crate::formats::linked_file::inside;
use crate::scene::Watch;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    uri: Option<String>,
    byte_length: u64,
}

/// Loads the bytes of all buffers. `embedded` is the first buffer, if it is inside the file.
pub(crate) fn load(buffers: &[Buffer], path: &Path, mut embedded: Option<Vec<u8>>) -> Result<Vec<Vec<u8>>> {
    let mut all = Vec::new();
    for (index, buffer) in buffers.iter().enumerate() {
        let embedded = if index == 0 { embedded.take() } else { None };
        all.push(buffer.load(path, embedded).with_context(|| format!("buffer {index}"))?);
    }
    Ok(all)
}

impl Buffer {
    fn load(&self, path: &Path, embedded: Option<Vec<u8>>) -> Result<Vec<u8>> {
        let wanted = self.byte_length;
        let mut bytes = match &self.uri {
            None => embedded.context("it is not in the file")?,
            Some(uri) => match uri.strip_prefix("data:") {
                Some(data) => {
                    let (_, text) = data.split_once(";base64,").context("it is not base64")?;
                    STANDARD.decode(text).context("it is not base64")?
                }
                None => read_beside(path, uri, wanted)?,
            },
        };
        ensure!(wanted <= bytes.len() as u64, "its byteLength is {wanted}, but it has {} bytes", bytes.len());
        // A chunk of a .glb is padded.
        bytes.truncate(wanted as usize);
        Ok(bytes)
    }
}

/// Reads the first `bytes` bytes of a file that lies beside the glTF file or below it.
fn read_beside(path: &Path, uri: &str, bytes: u64) -> Result<Vec<u8>> {
    let name = percent_decode_str(uri).decode_utf8().with_context(|| format!("its URI '{uri}' is not UTF-8"))?;
    ensure!(!uri.contains(':'), "its URI '{uri}' is not the name of a file in the folder of the scene");
    let file = inside(path.parent().unwrap_or(Path::new("")), &name)?;
    let quiet = Watch::NONE;
    let read = || Input::open(&file, &quiet)?.bytes(bytes, "its byteLength");
    read().with_context(|| name.into_owned())
}
