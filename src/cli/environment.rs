//! The environment variables of the program. Nothing else reads the environment for a switch.

use std::path::PathBuf;

use super::Usage;
use crate::gpu::{DeviceChoice, Validation};
use crate::pagefile::ReadFault;

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
    /// `surface@100` or `memory@100`. `render` and `serve` simulate the first of these.
    pub fault: Option<String>,
    /// `SMALTO_FAULT`: a fault of reading page files: `page@3` for a page that cannot be read, `slow@5` for reads that
    /// take 5 ms longer.
    pub read_fault: Option<ReadFault>,
}

impl Environment {
    /// Reads the environment of the process. An empty variable is as good as none.
    ///
    /// # Errors
    /// If a variable has a value without meaning.
    pub fn read() -> anyhow::Result<Self> {
        Ok(Self::parse(|name| std::env::var(name).ok())?)
    }

    fn parse(get: impl Fn(&str) -> Option<String>) -> Result<Self, Usage> {
        let set = |name| get(name).filter(|value| !value.is_empty());
        let validation = match set("SMALTO_VALIDATION").as_deref() {
            None => None,
            Some("0") => Some(Validation::Off),
            Some("1") => Some(Validation::Required),
            Some(other) => return Err(Usage(format!("SMALTO_VALIDATION={other}: expected 1 or 0"))),
        };
        let fault = set("SMALTO_FAULT");
        let is_of_reading = |text: &str| text.starts_with("page@") || text.starts_with("slow@");
        let (read_fault, fault) = match fault {
            Some(text) if is_of_reading(&text) => (Some(text), None),
            other => (None, other),
        };
        let parse = |text: String| {
            text.parse::<ReadFault>().map_err(|problem| Usage(format!("SMALTO_FAULT={text}: {problem:#}")))
        };
        let read_fault = read_fault.map(parse).transpose()?;
        #[cfg(feature = "viewer")]
        if let Some(text) = &fault {
            let parsed = text.parse::<crate::viewer::Fault>();
            parsed.map_err(|problem| Usage(format!("SMALTO_FAULT={text}: {problem:#}")))?;
        }
        Ok(Self {
            device: set("SMALTO_DEVICE").map_or(DeviceChoice::Best, |text| text.as_str().into()),
            validation,
            shaders: set("SMALTO_SHADERS").map(PathBuf::from),
            fault,
            read_fault,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn environment_reads_every_variable() {
        let parse = |device: &str, validation: &str, fault: &str| {
            let value = |name: &str| match name {
                "SMALTO_DEVICE" => device.to_owned(),
                "SMALTO_VALIDATION" => validation.to_owned(),
                "SMALTO_FAULT" => fault.to_owned(),
                _ => String::new(),
            };
            Environment::parse(|name| Some(value(name))).map_err(|problem| problem.to_string())
        };
        let nothing =
            Environment { device: DeviceChoice::Best, validation: None, shaders: None, fault: None, read_fault: None };
        let expected = Environment {
            device: DeviceChoice::Index(1),
            validation: Some(Validation::Required),
            fault: Some("device@7".to_owned()),
            ..nothing.clone()
        };
        assert_eq!(parse("1", "1", "device@7"), Ok(expected));
        let (device, validation) = (DeviceChoice::Name("llvm".into()), Some(Validation::Off));
        assert_eq!(parse("llvm", "0", ""), Ok(Environment { device, validation, ..nothing.clone() }));
        assert_eq!(parse("", "", ""), Ok(nothing.clone()));
        assert_eq!(Environment::parse(|_| None).ok(), Some(nothing.clone()));
        assert_eq!(parse("", "yes", ""), Err("SMALTO_VALIDATION=yes: expected 1 or 0".to_owned()));
        let read_fault = Some(ReadFault::Page(3));
        assert_eq!(parse("", "", "page@3"), Ok(Environment { read_fault, ..nothing.clone() }));
        assert!(parse("", "", "slow@x").unwrap_err().starts_with("SMALTO_FAULT=slow@x: expected a time"));
        #[cfg(feature = "viewer")]
        assert!(parse("", "", "nonsense").unwrap_err().starts_with("SMALTO_FAULT=nonsense: expected device@N"));
    }
}
