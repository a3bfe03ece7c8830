//! Whole pictures, held to the f64 reference and to known properties.

#[path = "../common/mod.rs"]
mod common;

mod attributes;
mod bands;
mod certificate;
mod depths;
mod explain;
mod extreme_views;
mod extremes;
mod frame;
mod gsplat;
mod inspect;
mod knobs;
mod levels;
mod metamorphic;
mod outputs;
mod placing;
mod promises;
mod properties;
mod prune;
mod rays;
mod rules;
mod storage;
mod surroundings;
mod town;
