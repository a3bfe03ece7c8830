//! Every environment switch, in one place.

use crate::gpu::{DeviceChoice, Validation};

/// What the `SMALTO_*` variables ask for.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// `SMALTO_DEVICE`: the number or a part of the name of the device to use.
    pub device: DeviceChoice,
    /// `SMALTO_VALIDATION`: 1 turns the validation layer and our own checks on, 0 off.
    pub validation: Option<Validation>,
    /// `SMALTO_FAULT`: a fault that the viewer meets on purpose, after so many frames: `device@100`, `surface@100` or
    /// `memory@100`.
    pub fault: Option<String>,
}

impl Environment {
    /// Reads the process's environment.
    pub fn read() -> Self {
        Self::parse(|name| std::env::var(name).ok())
    }

    fn parse(get: impl Fn(&str) -> Option<String>) -> Self {
        let set = |name| get(name).filter(|value| !value.is_empty());
        Self {
            device: set("SMALTO_DEVICE").map_or(DeviceChoice::Best, |text| text.as_str().into()),
            validation: set("SMALTO_VALIDATION")
                .map(|value| if value == "0" { Validation::Off } else { Validation::Required }),
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
            fault: Some("1".to_owned()),
        };
        assert_eq!(parse("1", "1"), expected);
        let expected = Environment {
            device: DeviceChoice::Name("llvm".into()),
            validation: Some(Validation::Off),
            fault: Some("0".to_owned()),
        };
        assert_eq!(parse("llvm", "0"), expected);
        let nothing = Environment { device: DeviceChoice::Best, validation: None, fault: None };
        assert_eq!(parse("", ""), nothing);
        assert_eq!(Environment::parse(|_| None), nothing);
    }
}
