//! Damage: changed bytes, changed bytes inside of gzip and zip files, and changed values of JSON.

use std::io::{Cursor, Read, Write};

use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde_json::{Value, json};
use smalto::pagefile::PAGE;
use twox_hash::XxHash3_64;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

use crate::common::Random;

/// How a file is damaged.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    Bytes,
    /// Bytes of the content of a gzip file, which gets a valid checksum.
    InsideGzip,
    /// Bytes, or values of JSON, of a file in a zip archive, which gets a valid checksum.
    InsideZip,
    /// Bytes of a page file of 32-bit floats, which gets valid checksums.
    InsidePages,
    /// Values of a JSON document; in a `.glb` those of its JSON chunk.
    Json,
}

impl Change {
    pub fn of(self, whole: &[u8], random: &mut Random) -> Vec<u8> {
        match self {
            Self::Bytes => bytes(whole, random),
            Self::InsideGzip => {
                let mut plain = Vec::new();
                GzDecoder::new(whole).read_to_end(&mut plain).unwrap();
                let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
                gzip.write_all(&bytes(&plain, random)).unwrap();
                gzip.finish().unwrap()
            }
            Self::InsideZip => inside_zip(whole, random),
            Self::InsidePages => inside_pages(whole, random),
            Self::Json if whole.starts_with(b"glTF") => inside_glb(whole, random),
            Self::Json => json_values(whole, random),
        }
    }
}

/// Replaces up to 20 bytes in the second half of a file, where most formats hold numbers of Gaussians: a file that can
/// often still be read.
pub fn numbers(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let (mut bytes, half) = (whole.to_vec(), whole.len() / 2);
    for _ in 0..1 + random.below(20) {
        bytes[half + random.below((whole.len() - half) as u32) as usize] = random.below(256) as u8;
    }
    bytes
}

/// Changes, cuts, doubles bytes or writes extreme numbers, mostly near the beginning, where headers are.
fn bytes(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut bytes = whole.to_vec();
    for _ in 0..1 + random.below(6) {
        let reach = if random.below(2) == 0 { 256 } else { bytes.len() as u32 };
        let at = random.below(reach.min(bytes.len() as u32).max(1)) as usize;
        if bytes.is_empty() {
            break;
        }
        match random.below(8) {
            0 => bytes.truncate(at),
            1 => {
                let end = (at + 1 + random.below(64) as usize).min(bytes.len());
                let part = bytes[at..end].to_vec();
                bytes.splice(at..at, part);
            }
            2 => {
                let numbers = [0, 1, 0x7f, 0xff, 0x7fff, 0xffff, 0x7fff_ffff, u32::MAX, 1 << 30];
                let number = numbers[random.below(numbers.len() as u32) as usize].to_le_bytes();
                bytes[at..].iter_mut().zip(number).for_each(|(byte, value)| *byte = value);
            }
            3 => {
                let digits = b"9999999999";
                let length = 1 + random.below(9) as usize;
                bytes.splice(at..at, digits[..length].iter().copied());
            }
            4 => bytes[at] ^= 1 << random.below(8),
            _ => bytes[at] = random.below(256) as u8,
        }
    }
    bytes
}

/// Changes the header, the table or the pages, and mends the checksums.
fn inside_pages(whole: &[u8], random: &mut Random) -> Vec<u8> {
    const HEADER: usize = 4096;
    const ENTRY: usize = 48;
    let mut bytes = whole.to_vec();
    let long = |bytes: &[u8], at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap()) as usize;
    let streams = [24, 32].map(|at| long(whole, at));
    let sizes = [13, 48].map(|words| 4 * words * PAGE);
    let pages = (whole.len() - streams[1]) / sizes[1];
    let table = HEADER..HEADER + pages * ENTRY;
    for _ in 0..1 + random.below(4) {
        let place = match random.below(4) {
            0 => 8 + random.below(1500) as usize,
            1 => table.start + random.below(table.len() as u32) as usize,
            _ => streams[0] + random.below((whole.len() - streams[0]) as u32) as usize,
        };
        let values = [0, 0x7f, 0x80, 0xff, random.below(256) as u8];
        bytes[place] = values[random.below(values.len() as u32) as usize];
    }
    for page in 0..pages {
        for stream in 0..2 {
            let start = streams[stream] + page * sizes[stream];
            let checksum = XxHash3_64::oneshot(&bytes[start..start + sizes[stream]]);
            bytes[table.start + page * ENTRY + 32 + 8 * stream..][..8].copy_from_slice(&checksum.to_le_bytes());
        }
    }
    let checksum = XxHash3_64::oneshot(&bytes[table]);
    bytes[40..48].copy_from_slice(&checksum.to_le_bytes());
    let checksum = XxHash3_64::oneshot(&bytes[..HEADER - 8]);
    bytes[HEADER - 8..HEADER].copy_from_slice(&checksum.to_le_bytes());
    bytes
}

fn inside_zip(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut archive = ZipArchive::new(Cursor::new(whole)).unwrap();
    let damaged = random.below(archive.len() as u32) as usize;
    let mut out = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for index in 0..archive.len() {
        let mut file = archive.by_index(index).unwrap();
        let (name, mut content) = (file.name().unwrap().into_owned(), Vec::new());
        file.read_to_end(&mut content).unwrap();
        if index == damaged {
            let is_json = name.ends_with(".json") && random.below(4) > 0;
            content = if is_json { json_values(&content, random) } else { bytes(&content, random) };
        }
        out.start_file(name, options).unwrap();
        out.write_all(&content).unwrap();
    }
    out.finish().unwrap().into_inner()
}

fn inside_glb(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let length = u32::from_le_bytes(whole[12..16].try_into().unwrap()) as usize;
    let mut text = json_values(&whole[20..20 + length], random);
    text.resize(text.len().next_multiple_of(4), b' ');
    let rest = &whole[20 + length..];
    let all = (20 + text.len() + rest.len()) as u32;
    let size = text.len() as u32;
    [&whole[..8], &all.to_le_bytes(), &size.to_le_bytes(), &whole[16..20], &text, rest].concat()
}

/// Changes one to three values anywhere in the document.
fn json_values(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut document: Value = serde_json::from_slice(whole).unwrap();
    for _ in 0..1 + random.below(3) {
        let mut paths = Vec::new();
        pointers(&document, String::new(), &mut paths);
        let path = &paths[random.below(paths.len() as u32) as usize];
        let other = document.pointer(&paths[random.below(paths.len() as u32) as usize]).cloned();
        let value = document.pointer_mut(path).unwrap();
        *value = strange(value, other, random);
    }
    document.to_string().into_bytes()
}

fn pointers(value: &Value, at: String, all: &mut Vec<String>) {
    match value {
        Value::Object(members) => members.iter().for_each(|(name, value)| {
            pointers(value, format!("{at}/{}", name.replace('~', "~0").replace('/', "~1")), all);
        }),
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, value)| pointers(value, format!("{at}/{i}"), all))
        }
        _ => {}
    }
    all.push(at);
}

/// A value that a careless or hostile writer could have put there.
fn strange(value: &Value, other: Option<Value>, random: &mut Random) -> Value {
    let numbers = [0.0, -1.0, 0.5, 1e-300, 1e18, 1e38, 1e39, 1e308, -1e308, 255.0, 65536.0, 4_294_967_295.0];
    match random.below(10) {
        0 => Value::Null,
        1 => json!(u64::MAX),
        2 => json!(i64::MIN),
        3 => json!([]),
        4 => json!({}),
        5 => ["", "../a", "/", "a\nb", "\u{0}", "data:;base64,AAAA"][random.below(6) as usize].into(),
        6 => "\u{7}é".repeat(3000).into(),
        7 => other.unwrap_or(Value::Bool(true)),
        8 => match value.as_f64() {
            Some(number) => json!(number * random.between(-2.0, 4.0)),
            None => Value::Bool(false),
        },
        _ => json!(numbers[random.below(numbers.len() as u32) as usize]),
    }
}
