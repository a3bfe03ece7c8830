//! How much a dispatch covers, and how large counts become workgroup counts that every device takes.

/// Largest workgroup count of a dispatch along x and y that every device takes; more is folded into y.
pub const FOLD: u32 = 65_535;

/// How much a dispatch covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DispatchSize {
    /// At least this many invocations in a row; the shader tests its index.
    Invocations(u64),
    /// This many workgroups in a row. Over [`FOLD`] they are folded into y, and there may be more of them.
    Groups(u64),
}

impl DispatchSize {
    /// Workgroups along x and y for workgroups of `size` invocations.
    pub fn groups(self, size: u32) -> [u32; 2] {
        let groups = match self {
            Self::Invocations(n) => n.div_ceil(size.into()),
            Self::Groups(n) => n,
        };
        let x = groups.min(FOLD.into());
        [x as u32, groups.div_ceil(x.max(1)) as u32]
    }
}
