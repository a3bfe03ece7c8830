//! The order in which Gaussians are dropped.

use crate::render::Share;

/// All Gaussians of a scene, those that contribute least first.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    gaussians: Vec<u32>,
    unseen: usize,
}

impl Order {
    /// By the largest share, then by the sum of all shares, then by index.
    pub fn of(shares: &[Share]) -> Self {
        let mut gaussians: Vec<u32> = (0..shares.len() as u32).collect();
        let key = |index: &u32| (shares[*index as usize].largest, shares[*index as usize].sum);
        gaussians.sort_by(|a, b| {
            let (a, b) = (key(a), key(b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)) // the sort is stable: equal ones keep their order
        });
        let unseen = shares.iter().filter(|share| share.largest == 0.0).count();
        Self { gaussians, unseen }
    }

    /// Number of all Gaussians.
    pub fn len(&self) -> usize {
        self.gaussians.len()
    }

    pub fn is_empty(&self) -> bool {
        self.gaussians.is_empty()
    }

    /// Number of Gaussians that have no share in any view.
    pub fn unseen(&self) -> usize {
        self.unseen
    }

    /// The first `count` Gaussians.
    pub fn dropped(&self, count: usize) -> &[u32] {
        &self.gaussians[..count]
    }

    /// The others, by index.
    pub fn kept(&self, count: usize) -> Vec<u32> {
        let mut kept = self.gaussians[count..].to_vec();
        kept.sort_unstable();
        kept
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_share_comes_first() {
        let share = |largest, sum| Share { largest, sum };
        let shares = [share(0.5, 1.0), share(0.0, 0.0), share(0.5, 0.5), share(0.1, 9.0), share(0.0, 0.0)];
        let order = Order::of(&shares);
        assert_eq!((order.dropped(5), order.unseen()), (&[1, 4, 3, 2, 0][..], 2));
        assert_eq!((order.dropped(3), order.kept(3)), (&[1, 4, 3][..], vec![0, 2]));
    }
}
