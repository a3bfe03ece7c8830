//! CSV files that splat-transform wrote from scene files, and the comparison with what smalto reads.

use std::fs;
use std::path::{Path, PathBuf};

use smalto::formats;
use smalto::scene::{self, Gaussians, Scene, Unreadable};

pub fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

pub fn read(path: &Path) -> Scene {
    formats::read(path).unwrap()
}

/// The columns of a CSV file, by name.
pub struct Table {
    names: Vec<String>,
    pub rows: Vec<Vec<f64>>,
}

impl Table {
    pub fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
        Self { names, rows }
    }

    pub fn value(&self, row: usize, name: &str) -> f64 {
        self.rows[row][self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"))]
    }

    /// The number of SH coefficients after the first, for one channel.
    fn rest(&self) -> usize {
        self.names.iter().filter(|name| name.starts_with("f_rest_")).count() / 3
    }
}

pub fn close(what: &str, ours: f32, theirs: f64, tolerance: f64) {
    assert!((f64::from(ours) - theirs).abs() <= tolerance, "{what}: {ours} for {theirs}");
}

/// The largest difference from splat-transform: of values, and of a rotation's cosine from 1.
pub struct Tolerance {
    pub value: f64,
    pub rotation: f64,
}

pub const SAME: Tolerance = Tolerance { value: 1e-6, rotation: 1e-6 };

/// Compares every attribute with what splat-transform reads from the same file.
pub fn agrees(name: &str, gaussians: &Gaussians, table: &Table, tolerance: &Tolerance) {
    let Tolerance { value, rotation } = *tolerance;
    assert_eq!(gaussians.len(), table.rows.len(), "{name}");
    assert_eq!(scene::sh_coefficients(gaussians.sh_degree()), 1 + table.rest(), "{name}");
    for i in 0..gaussians.len() {
        let theirs = |column: &str| table.value(i, column);
        for (axis, column) in ["x", "y", "z"].iter().enumerate() {
            close(&format!("{name} {i} {column}"), gaussians.means()[i][axis], theirs(column), value);
            let scale = theirs(&format!("scale_{axis}")).exp();
            close(&format!("{name} {i} scale {axis}"), gaussians.scales()[i][axis], scale, value * scale);
        }
        let opacity = 1.0 / (1.0 + (-theirs("opacity")).exp());
        close(&format!("{name} {i} opacity"), gaussians.opacities()[i], opacity, 2.0 * value);
        let q: [f64; 4] = std::array::from_fn(|k| theirs(&format!("rot_{k}")));
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let dot: f64 = q.iter().zip(gaussians.rotations()[i]).map(|(a, b)| a / length * f64::from(b)).sum();
        assert!(dot.abs() > 1.0 - rotation, "{name} {i} rotation: {q:?} for {:?}", gaussians.rotations()[i]);
        for (k, coefficient) in gaussians.sh(i).iter().enumerate() {
            for (channel, ours) in coefficient.iter().enumerate() {
                let column = match k {
                    0 => format!("f_dc_{channel}"),
                    _ => format!("f_rest_{}", channel * table.rest() + k - 1),
                };
                close(&format!("{name} {i} {column}"), *ours, theirs(&column), 2.0 * value);
            }
        }
    }
}

/// Reads a file with this ending and content. A refusal is one sentence that begins with the path; the rest is
/// returned.
pub fn parse(ending: &str, bytes: &[u8]) -> Result<Scene, String> {
    let file = tempfile::Builder::new().suffix(ending).tempfile().unwrap();
    fs::write(file.path(), bytes).unwrap();
    parse_at(file.path())
}

pub fn parse_at(path: &Path) -> Result<Scene, String> {
    formats::read(path).map_err(|error| {
        let text = error.to_string();
        assert!(text.starts_with(&path.display().to_string()), "it names the file: {text}");
        assert!(!text.contains('\n') && text.len() < 500, "it is one sentence: {text}");
        error.downcast::<Unreadable>().expect("it is about the file").problem
    })
}

/// Damages a file at random, 300 times: it is read or refused, never a panic or an endless read.
pub fn survives_damage(ending: &str, whole: &[u8], least_refused: usize) {
    let mut random = super::Random(42);
    let (mut read, mut refused) = (0, 0);
    for _ in 0..300 {
        let mut bytes = whole.to_vec();
        for _ in 0..1 + random.below(4) {
            // Headers more often than data.
            let end = if random.below(2) == 0 { 64.min(bytes.len()) } else { bytes.len() };
            bytes[random.below(end as u32) as usize] = random.bits() as u8;
        }
        if random.below(4) == 0 {
            bytes.truncate(random.below(bytes.len() as u32) as usize);
        }
        match parse(ending, &bytes) {
            Ok(_) => read += 1,
            Err(_) => refused += 1,
        }
    }
    assert!(refused >= least_refused, "{ending}: {read} read, {refused} refused");
}
