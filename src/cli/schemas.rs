//! `smalto schemas`, a hidden command: writes the JSON schemas of all reports, and of lists of places, into a folder.

use std::io::Write;
use std::path::PathBuf;

use anyhow::Result;
use schemars::{Schema, schema_for};

use super::say;
use crate::files::{make_folder, write_whole};
use crate::measure::{bench, metrics, prune, trade};
use crate::scene::InstancesFile;

/// Write the JSON schemas of reports and of lists of places
#[derive(clap::Args)]
pub(super) struct Args {
    /// The folder, like docs/schemas. Files in it are replaced
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// The name of a schema, and the function that makes it.
type Entry = (&'static str, fn() -> Schema);

/// The schemas: NAME.schema.json describes this type.
const SCHEMAS: &[Entry] = &[
    ("bench", || schema_for!(bench::Report)),
    ("compare", || schema_for!(metrics::Report)),
    ("convert", || schema_for!(super::convert::Report)),
    ("doctor", || schema_for!(super::doctor::Report)),
    ("info", || schema_for!(super::info::Report)),
    ("places", || schema_for!(InstancesFile)),
    ("prune", || schema_for!(prune::Report)),
    ("render", || schema_for!(super::render::Report)),
    #[cfg(feature = "serve")]
    ("serve-client", || schema_for!(crate::viewer::remote::ClientMessage)),
    #[cfg(feature = "serve")]
    ("serve-server", || schema_for!(crate::viewer::remote::ServerMessage)),
    ("trade", || schema_for!(trade::Report)),
    #[cfg(feature = "viewer")]
    ("view-events", || schema_for!(crate::viewer::Event)),
    ("verify", || schema_for!(super::render::VerifyReport)),
];

pub(super) fn run(args: &Args) -> Result<()> {
    make_folder(&args.folder)?;
    for (name, schema) in SCHEMAS {
        let text = format!("{:#}\n", schema().as_value());
        write_whole(&args.folder.join(format!("{name}.schema.json")), |out| Ok(out.write_all(text.as_bytes())?))?;
    }
    say!("{} schemas in {}", SCHEMAS.len(), args.folder.display())
}
