//! The environment variables of the program. Nothing else reads the environment for a switch.

use std::path::PathBuf;

use crate::gpu::{DeviceChoice, Validation};

/// The values of the `SMALTO_*` variables.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// `SMALTO_DEVICE`: the device to use, by its number or a part of its name.
    pub device: DeviceChoice,
    /// `SMALTO_VALIDATION`: 1 turns on the validation layer and the check for missing barriers; 0 turns them off.
    pub validation: Option<Validation>,
    /// `SMALTO_SHADERS`: a folder like `glsl/` whose shaders are compiled at run time; needs the feature `reload`.
    pub shaders: Option<PathBuf>,
    /// `SMALTO_FAULT`: a fault that the viewer simulates after a number of frames, for tests: `device@100`,
    /// `surface@100` or `memory@100`.
    pub fault: Option<String>,
}

impl Environment {
    /// Reads the environment of the process.
    pub fn read() -> Self {
        Self::parse(|name| std::env::var(name).ok())
    }

    fn parse(get: impl Fn(&str) -> Option<String>) -> Self {
        let set = |name| get(name).filter(|value| !value.is_empty());
        Self {
            device: set("SMALTO_DEVICE").map_or(DeviceChoice::Best, |text| text.as_str().into()),
            validation: set("SMALTO_VALIDATION")
                .map(|value| if value == "0" { Validation::Off } else { Validation::Required }),
            shaders: set("SMALTO_SHADERS").map(PathBuf::from),
            fault: set("SMALTO_FAULT"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environment_reads_device_and_validation() {
        let parse = |device: &str, validation: &str| {
            Environment::parse(|name| Some(if name == "SMALTO_DEVICE" { device } else { validation }.to_owned()))
        };
        let expected = Environment {
            device: DeviceChoice::Index(1),
            validation: Some(Validation::Required),
            shaders: Some("1".into()),
            fault: Some("1".to_owned()),
        };
        assert_eq!(parse("1", "1"), expected);
        let expected = Environment {
            device: DeviceChoice::Name("llvm".into()),
            validation: Some(Validation::Off),
            shaders: Some("0".into()),
            fault: Some("0".to_owned()),
        };
        assert_eq!(parse("llvm", "0"), expected);
        let nothing = Environment { device: DeviceChoice::Best, validation: None, shaders: None, fault: None };
        assert_eq!(parse("", ""), nothing);
        assert_eq!(Environment::parse(|_| None), nothing);
    }
}
