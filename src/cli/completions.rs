//! `smalto completions` and `smalto man`: what shells and the program `man` know of the commands.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap_complete::Shell;
use clap_mangen::Man;

use super::arguments::command;
use super::sink::Sink;
use super::{Usage, say};
use crate::files::{make_folder, write_whole};

/// Print the completions of a shell: commands and options that it offers after a press of Tab
#[derive(clap::Args)]
#[command(after_help = "\
For bash: smalto completions bash > ~/.local/share/bash-completion/completions/smalto

For zsh: smalto completions zsh > _smalto, in a folder of $fpath

For fish: smalto completions fish > ~/.config/fish/completions/smalto.fish

For elvish: smalto completions elvish > ~/.config/elvish/lib/smalto.elv, then `use smalto` in rc.elv

For PowerShell: smalto completions powershell >> $PROFILE")]
pub(super) struct CompletionsArgs {
    /// The shell
    shell: Shell,
}

/// Write the manual pages of the program and of every command
#[derive(clap::Args)]
#[command(after_help = "\
The pages are smalto.1, smalto-render.1 and so on: `man -l DIR/smalto.1` shows one, and `man smalto` finds them in \
~/.local/share/man/man1.")]
pub(super) struct ManArgs {
    /// The folder. It is made if the one above it exists; pages that are there are replaced
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

pub(super) fn completions(args: &CompletionsArgs) -> Result<()> {
    Sink::Stdout.write(|mut out| {
        clap_complete::generate(args.shell, &mut command(), "smalto", &mut out);
        Ok(())
    })
}

pub(super) fn man(args: &ManArgs) -> Result<()> {
    let folder = &args.folder;
    let above = folder.parent().filter(|above| !above.as_os_str().is_empty());
    if let Some(above) = above.filter(|above| !above.is_dir()) {
        let why = format!("cannot make the folder {}: there is no folder {}", folder.display(), above.display());
        return Err(Usage(why).into());
    }
    make_folder(folder)?;
    // There is no page of the command `help`, which is built in.
    let mut program = command().disable_help_subcommand(true);
    program.build();
    let shown = program.get_subcommands().filter(|command| !command.is_hide_set());
    let commands: Vec<_> = std::iter::once(&program).chain(shown).cloned().collect();
    let count = commands.len();
    for command in commands {
        let page = Man::new(command).source(concat!("smalto ", env!("CARGO_PKG_VERSION")));
        let file = folder.join(page.get_filename());
        write_whole(&file, |out| page.render(out).context("cannot make the page"))?;
    }
    say!("{count} manual pages in {}", folder.display())
}
