//! What is asked for in words: presets, knobs, backgrounds, layers.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use smalto::options::{KNOBS, Options};
use smalto::pixels::Integers;
use smalto::render::{Form, FrameOutputs};
use smalto::rules::Background;

use crate::camera::Camera;

/// A preset and the knobs that were turned, before a scene's and a camera's part in the options.
pub struct Asked {
    options: Options,
    has_near: bool,
    has_antialiased: bool,
}

impl Asked {
    /// Reads the name of a preset and knobs by name, with _ in the place of -.
    pub fn of(name: &str, knobs: Option<&Bound<PyDict>>) -> PyResult<Self> {
        Self::turned(preset(name)?, knobs)
    }

    /// The rules of a preset and what the knobs change, and nothing traded otherwise.
    pub fn exact(name: &str, knobs: Option<&Bound<PyDict>>) -> PyResult<Self> {
        Self::turned(preset(name)?.untraded(), knobs)
    }

    fn turned(options: Options, knobs: Option<&Bound<PyDict>>) -> PyResult<Self> {
        let mut asked = Self { options, has_near: false, has_antialiased: false };
        for (name, value) in knobs.into_iter().flat_map(|knobs| knobs.iter()) {
            let name: String = name.extract()?;
            let wanted = name.replace('_', "-");
            let knob = KNOBS.iter().find(|knob| knob.name == wanted).ok_or_else(|| {
                let all: Vec<String> = KNOBS.iter().map(|knob| knob.name.replace('-', "_")).collect();
                PyValueError::new_err(format!("there is no knob {name}; there are {}", all.join(", ")))
            })?;
            let text = value.str()?.to_string();
            let text = if text == "True" || text == "False" { text.to_lowercase() } else { text };
            let value = knob.parse(&text).map_err(|why| PyValueError::new_err(format!("{name}={text}: {why}")))?;
            asked.options = knob.turned(&asked.options, value);
            asked.has_near |= wanted == "near";
            asked.has_antialiased |= wanted == "antialiased";
        }
        Ok(asked)
    }

    /// The options for a scene that was trained with antialiasing or without.
    pub fn options(&self, is_antialiased: bool) -> Options {
        let mut options = self.options;
        if !self.has_antialiased {
            options.rules.antialiased = is_antialiased;
        }
        options
    }

    /// The near plane of a view: what a small scene shows must not lie before it.
    pub fn near(&self, camera: &Camera) -> f32 {
        let own = self.options.rules.near;
        camera.near.filter(|_| !self.has_near).map_or(own, |nearest| own.min(nearest))
    }
}

fn preset(name: &str) -> PyResult<Options> {
    let names = || Options::PRESETS.map(|(name, _)| name).join(", ");
    Options::preset(name).ok_or_else(|| PyValueError::new_err(format!("preset: expected {}", names())))
}

/// The background that a colour, or None for a transparent one, stands for.
pub fn ground(background: Option<[f32; 3]>) -> PyResult<Background> {
    match background {
        None => Ok(Background::Transparent),
        Some(colour) if colour.iter().all(|value| value.is_finite()) => Ok(Background::Colour(colour)),
        Some(_) => Err(PyValueError::new_err("background: expected three finite numbers, or None for transparent")),
    }
}

/// What is wanted of a view whose pixels stay on the device.
pub fn exported(has_depth: bool) -> FrameOutputs {
    FrameOutputs { picture: vec![Form::Floats], depths: has_depth, is_exported: true }
}

/// What is wanted of a view, from the names of its layers and of its numbers.
pub fn wanted(layers: Option<&[String]>, dtype: &str, background: Background) -> PyResult<FrameOutputs> {
    let picture = match dtype {
        "float32" => vec![Form::Floats],
        "uint8" if background == Background::Transparent => {
            let why = "dtype uint8 needs a background: 8 bits do not hold a transparent picture";
            return Err(PyValueError::new_err(why));
        }
        "uint8" => vec![Form::Integers(Integers::Rgb8), Form::Integers(Integers::Grey8)],
        _ => return Err(PyValueError::new_err(format!("dtype: expected float32 or uint8, found {dtype}"))),
    };
    let mut wanted = FrameOutputs { picture, ..FrameOutputs::default() };
    for layer in layers.unwrap_or_default() {
        match layer.as_str() {
            "color" | "alpha" => {}
            "depth" => wanted.depths = true,
            _ => return Err(PyValueError::new_err(format!("layers: expected color, alpha or depth, found {layer}"))),
        }
    }
    Ok(wanted)
}
