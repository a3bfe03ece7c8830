//! What single operations cost in a shader: `cargo bench --bench micro`. With `-- --caches FOLDER` it writes the
//! pipeline cache of each operation instead, whose machine code `benches/machine_code.py` shows.
//!
//! Every operation is applied in long chains, which fill the device. Its time is that of one application by one
//! subgroup, in multiples of that of an f32 fma; its code is the growth of the shader by one more application.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use smalto::cli::environment::Environment;
use smalto::gpu::{
    Access, Buffer, CachedPipelines, Commands, Device, DeviceKind, DispatchSize, Element, Feature, Shader, Stage,
    Validation,
};
use smalto::measure::bench::Statistics;
use smalto::render::flushes_denormals;
use smalto::render::shaders::bench::*;

/// The cases of `glsl/bench/micro.comp`, in their order. The first is the unit of time.
const OF_FLOATS: [&str; 12] = [
    "f32 fma",
    "f32 exp2",
    "f32 fma, exp2 (threshold by flush)",
    "f32 fma, compare, exp2, select",
    "packHalf2x16",
    "unpackHalf2x16, add",
    "shuffleXor, mul",
    "shuffle, mul",
    "compare, any, mul, select",
    "workgroup load of 4 bytes, add",
    "workgroup load of 8 bytes, fma",
    "workgroup load of 16 bytes, 2 fma, add",
];

/// The cases of `glsl/bench/micro_half.comp`, in their order.
const OF_HALVES: [&str; 8] = [
    "f16vec2 fma",
    "f16vec2 fma of .xx and .yy",
    "f16vec2 max(a, -a), add",
    "f16vec2 .yx, add",
    "f16vec2 exp2",
    "f16vec2 fma, mix by a comparison",
    "f16vec2 fma, step, mul",
    "f16vec2 fma, saturated fma, mul",
];

/// Applications of an operation to each value in the loops whose code is compared; the second is timed.
const UNROLLED: [u32; 2] = [MOST_UNROLLED / 2, MOST_UNROLLED];

/// Sizes of workgroup memory, words.
const WORDS: [u32; 9] = [128, 1024, 1536, 2048, 2560, 3072, 4096, 6144, 8192];

/// The amount of work that is timed: enough to fill a GPU, little for a CPU.
#[derive(Clone, Copy)]
struct Load {
    groups: u64,
    rounds: u32,
    repeats: usize,
    warm_up: Duration,
}

impl Load {
    fn of(device: &Device) -> Self {
        match device.capabilities().kind {
            DeviceKind::Cpu => Self { groups: 4, rounds: 2, repeats: 3, warm_up: Duration::ZERO },
            _ => Self { groups: 8192, rounds: 32, repeats: 15, warm_up: Duration::from_millis(200) },
        }
    }
}

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip_while(|argument| argument != "--caches").skip(1);
    if let Some(folder) = arguments.next() {
        fs::create_dir_all(&folder)?;
        write_caches::<Micro>(Path::new(&folder), &OF_FLOATS)?;
        return match open()?.capabilities().has(Feature::HalfFloats) {
            true => write_caches::<MicroHalf>(Path::new(&folder), &OF_HALVES),
            false => Ok(()),
        };
    }
    let device = open()?;
    let load = Load::of(&device);
    println!("{}, {}", device.capabilities().name, device.capabilities().driver);
    let mut operations = operations_of::<Micro>(&device, load, &OF_FLOATS)?;
    if device.capabilities().has(Feature::HalfFloats) {
        operations.extend(operations_of::<MicroHalf>(&device, load, &OF_HALVES)?);
    }
    warm_up(&device, load, &operations)?;
    print_operations(&device, load, &operations)?;
    print_occupancy(&device, load)?;
    print_arithmetic(&device)
}

fn open() -> Result<Device> {
    let environment = Environment::read()?;
    Device::open(&environment.device, environment.validation.unwrap_or(Validation::Off))?
        .with_shaders(environment.shaders.as_deref())
}

fn upload<T: Element>(device: &Device, name: &str, content: &[T]) -> Result<Buffer<T>> {
    let buffer = Buffer::new(device, name, content.len())?;
    let mut cmd = Commands::new(device)?;
    cmd.upload(&buffer, 0, content.len(), |memory| memory.copy_from_slice(content))?;
    cmd.submit()?.wait()?;
    Ok(buffer)
}

/// Numbers from 0.5 to 1, most of which no 16-bit float has.
fn numbers(device: &Device) -> Result<Buffer<f32>> {
    let numbers: Vec<f32> = (0..512).map(|i| 0.5 + (i * 37 % 512) as f32 / 1023.0).collect();
    upload(device, "numbers", &numbers)
}

/// Times a dispatch: the median of the load's repeats, ms.
fn median_ms(device: &Device, load: Load, record: impl Fn(&mut Commands)) -> Result<f64> {
    let once = |_| {
        let mut cmd = Commands::new(device)?;
        cmd.scope("operation", |cmd| record(cmd));
        let results = cmd.submit()?.wait()?;
        Ok(results.timings().first().context("the operation was not timed")?.duration_ms)
    };
    Ok(Statistics::of((0..load.repeats).map(once).collect::<Result<Vec<_>>>()?).median)
}

/// An operation that is ready to run.
struct Operation {
    name: &'static str,
    /// Bytes of machine code of one application, if the driver reports the size of shaders.
    code_bytes: Option<f64>,
    record: Box<dyn Fn(&mut Commands)>,
}

fn operations_of<S>(device: &Device, load: Load, names: &[&'static str]) -> Result<Vec<Operation>>
where
    S: for<'a> Shader<Bindings<'a> = MicroBindings<'a>, Push = MicroPush, Constants = MicroConstants> + 'static,
{
    let operation = |(number, name): (usize, &&'static str)| {
        let build = |unrolled| -> Result<_> {
            device.record_executables();
            let stage = Stage::<S>::new(device, &MicroConstants { operation: number as u32, unrolled })?;
            let executables = device.take_executables();
            let statistics = executables.iter().flat_map(|executable| &executable.statistics);
            let size = statistics.filter(|(name, _)| name == "Binary Size").find_map(|(_, value)| value.parse().ok());
            Ok((stage, size))
        };
        let ((_, small), (stage, large)) = (build(UNROLLED[0])?, build(UNROLLED[1])?);
        let bytes_each = |(small, large): (f64, f64)| (large - small) / f64::from(CHAINS * (UNROLLED[1] - UNROLLED[0]));
        let numbers = numbers(device)?;
        let results = Buffer::new(device, "results", load.groups as usize * S::WORKGROUP[0] as usize)?;
        let record = move |cmd: &mut Commands| {
            let bindings = MicroBindings { numbers: &numbers, results: &results };
            cmd.dispatch(&stage, bindings, MicroPush { rounds: load.rounds }, DispatchSize::Groups(load.groups));
        };
        Ok(Operation { name, code_bytes: small.zip(large).map(bytes_each), record: Box::new(record) })
    };
    names.iter().enumerate().map(operation).collect()
}

/// Keeps the device busy until its clock is that of a busy device.
fn warm_up(device: &Device, load: Load, operations: &[Operation]) -> Result<()> {
    let begun = Instant::now();
    while begun.elapsed() < load.warm_up {
        median_ms(device, load, &operations[0].record)?;
    }
    Ok(())
}

fn print_operations(device: &Device, load: Load, operations: &[Operation]) -> Result<()> {
    let subgroups = load.groups * u64::from(Micro::WORKGROUP[0] / device.capabilities().subgroup_size[0]);
    let applications = subgroups as f64 * f64::from(load.rounds * CHAINS * UNROLLED[1]);
    println!("\n{:<42} {:>14} {:>12} {:>12}", "operation", "billions a s", "f32 fma", "code, bytes");
    let mut unit = None;
    for Operation { name, code_bytes, record } in operations {
        let ms = median_ms(device, load, record)?;
        let code = code_bytes.map_or("-".to_owned(), |bytes| format!("{bytes:.0}"));
        let multiple = ms / *unit.get_or_insert(ms);
        println!("{name:<42} {:>14.3} {multiple:>12.2} {code:>12}", applications / (ms * 1e6));
    }
    Ok(())
}

/// Prints how many workgroups run at the same time, by their memory: all of a dispatch, times the share of its time
/// that one workgroup alone takes.
fn print_occupancy(device: &Device, load: Load) -> Result<()> {
    let lanes = Occupancy::WORKGROUP[0];
    let numbers = upload(device, "numbers", &vec![0_u32; lanes as usize])?;
    let results = Buffer::new(device, "results", load.groups as usize * lanes as usize)?;
    println!("\n{:<42} {:>30}", "workgroup memory, bytes", format!("workgroups of {lanes} in flight"));
    for words in WORDS.into_iter().filter(|words| 4 * words <= device.capabilities().limits.workgroup_memory) {
        let stage = Stage::<Occupancy>::new(device, &OccupancyConstants { words })?;
        let time = |groups| {
            median_ms(device, load, |cmd| {
                let bindings = OccupancyBindings { numbers: &numbers, results: &results };
                let push = OccupancyPush { rounds: 64 * load.rounds };
                cmd.dispatch(&stage, bindings, push, DispatchSize::Groups(groups));
            })
        };
        println!("{:<42} {:>30.0}", 4 * words, load.groups as f64 * time(1)? / time(load.groups)?);
    }
    Ok(())
}

/// Prints how the device deviates from the arithmetic of IEEE 754.
fn print_arithmetic(device: &Device) -> Result<()> {
    let (stage, lanes) = (Stage::<Folds>::new(device, &())?, Folds::WORKGROUP[0] as usize);
    let (numbers, results) = (numbers(device)?, Buffer::new(device, "results", lanes)?);
    let mut cmd = Commands::new(device)?;
    cmd.dispatch(&stage, FoldsBindings { numbers: &numbers, results: &results }, (), DispatchSize::Groups(1));
    cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
    let read = cmd.read(&results)?;
    let results = cmd.submit()?.wait()?;
    let results = results.view(&read);
    let yes = |holds: bool| if holds { "yes" } else { "no" };
    println!("\nexp2 flushes denormal numbers: {}", yes(flushes_denormals(device)?));
    println!("a - unpack(pack(a)) is taken for 0: {}", yes(results.iter().all(|[rest, _]| *rest == 0.0)));
    println!("fma(-K, exp2(e) * K, K) overflows: {}", yes(results.iter().any(|[_, left]| !left.is_finite())));
    Ok(())
}

/// Writes the pipeline cache of each operation to `folder`.
fn write_caches<S: Shader<Constants = MicroConstants>>(folder: &Path, names: &[&str]) -> Result<()> {
    for (number, name) in names.iter().enumerate() {
        let words: Vec<&str> = name.split(|c: char| !c.is_alphanumeric()).filter(|word| !word.is_empty()).collect();
        let path = folder.join(words.join("_") + ".cache");
        let device = open()?.with_pipeline_cache(CachedPipelines::default(), move |now| {
            if let Err(error) = fs::write(&path, &now.pipelines) {
                eprintln!("{}: {error}", path.display());
            }
        });
        Stage::<S>::new(&device, &MicroConstants { operation: number as u32, unrolled: UNROLLED[1] })?;
    }
    Ok(())
}
