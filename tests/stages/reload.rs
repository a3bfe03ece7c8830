//! Shaders that are compiled at run time, on a device.

use std::fs;
use std::path::Path;

use smalto::gpu::{Buffer, Commands, Device, DeviceChoice, DispatchSize, Stage, Validation};
use smalto::render::shaders::bench::{CopyWords, CopyWordsBindings, CopyWordsPush};

use crate::common::Turn;

const BUILT_IN: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/glsl");
const COPY_WORDS: &str = "bench/copy_words.comp";

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let to = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_folder(&entry.path(), &to)
        } else {
            drop(fs::copy(entry.path(), to))
        }
    }
}

/// Copies 1, 2, 3, 4 with the built-in `copy_words.comp` after `from` became `to` in its source.
fn copied(from: &str, to: &str) -> Result<[u32; 4], String> {
    let _turn = Turn::take();
    let folder = tempfile::tempdir().unwrap();
    copy_folder(Path::new(BUILT_IN), folder.path());
    let choice = std::env::var("SMALTO_DEVICE").map_or(DeviceChoice::Best, |name| name.as_str().into());
    let device = Device::open(&choice, Validation::Required).unwrap().with_shaders(Some(folder.path())).unwrap();
    let before = device.newest_shader().unwrap();
    let path = folder.path().join(COPY_WORDS);
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains(from));
    fs::write(&path, text.replace(from, to)).unwrap();
    assert!(device.newest_shader().unwrap() >= before);

    let stage = Stage::<CopyWords>::new(&device, &()).map_err(|error| format!("{error:#}"))?;
    let buffer = |name| Buffer::new(&device, name, 1).unwrap();
    let (source, target) = (buffer("source"), buffer("target"));
    let mut cmd = Commands::new(&device).unwrap();
    cmd.upload(&source, 0, 1, |values| values[0] = [1, 2, 3, 4]).unwrap();
    cmd.barrier(smalto::gpu::Access::COPY_WRITE, smalto::gpu::Access::SHADER_READ);
    let bindings = CopyWordsBindings { from: &source, to: &target };
    cmd.dispatch(&stage, bindings, CopyWordsPush { elements: 1 }, DispatchSize::Invocations(1));
    cmd.barrier(smalto::gpu::Access::SHADER_WRITE, smalto::gpu::Access::COPY_READ);
    let words = cmd.read(&target).unwrap();
    let results = cmd.submit().unwrap().wait().unwrap();
    assert_eq!(device.validation_messages(), Vec::<String>::new());
    Ok(results.view(&words)[0])
}

#[test]
fn a_changed_shader_is_used() {
    assert_eq!(copied("to[i] = from[i]", "to[i] = from[i]"), Ok([1, 2, 3, 4]));
    assert_eq!(copied("to[i] = from[i]", "to[i] = 2 * from[i]"), Ok([2, 4, 6, 8]));
}

#[test]
fn a_shader_with_another_interface_is_refused() {
    let error = copied("uint elements;", "uint elements, more;").unwrap_err();
    assert!(error.starts_with("stage copy_words: ") && error.contains(COPY_WORDS), "{error}");
    assert!(error.contains("has another interface"), "{error}");
}
