//! Shaders that are compiled at run time from a folder of sources, in place of those built into the program.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Result, ensure};

/// The time of the newest change to a file in `folder` or below it.
fn newest(folder: &Path) -> Option<SystemTime> {
    let times = fs::read_dir(folder).ok()?.flatten().filter_map(|entry| match entry.file_type().ok()?.is_dir() {
        true => newest(&entry.path()),
        false => entry.metadata().ok()?.modified().ok(),
    });
    times.max()
}

/// A folder with the layout of `glsl/`.
pub(super) struct ShaderFolder {
    path: PathBuf,
    /// The modules that were compiled since the newest change.
    #[cfg(feature = "reload")]
    compiled: std::sync::Mutex<Compiled>,
}

#[cfg(feature = "reload")]
#[derive(Default)]
struct Compiled {
    newest: Option<SystemTime>,
    modules: std::collections::HashMap<String, Vec<u32>>,
}

impl ShaderFolder {
    /// # Errors
    /// The program was built without the feature `reload`, or there is no such folder.
    pub fn new(folder: &Path) -> Result<Self> {
        ensure!(
            cfg!(feature = "reload"),
            "SMALTO_SHADERS needs a program built with the feature reload: cargo build --release --features reload"
        );
        ensure!(folder.is_dir(), "SMALTO_SHADERS: there is no folder {}", folder.display());
        Ok(Self {
            path: folder.to_owned(),
            #[cfg(feature = "reload")]
            compiled: Default::default(),
        })
    }

    /// The time of the newest change in the folder.
    pub fn newest(&self) -> Option<SystemTime> {
        newest(&self.path)
    }

    /// Compiles the shader at `path` in the folder to SPIR-V words, unless it did so since the newest change.
    /// `interface` is the fingerprint of the shader that is built in.
    ///
    /// # Errors
    /// The shader does not compile, or its interface or a header's constants differ from what Rust was built with.
    #[cfg(feature = "reload")]
    pub fn compile(&self, path: &str, interface: u64) -> Result<Vec<u32>> {
        let newest = self.newest();
        let mut compiled = self.compiled.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if compiled.newest != newest {
            *compiled = Compiled { newest, ..Compiled::default() };
        }
        if let Some(words) = compiled.modules.get(path) {
            return Ok(words.clone());
        }
        let words = self.compile_anew(path, interface)?;
        compiled.modules.insert(path.to_owned(), words.clone());
        Ok(words)
    }

    #[cfg(feature = "reload")]
    fn compile_anew(&self, path: &str, interface: u64) -> Result<Vec<u32>> {
        use anyhow::Context;

        use super::{glsl, spirv};

        let source = self.path.join(path);
        let failed = || format!("cannot compile {}", source.display());
        let compiler = shaderc::Compiler::new()?;
        let preprocessed =
            glsl::preprocess(&compiler, &self.path, &source).map_err(first_error).with_context(failed)?;
        let modules = glsl::compile(&compiler, &self.path, &source).map_err(first_error).with_context(failed)?;
        let reflected = spirv::reflect(&modules.named).with_context(failed)?;
        ensure!(
            preprocessed.fingerprint(&reflected) == interface,
            "{} has another interface (bindings, constants or structs) than the shader that is built in: build the \
             program again",
            source.display()
        );
        Ok(modules.optimized)
    }

    #[cfg(not(feature = "reload"))]
    pub fn compile(&self, _: &str, _: u64) -> Result<Vec<u32>> {
        unreachable!("without the feature `reload` no device has a folder of shaders")
    }
}

/// Reduces the compiler's report to its first error, which names file and line.
#[cfg(feature = "reload")]
fn first_error(error: anyhow::Error) -> anyhow::Error {
    let text = error.to_string();
    match text.lines().find(|line| line.contains(": error:")) {
        Some(line) if error.is::<shaderc::Error>() => anyhow::anyhow!("{}", line.trim()),
        _ => error,
    }
}

#[cfg(all(test, feature = "reload"))]
mod tests {
    use super::*;
    use crate::gpu::{glsl, spirv};

    const HEADER: &str = "const uint WORKGROUP = 64;\n";
    const SHADER: &str = "#version 460
#extension GL_EXT_scalar_block_layout : require
#extension GL_GOOGLE_include_directive : require
#include \"shared/sizes.glsl\"
layout(local_size_x = 64) in;
layout(constant_id = 0) const uint FACTOR = 2;
layout(binding = 0, scalar) buffer Values { uint values[]; };
void main() { values[gl_GlobalInvocationID.x] *= FACTOR; }
";

    /// A folder with one shader and one header, and the shader's fingerprint.
    fn folder() -> (tempfile::TempDir, ShaderFolder, u64) {
        let place = tempfile::tempdir().unwrap();
        for (name, text) in [("shared/sizes.glsl", HEADER), ("scale.comp", SHADER)] {
            fs::create_dir_all(place.path().join("shared")).unwrap();
            fs::write(place.path().join(name), text).unwrap();
        }
        let compiler = shaderc::Compiler::new().unwrap();
        let source = place.path().join("scale.comp");
        let interface = spirv::reflect(&glsl::compile(&compiler, place.path(), &source).unwrap().named).unwrap();
        let fingerprint = glsl::preprocess(&compiler, place.path(), &source).unwrap().fingerprint(&interface);
        let folder = ShaderFolder::new(place.path()).unwrap();
        (place, folder, fingerprint)
    }

    /// Compiles the shader after `from` became `to` in `file`.
    fn changed(file: &str, from: &str, to: &str) -> Result<Vec<u32>, String> {
        let (place, folder, fingerprint) = folder();
        let path = place.path().join(file);
        let text = fs::read_to_string(&path).unwrap();
        assert!(text.contains(from));
        fs::write(&path, text.replace(from, to)).unwrap();
        let short = |error| format!("{error:#}").replace(&place.path().display().to_string(), "DIR");
        folder.compile("scale.comp", fingerprint).map_err(short)
    }

    #[test]
    fn a_changed_shader_is_compiled() {
        let (_place, folder, fingerprint) = folder();
        let same = folder.compile("scale.comp", fingerprint).unwrap();
        assert_ne!(changed("scale.comp", "*= FACTOR", "+= FACTOR").unwrap(), same);
    }

    #[test]
    fn a_changed_interface_is_refused() {
        let refusal = "DIR/scale.comp has another interface (bindings, constants or structs) than the shader that is \
                       built in: build the program again";
        let declared = "layout(constant_id = 0) const uint FACTOR = 2;";
        let cases = [
            (
                "scale.comp",
                "buffer Values",
                "readonly buffer Others { uint others[]; };\nlayout(binding = 1, scalar) buffer Values",
            ),
            ("scale.comp", "local_size_x = 64", "local_size_x = 32"),
            ("scale.comp", declared, "const uint FACTOR = 2;"),
            ("shared/sizes.glsl", "WORKGROUP = 64", "WORKGROUP = 32"),
        ];
        for (file, from, to) in cases {
            assert_eq!(changed(file, from, to).err().as_deref(), Some(refusal), "{to}");
        }
    }

    #[test]
    fn an_error_names_the_file_and_the_line() {
        let found = changed("scale.comp", "*= FACTOR", "*= NOTHING").unwrap_err();
        let expected = "cannot compile DIR/scale.comp: DIR/scale.comp:8: error: 'NOTHING' : undeclared identifier";
        assert_eq!(found, expected);
        let found = changed("shared/sizes.glsl", "= 64", "= NOTHING").unwrap_err();
        assert!(found.contains("DIR/shared/sizes.glsl:1: error: "), "{found}");
    }

    #[test]
    fn the_newest_change_is_found_in_any_folder() {
        let (place, folder, _) = folder();
        let before = newest(&folder.path).unwrap();
        let file = fs::File::options().write(true).open(place.path().join("shared/sizes.glsl")).unwrap();
        let later = before + std::time::Duration::from_secs(10);
        file.set_modified(later).unwrap();
        assert_eq!(newest(&folder.path), Some(later));
    }
}
