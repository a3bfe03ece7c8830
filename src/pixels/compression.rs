//! The choice of how hard files are compressed.

use serde::Serialize;

/// How hard files are compressed. The values in them are the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Compression {
    /// As fast as it goes: PNG by fdeflate, EXR not at all.
    #[default]
    Fast,
    /// Some 10 % smaller PNG in 25 times the time, some 25 % smaller EXR (PIZ) in 15 times the time.
    Small,
}
