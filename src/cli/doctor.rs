//! `smalto doctor`.
use anyhow::Result;
/// doctor
#[derive(clap::Args)]
pub(super) struct Args {
}
pub(super) fn run(_args: &Args) -> Result<()> {
    println!("{:#?}", crate::gpu::survey()?);
    Ok(())
}
