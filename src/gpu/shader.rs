//! The traits that `build.rs` implements for every shader.

use bytemuck::Pod;

use super::resource::Resource;

/// A compute shader with its reflected interface.
///
/// # Safety
/// All items describe the interface of the module in `SPIRV` (clause 4 of the contract in `gpu`).
pub unsafe trait Shader {
    /// The stem of the shader's file, and the name of its stage in labels and messages.
    const NAME: &'static str;
    /// The shader's file, relative to the folder of shaders.
    const PATH: &'static str;
    /// The SPIR-V module, little-endian words.
    const SPIRV: &'static [u8];
    /// The fingerprint of the interface. A module that is compiled at run time must have the same.
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
    /// The number of descriptors: 1, or the length of an array.
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
