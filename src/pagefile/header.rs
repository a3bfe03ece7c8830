//! The header of a page file.

use anyhow::{Context, Result, bail, ensure};
use twox_hash::XxHash3_64;

use super::bytes::{Reader, Writer};
use super::page::{Entry, PAGE, PageWords};
use super::page_lod::{LEVEL_WORDS, NO_PAGE, PageLod};
use crate::formats::PAGE_FILE_SIGNATURE;
use crate::options::Storage;
use crate::packing::{Layout, NOTHING, Packing, Statistics};
use crate::scene::{
    Band, Bounds, Focus, Grid, LoadReport, MAX_SH_DEGREE, Requirements, USUAL_SH_DEGREE, sh_coefficients,
};

/// Bytes of the header.
pub const HEADER: usize = 4096;
/// The highest SH degree that the header has room for, and the format versions without levels of detail, with levels
/// that smalto made, and with those of the source.
const VERSIONS: [(u32, [u32; 3]); 2] = [(USUAL_SH_DEGREE, [1, 2, 5]), (MAX_SH_DEGREE, [3, 4, 6])];
/// Longest texts that are kept, in bytes.
const MOST_TEXT: usize = 512;

/// The header of a page file: all but its tables and its pages.
#[derive(Clone, Debug, PartialEq)]
pub struct Header {
    pub statistics: Statistics,
    pub layout: Layout,
    /// The alpha threshold that the reaches are made for.
    pub alpha_min: f32,
    /// The scene was trained with antialiasing.
    pub is_antialiased: bool,
    /// What was dropped or changed when the source was read.
    pub report: LoadReport,
    /// The name of the source.
    pub title: String,
    /// The format of the source.
    pub format: String,
    /// XXH3 of the table.
    pub table_checksum: u64,
    /// Byte offset of the geometry of the first page.
    pub geometry_at: u64,
    /// Byte offset of the colours of the first page.
    pub colours_at: u64,
    /// Sections of the levels of detail, in files that have them.
    pub levels: Option<LodSections>,
}

/// The sections of a file with levels of detail.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LodSections {
    /// Number of pages of nodes that stand for Gaussians of the scene. They follow the pages of the scene.
    pub pages: usize,
    /// Number of pages of the scene in files with the levels of a source, in which any page may have empty slots.
    pub scene_pages: Option<usize>,
    /// Byte offset of the words of levels.
    pub words_at: u64,
    /// Byte offset of the table of levels, which ends the file.
    pub table_at: u64,
    /// XXH3 of the table of levels.
    pub checksum: u64,
}

/// Bytes of the words of levels of a page.
const LEVEL_BYTES: u64 = 4 * (LEVEL_WORDS * PAGE) as u64;

/// Streams begin at multiples of this many bytes.
const ALIGNED: u64 = 4096;

impl Header {
    /// Byte offsets in a file of at most `pages` pages: of the streams geometry, colours and words of levels, and of
    /// the table of levels.
    pub fn stream_offsets(pages: usize, words: &PageWords) -> [u64; 4] {
        let table_end = HEADER as u64 + (pages * Entry::BYTES) as u64;
        let geometry = table_end.next_multiple_of(ALIGNED);
        let colours = (geometry + (pages * words.geometry() * 4) as u64).next_multiple_of(ALIGNED);
        let levels = (colours + (pages * words.colours() * 4) as u64).next_multiple_of(ALIGNED);
        [geometry, colours, levels, levels + pages as u64 * LEVEL_BYTES]
    }

    /// The format of the file in reports.
    pub fn format_of_pages(&self) -> String {
        format!("pages of {}", self.format)
    }

    /// Number of pages of Gaussians of the scene.
    pub fn scene_pages(&self) -> usize {
        self.levels.and_then(|levels| levels.scene_pages).unwrap_or(self.statistics.count.div_ceil(PAGE))
    }

    /// True if the levels of detail are those of the source.
    pub fn has_source_levels(&self) -> bool {
        self.levels.is_some_and(|levels| levels.scene_pages.is_some())
    }

    /// Number of all pages.
    pub fn pages(&self) -> usize {
        self.scene_pages() + self.levels.map_or(0, |levels| levels.pages)
    }

    /// The length of the file in bytes.
    pub fn file_bytes(&self) -> u64 {
        match self.levels {
            None => self.colours_at + self.pages() as u64 * 4 * PageWords::of(&self.layout).colours() as u64,
            Some(levels) => levels.table_at + (self.pages() * PageLod::BYTES) as u64,
        }
    }

    /// The bytes of the header, the last eight of which are the checksum of the others.
    pub fn encoded(&self) -> Vec<u8> {
        let mut out = Writer(PAGE_FILE_SIGNATURE.to_vec());
        let (most_degree, versions) = VERSIONS[usize::from(self.statistics.sh_degree > USUAL_SH_DEGREE)];
        out.u32(versions[usize::from(self.levels.is_some()) + usize::from(self.has_source_levels())]);
        out.u32(PAGE as u32);
        let places = [self.file_bytes(), self.geometry_at, self.colours_at, self.table_checksum];
        places.into_iter().for_each(|value| out.u64(value));
        out.f32s(&[self.alpha_min]);
        out.u32(self.is_antialiased.into());
        let LoadReport { read, not_finite, zero_rotation, transparent, clamped_scale, .. } = self.report;
        [read, not_finite, zero_rotation, transparent, clamped_scale].iter().for_each(|n| out.u64(*n as u64));
        put_statistics(&self.statistics, most_degree, &mut out);
        put_layout(&self.layout, most_degree, &mut out);
        out.text(&self.title, MOST_TEXT);
        out.text(&self.format, MOST_TEXT);
        if let Some(LodSections { pages, scene_pages, words_at, table_at, checksum }) = self.levels {
            let scene_pages = scene_pages.map(|pages| pages as u64);
            [pages as u64, words_at, table_at, checksum]
                .into_iter()
                .chain(scene_pages)
                .for_each(|value| out.u64(value));
        }
        let LoadReport { too_large, negative_scale, opacity_range, clamped_opacity, .. } = self.report;
        [too_large, negative_scale, opacity_range, clamped_opacity].iter().for_each(|n| out.u64(*n as u64));
        let LoadReport { vanished, displaced, displacement, displacement_squares, .. } = self.report;
        [vanished, displaced].iter().for_each(|n| out.u64(*n as u64));
        out.f64s(&[displacement, displacement_squares]);
        let mut bytes = out.0;
        bytes.resize(HEADER - 8, 0);
        bytes.extend(XxHash3_64::oneshot(&bytes).to_le_bytes());
        bytes
    }

    /// The header in these bytes.
    ///
    /// # Errors
    /// If it is damaged, of another version, or contradicts itself.
    pub fn decoded(bytes: &[u8; HEADER]) -> Result<Self> {
        let (content, checksum) = bytes.split_at(HEADER - 8);
        ensure!(content.starts_with(&PAGE_FILE_SIGNATURE), "it does not begin as a page file does");
        let mut from = Reader(&content[PAGE_FILE_SIGNATURE.len()..]);
        let version = from.u32()?;
        let known = VERSIONS.into_iter().find(|(_, versions)| versions.contains(&version));
        let (most_degree, [without_levels, _, with_source_levels]) =
            known.with_context(|| format!("its version is {version}, and smalto reads 1 to 6"))?;
        ensure!(checksum == XxHash3_64::oneshot(content).to_le_bytes(), "bytes 0 to {HEADER}, the header, are damaged");
        let page = from.u32()?;
        ensure!(page == PAGE as u32, "its pages hold {page} Gaussians, and smalto reads pages of {PAGE}");
        let [file_bytes, geometry_at, colours_at, table_checksum] =
            [from.u64()?, from.u64()?, from.u64()?, from.u64()?];
        let [alpha_min] = from.f32s()?;
        ensure!(alpha_min > 0.0 && alpha_min < 1.0, "its alpha threshold is {alpha_min}");
        let is_antialiased = from.flag()?;
        let mut report = LoadReport {
            read: from.u64()? as usize,
            not_finite: from.u64()? as usize,
            zero_rotation: from.u64()? as usize,
            transparent: from.u64()? as usize,
            clamped_scale: from.u64()? as usize,
            ..LoadReport::default()
        };
        let statistics = take_statistics(&mut from, most_degree)?;
        let layout = take_layout(&mut from, most_degree)?;
        let (title, format) = (from.text()?, from.text()?);
        let levels = match version == without_levels {
            true => None,
            false => Some(LodSections {
                pages: usize::try_from(from.u64()?)?,
                words_at: from.u64()?,
                table_at: from.u64()?,
                checksum: from.u64()?,
                scene_pages: match version == with_source_levels {
                    true => Some(usize::try_from(from.u64()?)?),
                    false => None,
                },
            }),
        };
        // Zeros in files of earlier versions of smalto.
        report.too_large = from.u64()? as usize;
        report.negative_scale = from.u64()? as usize;
        report.opacity_range = from.u64()? as usize;
        report.clamped_opacity = from.u64()? as usize;
        [report.vanished, report.displaced] = [from.u64()? as usize, from.u64()? as usize];
        [report.displacement, report.displacement_squares] = from.f64s()?;
        let header = Self {
            statistics,
            layout,
            alpha_min,
            is_antialiased,
            report,
            title,
            format,
            table_checksum,
            geometry_at,
            colours_at,
            levels,
        };
        header.check(file_bytes)?;
        Ok(header)
    }

    fn check(&self, file_bytes: u64) -> Result<()> {
        let count = self.statistics.count;
        ensure!((1..u32::MAX as usize).contains(&count), "it claims {count} Gaussians");
        let (scene_pages, all) = (self.scene_pages(), self.levels.map_or(0, |levels| levels.pages));
        ensure!((count.div_ceil(PAGE)..=count).contains(&scene_pages), "it claims {scene_pages} pages of the scene");
        let most = if self.has_source_levels() { NO_PAGE as usize - scene_pages } else { 2 * scene_pages + 32 };
        ensure!(all <= most, "it claims {all} pages of levels");
        let words = PageWords::of(&self.layout);
        let table_end = HEADER as u64 + (self.pages() * Entry::BYTES) as u64;
        let geometry_end = self.geometry_at.checked_add((self.pages() * words.geometry() * 4) as u64);
        let are_apart = self.geometry_at >= table_end && geometry_end.is_some_and(|end| self.colours_at >= end);
        let are_aligned = self.geometry_at.is_multiple_of(ALIGNED) && self.colours_at.is_multiple_of(ALIGNED);
        let end = self.colours_at.checked_add((self.pages() * words.colours() * 4) as u64);
        let end = match self.levels {
            None => end,
            Some(levels) => {
                let is_behind =
                    end.is_some_and(|end| levels.words_at >= end && levels.words_at.is_multiple_of(ALIGNED));
                let table = levels.words_at.checked_add(self.pages() as u64 * LEVEL_BYTES);
                let is_table = is_behind && table.is_some_and(|end| levels.table_at >= end);
                let end = levels.table_at.checked_add((self.pages() * PageLod::BYTES) as u64);
                end.filter(|_| is_table)
            }
        };
        ensure!(are_apart && are_aligned && end == Some(file_bytes), "the places of its parts contradict each other");
        ensure!(self.layout.sh_degree <= self.statistics.sh_degree, "its SH degrees contradict each other");
        Ok(())
    }
}

fn put_statistics(statistics: &Statistics, most_degree: u32, out: &mut Writer) {
    let (coefficients, degrees) = (sh_coefficients(most_degree), most_degree as usize + 1);
    let Statistics { count, sh_degree, extent, focus, requirements, scales, is_flat, highest_opacity, .. } = statistics;
    out.u64(*count as u64);
    out.u32(*sh_degree);
    out.f32s(&extent.low);
    out.f32s(&extent.high);
    out.f64s(&focus.centre);
    out.f64s(&[focus.radius]);
    let Requirements { sh_degree, bands, brightest, sh_grids, scale_grid } = requirements;
    out.u32(*sh_degree);
    bands[..degrees].iter().for_each(|band| out.f64s(&[band.bound, band.rms]));
    out.f64s(&[*brightest]);
    out.u32(sh_grids.is_some().into());
    put_grids(&sh_grids.unwrap_or([Grid::UNUSED; _])[..coefficients], out);
    out.u32(scale_grid.is_some().into());
    put_grids(&[scale_grid.unwrap_or(Grid::UNUSED)], out);
    out.f32s(scales);
    out.u32((*is_flat).into());
    out.f32s(&[*highest_opacity]);
    out.f32s(statistics.sh[..coefficients].as_flattened());
    out.f64s(&statistics.half_errors[..degrees]);
}

fn put_grids(grids: &[Grid], out: &mut Writer) {
    grids.iter().for_each(|grid| out.f32s(&[grid.offset, grid.step]));
}

/// The first `count` of `N` grids; the others are not used.
fn grids<const N: usize>(from: &mut Reader, count: usize) -> Result<[Grid; N]> {
    let mut grids = [Grid::UNUSED; N];
    for grid in &mut grids[..count] {
        let [offset, step] = from.f32s()?;
        ensure!(offset.is_finite() && step.is_finite() && step > 0.0, "a grid begins at {offset} with steps of {step}");
        *grid = Grid { offset, step };
    }
    Ok(grids)
}

fn degree(from: &mut Reader, most: u32) -> Result<u32> {
    let degree = from.u32()?;
    ensure!(degree <= most, "its SH degree is {degree}");
    Ok(degree)
}

fn take_statistics(from: &mut Reader, most_degree: u32) -> Result<Statistics> {
    let (coefficients, degrees) = (sh_coefficients(most_degree), most_degree as usize + 1);
    let count = usize::try_from(from.u64()?)?;
    let sh_degree = degree(from, most_degree)?;
    let extent = Bounds { low: from.f32s()?, high: from.f32s()? };
    let (centre, [radius]) = (from.f64s()?, from.f64s()?);
    let needed = degree(from, most_degree)?;
    let mut bands = [Band::default(); _];
    for band in &mut bands[..degrees] {
        let [bound, rms] = from.f64s()?;
        *band = Band { bound, rms };
    }
    let [brightest] = from.f64s()?;
    let (has_sh, sh_grids) = (from.flag()?, grids(from, coefficients)?);
    let (has_scale, [scale_grid]) = (from.flag()?, grids(from, 1)?);
    let scales = from.f32s()?;
    let is_flat = from.flag()?;
    let [highest_opacity] = from.f32s()?;
    let mut sh = [NOTHING; _];
    for range in &mut sh[..coefficients] {
        *range = from.f32s()?;
    }
    let requirements = Requirements {
        sh_degree: needed,
        bands,
        brightest,
        sh_grids: has_sh.then_some(sh_grids),
        scale_grid: has_scale.then_some(scale_grid),
    };
    let focus = Focus { centre, radius };
    let mut half_errors = [0.0; MAX_SH_DEGREE as usize + 1];
    for half_error in &mut half_errors[..degrees] {
        [*half_error] = from.f64s()?;
    }
    // Degrees that the scene does not have add nothing.
    let all = half_errors[degrees - 1];
    half_errors[degrees..].fill(all);
    let is_place = centre.iter().all(|v: &f64| v.is_finite()) && radius.is_finite() && radius > 0.0;
    let is_box = (0..3).all(|i| extent.low[i] <= extent.high[i]);
    ensure!(is_place && is_box && brightest.is_finite(), "its statistics are not those of a scene");
    Ok(Statistics { count, sh_degree, extent, focus, requirements, scales, is_flat, highest_opacity, sh, half_errors })
}

fn put_layout(layout: &Layout, most_degree: u32, out: &mut Writer) {
    out.u32(layout.sh_degree);
    for Packing { storage, is_lossless } in [layout.sh, layout.shape] {
        out.u32(match storage {
            Storage::Lossless | Storage::F32 => 0,
            Storage::F16 => 1,
            Storage::U8 => 2,
        });
        out.u32(is_lossless.into());
    }
    let (sh, scale) = layout.grids();
    put_grids(&sh[..sh_coefficients(most_degree)], out);
    put_grids(&[scale], out);
    out.u32(layout.scale_base());
    out.u32(layout.has_clamped_alphas.into());
    out.f64s(&[layout.brightest]);
    out.u32(layout.is_bright().into());
}

fn take_layout(from: &mut Reader, most_degree: u32) -> Result<Layout> {
    let sh_degree = degree(from, most_degree)?;
    let mut packing = || -> Result<Packing> {
        let storage = match from.u32()? {
            0 => Storage::F32,
            1 => Storage::F16,
            2 => Storage::U8,
            other => bail!("its number format {other} is unknown"),
        };
        Ok(Packing { storage, is_lossless: from.flag()? })
    };
    let (sh, shape) = (packing()?, packing()?);
    let (sh_grids, [scale_grid]) = (grids(from, sh_coefficients(most_degree))?, grids(from, 1)?);
    let scale_base = from.u32()?;
    ensure!(scale_base <= f32::MAX.to_bits() >> 13, "its base of scales is {scale_base}");
    let has_clamped_alphas = from.flag()?;
    let [brightest] = from.f64s()?;
    let is_bright = from.flag()?;
    let colours = (has_clamped_alphas, brightest, is_bright);
    Ok(Layout::from_parts((sh_degree, sh, shape), (sh_grids, scale_grid), scale_base, colours))
}
