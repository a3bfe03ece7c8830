//! Compiles `glsl/*/*.comp` to SPIR-V and writes one typed Rust interface per shader to `OUT_DIR/shaders.rs`, in one
//! module per folder.
//!
//! A shader declares its own interface; this turns it into a marker type, a bindings struct, a push-constant struct and
//! a struct of specialization constants, so that a forgotten or mistyped buffer does not compile. The `const uint` and
//! `const float` values of a folder's headers (`*.glsl`) become Rust constants of the same names.

use std::collections::BTreeMap;
use std::collections::hash_map::DefaultHasher;
use std::ffi::OsString;
use std::fmt::Write as _;
use std::fs;
use std::hash::{Hash, Hasher};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use anyhow::{Context, Result, bail, ensure};
use shaderc::Compiler;

#[path = "src/gpu/glsl.rs"]
mod glsl;
#[path = "src/gpu/spirv.rs"]
mod spirv;
use glsl::{Modules, Preprocessed};
use spirv::{Interface, Kind, Member, Struct, Type, Value};

const SHADER_FOLDER: &str = "glsl";
/// The first bytes of a module.
const SPIRV_MAGIC: [u8; 4] = 0x0723_0203_u32.to_le_bytes();

fn main() {
    if let Err(error) = run() {
        eprintln!("{error:#}");
        std::process::exit(1);
    }
}

fn run() -> Result<()> {
    println!("cargo::rerun-if-changed={SHADER_FOLDER}");
    let out = PathBuf::from(std::env::var("OUT_DIR")?);
    let mut shaders = all_compiled(&out)?;
    let mut generated = Generated::default();
    for folder in sorted_entries(Path::new(SHADER_FOLDER))? {
        for header in sorted_entries(&folder)?.iter().filter(|path| has_ending(path, "glsl")) {
            generated.header_constants(&fs::read_to_string(header)?).with_context(|| header.display().to_string())?;
        }
    }
    generated.shared_constants()?;
    for folder in sorted_entries(Path::new(SHADER_FOLDER))? {
        let module = stem(&folder)?.to_owned();
        let files = sorted_entries(&folder)?;
        writeln!(generated.modules, "\n/// The shaders and constants of `{SHADER_FOLDER}/{module}/`.")?;
        // Numbers stay as GLSL has them.
        writeln!(generated.modules, "#[allow(clippy::approx_constant, clippy::excessive_precision)]")?;
        writeln!(generated.modules, "pub mod {module} {{\n    use super::*;\n")?;
        for header in files.iter().filter(|path| has_ending(path, "glsl")) {
            for declaration in glsl::numbers(&fs::read_to_string(header)?) {
                writeln!(generated.modules, "    {declaration}")?;
            }
        }
        for source in files.iter().filter(|path| has_ending(path, "comp")) {
            let stem = stem(source)?;
            let place = || source.display().to_string();
            let Shader { preprocessed, named, optimized } = shaders.remove(source).with_context(place)?;
            let interface = spirv::reflect(&named).with_context(place)?;
            let fingerprint = preprocessed.fingerprint(&interface);
            generated.shader((&module, stem), &interface, &optimized, fingerprint).with_context(place)?;
        }
        writeln!(generated.modules, "}}")?;
        generated.known.clear();
    }
    write_if_changed(&out.join("shaders.rs"), (generated.structs_code + &generated.modules).as_bytes())
}

fn sorted_entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut paths = entries.map(|entry| Ok(entry?.path())).collect::<Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

fn has_ending(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|e| e == ending)
}

fn stem(path: &Path) -> Result<&str> {
    path.file_stem().and_then(|s| s.to_str()).context("a shader's name is not UTF-8")
}

/// A shader that is compiled.
struct Shader {
    preprocessed: Preprocessed,
    /// The words of the unoptimized module.
    named: Vec<u32>,
    /// The path of the optimized module.
    optimized: PathBuf,
}

/// Compiles all shaders, on as many threads as Cargo has jobs.
fn all_compiled(out: &Path) -> Result<BTreeMap<PathBuf, Shader>> {
    let mut sources = Vec::new();
    for folder in sorted_entries(Path::new(SHADER_FOLDER))? {
        sources.extend(sorted_entries(&folder)?.into_iter().filter(|path| has_ending(path, "comp")));
    }
    let versions = compiler_versions();
    let (jobs, next) = (std::env::var("NUM_JOBS")?.parse::<usize>()?, AtomicUsize::new(0));
    let work = || {
        let (compiler, mut shaders) = (Compiler::new()?, Vec::new());
        while let Some(source) = sources.get(next.fetch_add(1, Ordering::Relaxed)) {
            shaders.push((source.clone(), compiled(&compiler, source, &versions, out)?));
        }
        Ok(shaders)
    };
    let parts = thread::scope(|threads| {
        let running: Vec<_> = (0..jobs.min(sources.len())).map(|_| threads.spawn(work)).collect();
        running.into_iter().map(|thread| thread.join().expect("the compiler panicked")).collect::<Result<Vec<_>>>()
    })?;
    Ok(parts.into_iter().flatten().collect())
}

/// Compiles a shader, unless there are modules of the same preprocessed source from an earlier build, or from one with
/// other features.
fn compiled(compiler: &Compiler, source: &Path, versions: &impl Hash, out: &Path) -> Result<Shader> {
    let preprocessed = glsl::preprocess(compiler, Path::new(SHADER_FOLDER), source)?;
    let mut hasher = DefaultHasher::new();
    (&preprocessed.text, include_str!("src/gpu/glsl.rs"), versions).hash(&mut hasher);
    let module = source.parent().context("a shader lies in no folder")?;
    let name = format!("{}.{}.{:016x}", stem(module)?, stem(source)?, hasher.finish());
    let [named, optimized] = ["named", "optimized"].map(|kind| out.join(format!("{name}.{kind}.spv")));
    if !named.exists() || !optimized.exists() {
        let modules = match found(out, [&named, &optimized]) {
            Some(modules) => modules,
            None => {
                let Modules { named, optimized } = glsl::compile(compiler, Path::new(SHADER_FOLDER), source)?;
                [named, optimized].map(|words| words.into_iter().flat_map(u32::to_le_bytes).collect())
            }
        };
        for (path, bytes) in [&named, &optimized].into_iter().zip(modules) {
            let unfinished = path.with_extension("part");
            fs::write(&unfinished, bytes)?;
            fs::rename(&unfinished, path)?;
        }
    }
    let named = fs::read(&named)?.chunks_exact(4).map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
    Ok(Shader { preprocessed, named, optimized })
}

/// What tells one version of shaderc from another: its entries in Cargo.lock, and whose library is linked.
fn compiler_versions() -> (Vec<String>, [Option<OsString>; 2]) {
    let lock = fs::read_to_string("Cargo.lock").unwrap_or_default();
    let packages = lock.split("[[package]]").filter(|package| package.contains("name = \"shaderc"));
    let variables = ["CARGO_FEATURE_BUILD_SHADERC", "SHADERC_LIB_DIR"].map(std::env::var_os);
    (packages.map(str::to_owned).collect(), variables)
}

/// The modules of these file names that a build with other features made: Cargo gives each a folder beside that of
/// `out`.
fn found(out: &Path, modules: [&Path; 2]) -> Option<[Vec<u8>; 2]> {
    let builds = fs::read_dir(out.parent()?.parent()?).ok()?.flatten();
    builds.into_iter().find_map(|build| {
        let read = |path: &Path| fs::read(build.path().join("out").join(path.file_name()?)).ok();
        let is_whole = |bytes: &Vec<u8>| bytes.starts_with(&SPIRV_MAGIC) && bytes.len().is_multiple_of(4);
        let [named, optimized] = modules.map(|path| read(path).filter(is_whole));
        Some([named?, optimized?])
    })
}

fn write_if_changed(path: &Path, bytes: &[u8]) -> Result<()> {
    if fs::read(path).is_ok_and(|old| old == bytes) {
        return Ok(());
    }
    Ok(fs::write(path, bytes)?)
}

#[derive(Default)]
struct Generated {
    /// Code of the structs that shaders of several folders share.
    structs_code: String,
    structs: Vec<(String, Struct)>,
    /// Code of the modules, one per folder.
    modules: String,
    /// Name and GLSL type of every specialization constant that a header declares, in lower case.
    header_constants: BTreeMap<String, String>,
    /// Bodies of the structs of the current module, by name: an equal body becomes a type alias.
    known: Vec<(String, String)>,
}

impl Generated {
    /// Notes the specialization constants of a header: several shaders share them.
    fn header_constants(&mut self, header: &str) -> Result<()> {
        for line in header.lines().filter(|line| line.starts_with("layout(constant_id")) {
            let declaration = line.split_once("const ").and_then(|(_, rest)| rest.split_once(" = "));
            let (ty, name) =
                declaration.and_then(|(d, _)| d.split_once(' ')).context("not a specialization constant")?;
            let known = self.header_constants.insert(name.to_lowercase(), ty.to_owned());
            ensure!(known.is_none_or(|known| known == ty), "{name} has two types");
        }
        Ok(())
    }

    /// Writes the struct of all specialization constants that headers declare.
    fn shared_constants(&mut self) -> Result<()> {
        writeln!(
            self.structs_code,
            "\n/// The specialization constants that headers declare, so that shaders share them.\n\
             #[derive(Clone, Copy, Debug, PartialEq)]"
        )?;
        writeln!(self.structs_code, "pub struct SharedConstants {{")?;
        for (name, ty) in &self.header_constants {
            let ty = match ty.as_str() {
                "bool" => "bool",
                "uint" => "u32",
                "float" => "f32",
                other => bail!("{name} is a {other}"),
            };
            writeln!(self.structs_code, "    pub {}: {ty},", identifier(name)?)?;
        }
        Ok(writeln!(self.structs_code, "}}")?)
    }

    fn shader(
        &mut self,
        (module, stem): (&str, &str),
        interface: &Interface,
        spirv: &Path,
        fingerprint: u64,
    ) -> Result<()> {
        for structure in &interface.structs {
            self.shared_struct(&format!("{module}/{stem}"), structure)?;
        }
        let name = pascal_case(stem);
        self.bindings(&name, interface)?;
        let push = match &interface.push {
            Some(members) => {
                let body = plain_struct_body(members)?;
                self.type_of_module(&name, "Push", &body, |ty| {
                    format!("/// Push constants of [`{name}`].\n{PLAIN}\npub struct {ty} {{\n{body}}}\n")
                });
                format!("{name}Push")
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
                "        Binding {{ number: {number}, name: \"{name}\", count: {count}, kind: BindingKind::{kind}, \
                 reads: {reads}, writes: {writes} }},\n"
            )
        });
        let bindings: String = bindings.collect();
        let [x, y, z] = interface.workgroup;
        write!(
            self.modules,
            "
/// `{SHADER_FOLDER}/{module}/{stem}.comp`.
pub struct {name};

// SAFETY: build.rs reflected the interface from this very module.
#[allow(unsafe_code)]
unsafe impl Shader for {name} {{
    const NAME: &'static str = \"{stem}\";
    const PATH: &'static str = \"{module}/{stem}.comp\";
    const SPIRV: &'static [u8] = include_bytes!({spirv:?});
    const INTERFACE: u64 = {fingerprint:#x};
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

    /// Writes the type `shader` + `kind` into the current module, or an alias if a type of this kind and body exists.
    fn type_of_module(&mut self, shader: &str, kind: &'static str, body: &str, code: impl Fn(&str) -> String) {
        let name = format!("{shader}{kind}");
        let lifetime = if kind == "Bindings" { "<'a>" } else { "" };
        match self.known.iter().find(|(known, text)| text == body && known.ends_with(kind)) {
            Some((twin, _)) => {
                self.modules +=
                    &format!("\n/// The same as [`{twin}`].\npub type {name}{lifetime} = {twin}{lifetime};\n");
            }
            None => {
                self.modules += &format!("\n{}", code(&name));
                self.known.push((name, body.to_owned()));
            }
        }
    }

    /// A struct that shaders of several folders may declare: written once, and refused when two declarations differ.
    fn shared_struct(&mut self, shader: &str, structure: &Struct) -> Result<()> {
        if let Some((owner, known)) = self.structs.iter().find(|(_, s)| s.name == structure.name) {
            ensure!(known == structure, "struct `{}` differs from the one in {owner}.comp", structure.name);
            return Ok(());
        }
        self.structs.push((shader.to_owned(), structure.clone()));
        let (name, body) = (&structure.name, plain_struct_body(&structure.members)?);
        write!(
            self.structs_code,
            "\n/// `{name}` as the shaders lay it out.\n{PLAIN}\npub struct {name} {{\n{body}}}\n"
        )?;
        // A struct of one kind of number can be the element of a buffer.
        if let Some(scalar) = self.scalar(&Type::Struct(name.clone())) {
            let implementation = format!("const SCALAR: Scalar = Scalar::{scalar};");
            writeln!(self.structs_code, "\nimpl Element for {name} {{\n    {implementation}\n}}")?;
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

    fn bindings(&mut self, shader: &str, interface: &Interface) -> Result<()> {
        let (mut fields, mut visits) = (String::new(), String::new());
        for binding in &interface.bindings {
            let field = identifier(&binding.name)?;
            let one = match &binding.kind {
                Kind::Buffer(element) => format!("&'a Buffer<{}>", rust_type(element)),
                Kind::Image => "&'a Image".to_owned(),
            };
            match binding.count {
                1 => {
                    writeln!(fields, "    pub {field}: {one},")?;
                    writeln!(visits, "        bind(self.{field}.resource());")?;
                }
                count => {
                    writeln!(fields, "    pub {field}: [{one}; {count}],")?;
                    writeln!(
                        visits,
                        "        for element in self.{field} {{\n            bind(element.resource());\n        }}"
                    )?;
                }
            }
        }
        self.type_of_module(shader, "Bindings", &fields, |name| {
            format!(
                "/// The resources that [`{shader}`] reads and writes.
#[derive(Clone, Copy)]
pub struct {name}<'a> {{
{fields}}}

// SAFETY: the fields are those that build.rs reflected, in the order of their binding numbers.
#[allow(unsafe_code)]
unsafe impl Bindings for {name}<'_> {{
    fn each(&self, bind: &mut dyn FnMut(Resource)) {{
{visits}    }}
}}
"
            )
        });
        Ok(())
    }

    /// Writes the struct of specialization constants, if there are any, and returns its type.
    fn constants(&mut self, shader: &str, interface: &Interface) -> Result<String> {
        if interface.constants.is_empty() {
            return Ok("()".to_owned());
        }
        let (mut fields, mut defaults, mut entries) = (String::new(), String::new(), String::new());
        let mut shared = String::new();
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
            if self.header_constants.contains_key(&field) {
                writeln!(shared, "            {field}: shared.{field},")?;
            }
            writeln!(fields, "    pub {}: {ty},", identifier(&field)?)?;
            writeln!(defaults, "            {field}: {default},")?;
            writeln!(entries, "            ({}, {bits}),", constant.id)?;
        }
        self.type_of_module(shader, "Constants", &format!("{fields}{defaults}{entries}"), |name| {
            format!(
                "/// The specialization constants of [`{shader}`]; the defaults are the shader's.
#[derive(Clone, Copy, Debug)]
pub struct {name} {{
{fields}}}

#[allow(clippy::derivable_impls)] // where every default happens to be zero
impl Default for {name} {{
    fn default() -> Self {{
        Self {{
{defaults}        }}
    }}
}}

impl {name} {{
    /// The values of `shared`, and the shader's defaults for its own constants.
    #[allow(clippy::needless_update, unused_variables)] // where all constants are shared, or none
    pub fn of(shared: &SharedConstants) -> Self {{
        Self {{
{shared}            ..Self::default()
        }}
    }}
}}

// SAFETY: the numbers and types are those that build.rs reflected.
#[allow(unsafe_code)]
unsafe impl Constants for {name} {{
    fn entries(&self) -> Vec<(u32, u32)> {{
        vec![
{entries}        ]
    }}
}}
"
            )
        });
        Ok(format!("{shader}Constants"))
    }
}

/// The attributes of a struct that is copied to the GPU as it lies in memory.
const PLAIN: &str = "#[repr(C)]\n#[derive(Clone, Copy, Debug, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]";

fn plain_struct_body(members: &[Member]) -> Result<String> {
    members
        .iter()
        .map(|Member { name, ty }| Ok(format!("    pub {}: {},\n", identifier(name)?, rust_type(ty))))
        .collect()
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
