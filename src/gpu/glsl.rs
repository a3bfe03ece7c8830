//! Compiles a GLSL compute shader to SPIR-V with shaderc (glslang).
//!
//! `build.rs` includes this file; the library does only with the feature `reload`.

use std::cell::RefCell;
use std::collections::BTreeSet;
use std::fmt::Debug;
use std::fs;
use std::path::Path;
use std::rc::Rc;

use anyhow::{Context, Result};
use shaderc::{
    CompileOptions, Compiler, EnvVersion, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion, TargetEnv,
};

/// The two forms of one compiled shader, in SPIR-V words.
pub struct Modules {
    /// Unoptimized: keeps the names and the unused bindings that reflection needs.
    pub named: Vec<u32>,
    /// Optimized: the form that pipelines are made from.
    pub optimized: Vec<u32>,
}

/// A shader's source after preprocessing.
pub struct Preprocessed {
    /// Two equal texts compile to the same modules.
    pub text: String,
    /// The [`numbers`] of the included headers.
    numbers: BTreeSet<String>,
}

impl Preprocessed {
    /// A number that differs if the reflected `interface` or the shared constants of the included headers do (FNV-1a
    /// of their `Debug` text, the same in every build).
    pub fn fingerprint(&self, interface: &impl Debug) -> u64 {
        format!("{interface:?}{:?}", self.numbers)
            .bytes()
            .fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3))
    }
}

/// Preprocesses `source`, whose includes are relative to `folder`.
pub fn preprocess(compiler: &Compiler, folder: &Path, source: &Path) -> Result<Preprocessed> {
    let headers = Rc::new(RefCell::new(Vec::new()));
    let options = options(OptimizationLevel::Zero, folder, headers.clone())?;
    let text = compiler.preprocess(&read(source)?, name(source)?, "main", Some(&options))?.as_text();
    let numbers = headers.borrow().iter().flat_map(|header| numbers(header)).collect();
    Ok(Preprocessed { text, numbers })
}

/// Compiles `source`, whose includes are relative to `folder`.
pub fn compile(compiler: &Compiler, folder: &Path, source: &Path) -> Result<Modules> {
    let text = read(source)?;
    let module = |level| -> Result<Vec<u32>> {
        let options = options(level, folder, Rc::default())?;
        let module = compiler.compile_into_spirv(&text, ShaderKind::Compute, name(source)?, "main", Some(&options))?;
        Ok(module.as_binary().to_vec())
    };
    Ok(Modules { named: module(OptimizationLevel::Zero)?, optimized: module(OptimizationLevel::Performance)? })
}

/// The `const uint` and `const float` values of a header that are one number each, as Rust declarations.
pub fn numbers(header: &str) -> Vec<String> {
    let mut declarations = Vec::new();
    for line in header.lines() {
        let code = line.split("//").next().unwrap_or_default().trim();
        let Some((ty, list)) = code.strip_prefix("const ").and_then(|rest| rest.split_once(' ')) else { continue };
        for (name, value) in list.trim_end_matches(';').split(',').filter_map(|one| one.split_once('=')) {
            let (name, value) = (name.trim(), value.trim().trim_end_matches('u'));
            match ty {
                "uint" if value.parse::<u32>().is_ok() => {
                    declarations.push(format!("pub const {name}: u32 = {value};"))
                }
                "float" if value.parse::<f32>().is_ok() => {
                    declarations.push(format!("pub const {name}: f32 = {value};"))
                }
                _ => {}
            }
        }
    }
    declarations
}

fn read(source: &Path) -> Result<String> {
    fs::read_to_string(source).with_context(|| source.display().to_string())
}

fn name(source: &Path) -> Result<&str> {
    source.to_str().context("a shader's path is not UTF-8")
}

/// Options that append the text of every included header to `headers`.
fn options(
    level: OptimizationLevel,
    folder: &Path,
    headers: Rc<RefCell<Vec<String>>>,
) -> Result<CompileOptions<'static>> {
    let mut options = CompileOptions::new()?;
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(SpirvVersion::V1_6);
    options.set_optimization_level(level);
    options.set_warnings_as_errors();
    let folder = folder.to_owned();
    options.set_include_callback(move |name, _, from, _| {
        let path = folder.join(name);
        let content = fs::read_to_string(&path).map_err(|e| format!("{from} includes {name}: {e}"))?;
        headers.borrow_mut().push(content.clone());
        Ok(ResolvedInclude { resolved_name: path.display().to_string(), content })
    });
    Ok(options)
}
