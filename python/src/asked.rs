//! What is asked for in words: presets, knobs, layers.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyString};
use smalto::options::{KNOBS, Options};
use smalto::pixels::Integers;
use smalto::render::{Form, FrameOutputs};
use smalto::rules::Background;

use crate::camera::Camera;
use crate::given::given;

/// A preset and the knobs that were turned, before a scene's and a camera's part in the options.
pub struct Asked {
    options: Options,
    has_near: bool,
    has_antialiased: bool,
}

impl Asked {
    /// Reads the name of a preset and knobs by name, with _ in the place of -.
    pub fn of(preset: Option<&Bound<PyAny>>, knobs: Option<&Bound<PyDict>>) -> PyResult<Self> {
        Self::turned(preset_of(preset)?, knobs)
    }

    /// The rules of a preset and what the knobs change, and nothing traded otherwise.
    pub fn exact(preset: Option<&Bound<PyAny>>, knobs: Option<&Bound<PyDict>>) -> PyResult<Self> {
        Self::turned(preset_of(preset)?.untraded(), knobs)
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

/// The preset of this name, by default the balanced one.
fn preset_of(name: Option<&Bound<PyAny>>) -> PyResult<Options> {
    let names = || format!("one of {}", Options::PRESETS.map(|(name, _)| name).join(", "));
    let Some(given_name) = name else { return Ok(Options::BALANCED) };
    let name: String = given(given_name, "preset", &names())?;
    Options::preset(&name).ok_or_else(|| PyValueError::new_err(format!("preset: expected {}, found {name}", names())))
}

/// What is wanted of a view whose pixels stay on the device.
pub fn exported(has_depth: bool) -> FrameOutputs {
    FrameOutputs { picture: vec![Form::Floats], depths: has_depth, is_exported: true }
}

/// What is wanted of a view, from the names of its layers and of its numbers.
pub fn wanted(
    layers: Option<&Bound<PyAny>>,
    dtype: Option<&Bound<PyAny>>,
    background: Background,
) -> PyResult<FrameOutputs> {
    let picture = match dtype.map(dtype_name).transpose()?.as_deref() {
        None | Some("float32") => vec![Form::Floats],
        Some("uint8") if background == Background::Transparent => {
            let why = "dtype: uint8 needs a background, because 8 bits do not hold a transparent picture";
            return Err(PyValueError::new_err(why));
        }
        Some("uint8") => vec![Form::Integers(Integers::Rgb8), Form::Integers(Integers::Grey8)],
        Some(other) => return Err(PyValueError::new_err(format!("dtype: expected float32 or uint8, found {other}"))),
    };
    let mut wanted = FrameOutputs { picture, ..FrameOutputs::default() };
    if let Some(layers) = layers {
        // The letters of a text are no names.
        let names = layers.try_iter().ok().filter(|_| !layers.is_instance_of::<PyString>());
        let names = names.ok_or_else(|| PyTypeError::new_err(format!("layers: expected {LAYERS}")))?;
        for layer in names {
            match given::<String>(&layer?, "layers", LAYERS)?.as_str() {
                "color" | "alpha" => {}
                "depth" => wanted.depths = true,
                layer => return Err(PyValueError::new_err(format!("layers: expected {LAYERS}, found {layer}"))),
            }
        }
    }
    Ok(wanted)
}

const LAYERS: &str = "some of (\"color\", \"alpha\", \"depth\")";

/// The name of a kind of numbers: a text, or a type of NumPy.
fn dtype_name(dtype: &Bound<PyAny>) -> PyResult<String> {
    if dtype.is_instance_of::<PyString>() {
        return dtype.extract();
    }
    let named = dtype.py().import("numpy")?.call_method1("dtype", (dtype,)).and_then(|dtype| dtype.getattr("name"));
    named.map_or_else(|_| given(dtype, "dtype", "float32 or uint8"), |name| name.extract())
}
