//! Tables on the terminal.

use anyhow::Result;
use comfy_table::presets::NOTHING;
use comfy_table::{CellAlignment, Table};

use super::say;

/// A table with a left-aligned first column and right-aligned others.
pub(super) fn table(header: &[&str]) -> Table {
    let mut table = Table::new();
    table.load_style(NOTHING).set_header(header);
    for (index, column) in table.column_iter_mut().enumerate() {
        column.set_padding((0, 2));
        column.set_cell_alignment(if index == 0 { CellAlignment::Left } else { CellAlignment::Right });
    }
    table
}

pub(super) fn say_table(table: &Table) -> Result<()> {
    for line in table.lines() {
        say!("  {}", line.trim_end())?;
    }
    Ok(())
}
