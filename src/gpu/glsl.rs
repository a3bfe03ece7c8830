//! Compiles a GLSL compute shader to SPIR-V with shaderc (glslang).
//!
//! `build.rs` includes this file; the library does only with the feature `reload`.

use std::fs;
use std::path::Path;

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

/// The source text of a shader after preprocessing. Two equal texts compile to the same modules.
pub fn preprocess(compiler: &Compiler, folder: &Path, source: &Path) -> Result<String> {
    let text = read(source)?;
    let options = options(OptimizationLevel::Zero, folder)?;
    Ok(compiler.preprocess(&text, name(source)?, "main", Some(&options))?.as_text())
}

/// Compiles `source`, whose includes are relative to `folder`.
pub fn compile(compiler: &Compiler, folder: &Path, source: &Path) -> Result<Modules> {
    let text = read(source)?;
    let module = |level| -> Result<Vec<u32>> {
        let options = options(level, folder)?;
        let module = compiler.compile_into_spirv(&text, ShaderKind::Compute, name(source)?, "main", Some(&options))?;
        Ok(module.as_binary().to_vec())
    };
    Ok(Modules { named: module(OptimizationLevel::Zero)?, optimized: module(OptimizationLevel::Performance)? })
}

fn read(source: &Path) -> Result<String> {
    fs::read_to_string(source).with_context(|| source.display().to_string())
}

fn name(source: &Path) -> Result<&str> {
    source.to_str().context("a shader's path is not UTF-8")
}

fn options(level: OptimizationLevel, folder: &Path) -> Result<CompileOptions<'static>> {
    let mut options = CompileOptions::new()?;
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(SpirvVersion::V1_6);
    options.set_optimization_level(level);
    options.set_warnings_as_errors();
    let folder = folder.to_owned();
    options.set_include_callback(move |name, _, from, _| {
        let path = folder.join(name);
        let content = fs::read_to_string(&path).map_err(|e| format!("{from} includes {name}: {e}"))?;
        Ok(ResolvedInclude { resolved_name: path.display().to_string(), content })
    });
    Ok(options)
}
