//! Decoders of everything that smalto writes, made here from the specifications of the formats alone: in 32-bit floats,
//! as the readers of other software have them, and without their kindness to values out of range.

use std::io::{Cursor, Read};

use serde_json::Value;

/// One Gaussian as a file holds it, in the axes right, down, forward.
pub struct Decoded {
    pub mean: [f32; 3],
    pub scale: [f32; 3],
    /// w x y z, not normalized, but for `.splat`, whose readers normalize.
    pub rotation: [f32; 4],
    pub opacity: f32,
}

const SQRT_HALF: f32 = std::f32::consts::FRAC_1_SQRT_2;

fn word(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

fn float(bytes: &[u8], at: usize) -> f32 {
    f32::from_bits(word(bytes, at))
}

fn floats<const N: usize>(bytes: &[u8], at: usize) -> [f32; N] {
    std::array::from_fn(|i| float(bytes, at + 4 * i))
}

/// The component that is left out, as all these formats define it. It is not a number if the others are too long.
fn with_left_out(left_out: usize, others: [f32; 3]) -> [f32; 4] {
    let sum = others.iter().rev().fold(0.0, |sum, v| sum + v * v);
    let mut others = others.into_iter();
    std::array::from_fn(|i| if i == left_out { (1.0 - sum).sqrt() } else { others.next().unwrap() })
}

/// From the axes right, up, back: half a turn about x.
fn from_right_up_back([x, y, z]: [f32; 3], [qx, qy, qz, qw]: [f32; 4]) -> ([f32; 3], [f32; 4]) {
    ([x, -y, -z], [qw, qx, -qy, -qz])
}

/// Text up to the end of a PLY header, and the bytes after it.
fn split_ply(bytes: &[u8]) -> (String, &[u8]) {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    (String::from_utf8(bytes[..at].to_vec()).unwrap(), &bytes[at..])
}

fn element_count(header: &str, name: &str) -> usize {
    let line = header.lines().find_map(|line| line.strip_prefix(&format!("element {name} ")));
    line.unwrap().parse().unwrap()
}

pub fn ply(bytes: &[u8]) -> Vec<Decoded> {
    let (header, rows) = split_ply(bytes);
    let names: Vec<&str> = header.lines().filter_map(|line| line.strip_prefix("property float ")).collect();
    let at = |name: &str| 4 * names.iter().position(|n| *n == name).unwrap();
    let (x, opacity, scale, rotation) = (at("x"), at("opacity"), at("scale_0"), at("rot_0"));
    let rows = rows.chunks_exact(4 * names.len());
    assert_eq!(rows.len(), element_count(&header, "vertex"));
    let decoded = rows.map(|row| Decoded {
        mean: floats(row, x),
        scale: floats(row, scale).map(f32::exp),
        rotation: floats(row, rotation),
        opacity: 1.0 / (1.0 + (-float(row, opacity)).exp()),
    });
    decoded.collect()
}

pub fn compressed_ply(bytes: &[u8]) -> Vec<Decoded> {
    let (header, rows) = split_ply(bytes);
    let (chunks, vertices) = rows.split_at(72 * element_count(&header, "chunk"));
    let vertices = vertices[..16 * element_count(&header, "vertex")].chunks_exact(16).enumerate();
    let decoded = vertices.map(|(i, row)| {
        let chunk = &chunks[72 * (i / 256)..][..72];
        let between = |packed: u32, at: usize| -> [f32; 3] {
            let [low, high]: [[f32; 3]; 2] = [floats(chunk, at), floats(chunk, at + 12)];
            let parts = [(packed >> 21, 2047.0), (packed >> 11 & 1023, 1023.0), (packed & 2047, 2047.0)];
            std::array::from_fn(|axis| {
                let t = parts[axis].0 as f32 / parts[axis].1;
                low[axis] * (1.0 - t) + high[axis] * t
            })
        };
        let rotation = word(row, 4);
        let component = |shift: u32| ((rotation >> shift & 1023) as f32 / 1023.0 - 0.5) / (0.5 * 2_f32.sqrt());
        Decoded {
            mean: between(word(row, 0), 0),
            scale: between(word(row, 8), 24).map(f32::exp),
            rotation: with_left_out((rotation >> 30) as usize, [20, 10, 0].map(component)),
            opacity: f32::from(row[12]) / 255.0,
        }
    });
    decoded.collect()
}

pub fn splat(bytes: &[u8]) -> Vec<Decoded> {
    let decoded = bytes.chunks_exact(32).map(|row| {
        let q: [f32; 4] = std::array::from_fn(|i| (f32::from(row[28 + i]) - 128.0) / 128.0);
        let length = q.iter().map(|v| v * v).sum::<f32>().sqrt();
        Decoded {
            mean: floats(row, 0),
            scale: floats(row, 12),
            rotation: q.map(|v| v / length),
            opacity: f32::from(row[27]) / 255.0,
        }
    });
    decoded.collect()
}

/// Both versions that are written.
pub fn spz(bytes: &[u8]) -> Vec<Decoded> {
    let (mut header, mut planes) = (bytes[..32.min(bytes.len())].to_vec(), Vec::new());
    if bytes.starts_with(b"NGSP") {
        let mut at = word(bytes, 16) as usize;
        let mut stream = at + 16 * usize::from(bytes[15]);
        for _ in 0..bytes[15] {
            let size = word(bytes, at) as usize;
            planes.push(zstd::decode_all(&bytes[stream..stream + size]).unwrap());
            (at, stream) = (at + 16, stream + size);
        }
    } else {
        let mut all = Vec::new();
        flate2::read::GzDecoder::new(bytes).read_to_end(&mut all).unwrap();
        header = all.drain(..16).collect();
        for each in [9, 1, 3, 3, 4] {
            planes.push(all.drain(..each * word(&header, 8) as usize).collect());
        }
    }
    assert!([3, 4].contains(&word(&header, 4)));
    let step = 1.0 / (1 << header[13]) as f32;
    let decoded = (0..word(&header, 8) as usize).map(|i| {
        let row = |plane: usize, each: usize| &planes[plane][i * each..][..each];
        let axis = |b: &[u8]| (i32::from_le_bytes([0, b[0], b[1], b[2]]) >> 8) as f32 * step;
        let [x, y, z] = [0, 3, 6].map(|at| axis(&row(0, 9)[at..]));
        // The loop of the reference implementation, with its order of operations.
        let (mut packed, mut q, mut sum) = (word(row(4, 4), 0), [0.0_f32; 4], 0.0);
        let left_out = (packed >> 30) as usize;
        for k in (0..4).rev().filter(|k| *k != left_out) {
            let magnitude = SQRT_HALF * (packed & 511) as f32 / 511.0;
            q[k] = if packed >> 9 & 1 == 1 { -magnitude } else { magnitude };
            sum += q[k] * q[k];
            packed >>= 10;
        }
        q[left_out] = (1.0 - sum).sqrt();
        let (mean, rotation) = from_right_up_back([x, y, z], q);
        let scale = std::array::from_fn(|axis| (f32::from(row(3, 3)[axis]) / 16.0 - 10.0).exp());
        Decoded { mean, scale, rotation, opacity: f32::from(row(1, 1)[0]) / 255.0 }
    });
    decoded.collect()
}

pub fn glb(bytes: &[u8]) -> Vec<Decoded> {
    let text = word(bytes, 12) as usize;
    let document: Value = serde_json::from_slice(&bytes[20..20 + text]).unwrap();
    let binary = &bytes[28 + text..];
    let attributes = &document["meshes"][0]["primitives"][0]["attributes"];
    let number = |value: &Value| value.as_u64().unwrap_or(0) as usize;
    let accessor = |name: &str| &document["accessors"][number(&attributes[name])];
    let start = |name: &str| {
        let view = &document["bufferViews"][number(&accessor(name)["bufferView"])];
        number(&view["byteOffset"]) + number(&accessor(name)["byteOffset"])
    };
    let own = |name: &str| start(&format!("KHR_gaussian_splatting:{name}"));
    let (position, rotation, scale, opacity) = (start("POSITION"), own("ROTATION"), own("SCALE"), own("OPACITY"));
    let decoded = (0..number(&accessor("POSITION")["count"])).map(|i| {
        let (mean, rotation) = from_right_up_back(floats(binary, position + 12 * i), floats(binary, rotation + 16 * i));
        Decoded { mean, scale: floats(binary, scale + 12 * i), rotation, opacity: float(binary, opacity + 4 * i) }
    });
    decoded.collect()
}

pub fn sog(bytes: &[u8]) -> Vec<Decoded> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut file = |name: &str| {
        let mut content = Vec::new();
        archive.by_name(name).unwrap().read_to_end(&mut content).unwrap();
        content
    };
    let meta: Value = serde_json::from_slice(&file("meta.json")).unwrap();
    let mut texture = |kind: &str, index: usize| {
        let name = meta[kind]["files"][index].as_str().unwrap();
        let mut decoder = image_webp::WebPDecoder::new(Cursor::new(file(name))).unwrap();
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        let mut texels = vec![0; decoder.output_buffer_size().unwrap()];
        decoder.read_image(&mut texels).unwrap();
        move |i: usize| -> [u8; 4] {
            std::array::from_fn(|k| if k < channels { texels[channels * i + k] } else { 255 })
        }
    };
    let (low, high) = (texture("means", 0), texture("means", 1));
    let (scales, rotations, colours) = (texture("scales", 0), texture("quats", 0), texture("sh0", 0));
    let number = |value: &Value| value.as_f64().unwrap() as f32;
    let decoded = (0..meta["count"].as_u64().unwrap() as usize).map(|i| {
        let axis = |axis: usize| {
            let [min, max] = ["mins", "maxs"].map(|bound| number(&meta["means"][bound][axis]));
            let t = f32::from(u16::from_le_bytes([low(i)[axis], high(i)[axis]])) / 65535.0;
            let v = min + (max - min) * t;
            v.signum() * (v.abs().exp() - 1.0)
        };
        let [a, b, c, mode] = rotations(i);
        let component = |byte: u8| (f32::from(byte) / 255.0 - 0.5) * 2.0 / 2_f32.sqrt();
        let scale = |axis: usize| number(&meta["scales"]["codebook"][usize::from(scales(i)[axis])]).exp();
        Decoded {
            mean: [0, 1, 2].map(axis),
            scale: [0, 1, 2].map(scale),
            rotation: with_left_out(usize::from(mode) - 252, [a, b, c].map(component)),
            opacity: f32::from(colours(i)[3]) / 255.0,
        }
    });
    decoded.collect()
}
