//! The size of a dispatch, and its workgroup counts within the limits of every device.

/// The largest workgroup count along x or y that every device accepts. Larger counts along x are folded into y.
pub const FOLD: u32 = 65_535;

/// The size of a dispatch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DispatchSize {
    /// At least this many invocations in a row; the shader tests its index.
    Invocations(u64),
    /// At least this many workgroups in a row: above [`FOLD`], folding into y may add some.
    Groups(u64),
}

impl DispatchSize {
    /// The workgroup counts along x and y for workgroups of `size` invocations.
    pub fn groups(self, size: u32) -> [u32; 2] {
        let groups = match self {
            Self::Invocations(n) => n.div_ceil(size.into()),
            Self::Groups(n) => n,
        };
        let x = groups.min(FOLD.into());
        [x as u32, groups.div_ceil(x.max(1)) as u32]
    }
}
