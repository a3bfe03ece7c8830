//! The checks themselves: each reports the fault that it is for. And promises of the GPU layer.

use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};

use crate::common::{Gpu, Turn, compare, open};
use glam::DVec3;
use smalto::camera::Camera;
use smalto::gpu::{
    Access, Buffer, Commands, Device, DeviceChoice, DispatchSize, Stage, Staging, Timestamps, Unavailable, Validation,
};
use smalto::host_memory::OutOfMemory;
use smalto::options::Options;
use smalto::procedural::cactus;
use smalto::reference;
use smalto::render::shaders::portable::{Ranges, RangesBindings, TileOrder, TileOrderBindings, TileOrderPush};
use smalto::render::*;
use smalto::rules::Background;

/// A device of the test's own, whose validation messages do not fail it.
fn device_with_complaints() -> (Device, Turn) {
    let turn = Turn::take();
    (open(Validation::Required), turn)
}

/// The messages about these commands. Each call opens a device of its own.
fn complaints(record: impl FnOnce(&Fixture, &mut Commands)) -> Vec<String> {
    let (device, _turn) = device_with_complaints();
    let fixture = Fixture {
        ranges: Stage::new(&device, &()).unwrap(),
        tile_order: Stage::new(&device, &()).unwrap(),
        totals: Buffer::new(&device, "totals", 1).unwrap(),
        tile_keys: Buffer::new(&device, "tile keys", 64).unwrap(),
        tile_ranges: Buffer::new(&device, "ranges", 4).unwrap(),
        tiles_by_class: Buffer::new(&device, "tiles by class", 24).unwrap(),
        groups: Buffer::new(&device, "groups", 3).unwrap(),
    };
    // Recorded, not run: what a missing barrier does on the GPU is undefined.
    let mut cmd = Commands::new(&device).unwrap();
    record(&fixture, &mut cmd);
    own(&device.validation_messages())
}

/// The messages of our own check; a validation layer may report the same.
fn own(complaints: &[String]) -> Vec<String> {
    complaints.iter().filter(|c| c.starts_with("no barrier on")).cloned().collect()
}

struct Fixture {
    ranges: Stage<Ranges>,
    tile_order: Stage<TileOrder>,
    totals: Buffer<Totals>,
    tile_keys: Buffer<u32>,
    tile_ranges: Buffer<[u32; 2]>,
    tiles_by_class: Buffer<u32>,
    groups: Buffer<u32>,
}

impl Fixture {
    fn write_ranges(&self, cmd: &mut Commands) {
        let bindings = RangesBindings { totals: &self.totals, tile_keys: &self.tile_keys, ranges: &self.tile_ranges };
        cmd.dispatch(&self.ranges, bindings, (), DispatchSize::Invocations(64));
    }

    fn read_ranges(&self, cmd: &mut Commands) {
        let (ranges, tiles_by_class, totals) = (&self.tile_ranges, &self.tiles_by_class, &self.totals);
        let bindings = TileOrderBindings { ranges, tiles_by_class, totals };
        cmd.dispatch(&self.tile_order, bindings, TileOrderPush { tiles: 4 }, DispatchSize::Invocations(4));
    }
}

#[test]
fn a_missing_barrier_between_stages_is_reported() {
    let found = complaints(|f, cmd| {
        f.write_ranges(cmd);
        f.read_ranges(cmd);
    });
    let expected = [
        "no barrier on `ranges` between ranges and tile_order",
        "no barrier on `totals` between ranges and tile_order",
    ];
    assert_eq!(found, expected);
}

#[test]
fn a_barrier_between_stages_is_enough() {
    let found = complaints(|f, cmd| {
        f.write_ranges(cmd);
        cmd.barrier(Access::SHADER_WRITE, Access::SHADER);
        f.read_ranges(cmd);
    });
    assert_eq!(found, Vec::<String>::new());
}

#[test]
fn a_barrier_of_the_wrong_kind_is_reported() {
    for (from, to) in [
        (Access::COPY_WRITE, Access::SHADER),
        (Access::SHADER_WRITE, Access::COPY_READ),
        (Access::SHADER_WRITE, Access::INDIRECT),
        (Access::SHADER_READ, Access::SHADER_READ),
    ] {
        let found = complaints(|f, cmd| {
            f.write_ranges(cmd);
            cmd.barrier(from, to);
            f.read_ranges(cmd);
        });
        assert!(found.contains(&"no barrier on `ranges` between ranges and tile_order".to_owned()), "{from:?} {to:?}");
    }
}

#[test]
fn a_missing_barrier_around_copies_and_indirect_counts_is_reported() {
    let found = complaints(|f, cmd| {
        cmd.fill(&f.tile_keys, 0);
        f.write_ranges(cmd);
    });
    assert_eq!(found, ["no barrier on `tile keys` between fill and ranges"]);
    let found = complaints(|f, cmd| {
        f.write_ranges(cmd);
        cmd.read(&f.tile_ranges).unwrap();
    });
    assert_eq!(found, ["no barrier on `ranges` between ranges and read back"]);
    let found = complaints(|f, cmd| {
        f.write_ranges(cmd);
        cmd.fill(&f.tile_keys, 0);
    });
    assert_eq!(found, ["no barrier on `tile keys` between ranges and fill"], "a read before a write");
    let found = complaints(|f, cmd| {
        cmd.fill(&f.groups, 1);
        cmd.barrier(Access::COPY_WRITE, Access::SHADER);
        let bindings = RangesBindings { totals: &f.totals, tile_keys: &f.tile_keys, ranges: &f.tile_ranges };
        cmd.dispatch_indirect(&f.ranges, bindings, (), &f.groups, 0);
    });
    assert_eq!(found, ["no barrier on `groups` between fill and ranges"]);
}

/// Ranges that are uploaded together need no barriers between them, and arrive where they belong.
#[test]
fn ranges_are_uploaded_to_their_places() {
    let device = open(Validation::Required);
    let (buffer, values) = (Buffer::<u32>::new(&device, "words", 64).unwrap(), (100..164).collect::<Vec<u32>>());
    let mut cmd = Commands::new(&device).unwrap();
    cmd.fill(&buffer, 7);
    cmd.barrier(Access::COPY_WRITE, Access::COPY_WRITE);
    cmd.upload_ranges(&buffer, &values, &[0..3, 10..10, 10..20, 63..64]).unwrap();
    cmd.barrier(Access::COPY_WRITE, Access::COPY_READ);
    let read = cmd.read(&buffer).unwrap();
    let results = cmd.submit().unwrap().wait().unwrap();
    let expected = (0..64).map(|i| if i < 3 || (10..20).contains(&i) || i == 63 { 100 + i } else { 7 });
    assert_eq!(results.view(&read), expected.collect::<Vec<u32>>());
    let mut cmd = Commands::new(&device).unwrap();
    cmd.upload_ranges(&buffer, &values, &[]).unwrap();
    cmd.submit().unwrap().wait().unwrap();
    assert_eq!(device.validation_messages(), Vec::<String>::new());
}

/// Every barrier of a frame is there for a reason, and the check knows it.
#[test]
fn every_barrier_of_a_frame_is_needed() {
    let scene = cactus(300).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [48, 48], 0.9);
    for (portable, least) in [(true, 20), (false, 6)] {
        let (device, _turn) = device_with_complaints();
        let options = Options { portable, ..Options::EXACT };
        let scene = GpuScene::new(&device, &scene, &options).unwrap();
        let mut still = Renderer::new(&device, &options, &scene).unwrap();
        let mut render = |overlooked: Option<usize>| {
            let before = device.validation_messages().len();
            let prepare = |cmd: &mut Commands| {
                if let Some(number) = overlooked {
                    cmd.overlook_barrier(number);
                }
            };
            let (_, results) = still.render_with(&camera, Background::BLACK, prepare).unwrap();
            (device.validation_messages().split_off(before), results.barriers())
        };
        let (none, barriers) = render(None);
        assert_eq!(none, Vec::<String>::new());
        assert!(barriers > least, "{barriers} barriers");
        // The last two lead to the host: from the frame to the copy of the totals, which is checked, and to the host.
        for number in 0..barriers - 1 {
            let (found, _) = render(Some(number));
            assert!(!own(&found).is_empty(), "barrier {number} of {barriers}: {found:?}");
        }
    }
}

#[test]
fn a_validation_message_fails_its_test() {
    let outcome = catch_unwind(|| {
        let gpu = Gpu::own();
        let buffer = Buffer::<u32>::new(&gpu.0, "buffer", 4).unwrap();
        gpu.run(|cmd| {
            cmd.fill(&buffer, 1);
            cmd.fill(&buffer, 2);
        });
    });
    assert!(outcome.is_err());
}

#[test]
fn a_changed_pixel_fails_the_comparison() {
    let gpu = Gpu::new();
    let scene = cactus(500).unwrap().gaussians;
    let camera = Camera::looking_at(DVec3::new(1.5, -2.5, -4.0), DVec3::new(0.0, -1.2, 0.0), [48, 48], 0.9);
    let rendering = reference::render(&scene, &camera, &Options::EXACT.rules, Background::BLACK);
    let mut pixels = gpu.render(&scene, &camera, &Options::EXACT);
    assert_eq!(compare(&pixels, &rendering).unexplained, 0);
    for value in [f32::NAN, f32::INFINITY, pixels.rgba[1000][1] + 0.02] {
        let kept = std::mem::replace(&mut pixels.rgba[1000][1], value);
        assert_eq!(compare(&pixels, &rendering).unexplained, 1, "{value}");
        pixels.rgba[1000][1] = kept;
    }
}

#[test]
fn a_command_buffer_keeps_what_it_uses() {
    let gpu = Gpu::new();
    let mut cmd = Commands::new(&gpu.0).unwrap();
    let readback = {
        let buffer = Buffer::<u32>::new(&gpu.0, "short-lived", 1000).unwrap();
        cmd.fill(&buffer, 7);
        cmd.barrier(Access::COPY_WRITE, Access::COPY_READ);
        cmd.read(&buffer).unwrap()
    };
    let results = cmd.submit().unwrap().wait().unwrap();
    assert_eq!(results.view(&readback), [7; 1000]);
}

#[test]
fn a_readback_opens_only_with_its_own_results() {
    let gpu = Gpu::new();
    let buffer = gpu.upload("buffer", &[1_u32, 2, 3]);
    let mut first = Commands::new(&gpu.0).unwrap();
    let readback = first.read(&buffer).unwrap();
    let other = Commands::new(&gpu.0).unwrap().submit().unwrap().wait().unwrap();
    assert!(catch_unwind(AssertUnwindSafe(|| other.view(&readback).len())).is_err());
    assert_eq!(first.submit().unwrap().wait().unwrap().view(&readback), [1, 2, 3]);
}

#[test]
fn a_buffer_over_the_limits_is_refused_with_its_bytes() {
    let gpu = Gpu::new();
    let limit = gpu.0.capabilities().limits.storage_range;
    let elements = (limit / 4 + 1) as usize;
    let error = Buffer::<u32>::new(&gpu.0, "too large", elements).err().expect("it does not fit");
    let refusal = error.downcast_ref::<OutOfMemory>().expect("it is a matter of memory");
    assert_eq!((refusal.name.as_str(), refusal.bytes), ("too large", Some(elements as u64 * 4)));
}

#[test]
fn a_device_that_does_not_exist_is_named() {
    let _turn = Turn::take();
    for choice in [DeviceChoice::Index(99), DeviceChoice::Name("no such device".into())] {
        let error = Device::open(&choice, Validation::Off).err().expect("there is none");
        assert!(error.is::<Unavailable>(), "{error:#}");
        assert!(error.to_string().contains("there are: 0 "), "{error:#}");
    }
}

#[test]
fn scopes_are_timed_and_the_last_one_is_marked() {
    let gpu = Gpu::new();
    let buffer = Buffer::<u32>::new(&gpu.0, "buffer", 1 << 20).unwrap();
    for (timestamps, expected) in [(Timestamps::All, vec!["inner", "outer"]), (Timestamps::Outermost, vec!["outer"])] {
        let mut cmd = Commands::new(&gpu.0).unwrap();
        cmd.set_timestamps(timestamps);
        cmd.scope("outer", |cmd| cmd.scope("inner", |cmd| cmd.fill(&buffer, 1)));
        let results = cmd.submit().unwrap().wait().unwrap();
        assert_eq!(results.timings().iter().map(|t| t.name).collect::<Vec<_>>(), expected);
        let outer = results.timings().last().unwrap();
        assert!(outer.duration_ms > 0.0 && outer.depth == 0);
        assert!(results.timings().iter().all(|t| t.duration_ms <= outer.duration_ms));
        assert_eq!(results.last_scope(), Some("inner"), "the scope a lost device would be reported in");
    }
}

#[test]
fn dispatches_over_65535_workgroups_are_folded() {
    for (groups, expected) in
        [(0, [0, 0]), (1, [1, 1]), (65_535, [65_535, 1]), (65_536, [65_535, 2]), (1 << 24, [65_535, 257])]
    {
        assert_eq!(DispatchSize::Groups(groups).groups(256), expected);
        assert_eq!(DispatchSize::Invocations(groups * 256).groups(256), expected);
    }
}

#[test]
fn captures_hold_what_a_scope_wrote() {
    let gpu = Gpu::new();
    let buffer = Buffer::<[f32; 2]>::new(&gpu.0, "pairs", 3).unwrap();
    let mut cmd = Commands::new(&gpu.0).unwrap();
    cmd.capture_scopes();
    cmd.scope("one", |cmd| cmd.fill(&buffer, 1.0_f32.to_bits()));
    cmd.barrier(Access::COPY_WRITE, Access::COPY_WRITE);
    cmd.scope("two", |cmd| cmd.fill(&buffer, 2.0_f32.to_bits()));
    let results = cmd.submit().unwrap().wait().unwrap();
    let seen = Cell::new(0);
    for (capture, (scope, value)) in results.captures().iter().zip([("one", 1.0_f32), ("two", 2.0)]) {
        assert_eq!((capture.scope(), capture.buffer()), (scope, "pairs"));
        assert_eq!(capture.element(), (smalto::gpu::Scalar::F32, 2));
        assert_eq!(bytemuck::pod_collect_to_vec::<u8, f32>(capture.bytes()), [value; 6]);
        seen.set(seen.get() + 1);
    }
    assert_eq!(seen.get(), 2);
}

#[test]
fn staging_copies_elements_both_ways() {
    let gpu = Gpu::new();
    let buffer = Buffer::<[u32; 2]>::new(&gpu.0, "pairs", 5).unwrap();
    let mut staging = Staging::<[u32; 2]>::new(&gpu.0, "staging", 5).unwrap();
    staging.map().copy_from_slice(&[[1, 2], [3, 4], [5, 6], [7, 8], [9, 10]]);
    gpu.run(|cmd| {
        cmd.fill(&buffer, 0);
        cmd.barrier(Access::COPY_WRITE, Access::COPY_WRITE);
        cmd.upload_staged(&staging, &buffer, 3);
    });
    staging.map().fill([0; 2]);
    gpu.run(|cmd| cmd.download(&buffer, &staging, 4));
    assert_eq!(staging.map(), [[1, 2], [3, 4], [5, 6], [0, 0], [0, 0]]);
}

#[test]
#[should_panic(expected = "opened when no commands use it")]
fn staging_is_not_opened_while_commands_use_it() {
    let (device, _turn) = device_with_complaints();
    let buffer = Buffer::<u32>::new(&device, "words", 1).unwrap();
    let mut staging = Staging::<u32>::new(&device, "staging", 1).unwrap();
    let mut cmd = Commands::new(&device).unwrap();
    cmd.download(&buffer, &staging, 1);
    let _in_flight = cmd.submit().unwrap();
    staging.map();
}

#[test]
#[should_panic(expected = "of one device")]
fn commands_refuse_resources_of_another_device() {
    let (device, _turn) = device_with_complaints();
    let (other, _same_turn) = device_with_complaints();
    let buffer = Buffer::<u32>::new(&other, "elsewhere", 1).unwrap();
    Commands::new(&device).unwrap().fill(&buffer, 0);
}

#[test]
fn a_device_is_closed_with_its_last_user() {
    let (device, _turn) = device_with_complaints();
    let users = device.users();
    {
        let buffer = Buffer::<u32>::new(&device, "buffer", 4).unwrap();
        let mut cmd = Commands::new(&device).unwrap();
        cmd.scope("fill", |cmd| cmd.fill(&buffer, 1));
        cmd.submit().unwrap().wait().unwrap();
        drop(Commands::new(&device).unwrap());
    }
    assert_eq!(device.users(), users, "nothing is left that keeps the device");
}
