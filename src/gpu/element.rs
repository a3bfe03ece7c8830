//! The types that a buffer may hold.

use bytemuck::Pod;

/// An element of a buffer: plain data made of one kind of scalar.
pub trait Element: Pod {
    const SCALAR: Scalar;
}

/// The kind of number that a buffer's elements are made of. Dumps write it as their element type.
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
