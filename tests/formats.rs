//! Scene files: agreement with independent software, and one clear sentence for every file that is damaged.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::{Random, captured};
use smalto::scene::{self, Gaussians, Scene, Unreadable};

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

fn read(path: &Path) -> Scene {
    scene::read(path, &|_| {}).unwrap()
}

/// The columns of a CSV file, by name.
struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn read(path: &Path) -> Self {
        let text = fs::read_to_string(path).unwrap();
        let mut lines = text.lines();
        let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
        let rows = lines.map(|l| l.split(',').map(|v| v.parse().unwrap()).collect()).collect();
        Self { names, rows }
    }

    fn value(&self, row: usize, name: &str) -> f64 {
        self.rows[row][self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"))]
    }
}

fn close(what: &str, ours: f32, theirs: f64, tolerance: f64) {
    assert!((f64::from(ours) - theirs).abs() <= tolerance, "{what}: {ours} for {theirs}");
}

/// Every attribute as splat-transform reads it from the same file.
fn agrees_with_splat_transform(name: &str) {
    let gaussians = read(&fixture(name)).gaussians;
    let table = Table::read(&fixture(&format!("{name}.csv")));
    assert_eq!(gaussians.len(), table.rows.len());
    assert_eq!(gaussians.sh_degree(), 3);
    for i in 0..gaussians.len() {
        let theirs = |column: &str| table.value(i, column);
        for (axis, column) in ["x", "y", "z"].iter().enumerate() {
            close(&format!("{name} {i} {column}"), gaussians.means()[i][axis], theirs(column), 1e-6);
            let scale = theirs(&format!("scale_{axis}")).exp();
            close(&format!("{name} {i} scale {axis}"), gaussians.scales()[i][axis], scale, 1e-6 * scale);
        }
        let opacity = 1.0 / (1.0 + (-theirs("opacity")).exp());
        close(&format!("{name} {i} opacity"), gaussians.opacities()[i], opacity, 1e-6);
        let q: [f64; 4] = std::array::from_fn(|k| theirs(&format!("rot_{k}")));
        let length = q.iter().map(|v| v * v).sum::<f64>().sqrt();
        let dot: f64 = q.iter().zip(gaussians.rotations()[i]).map(|(a, b)| a / length * f64::from(b)).sum();
        assert!(dot.abs() > 1.0 - 1e-6, "{name} {i} rotation: {q:?} for {:?}", gaussians.rotations()[i]);
        for (k, coefficient) in gaussians.sh(i).iter().enumerate() {
            for (channel, value) in coefficient.iter().enumerate() {
                let column =
                    if k == 0 { format!("f_dc_{channel}") } else { format!("f_rest_{}", channel * 15 + k - 1) };
                close(&format!("{name} {i} {column}"), *value, theirs(&column), 2e-6);
            }
        }
    }
}

#[test]
fn ply_agrees_with_splat_transform() {
    agrees_with_splat_transform("plush.ply");
}

#[test]
fn compressed_ply_agrees_with_splat_transform() {
    agrees_with_splat_transform("plush.compressed.ply");
}

#[test]
fn spz_3_agrees_with_splat_transform() {
    agrees_with_splat_transform("plush.v3.spz");
}

#[test]
fn spz_4_agrees_with_splat_transform() {
    agrees_with_splat_transform("plush.v4.spz");
}

#[test]
fn every_degree_is_read_from_every_format() {
    for degree in 0..3 {
        for ending in ["ply", "compressed.ply", "spz"] {
            let (low, full) = (read(&fixture(&format!("plush.sh{degree}.{ending}"))), read(&fixture("plush.ply")));
            assert_eq!((low.gaussians.sh_degree(), low.gaussians.len()), (degree, full.gaussians.len()), "{ending}");
        }
    }
}

#[test]
fn one_object_in_two_formats_is_one_scene() {
    let (Some(a), Some(b)) = (captured("biker.compressed.ply"), captured("biker.spz")) else { return };
    let (a, b) = (read(&a).gaussians, read(&b).gaussians);
    assert_eq!(a.len(), b.len());
    let range = |g: &Gaussians| scene::Bounds::of(g);
    for axis in 0..3 {
        assert!((range(&a).low[axis] - range(&b).low[axis]).abs() < 2e-3);
        assert!((range(&a).high[axis] - range(&b).high[axis]).abs() < 2e-3);
    }
}

/// A PLY with the properties in any order and types, one Gaussian.
fn ply(properties: &[(&str, &str)]) -> Vec<u8> {
    let mut file = b"ply\nformat binary_little_endian 1.0\ncomment made by a test\nelement vertex 1\n".to_vec();
    for (kind, name) in properties {
        file.extend(format!("property {kind} {name}\n").bytes());
    }
    file.extend(b"end_header\n");
    for (kind, name) in properties {
        let value = match *name {
            "x" => 1.5,
            "y" => -2.0,
            "z" => 3.0,
            "rot_0" => 2.0,
            "opacity" => 0.0,
            name if name.starts_with("scale") => -1.0,
            name if name.starts_with("f_dc") => 0.25,
            _ => 0.0,
        };
        match *kind {
            "double" => file.extend(f64::to_le_bytes(value)),
            "uchar" => file.push(value as u8),
            _ => file.extend((value as f32).to_le_bytes()),
        }
    }
    file
}

const NAMES: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2",
    "rot_3",
];

fn parse(bytes: &[u8]) -> Result<Scene, String> {
    let file = tempfile::NamedTempFile::new().unwrap();
    fs::write(file.path(), bytes).unwrap();
    let result = scene::read(file.path(), &|_| {});
    result.map_err(|error| {
        let text = error.to_string();
        assert!(text.starts_with(&file.path().display().to_string()), "it names the file: {text}");
        assert!(!text.contains('\n') && text.len() < 400, "it is one sentence: {text}");
        error.downcast::<Unreadable>().expect("it is about the file").problem
    })
}

#[test]
fn ply_takes_any_order_and_extra_properties() {
    let plain: Vec<_> = NAMES.iter().map(|n| ("float", *n)).collect();
    let expected = parse(&ply(&plain)).unwrap().gaussians;
    assert_eq!(expected.means(), [[1.5, -2.0, 3.0]]);
    assert_eq!(expected.rotations(), [[1.0, 0.0, 0.0, 0.0]]);
    assert_eq!(expected.opacities(), [0.5]);
    let mut random = Random(1);
    for _ in 0..20 {
        let mut mixed = plain.clone();
        mixed.extend([("float", "nx"), ("uchar", "red"), ("double", "extra")]);
        for property in &mut mixed[..7] {
            if random.below(2) == 0 {
                property.0 = "double";
            }
        }
        for i in (1..mixed.len()).rev() {
            mixed.swap(i, random.below(i as u32 + 1) as usize);
        }
        assert_eq!(parse(&ply(&mixed)).unwrap().gaussians, expected, "{mixed:?}");
    }
}

#[test]
fn antialiased_scenes_are_recognized() {
    let plain = ply(&NAMES.map(|n| ("float", n)));
    let with = |comment: &str| String::from_utf8_lossy(&plain).replacen("made by a test", comment, 1);
    // The data after the header are not text, but the replacement is before them.
    let header_end = |text: &str| text.find("end_header\n").unwrap() + 11;
    let data = &plain[header_end(&String::from_utf8_lossy(&plain))..];
    let mip = replaced(
        &fs::read(fixture("plush.compressed.ply")).unwrap(),
        "comment Generated by splat-transform 2.7.1",
        "comment SplatRenderMode: mip",
    );
    assert!(parse(&mip).unwrap().is_antialiased);
    for (comment, expected) in
        [("SplatRenderMode: mip", true), ("SplatRenderMode: default", false), ("antialiased 1", true)]
    {
        let text = with(comment);
        let file = [&text.as_bytes()[..header_end(&text)], data].concat();
        assert_eq!(parse(&file).unwrap().is_antialiased, expected, "{comment}");
    }
    let mut spz = fs::read(fixture("plush.v4.spz")).unwrap();
    assert!(!parse(&spz).unwrap().is_antialiased);
    spz[14] |= 1;
    assert!(parse(&spz).unwrap().is_antialiased);
}

/// Comments may be in any encoding, and elements that nothing is taken from of any count and size.
#[test]
fn ply_reads_past_what_it_does_not_need() {
    let whole = ply(&NAMES.map(|n| ("float", n)));
    let expected = parse(&whole).unwrap().gaussians;
    let latin = replaced(&whole, "made by", b"m\xe9 by");
    assert_eq!(parse(&latin).unwrap().gaussians, expected);
    let before = |element: &str, bytes: &[u8]| {
        let file = replaced(&whole, "element vertex", format!("{element}element vertex"));
        replaced(&file, "end_header\n", [b"end_header\n", bytes].concat())
    };
    assert_eq!(parse(&before("element nothing 99999999999999\n", b"")).unwrap().gaussians, expected);
    let pairs = "element pair 3\nproperty uchar a\nproperty uchar b\n";
    assert_eq!(parse(&before(pairs, b"abcdef")).unwrap().gaussians, expected);
}

#[test]
fn ply_says_what_is_missing() {
    // Without scale_2 they are flat.
    for missing in NAMES.into_iter().filter(|name| *name != "scale_2") {
        let properties: Vec<_> = NAMES.iter().filter(|n| **n != missing).map(|n| ("float", *n)).collect();
        let problem = parse(&ply(&properties)).unwrap_err();
        assert!(problem.contains(&format!("property {missing} of element vertex is missing")), "{problem}");
    }
}

fn replaced(bytes: &[u8], from: &str, to: impl AsRef<[u8]>) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).expect("it is there");
    [&bytes[..at], to.as_ref(), &bytes[at + from.len()..]].concat()
}

/// An SPZ 4 file whose second stream holds this many alphas, whatever its table of contents says.
fn with_alphas(spz: &[u8], count: usize) -> Vec<u8> {
    let size = |stream: usize| u64::from_le_bytes(spz[32 + 16 * stream..][..8].try_into().unwrap()) as usize;
    let at = 32 + 6 * 16 + size(0);
    let alphas = zstd::encode_all(&vec![200; count][..], 0).unwrap();
    let mut file = [&spz[..at], &alphas, &spz[at + size(1)..]].concat();
    file[48..56].copy_from_slice(&(alphas.len() as u64).to_le_bytes());
    file
}

/// Damage, and what its sentence must contain.
#[test]
fn damaged_files_are_refused_in_one_sentence() {
    let whole = ply(&NAMES.map(|n| ("float", n)));
    let with = |from: &str, to: &str| {
        let text = String::from_utf8_lossy(&whole[..400]).into_owned();
        let at = text.find(from).unwrap();
        [&whole[..at], to.as_bytes(), &whole[at + from.len()..]].concat()
    };
    let spz = fs::read(fixture("plush.v4.spz")).unwrap();
    let gzip = fs::read(fixture("plush.v3.spz")).unwrap();
    let changed = |bytes: &[u8], at: usize, value: u8| {
        let mut copy = bytes.to_vec();
        copy[at] = value;
        copy
    };
    let compressed = fs::read(fixture("plush.compressed.ply")).unwrap();
    let huge = [0xff; 4];
    let cases: Vec<(&str, Vec<u8>, &str)> = vec![
        ("empty", vec![], "the file is empty"),
        ("text", b"hello".to_vec(), "not a scene"),
        ("short", b"pl".to_vec(), "not a scene"),
        ("header only", whole[..60].to_vec(), "ends at byte 60, inside the PLY header"),
        ("magic only", b"ply".to_vec(), "inside the PLY header"),
        ("endless header", [&whole[..45], &vec![b' '; 1 << 21]].concat(), "no end within"),
        ("no format", with("format binary_little_endian 1.0\n", ""), "no format line"),
        ("truncated", whole[..whole.len() - 3].to_vec(), "truncated"),
        ("count too large", with("vertex 1", "vertex 99999999999"), "truncated"),
        ("count overflows", with("vertex 1", "vertex 18446744073709551615"), "claims"),
        ("count is text", with("vertex 1", "vertex many"), "'many' is not a count"),
        ("no Gaussians", with("vertex 1", "vertex 0"), "holds no Gaussians"),
        ("ascii", with("binary_little_endian", "ascii"), "is not a number"),
        ("unknown type", with("property float x", "property quad x"), "'quad' is not a PLY type"),
        ("twice", with("property float y", "property float x"), "there twice"),
        ("list", with("property float x", "property list uchar int x"), "list"),
        ("strange line", with("comment made", "nonsense here"), "header line 3 is not PLY"),
        ("property first", with("element vertex 1\n", ""), "outside of an element"),
        ("no vertices", with("element vertex", "element corner"), "no element vertex"),
        ("SPZ header cut", spz[..20].to_vec(), "inside the SPZ header"),
        ("SPZ version", changed(&spz, 4, 9), "version 9"),
        ("SPZ degree", changed(&spz, 12, 7), "SH degree 7"),
        ("SPZ fraction", changed(&spz, 13, 40), "40 fractional bits"),
        ("SPZ streams", changed(&spz, 15, 3), "says 3"),
        ("SPZ toc inside", changed(&spz, 16, 3), "begins inside the header"),
        ("SPZ toc outside", changed(&spz, 19, 0xff), "past the end"),
        ("SPZ count", changed(&spz, 8, 62), "the file says"),
        ("SPZ huge count", [&spz[..8], &huge, &spz[12..]].concat(), "at most"),
        ("SPZ cut", spz[..spz.len() - 30].to_vec(), "are left"),
        ("gzip cut", gzip[..gzip.len() / 2].to_vec(), ""),
        ("gzip of nothing", gzip[..12].to_vec(), ""),
        ("SPZ levels of detail", changed(&spz, 14, 0x80), "levels of detail"),
        ("SPZ bomb", changed(&changed(&spz, 8, 0x41), 9, 0x5d), "holds 23504 at most"),
        ("SPZ alphas too many", with_alphas(&spz, 62), "the alphas go on"),
        ("SPZ alphas too few", with_alphas(&spz, 60), "the alphas of Gaussians 0 to 61 of 61 are damaged"),
        ("gzip checksum", changed(&gzip, gzip.len() - 6, !gzip[gzip.len() - 6]), "damaged"),
        ("gzip trailer cut", gzip[..gzip.len() - 3].to_vec(), "damaged"),
        (
            "compressed list",
            replaced(&compressed, "uint packed_color", "uint packed_color\nproperty list uchar int l"),
            "list property",
        ),
        ("compressed type", replaced(&compressed, "uint packed_color", "int packed_color"), "is not of type U32"),
        ("compressed cut", compressed[..compressed.len() - 5].to_vec(), "truncated"),
    ];
    for (name, bytes, expected) in cases {
        let expected = if name == "SPZ cut" { "the file has" } else { expected };
        match parse(&bytes) {
            Ok(_) => panic!("{name}: was read"),
            Err(problem) => assert!(problem.contains(expected), "{name}: {problem}"),
        }
    }
}

/// Bytes changed at random: a file is read or refused, never a panic or an endless read.
#[test]
fn files_with_random_damage_never_panic() {
    let mut random = Random(42);
    for name in ["plush.ply", "plush.compressed.ply", "plush.v3.spz", "plush.v4.spz"] {
        let whole = fs::read(fixture(name)).unwrap();
        let (mut read, mut refused) = (0, 0);
        for _ in 0..300 {
            let mut bytes = whole.clone();
            for _ in 0..1 + random.below(4) {
                // Headers more often than data.
                let end = if random.below(2) == 0 { 64.min(bytes.len()) } else { bytes.len() };
                bytes[random.below(end as u32) as usize] = random.bits() as u8;
            }
            if random.below(4) == 0 {
                bytes.truncate(random.below(bytes.len() as u32) as usize);
            }
            match parse(&bytes) {
                Ok(_) => read += 1,
                Err(_) => refused += 1,
            }
        }
        assert!(refused > 50, "{name}: {read} read, {refused} refused");
    }
}

#[test]
fn a_missing_file_and_a_folder_are_refused() {
    let missing = scene::read(Path::new("no/such/file.ply"), &|_| {}).unwrap_err();
    assert_eq!(missing.to_string(), "no/such/file.ply: cannot be opened: there is no such file");
    let folder = scene::read(Path::new("tests"), &|_| {}).unwrap_err();
    assert_eq!(folder.to_string(), "tests: is not a file");
}

#[test]
fn progress_goes_from_the_beginning_to_the_end() {
    let seen = std::cell::RefCell::new(Vec::new());
    scene::read(&fixture("plush.ply"), &|fraction| seen.borrow_mut().push(fraction)).unwrap();
    let seen = seen.into_inner();
    assert!(seen.is_sorted() && seen.iter().all(|f| (0.0..=1.0).contains(f)));
    assert!(seen.last().is_some_and(|f| *f > 0.99));
}

/// SPZ 4 with the extension that names its axes.
#[test]
fn spz_axes_follow_the_extension() {
    let plain = fs::read(fixture("plush.v4.spz")).unwrap();
    let with_system = |system: u32| {
        let mut file = plain[..32].to_vec();
        file[14] |= 2;
        file[16..20].copy_from_slice(&(32_u32 + 16 + 12).to_le_bytes());
        file.extend([1_u32, 8, 0, 0].iter().flat_map(|w| w.to_le_bytes())); // one to skip
        file.extend([0xadbe_0003_u32, 4, system].iter().flat_map(|w| w.to_le_bytes()));
        [&file, &plain[32..]].concat()
    };
    let expected = parse(&plain).unwrap().gaussians;
    // 4 is right, up, back, the default; 0 leaves it unspecified.
    for system in [0, 4] {
        assert_eq!(parse(&with_system(system)).unwrap().gaussians, expected);
    }
    // 6 is right, down, front: the file's values are ours.
    let same_axes = parse(&with_system(6)).unwrap().gaussians;
    for (ours, default) in same_axes.means().iter().zip(expected.means()) {
        assert_eq!(*ours, [default[0], -default[1], -default[2]]);
    }
    // 1 is left, down, back.
    let mirrored = parse(&with_system(1)).unwrap().gaussians;
    assert_eq!(mirrored.means()[0], [-expected.means()[0][0], -expected.means()[0][1], expected.means()[0][2]]);
    assert!(parse(&with_system(12)).unwrap_err().contains("coordinate system 12"));
}

/// SPZ version 2, which no tool at hand writes: 3-byte rotations, made here from the published layout.
#[test]
fn spz_2_rotations_have_their_own_layout() {
    let mut plain = Vec::new();
    plain.extend(0x5053_474e_u32.to_le_bytes());
    plain.extend(2_u32.to_le_bytes());
    plain.extend(1_u32.to_le_bytes());
    plain.extend([0, 12, 0, 0]);
    for value in [1.5_f64, -2.0, 0.25] {
        plain.extend(&((value * 4096.0) as i32).to_le_bytes()[..3]);
    }
    plain.extend([128, 166, 128, 90, 160, 150, 140]); // alpha, colour, scale
    plain.extend([255, 128, 64]); // x y z of the quaternion
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
    std::io::Write::write_all(&mut encoder, &plain).unwrap();
    let gaussians = parse(&encoder.finish().unwrap()).unwrap().gaussians;
    // Right, up, back to right, down, forward.
    assert_eq!(gaussians.means(), [[1.5, 2.0, -0.25]]);
    close("scale", gaussians.scales()[0][0], 0.0_f64.exp(), 1e-6);
    close("scale", gaussians.scales()[0][2], (-1.25_f64).exp(), 1e-6);
    close("opacity", gaussians.opacities()[0], 128.0 / 255.0, 1e-6);
    let q = gaussians.rotations()[0];
    let length = (1.0 + (0.5 / 127.5_f64).powi(2) + (63.5 / 127.5_f64).powi(2)).sqrt();
    close("x", q[1], 1.0 / length, 1e-3);
    close("z", q[3], 63.5 / 127.5 / length, 1e-3);
}
