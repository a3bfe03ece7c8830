//! The traits that `build.rs` implements for every shader.

use std::sync::Arc;

use bytemuck::Pod;

use super::buffer::Storage;
use super::device::Shared;
use super::image::Texture;

/// A compute shader with its reflected interface.
///
/// # Safety
/// All items describe the interface of the module in `SPIRV` (clause 4 of the contract in `gpu`).
pub unsafe trait Shader {
    /// The stem of the shader's file, and the name of its stage in labels and messages.
    const NAME: &'static str;
    /// The shader's file, relative to the folder of shaders.
    const PATH: &'static str;
    /// The module, little-endian words.
    const SPIRV: &'static [u8];
    /// The fingerprint of the interface, which a module that is loaded at run time must have too.
    const INTERFACE: u64;
    /// Invocations in a workgroup.
    const WORKGROUP: [u32; 3];
    const BINDINGS: &'static [Binding];
    type Bindings<'a>: Bindings;
    /// `()` for a shader without push constants.
    type Push: Pod;
    type Constants: Constants;
}

/// One binding of a shader.
pub struct Binding {
    pub number: u32,
    pub name: &'static str,
    /// Descriptors in it.
    pub count: u32,
    pub kind: BindingKind,
    pub reads: bool,
    pub writes: bool,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BindingKind {
    Buffer,
    Image,
}

/// What a buffer may hold: plain data made of one kind of scalar.
pub trait Element: Pod {
    const SCALAR: Scalar;
}

/// The kind of a buffer's numbers, which captures are written as.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Scalar {
    F32,
    I32,
    U32,
    U64,
}

impl Scalar {
    pub const fn bytes(self) -> usize {
        match self {
            Self::F32 | Self::I32 | Self::U32 => 4,
            Self::U64 => 8,
        }
    }
}

impl Element for f32 {
    const SCALAR: Scalar = Scalar::F32;
}

impl Element for i32 {
    const SCALAR: Scalar = Scalar::I32;
}

impl Element for u32 {
    const SCALAR: Scalar = Scalar::U32;
}

impl Element for u64 {
    const SCALAR: Scalar = Scalar::U64;
}

impl<T: Element, const N: usize> Element for [T; N]
where
    [T; N]: Pod,
{
    const SCALAR: Scalar = T::SCALAR;
}

/// The resources for one dispatch.
///
/// # Safety
/// `each` visits as many resources as the shader has descriptors, of the kinds and element types that it declares.
pub unsafe trait Bindings {
    /// Visits every descriptor in the order of [`Shader::BINDINGS`].
    fn each(&self, bind: &mut dyn FnMut(Resource));
}

/// The values of the specialization constants of one pipeline.
///
/// # Safety
/// `entries` has constants that the shader declares, with bits that are values of their types.
pub unsafe trait Constants: Default {
    /// `constant_id` and bits.
    fn entries(&self) -> Vec<(u32, u32)>;
}

// SAFETY: a shader without constants takes no entries.
unsafe impl Constants for () {
    fn entries(&self) -> Vec<(u32, u32)> {
        Vec::new()
    }
}

/// A buffer or an image, whatever its element type.
#[derive(Clone, Copy)]
pub enum Resource<'a> {
    Buffer(&'a Arc<Storage>),
    Image(&'a Arc<Texture>),
}

impl Resource<'_> {
    pub(super) fn device(&self) -> &Arc<Shared> {
        match self {
            Self::Buffer(storage) => &storage.device,
            Self::Image(texture) => &texture.device,
        }
    }

    pub(super) fn id(&self) -> u64 {
        match self {
            Self::Buffer(storage) => storage.id,
            Self::Image(texture) => texture.id,
        }
    }

    pub(super) fn name(&self) -> &str {
        match self {
            Self::Buffer(storage) => &storage.name,
            Self::Image(texture) => &texture.name,
        }
    }
}
