//! The stages of the fast path, each on what the stages before it made of made-up splats.

use anyhow::Result;
use bytemuck::Zeroable;
use smalto::gpu::{Access, Commands, Device, Image};
use smalto::options::Options;
use smalto::render::shaders::FastCounters;
use smalto::render::shaders::fast::{BIN_RUN, MERGE_RUNS};
use smalto::render::{BinGrid, Capacity, FastPipeline, FastWorkspace, GpuScene, Target};
use smalto::rules::Background;

use crate::{Bench, random};

/// The stages of the fast path at 1920x1080, on made-up splats: two bins each on average, all of one size.
pub struct Fast {
    pipeline: FastPipeline,
    work: FastWorkspace,
    grid: BinGrid,
    image: Image,
    splats: u32,
    entries: u32,
}

/// Records one stage.
type Record = fn(&Fast, &mut Commands);

impl Fast {
    /// `None` if the device has no fast path.
    pub fn new(device: &Device, splats: u32) -> Result<Option<Self>> {
        const SIZE: [u32; 2] = [1920, 1080];
        let options = Options::EXACT;
        let scene = GpuScene::new(device, &smalto::procedural::cactus(1)?.gaussians, &options)?;
        let Some(mut pipeline) = FastPipeline::new(device, &options, scene.layout())? else { return Ok(None) };
        let grid = BinGrid::new(SIZE, 2);
        let [columns, rows] = grid.bins;
        // Row and columns of bins; the splat lies in the middle of its first.
        let place = |i: u32| (random(3 * i) % rows, random(3 * i + 1) % columns, 1 + random(3 * i + 2) % 3);
        let span = |i: u32| {
            let (row, begin, width) = place(i);
            [begin | (begin + width).min(columns) << 16, row | 1 << 16]
        };
        let span_ranges: Vec<_> = (0..splats).map(span).collect();
        let entries: u32 = span_ranges.iter().map(|[span, _]| (span >> 16) - (span & 0xffff)).sum();
        let capacity = Capacity {
            gaussians: splats as usize,
            visible: splats.into(),
            spans: 1,
            listed: entries.into(),
            cells: grid.count() as usize,
        };
        let mut work = FastWorkspace::new(device, capacity, pipeline.splat_elements())?;
        // Lists of two runs are merged at once or in pairs.
        work.grow(device, capacity, BIN_RUN * (MERGE_RUNS + 1))?;
        pipeline.prepare(device, grid)?;
        // Round, 4 px to the threshold, faint: no pixel stops before its list ends.
        let splat = |i: u32| {
            let (row, begin, _) = place(i);
            let mean = [(begin * 64 + random(i) % 64) as f32, (row * 32 + random(!i) % 32) as f32];
            let words = [mean[0], mean[1], 0.3, 0.0, 0.3, 0.1, 0.5, 0.5, 0.5, 0.0, 0.0, 0.0].map(f32::to_bits);
            [[words[0], words[1], words[2], words[3]], [words[4], words[5], words[6], words[7]], [words[8], 0, 0, 0]]
        };
        let records: Vec<[u32; 4]> = (0..splats).flat_map(splat).collect();
        let keys: Vec<u32> = (0..splats).map(|i| random(i) >> 8).collect();
        let ids: Vec<u32> = (0..splats).collect();
        let image = Image::new(device, "image", SIZE[0], SIZE[1])?;
        let fast = Self { pipeline, work, grid, image, splats, entries };
        let mut cmd = Commands::new(device)?;
        cmd.upload(&fast.work.span_ranges, 0, ids.len(), |m| m.copy_from_slice(&span_ranges))?;
        cmd.upload(&fast.work.splats, 0, records.len(), |m| m.copy_from_slice(&records))?;
        cmd.upload(&fast.work.depth_keys, 0, keys.len(), |m| m.copy_from_slice(&keys))?;
        cmd.upload(&fast.work.gaussian_from_splat, 0, ids.len(), |m| m.copy_from_slice(&ids))?;
        for stage in [Self::reset, Self::list, Self::offsets, Self::sort, Self::merge_runs] {
            stage(&fast, &mut cmd);
            cmd.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::SHADER | Access::INDIRECT);
        }
        cmd.submit()?.wait()?;
        Ok(Some(fast))
    }

    /// Sets the counters to the values that `list` finds.
    fn reset(&self, cmd: &mut Commands) {
        let counters = FastCounters { visible: self.splats, ..FastCounters::zeroed() };
        cmd.upload(&self.work.counters, 0, 1, |memory| memory[0] = counters).expect("there is memory for a counter");
        cmd.fill(&self.work.listed_in_bins, 0);
    }

    fn list(&self, cmd: &mut Commands) {
        self.pipeline.list(cmd, &self.work, self.grid);
    }

    fn offsets(&self, cmd: &mut Commands) {
        self.pipeline.offsets(cmd, &self.work, self.grid);
    }

    fn sort(&self, cmd: &mut Commands) {
        self.pipeline.sort(cmd, &self.work, self.grid);
    }

    fn merge_runs(&self, cmd: &mut Commands) {
        self.pipeline.merge_runs(cmd, &self.work);
    }

    fn merge_pairs(&self, cmd: &mut Commands) {
        self.pipeline.merge_pairs(cmd, &self.work);
    }

    fn masks(&self, cmd: &mut Commands) {
        self.pipeline.masks(cmd, &self.work, self.grid);
    }

    fn blend(&self, cmd: &mut Commands) {
        let target = Target { image: &self.image, certificate: None, background: Background::BLACK };
        self.pipeline.blend(cmd, &self.work, self.grid, target);
    }

    /// One row per stage. Each stage runs on the output of the stages before it. Input that an earlier run of a stage
    /// changed is made again first, outside of the measured time.
    pub fn benches(&self) -> Vec<Bench<'_>> {
        let [splats, entries, bins] = [self.splats, self.entries, self.grid.count()].map(u64::from);
        let pixels: u64 = self.image.size().iter().map(|side| u64::from(*side)).product();
        let chunk_lists = 4 * u64::from(self.work.bin_chunks(self.grid)) * (bins + 1);
        let stages: [(&'static str, u64, &'static [Record], Record); 7] = [
            ("fast list", 8 * splats + 4 * bins + chunk_lists + 4 * entries, &[Self::reset], Self::list),
            ("fast offsets", 28 * bins, &[Self::reset, Self::list], Self::offsets),
            ("fast sort", chunk_lists + 8 * entries + 4 * splats, &[Self::reset, Self::list], Self::sort),
            ("fast merge runs", 12 * entries, &[], Self::merge_runs),
            // No list has more than two runs, so merges change no input.
            ("fast merge pairs", 12 * entries, &[], Self::merge_pairs),
            ("fast masks", 8 * entries + 32 * splats, &[], Self::masks),
            ("fast blend", 8 * entries + 48 * splats + 16 * pixels, &[Self::masks], Self::blend),
        ];
        let bench = |(stage, bytes, before, record): (&'static str, u64, &'static [Record], Record)| Bench {
            stage,
            input: format!("{splats} splats, {entries} entries"),
            bytes,
            record: Box::new(move |cmd: &mut Commands| {
                for record in before {
                    record(self, cmd);
                    cmd.barrier(Access::SHADER_WRITE | Access::COPY_WRITE, Access::SHADER | Access::INDIRECT);
                }
                cmd.scope(stage, |cmd| record(self, cmd));
            }),
        };
        stages.into_iter().map(bench).collect()
    }
}
