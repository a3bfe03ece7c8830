//! Compiles `glsl/*.comp` to SPIR-V and writes one typed Rust interface per shader to `OUT_DIR/shaders.rs`.
//!
//! A shader declares its own interface; this turns it into a marker type, a bindings struct, a push-constant struct and
//! a struct of specialization constants, so that a forgotten or mistyped buffer does not compile.

use std::collections::hash_map::DefaultHasher;
use std::fmt::Write as _;
use std::fs;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use shaderc::{
    CompileOptions, Compiler, EnvVersion, OptimizationLevel, ResolvedInclude, ShaderKind, SpirvVersion, TargetEnv,
};

#[path = "src/gpu/spirv.rs"]
mod spirv;
use spirv::{Interface, Kind, Member, Struct, Type, Value};

const SHADER_FOLDER: &str = "glsl";
/// Defined where a shader is compiled for arithmetic in 16-bit floats.
const HALF: &str = "HALF_ARITHMETIC";

fn main() {
    if let Err(error) = run() {
        eprintln!("{error:#}");
        std::process::exit(1);
    }
}

fn run() -> Result<()> {
    println!("cargo::rerun-if-changed={SHADER_FOLDER}");
    println!("cargo::rerun-if-changed=src");
    tell_commit();
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let mut sources: Vec<PathBuf> = fs::read_dir(SHADER_FOLDER)?.map(|e| Ok(e?.path())).collect::<Result<_>>()?;
    sources.retain(|path| path.extension().is_some_and(|e| e == "comp"));
    sources.sort();

    let compiler = Compiler::new()?;
    let mut generated = Generated::default();
    for source in sources {
        let stem = source.file_stem().and_then(|s| s.to_str()).context("a shader's name is not UTF-8")?;
        let place = || source.display().to_string();
        let modules = compile(&compiler, &source, &out, None)?;
        let interface = spirv::reflect(&modules.named).with_context(place)?;
        let half = compile(&compiler, &source, &out, Some(HALF))?;
        // What asks for the macro has a second form; of any other shader, both are the same.
        let half = (half.optimized_path != modules.optimized_path).then_some(half.optimized_path);
        generated.shader(stem, &interface, &modules.optimized_path, half.as_deref()).with_context(place)?;
    }
    write_if_changed(&out.join("shaders.rs"), generated.code.as_bytes())
}

/// Lets the program know which commit it is built from, where git knows it.
fn tell_commit() {
    let git = |arguments: &[&str]| {
        let output = std::process::Command::new("git").args(arguments).output().ok().filter(|o| o.status.success())?;
        Some(String::from_utf8_lossy(&output.stdout).trim().to_owned())
    };
    // What changes with every commit.
    for path in ["HEAD", "index"].iter().filter_map(|name| git(&["rev-parse", "--git-path", name])) {
        println!("cargo::rerun-if-changed={path}");
    }
    if let Some(commit) = git(&["describe", "--always", "--dirty", "--abbrev=12"]) {
        println!("cargo::rustc-env=SMALTO_COMMIT={commit}");
    }
}

struct Modules {
    /// Unoptimized, with the names and the unused bindings that reflection needs.
    named: Vec<u32>,
    /// What the library embeds.
    optimized_path: PathBuf,
}

/// Compiles one shader twice, or takes both modules from an earlier build of the same preprocessed source by
/// the same build script.
fn compile(compiler: &Compiler, source: &Path, out: &Path, defined: Option<&str>) -> Result<Modules> {
    let text = fs::read_to_string(source)?;
    let file = source.to_str().context("a shader's path is not UTF-8")?;
    let preprocessed =
        compiler.preprocess(&text, file, "main", Some(&options(OptimizationLevel::Zero, defined)?))?.as_text();
    let mut hasher = DefaultHasher::new();
    (preprocessed, include_str!("build.rs")).hash(&mut hasher);
    let stem = source.file_stem().and_then(|s| s.to_str()).context("a shader's name is not UTF-8")?;
    let path = |kind: &str| out.join(format!("{stem}.{:016x}.{kind}.spv", hasher.finish()));
    let (named_path, optimized_path) = (path("named"), path("optimized"));
    for (level, path) in [(OptimizationLevel::Zero, &named_path), (OptimizationLevel::Performance, &optimized_path)] {
        if !path.exists() {
            let module = compiler.compile_into_spirv(
                &text,
                ShaderKind::Compute,
                file,
                "main",
                Some(&options(level, defined)?),
            )?;
            let unfinished = path.with_extension("part");
            fs::write(&unfinished, module.as_binary_u8())?;
            fs::rename(&unfinished, path)?;
        }
    }
    let named = fs::read(&named_path)?.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    Ok(Modules { named, optimized_path })
}

fn options(level: OptimizationLevel, defined: Option<&str>) -> Result<CompileOptions<'static>> {
    let mut options = CompileOptions::new()?;
    if let Some(name) = defined {
        options.add_macro_definition(name, None);
    }
    options.set_target_env(TargetEnv::Vulkan, EnvVersion::Vulkan1_3 as u32);
    options.set_target_spirv(SpirvVersion::V1_6);
    options.set_optimization_level(level);
    options.set_warnings_as_errors();
    options.set_include_callback(|name, _, from, _| {
        let path = Path::new(SHADER_FOLDER).join(name);
        let content = fs::read_to_string(&path).map_err(|e| format!("{from} includes {name}: {e}"))?;
        Ok(ResolvedInclude { resolved_name: path.display().to_string(), content })
    });
    Ok(options)
}

fn write_if_changed(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|old| old == bytes) {
        return Ok(());
    }
    Ok(fs::write(path, bytes)?)
}

#[derive(Default)]
struct Generated {
    code: String,
    structs: Vec<(String, Struct)>,
}

impl Generated {
    fn shader(&mut self, stem: &str, interface: &Interface, spirv: &Path, half: Option<&Path>) -> Result<()> {
        for structure in &interface.structs {
            self.shared_struct(stem, structure)?;
        }
        let name = pascal_case(stem);
        self.bindings(&name, interface)?;
        let push = match &interface.push {
            Some(members) => {
                let structure = Struct { name: format!("{name}Push"), members: members.clone() };
                self.plain_struct(&structure, &format!("Push constants of `{stem}.comp`."))?;
                structure.name
            }
            None => "()".to_owned(),
        };
        let constants = self.constants(&name, interface)?;
        let bindings = interface.bindings.iter().map(|b| {
            let (number, name, count, reads, writes) = (b.number, &b.name, b.count, b.reads, b.writes);
            let kind = match b.kind {
                Kind::Buffer(_) => "Buffer",
                Kind::Image => "Image",
            };
            format!(
                "        Binding {{ number: {number}, name: \"{name}\", count: {count}, kind: BindingKind::{kind}, reads: {reads}, writes: {writes} }},\n"
            )
        });
        let bindings: String = bindings.collect();
        let [x, y, z] = interface.workgroup;
        let half = half.map_or("None".to_owned(), |path| format!("Some(include_bytes!({path:?}))"));
        write!(
            self.code,
            "
/// `{SHADER_FOLDER}/{stem}.comp`.
pub struct {name};

impl Shader for {name} {{
    const NAME: &'static str = \"{stem}\";
    const SPIRV: &'static [u8] = include_bytes!({spirv:?});
    const HALF_SPIRV: Option<&'static [u8]> = {half};
    const WORKGROUP: [u32; 3] = [{x}, {y}, {z}];
    const BINDINGS: &'static [Binding] = &[
{bindings}    ];
    type Bindings<'a> = {name}Bindings<'a>;
    type Push = {push};
    type Constants = {constants};
}}
"
        )?;
        Ok(())
    }

    /// A struct that several shaders may declare: written once, and refused when two declarations differ.
    fn shared_struct(&mut self, stem: &str, structure: &Struct) -> Result<()> {
        if let Some((owner, known)) = self.structs.iter().find(|(_, s)| s.name == structure.name) {
            ensure!(known == structure, "struct `{}` differs from the one in {owner}.comp", structure.name);
            return Ok(());
        }
        self.structs.push((stem.to_owned(), structure.clone()));
        self.plain_struct(structure, &format!("`{}` as the shaders lay it out.", structure.name))?;
        // A struct of one kind of number can be the element of a buffer.
        if let Some(scalar) = self.scalar(&Type::Struct(structure.name.clone())) {
            let implementation = format!("const SCALAR: Scalar = Scalar::{scalar};");
            writeln!(self.code, "\nimpl Element for {} {{\n    {implementation}\n}}", structure.name)?;
        }
        Ok(())
    }

    /// The kind of number that a type is made of, if there is only one.
    fn scalar(&self, ty: &Type) -> Option<&'static str> {
        match ty {
            Type::U32 => Some("U32"),
            Type::I32 => Some("I32"),
            Type::F32 => Some("F32"),
            Type::U64 => Some("U64"),
            Type::Array(element, _) => self.scalar(element),
            Type::Struct(name) => {
                let (_, structure) = self.structs.iter().find(|(_, s)| s.name == *name)?;
                let scalars: Vec<_> = structure.members.iter().map(|m| self.scalar(&m.ty)).collect();
                scalars.first().copied().flatten().filter(|first| scalars.iter().all(|s| *s == Some(*first)))
            }
        }
    }

    fn plain_struct(&mut self, structure: &Struct, doc: &str) -> Result<()> {
        ensure!(
            !self.code.contains(&format!("pub struct {} ", structure.name)),
            "two types are named `{}`",
            structure.name
        );
        writeln!(
            self.code,
            "\n/// {doc}\n#[repr(C)]\n#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]"
        )?;
        writeln!(self.code, "pub struct {} {{", structure.name)?;
        for Member { name, ty } in &structure.members {
            writeln!(self.code, "    pub {}: {},", identifier(name)?, rust_type(ty))?;
        }
        writeln!(self.code, "}}")?;
        Ok(())
    }

    fn bindings(&mut self, name: &str, interface: &Interface) -> Result<()> {
        writeln!(self.code, "\n/// The resources that [`{name}`] reads and writes.\n#[derive(Clone, Copy)]")?;
        writeln!(self.code, "pub struct {name}Bindings<'a> {{")?;
        let mut visits = String::new();
        for binding in &interface.bindings {
            let field = identifier(&binding.name)?;
            let one = match &binding.kind {
                Kind::Buffer(element) => format!("&'a Buffer<{}>", rust_type(element)),
                Kind::Image => "&'a Image".to_owned(),
            };
            match binding.count {
                1 => {
                    writeln!(self.code, "    pub {field}: {one},")?;
                    writeln!(visits, "        bind(self.{field}.resource());")?;
                }
                count => {
                    writeln!(self.code, "    pub {field}: [{one}; {count}],")?;
                    writeln!(
                        visits,
                        "        for element in self.{field} {{\n            bind(element.resource());\n        }}"
                    )?;
                }
            }
        }
        writeln!(self.code, "}}\n\nimpl Bindings for {name}Bindings<'_> {{")?;
        writeln!(self.code, "    fn each(&self, bind: &mut dyn FnMut(Resource)) {{\n{visits}    }}\n}}")?;
        Ok(())
    }

    /// Writes the struct of specialization constants, if there are any, and returns its type.
    fn constants(&mut self, name: &str, interface: &Interface) -> Result<String> {
        if interface.constants.is_empty() {
            return Ok("()".to_owned());
        }
        writeln!(
            self.code,
            "\n/// The specialization constants of [`{name}`]; the defaults are the shader's.\n#[derive(Clone, Copy, Debug)]"
        )?;
        writeln!(self.code, "pub struct {name}Constants {{")?;
        let (mut defaults, mut entries) = (String::new(), String::new());
        for constant in &interface.constants {
            let field = constant.name.to_lowercase();
            let (ty, default, bits) = match constant.default {
                Value::Bool(v) => ("bool", v.to_string(), format!("u32::from(self.{field})")),
                Value::U32(v) => ("u32", v.to_string(), format!("self.{field}")),
                Value::I32(v) => ("i32", v.to_string(), format!("self.{field} as u32")),
                Value::F32(v) => {
                    ("f32", format!("f32::from_bits({:#x})", v.to_bits()), format!("self.{field}.to_bits()"))
                }
            };
            writeln!(self.code, "    pub {}: {ty},", identifier(&field)?)?;
            writeln!(defaults, "            {field}: {default},")?;
            writeln!(entries, "            ({}, {bits}),", constant.id)?;
        }
        write!(
            self.code,
            "}}

#[allow(clippy::derivable_impls)] // where every default happens to be zero
impl Default for {name}Constants {{
    fn default() -> Self {{
        Self {{
{defaults}        }}
    }}
}}

impl Constants for {name}Constants {{
    fn entries(&self) -> Vec<(u32, u32)> {{
        vec![
{entries}        ]
    }}
}}
"
        )?;
        Ok(format!("{name}Constants"))
    }
}

fn rust_type(ty: &Type) -> String {
    match ty {
        Type::U32 => "u32".to_owned(),
        Type::I32 => "i32".to_owned(),
        Type::F32 => "f32".to_owned(),
        Type::U64 => "u64".to_owned(),
        Type::Array(element, length) => format!("[{}; {length}]", rust_type(element)),
        Type::Struct(name) => name.clone(),
    }
}

/// The name, if it can be a Rust field.
fn identifier(name: &str) -> Result<&str> {
    const KEYWORDS: [&str; 12] =
        ["as", "fn", "impl", "let", "loop", "match", "mod", "move", "ref", "self", "type", "where"];
    if name.is_empty() || KEYWORDS.contains(&name) {
        bail!("`{name}` cannot name a Rust field");
    }
    Ok(name)
}

fn pascal_case(stem: &str) -> String {
    let words = stem.split('_').filter(|w| !w.is_empty());
    words.map(|w| w[..1].to_uppercase() + &w[1..]).collect()
}
