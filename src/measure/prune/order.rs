//! The order in which Gaussians are dropped.

use crate::render::Share;

/// The Gaussians of a scene that may be dropped, the least contribution first.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    gaussians: Vec<u32>,
    /// Gaussians that are always kept, by index.
    spared: Vec<u32>,
    /// Number of leading entries without a share in any view.
    unseen: usize,
}

impl Order {
    /// Sorts by the largest share, then by the sum of all shares, then by index. With `spares_unseen`, Gaussians
    /// without a share in any view are kept.
    pub fn of(shares: &[Share], spares_unseen: bool) -> Self {
        let is_spared = |index: &u32| spares_unseen && shares[*index as usize].largest == 0.0;
        let (spared, mut gaussians): (Vec<u32>, Vec<u32>) = (0..shares.len() as u32).partition(is_spared);
        let key = |index: u32| (shares[index as usize].largest, shares[index as usize].sum);
        gaussians.sort_by(|a, b| {
            let (a, b) = (key(*a), key(*b));
            a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)) // the sort is stable: equal ones keep their order
        });
        let unseen = gaussians.iter().take_while(|index| shares[**index as usize].largest == 0.0).count();
        Self { gaussians, spared, unseen }
    }

    /// Number of all Gaussians of the scene.
    pub fn all(&self) -> usize {
        self.gaussians.len() + self.spared.len()
    }

    /// Number of Gaussians that have no share in any view, and may be dropped.
    pub fn unseen(&self) -> usize {
        self.unseen
    }

    /// The most Gaussians that may be dropped: one is kept.
    pub fn most(&self) -> usize {
        self.gaussians.len().min(self.all().saturating_sub(1))
    }

    /// The first `count` Gaussians that may be dropped.
    pub fn dropped(&self, count: usize) -> &[u32] {
        &self.gaussians[..count]
    }

    /// The Gaussians that remain when the first `count` are dropped, by index.
    pub fn kept(&self, count: usize) -> Vec<u32> {
        let mut kept = [&self.gaussians[count..], &self.spared].concat();
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
        let order = Order::of(&shares, false);
        assert_eq!((order.dropped(5), order.unseen(), order.most()), (&[1, 4, 3, 2, 0][..], 2, 4));
        assert_eq!((order.dropped(3), order.kept(3)), (&[1, 4, 3][..], vec![0, 2]));
        let order = Order::of(&shares, true);
        assert_eq!((order.dropped(3), order.unseen(), order.most()), (&[3, 2, 0][..], 0, 3));
        assert_eq!((order.all(), order.kept(1)), (5, vec![0, 1, 2, 4]));
    }
}
