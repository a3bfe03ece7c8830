//! The commands that measure: bench, its ladder, compare and trade.

#[path = "../common/mod.rs"]
mod common;

mod bench;
mod budgets;
mod compare;
mod ladder;
mod pairs;
mod trade;
