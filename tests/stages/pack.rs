//! Pictures as integers, and frames that are drawn one after another.

use crate::common::Gpu;
use glam::DVec3;
use smalto::camera::{Camera, path};
use smalto::gpu::{Access, Commands, Image, Staging};
use smalto::options::Options;
use smalto::pixels::{Integers, Pixels};
use smalto::procedural::{Procedural, cactus};
use smalto::render::{
    Band, Capacity, Form, FrameOutputs, FrameQueue, GpuScene, HostFrame, Inspection, Look, Packer, Renderer, Unpacker,
    Work,
};
use smalto::rules::Background;

const ALL: [Integers; 4] = [Integers::Rgb8, Integers::Rgb16, Integers::Grey8, Integers::Grey16];

/// The twin: what the host makes of the same floats.
fn expected(pixels: &Pixels, integers: Integers) -> Vec<u8> {
    match integers {
        Integers::Rgb8 => pixels.to_rgb8(),
        Integers::Rgb16 => bytemuck::cast_slice(&pixels.to_rgb16()).to_vec(),
        Integers::Grey8 => pixels.alpha().to_grey8(),
        Integers::Grey16 => bytemuck::cast_slice(&pixels.alpha().to_grey16()).to_vec(),
    }
}

/// Every step and the floats next to the middle between two steps, and what is no value from 0 to 1.
fn values() -> Vec<f32> {
    let around = |middle: f32| [middle.next_down(), middle, middle.next_up()];
    let steps = |most: f32, by: usize| {
        (0..most as u32)
            .step_by(by)
            .flat_map(move |i| around((i as f32 + 0.5) / most).into_iter().chain([i as f32 / most]))
    };
    let odd = [f32::NAN, -f32::NAN, f32::INFINITY, -f32::INFINITY, -0.0, -1e-30, 1e-40, 1.0, 1.0f32.next_up(), 7.0];
    steps(255.0, 1).chain(steps(65535.0, 37)).chain(odd).collect()
}

#[test]
fn pack_rounds_like_the_host() {
    let gpu = Gpu::new();
    let values = values();
    for [width, height] in [[1, 1], [2, 1], [3, 1], [5, 7], [64, 64], [63, 65]] {
        let value = |i: usize| values[i * 7919 % values.len()];
        let pixel = |i: usize| std::array::from_fn(|channel| value(4 * i + channel));
        let pixels = Pixels { size: [width, height], rgba: (0..(width * height) as usize).map(pixel).collect() };
        let image = Image::new(&gpu.0, "image", width, height).unwrap();
        for integers in ALL {
            let mut packer = Packer::new(&gpu.0, integers).unwrap();
            packer.fit(&gpu.0, pixels.size).unwrap();
            let words = integers.words(pixels.size);
            let mut host: Staging<u32> = Staging::new(&gpu.0, "host", words).unwrap();
            let mut cmd = Commands::new(&gpu.0).unwrap();
            cmd.upload_image(&image, &pixels.rgba).unwrap();
            cmd.barrier(Access::COPY_WRITE, Access::SHADER_READ);
            let packed = packer.record(&mut cmd, &image);
            cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
            cmd.download(packed, &host, words);
            cmd.submit().unwrap().wait().unwrap();
            let (bytes, expected) = (bytemuck::cast_slice::<u32, u8>(host.map()), expected(&pixels, integers));
            assert!(bytes[..expected.len()] == expected, "{integers:?} {width}x{height}");
            assert!(bytes[expected.len()..].iter().all(|byte| *byte == 0), "{integers:?} {width}x{height}");
        }
    }
}

/// All values of 8 bits come back to the nearest floats, in bands of any place and size, and are packed to the same.
#[test]
fn unpack_is_the_inverse_of_pack() {
    let gpu = Gpu::new();
    let mut unpacker = Unpacker::new(&gpu.0).unwrap();
    for [width, height, border] in [[1, 3, 1], [5, 7, 4], [64, 64, 32], [63, 65, 64]] {
        let bands = [Band { top: 0, rows: border }, Band { top: border, rows: height - border }];
        let colour = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8;
        let colours: Vec<u8> = (0..3 * width * height).map(colour).collect();
        let (upper, lower) = colours.split_at((3 * width * border) as usize);
        // The memory of a band may be larger.
        let memory = [upper, lower].map(|bytes| {
            let mut memory: Staging<u32> = Staging::new(&gpu.0, "band", bytes.len().div_ceil(4) + 5).unwrap();
            memory.map().fill(u32::MAX);
            bytemuck::cast_slice_mut::<u32, u8>(memory.map())[..bytes.len()].copy_from_slice(bytes);
            memory
        });
        let image = Image::new(&gpu.0, "image", width, height).unwrap();
        let mut cmd = Commands::new(&gpu.0).unwrap();
        let places = [0, 1].map(|i| (bands[i], &memory[i]));
        unpacker.fit(&gpu.0, image.size(), &places).unwrap();
        unpacker.record(&mut cmd, &places, &image);
        cmd.barrier(Access::SHADER_WRITE, Access::COPY_READ);
        let pixels = cmd.read_rows(&image, 0..height).unwrap();
        let rgba = cmd.submit().unwrap().wait().unwrap().view(&pixels).to_vec();
        for (i, (pixel, colour)) in rgba.iter().zip(colours.chunks(3)).enumerate() {
            let expected: [f32; 4] =
                std::array::from_fn(|k| colour.get(k).map_or(1.0, |byte| f32::from(*byte) / 255.0));
            // The division of the device may be off by an ulp or two.
            let error =
                pixel.iter().zip(expected).map(|(found, expected)| (found - expected).abs()).fold(0.0, f32::max);
            assert!(error <= 3e-7, "pixel {i} of {width}x{height}: {pixel:?} for {expected:?}");
        }
        assert!(Pixels { size: [width, height], rgba }.to_rgb8() == colours, "{width}x{height}");
    }
}

/// Several views are in flight, and the first do not fit: the pixels are those of views that are drawn alone.
#[test]
fn frames_in_flight_have_the_pixels_of_frames_drawn_alone() {
    for portable in [false, true] {
        compare_in_flight(&Options { portable, ..Options::default() });
    }
}

fn compare_in_flight(options: &Options) {
    let gpu = Gpu::new();
    let gaussians = cactus(3000).unwrap().gaussians;
    let scene = GpuScene::new(&gpu.0, &gaussians, options).unwrap();
    let mut views = path::orbit(DVec3::new(0.0, -1.0, 0.0), 2.0, true, [97, 53], 5);
    views.extend(views.clone().into_iter().take(2).map(|view: Camera| view.resized([40, 64])));
    let tiny = Capacity { gaussians: 3000, visible: 100, spans: 100, listed: 100, cells: 1 };
    let renderer = Renderer::new(&gpu.0, options, &scene).unwrap().with_capacity(tiny).unwrap();
    let mut alone = Renderer::new(&gpu.0, options, &scene).unwrap();
    let mut stream = FrameQueue::new(&gpu.0, renderer);
    let forms = vec![Form::Integers(Integers::Rgb8), Form::Floats, Form::Integers(Integers::Grey16)];
    let wanted = |i: usize| match i % 3 {
        0 => FrameOutputs { picture: forms.clone(), depths: true, is_exported: false },
        1 => FrameOutputs { picture: forms.clone(), depths: false, is_exported: false },
        _ => FrameOutputs { picture: Vec::new(), depths: true, is_exported: false },
    };
    let start = |(i, view)| stream_start(&mut stream, view, &wanted(i));
    let in_flight: Vec<_> = views.iter().enumerate().map(start).collect();
    for (i, (view, started)) in views.iter().zip(in_flight).enumerate() {
        let mut finished = stream.finish(started).unwrap();
        let wanted = wanted(i);
        assert_eq!(finished.frames.len(), usize::from(!wanted.picture.is_empty()) + usize::from(wanted.depths));
        assert!(finished.frames.iter().all(|frame| frame.timings.iter().any(|timing| timing.name == "frame")));
        let mut drawn = |look: Look| {
            alone.set_inspection(Inspection { look, ..Inspection::default() }).unwrap();
            alone.render(view, Background::BLACK).unwrap();
            alone.pixels().unwrap()
        };
        if !wanted.picture.is_empty() {
            let expected_floats = drawn(Look::Colour);
            assert!(finished.host.picture().unwrap() == expected_floats, "view {i}");
            for integers in [Integers::Rgb8, Integers::Grey16] {
                assert!(finished.host.integers(integers).unwrap() == expected(&expected_floats, integers), "view {i}");
            }
        }
        let depths = finished.host.depths().map(|pixels| pixels.rgba);
        assert!(depths == wanted.depths.then(|| drawn(Look::Work(Work::Depths)).rgba), "view {i}");
        assert_eq!(finished.host.integers(Integers::Rgb16), None);
    }
}

fn stream_start(stream: &mut FrameQueue, view: &Camera, wanted: &FrameOutputs) -> smalto::render::QueuedFrame {
    stream.start(view, Background::BLACK, wanted, HostFrame::default()).unwrap()
}

/// The first frame of a view may be too much for the fast path while that of its depths is not.
#[test]
fn lists_that_are_too_long_for_the_fast_path_are_drawn_with_their_depths() {
    let gpu = Gpu::new();
    let options = Options::default();
    let gaussians = Procedural::parse("many-small:70000").unwrap().unwrap().make().unwrap().gaussians;
    let scene = GpuScene::new(&gpu.0, &gaussians, &options).unwrap();
    let views = path::orbit(DVec3::ZERO, 2.0, false, [16, 16], 3);
    let mut stream = FrameQueue::new(&gpu.0, Renderer::new(&gpu.0, &options, &scene).unwrap());
    let wanted = FrameOutputs { picture: vec![Form::Floats], depths: true, is_exported: false };
    for view in &views {
        let started = stream_start(&mut stream, view, &wanted);
        let mut finished = stream.finish(started).unwrap();
        let mut alone = Renderer::new(&gpu.0, &options, &scene).unwrap();
        alone.render(view, Background::BLACK).unwrap();
        assert!(finished.host.picture().unwrap() == alone.pixels().unwrap());
    }
}
