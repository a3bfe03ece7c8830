//! Comparison of certificates with the true errors, for every pixel of some views and for settings that leave out
//! little or much.

use anyhow::Result;

use super::measure::Study;
use super::report::{CertificateReport, SettingReport};
use crate::options::Options;
use crate::reference::{self, Rendering};
use crate::render::{GpuScene, RayCertifier, Renderer};
use crate::rules::{Footprint, Response, Rules};

/// Names and options of the settings: a certificate covers what stop, alpha threshold and footprint leave out.
fn settings(exact: &Options) -> Vec<(String, Options)> {
    let with = |alpha_min: f32, stop: f32| Options { stop, rules: Rules { alpha_min, ..exact.rules }, ..*exact };
    let mut all = vec![("exact".to_owned(), *exact)];
    for stop in [1e-3, 1.0 / 255.0, 1e-2, 1.0 / 16.0] {
        all.push((format!("stop {stop:.4}"), Options { stop, ..*exact }));
    }
    for inverse in [65_536, 4096, 512, 128, 64, 16] {
        all.push((format!("alpha-min 1/{inverse}"), with(1.0 / inverse as f32, 0.0)));
    }
    all.push(("alpha-min 1/128, stop 0.01".to_owned(), with(1.0 / 128.0, 0.01)));
    let rules = Rules { extent: Footprint::ThreeSigma, ..exact.rules };
    all.push(("extent three-sigma".to_owned(), Options { rules, ..*exact }));
    all
}

/// Compares the certificates of the study's small views with the reference that leaves nothing out. `progress` receives
/// the completed fraction.
pub fn certify(study: &Study, progress: &dyn Fn(f64)) -> Result<CertificateReport> {
    let mut settings: Vec<(Options, SettingReport)> =
        settings(&study.exact).into_iter().map(|(name, options)| (options, empty(&name))).collect();
    let scene = GpuScene::certifiable(study.device, study.gaussians, study.statistics, &study.exact)?;
    let along_rays = || {
        let certifier = RayCertifier::new(study.device, &study.exact, &scene)?;
        let renderer = Renderer::new(study.device, &study.exact, &scene)?;
        anyhow::Ok((certifier, renderer, empty("exact, along rays")))
    };
    let mut along_rays = (study.rules().response == Response::Screen).then(along_rays).transpose()?;
    for (done, view) in study.small_views.iter().enumerate() {
        progress(done as f64 / study.small_views.len() as f64);
        let complete = reference::render(study.gaussians, view, &study.rules().complete(), study.background);
        for (options, report) in &mut settings {
            let mut renderer = Renderer::certified(study.device, options, &scene)?;
            renderer.render(view, study.background)?;
            if let Some(certificate) = renderer.certificate()? {
                let bounds = certificate.rgba.iter().map(|bound| f64::from(bound[0]));
                compare(report, renderer.pixels()?.rgba.iter(), bounds, &complete);
            }
        }
        // Lenses are drawn along rays by all settings.
        if let Some((certifier, renderer, report)) = along_rays.as_mut().filter(|_| view.lens.is_none()) {
            renderer.render(view, study.background)?;
            let picture = renderer.pixels()?;
            let certificate = certifier.certificate(&picture, view, study.background)?;
            let rules = Rules { response: Response::Ray, ..*study.rules() };
            let complete = reference::render(study.gaussians, view, &rules.complete(), study.background);
            let bounds = certificate.rgba.iter().map(|bound| f64::from(bound[0]));
            compare(report, picture.rgba.iter(), bounds, &complete);
        }
    }
    let settings = settings.into_iter().map(|(_, report)| report);
    let along_rays = along_rays.map(|(_, _, report)| report).filter(|report| report.pixel_tests > 0);
    let settings: Vec<_> = settings.chain(along_rays).map(finish).collect();
    let sum = |count: fn(&SettingReport) -> u64| settings.iter().map(count).sum();
    Ok(CertificateReport { pixel_tests: sum(|s| s.pixel_tests), violations: sum(|s| s.violations), settings })
}

fn empty(name: &str) -> SettingReport {
    SettingReport {
        name: name.to_owned(),
        pixel_tests: 0,
        violations: 0,
        max_error: 0.0,
        max_certificate: 0.0,
        mean_error: 0.0,
        mean_certificate: 0.0,
        tightest: 0.0,
    }
}

/// Adds the pixels of a picture to `report`. The means are sums until [`finish`].
fn compare<'p>(
    report: &mut SettingReport,
    picture: impl Iterator<Item = &'p [f32; 4]>,
    bounds: impl Iterator<Item = f64>,
    complete: &Rendering,
) {
    for ((pixel, bound), exact) in picture.zip(bounds).zip(&complete.pixels) {
        let error = (0..3).map(|i| (f64::from(pixel[i]) - exact.colour[i]).abs()).fold(0.0, f64::max);
        report.pixel_tests += 1;
        let holds = error <= bound; // false for NaN
        report.violations += u64::from(!holds);
        report.max_error = report.max_error.max(error);
        report.max_certificate = report.max_certificate.max(bound);
        report.mean_error += error;
        report.mean_certificate += bound;
        if bound > 0.0 {
            report.tightest = report.tightest.max(error / bound);
        }
    }
}

fn finish(mut report: SettingReport) -> SettingReport {
    let pixels = report.pixel_tests.max(1) as f64;
    report.mean_error /= pixels;
    report.mean_certificate /= pixels;
    report
}
