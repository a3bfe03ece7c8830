//! Where the slabs of a frame end.

use crate::render::shaders::Slab;

/// A place in the total order: the depth key in the upper 32 bits, the index of the Gaussian in the lower ones.
pub type Place = u64;

/// The first place of a depth key.
pub fn place_of(key: u32) -> Place {
    u64::from(key) << 32
}

/// The slab from `begin` up to, but without, `end`.
pub fn slab(begin: Place, end: Place) -> Slab {
    let pair = |place: Place| [(place >> 32) as u32, place as u32];
    Slab { begin: pair(begin), end: pair(end) }
}

/// The part of their capacity that slabs are meant to fill. What is left covers the error of the estimate.
const FILL: f64 = 0.7;

/// Cuts a frame into slabs that fit, by what the slabs before demanded.
#[derive(Debug)]
pub struct Cut {
    begin: Place,
    end: Place,
    /// Places of the next slab.
    length: u64,
}

impl Cut {
    /// Begins a frame with the places below `end`, in slabs of `length` places as a first guess.
    pub fn new(end: Place, length: u64) -> Self {
        Self { begin: 0, end, length: length.max(1) }
    }

    /// The next slab; `None` if there is none left.
    pub fn next(&self) -> Option<(Place, Place)> {
        (self.begin < self.end).then(|| (self.begin, self.end.min(self.begin.saturating_add(self.length))))
    }

    /// The length of the next slab.
    pub fn length(&self) -> u64 {
        self.length
    }

    /// Goes on behind a slab that filled this part of the capacity.
    pub fn drawn(&mut self, (_, end): (Place, Place), filled: f64) {
        self.begin = end;
        let factor = (FILL / filled.max(1e-3)).clamp(0.5, 8.0);
        self.length = (self.length as f64 * factor) as u64;
    }

    /// Makes the slab shorter, which demanded `filled` times the capacity. False if it has a single place.
    pub fn shorten(&mut self, (begin, end): (Place, Place), filled: f64) -> bool {
        let length = end - begin;
        // The demand may be hidden by the overflow of an earlier stage, so it is at least halved.
        self.length = (length as f64 * (FILL / filled).clamp(1.0 / 1024.0, 0.5)) as u64;
        self.length = self.length.max(1);
        length > 1
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cuts places where `weight` splats lie at each of some depth keys, with room for `room` of them.
    fn cut(weights: &[(u32, u32)], room: u32) -> Vec<(Place, Place)> {
        let mut cut = Cut::new(place_of(1 << 20), u64::MAX);
        let mut slabs = Vec::new();
        let count = |(begin, end): (Place, Place)| -> u64 {
            let within = |key: u32, index: u32| (begin..end).contains(&(place_of(key) + u64::from(index)));
            weights.iter().map(|(key, n)| (0..*n).filter(|index| within(*key, *index)).count() as u64).sum()
        };
        while let Some(slab) = cut.next() {
            let filled = count(slab) as f64 / f64::from(room);
            if filled > 1.0 {
                assert!(cut.shorten(slab, filled));
            } else {
                slabs.push(slab);
                cut.drawn(slab, filled);
            }
        }
        slabs
    }

    #[test]
    fn slabs_follow_each_other_and_fit() {
        let slabs = cut(&[(10, 50), (11, 30), (900, 80), (1 << 19, 7)], 40);
        assert_eq!(slabs[0].0, 0);
        assert_eq!(slabs.last().unwrap().1, place_of(1 << 20));
        assert!(slabs.windows(2).all(|pair| pair[0].1 == pair[1].0));
        assert!(slabs.len() < 200, "{} slabs", slabs.len());
    }

    #[test]
    fn a_single_depth_is_cut_by_the_indices_of_its_gaussians() {
        let slabs = cut(&[(7, 100)], 9);
        let inside = slabs.iter().filter(|(begin, end)| begin >> 32 == 7 && end >> 32 == 7).count();
        assert!(inside >= 9, "{slabs:?}");
    }

    #[test]
    fn one_splat_without_room_is_told() {
        let mut cut = Cut::new(place_of(4), 1);
        assert!(!cut.shorten((5, 6), 2.0));
    }
}
