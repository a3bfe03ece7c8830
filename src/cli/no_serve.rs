//! `smalto serve` of a program that was built without the server.

use std::ffi::OsString;

use anyhow::{Result, bail};

/// Not in this build: the server comes with the feature `serve`
#[derive(clap::Args)]
pub(super) struct Args {
    #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
    _rest: Vec<OsString>,
}

pub(super) fn run(_: &Args) -> Result<()> {
    bail!("this build has no server: build smalto with the feature `serve`")
}
