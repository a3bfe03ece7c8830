//! The page table of a scene, as the stages of the selection read it.

use std::ops::Range;

use crate::lod::CODES_PER_OCTAVE;
use crate::pagefile::{PARTS, Page, PageLod, Pages};
use crate::render::shaders::{PageBox, PageErrors};
use crate::rules::LOW_PASS;

/// Codes per octave of squared errors: half as many as per octave of errors.
pub const STEPS: usize = CODES_PER_OCTAVE as usize / 2;

/// The smallest significand of a float in each step of an octave.
pub fn steps() -> [u32; STEPS] {
    std::array::from_fn(|step| (((step as f64 / STEPS as f64).exp2() - 1.0) * 23f64.exp2()).ceil() as u32)
}

/// The bounds of a page of a scene that has these views.
pub fn page_box(pages: &Pages, number: usize, views: &Range<u32>) -> PageBox {
    let Page { low, high, reach, highest_opacity, .. } = pages.pages()[number];
    let level = pages.level(number);
    // The reach of a splat in standard deviations, with a margin for rounding.
    let deviations = (2.0 * (f64::from(highest_opacity / pages.alpha_min())).max(1.0).ln()).sqrt() * 1.02;
    PageBox {
        low,
        high,
        reach,
        margin_px: (deviations * LOW_PASS.sqrt()) as f32,
        lod_low: level.low,
        lod_high: level.high,
        // Limited, so that the product with a squared pixel width is finite.
        per_width_squared: (f64::from(level.reference_width).powi(-2) as f32).min(1e15),
        first_view: views.start as f32,
        // Of one scene, which may have more instances than a float has whole numbers, all views are its own.
        views: if views.start == 0 { (views.end as f32).next_up() } else { (views.end - views.start) as f32 },
    }
}

/// The errors of all pages. Without levels of detail, the errors of a page put it in every cut.
pub fn errors_of_pages(pages: &Pages) -> Vec<PageErrors> {
    let pages = pages.pages().iter().enumerate().map(|(number, page)| (page, pages.level(number)));
    pages.map(|(page, level)| page_errors(page.count, &level)).collect()
}

fn page_errors(count: u32, level: &PageLod) -> PageErrors {
    let pairs =
        |codes: [u16; PARTS]| std::array::from_fn(|i| u32::from(codes[2 * i]) | u32::from(codes[2 * i + 1]) << 16);
    PageErrors {
        parent: level.parent,
        count,
        level: level.level.into(),
        least_error: level.least_error.into(),
        errors: pairs(level.errors),
        parent_errors: pairs(level.parent_errors),
        squared_errors: pairs(level.squared_errors),
        samples: level.samples,
    }
}
