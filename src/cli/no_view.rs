//! `smalto view` of a program that was built without the viewer.

use std::ffi::OsString;

use anyhow::{Result, bail};

/// Not in this build: the viewer comes with the feature `viewer`
#[derive(clap::Args)]
pub(super) struct Args {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    _rest: Vec<OsString>,
}

pub(super) fn run(_: &Args) -> Result<()> {
    bail!("this build has no viewer: build smalto with the feature `viewer`")
}
