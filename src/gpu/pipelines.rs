//! The pipelines of a device, by what tells them apart. Equal stages share one: drivers take long to compile it.

use std::any::Any;
use std::collections::HashMap;
use std::sync::{Arc, Weak};

/// Two stages with equal keys can share one pipeline of a device.
#[derive(PartialEq, Eq, Hash)]
pub(super) struct Key {
    pub words: Vec<u32>,
    /// Numbers and bits of the specialization constants.
    pub constants: Vec<(u32, u32)>,
    pub subgroup: Option<u32>,
}

/// Pipelines own the device: it knows them only as values that are alive or not.
type Value = dyn Any + Send + Sync;

#[derive(Default)]
pub(super) struct Pipelines {
    in_use: HashMap<Key, Weak<Value>>,
    kept: Option<Vec<Arc<Value>>>,
}

impl Pipelines {
    /// The pipeline with this key, if it is in use.
    pub fn find<P: Any + Send + Sync>(&self, key: &Key) -> Option<Arc<P>> {
        let pipeline = self.in_use.get(key)?.upgrade()?;
        Some(pipeline.downcast().expect("all values are of one type"))
    }

    pub fn insert<P: Any + Send + Sync>(&mut self, key: Key, pipeline: &Arc<P>) {
        let pipeline: Arc<Value> = pipeline.clone();
        self.in_use.retain(|_, pipeline| pipeline.strong_count() > 0);
        self.in_use.insert(key, Arc::downgrade(&pipeline));
        if let Some(kept) = &mut self.kept {
            kept.push(pipeline);
        }
    }

    /// Keeps all pipelines that are inserted from now on.
    pub fn keep(&mut self) {
        self.kept.get_or_insert_default();
    }
}
