//! The typed interfaces of `glsl/*/*.comp`, written by `build.rs`: one module per folder, and the structs that they
//! share.

use crate::gpu::{Binding, BindingKind, Bindings, Buffer, Constants, Element, Image, Resource, Scalar, Shader};

include!(concat!(env!("OUT_DIR"), "/shaders.rs"));
