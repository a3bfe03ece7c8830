//! `smalto info`.
use super::SceneArg;
use anyhow::Result;
/// info
#[derive(clap::Args)]
pub(super) struct Args {
    #[command(flatten)]
    scene: SceneArg,
}
pub(super) fn run(_args: &Args) -> Result<()> {
    Ok(())
}
