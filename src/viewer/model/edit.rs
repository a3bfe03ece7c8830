//! Edits: the sets of selected, hidden and deleted Gaussians, and what is selected by.

use std::ops::RangeInclusive;
use std::sync::Arc;

use glam::DVec3;
use rayon::prelude::*;

use crate::render::{Figure, Outline, SelectionMode};
use crate::scene::{Gaussians, harmonics};

/// A set of Gaussians: a bit for each. A clone shares them.
type Set = Arc<[u32]>;

/// The edits of layers, by their numbers.
pub type Edits = Vec<(u64, Option<Arc<Edit>>)>;

/// Numbers of a run in a project file: 1 if its Gaussians are selected, plus 2 if hidden, plus 4 if deleted.
const SELECTED: u8 = 1;
const HIDDEN: u8 = 2;
const DELETED: u8 = 4;

/// The sets of selected, hidden and deleted Gaussians of a scene, of which no two have one in common. A clone shares
/// them, and edits share the sets in which they do not differ.
#[derive(Clone, PartialEq, Eq)]
pub struct Edit {
    gaussians: usize,
    selected: Set,
    hidden: Set,
    deleted: Set,
    counts: Counts,
}

/// Numbers of Gaussians.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counts {
    pub selected: usize,
    pub hidden: usize,
    pub deleted: usize,
}

/// A change of all Gaussians, by the sets that they are in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    Hide,
    Delete,
    /// Deletes all Gaussians that are drawn and not selected.
    Crop,
    ShowHidden,
    SelectAll,
    SelectNone,
    Invert,
}

impl Edit {
    /// An edit of this number of Gaussians with empty sets.
    pub fn new(gaussians: usize) -> Self {
        let none: Set = vec![0; gaussians.div_ceil(32)].into();
        Self { gaussians, selected: none.clone(), hidden: none.clone(), deleted: none, counts: Counts::default() }
    }

    fn with(&self, selected: Set, hidden: Set, deleted: Set) -> Self {
        let count = |set: &Set| set.iter().map(|word| word.count_ones() as usize).sum();
        let counts = Counts { selected: count(&selected), hidden: count(&hidden), deleted: count(&deleted) };
        Self { gaussians: self.gaussians, selected, hidden, deleted, counts }
    }

    /// Number of Gaussians of the scene.
    pub fn gaussians(&self) -> usize {
        self.gaussians
    }

    /// Bytes of the sets that this edit does not share with another one.
    pub fn bytes_beside(&self, other: Option<&Self>) -> usize {
        let mine = [&self.selected, &self.hidden, &self.deleted];
        let theirs = other.map(|other| [&other.selected, &other.hidden, &other.deleted]);
        let is_own = |set: &&&Set| theirs.is_none_or(|theirs| !theirs.iter().any(|other| Arc::ptr_eq(set, other)));
        mine.iter().filter(is_own).map(|set| 4 * set.len()).sum()
    }

    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// True if not all Gaussians are drawn.
    pub fn leaves_out(&self) -> bool {
        self.counts.hidden + self.counts.deleted > 0
    }

    /// The set of selected Gaussians.
    pub fn selected(&self) -> &[u32] {
        &self.selected
    }

    /// The words of the set of hidden and deleted Gaussians.
    pub fn left_out(&self) -> impl Iterator<Item = u32> {
        self.hidden.iter().zip(&*self.deleted).map(|(hidden, deleted)| hidden | deleted)
    }

    /// Indices of the drawn Gaussians.
    pub fn drawn(&self) -> Vec<u32> {
        self.outside(self.left_out())
    }

    /// Indices of the Gaussians that are not deleted.
    pub fn kept(&self) -> Vec<u32> {
        self.outside(self.deleted.iter().copied())
    }

    fn outside(&self, set: impl Iterator<Item = u32>) -> Vec<u32> {
        let of_word = |(i, word): (usize, u32)| {
            (0..32).filter(move |bit| word >> bit & 1 == 0).map(move |bit| 32 * i as u32 + bit)
        };
        set.enumerate().flat_map(of_word).take_while(|index| (*index as usize) < self.gaussians).collect()
    }

    /// True if the same Gaussians are drawn.
    pub fn draws_same(&self, other: &Self) -> bool {
        let are_same = |a: &Set, b: &Set| Arc::ptr_eq(a, b);
        let shares = are_same(&self.hidden, &other.hidden) && are_same(&self.deleted, &other.deleted);
        let left_out = |counts: Counts| counts.hidden + counts.deleted;
        self.gaussians == other.gaussians
            && left_out(self.counts) == left_out(other.counts)
            && (shares || self.left_out().eq(other.left_out()))
    }

    /// The edit with another set of selected Gaussians, without those that are not drawn.
    #[must_use]
    pub fn selecting(&self, selected: impl Iterator<Item = u32>) -> Self {
        let selected = selected.zip(self.drawn_words()).map(|(selected, drawn)| selected & drawn).collect();
        self.with(selected, self.hidden.clone(), self.deleted.clone())
    }

    /// The edit with the Gaussians of a set selected, combined with the selection before.
    #[must_use]
    pub fn combined(&self, mode: SelectionMode, inside: &[u32]) -> Self {
        let pairs = self.selected.iter().zip(inside);
        self.selecting(pairs.map(|(before, inside)| match mode {
            SelectionMode::Replace => *inside,
            SelectionMode::Add => before | inside,
            SelectionMode::Subtract => before & !inside,
        }))
    }

    #[must_use]
    pub fn changed(&self, change: Change) -> Self {
        let Self { selected, hidden, deleted, .. } = self;
        let none = || Self::new(self.gaussians).selected;
        let with_selected = |set: &Set| set.iter().zip(&**selected).map(|(set, selected)| set | selected).collect();
        let unselected = || self.drawn_words().zip(&**selected).map(|(drawn, selected)| drawn & !selected);
        match change {
            Change::Hide => self.with(none(), with_selected(hidden), deleted.clone()),
            Change::Delete => self.with(none(), hidden.clone(), with_selected(deleted)),
            Change::Crop => {
                let deleted = deleted.iter().zip(unselected()).map(|(deleted, others)| deleted | others).collect();
                self.with(selected.clone(), hidden.clone(), deleted)
            }
            Change::ShowHidden => self.with(selected.clone(), none(), deleted.clone()),
            Change::SelectAll => self.with(self.drawn_words().collect(), hidden.clone(), deleted.clone()),
            Change::SelectNone => self.with(none(), hidden.clone(), deleted.clone()),
            Change::Invert => self.with(unselected().collect(), hidden.clone(), deleted.clone()),
        }
    }

    /// The edit with the Gaussians of a set deleted, too.
    #[must_use]
    pub fn deleting(&self, set: &[u32]) -> Self {
        let deleted = self.deleted.iter().zip(set).map(|(deleted, set)| deleted | set).collect();
        self.with(self.selected.clone(), self.hidden.clone(), deleted)
    }

    /// The words of the set of drawn Gaussians.
    fn drawn_words(&self) -> impl Iterator<Item = u32> {
        let last = self.gaussians / 32;
        let tail = !(u32::MAX << (self.gaussians % 32));
        let drawn = move |(i, left_out): (usize, u32)| if i == last { !left_out & tail } else { !left_out };
        self.left_out().enumerate().map(drawn)
    }

    /// Runs of Gaussians in the same sets, for a file: length, and the sum of the numbers of the sets.
    pub fn to_runs(&self) -> Vec<(usize, u8)> {
        let mut runs: Vec<(usize, u8)> = Vec::new();
        for i in 0..self.gaussians {
            let number = |set: &Set, number: u8| if set[i / 32] >> (i % 32) & 1 == 1 { number } else { 0 };
            let of = number(&self.selected, SELECTED) | number(&self.hidden, HIDDEN) | number(&self.deleted, DELETED);
            match runs.last_mut() {
                Some((length, last)) if *last == of => *length += 1,
                _ => runs.push((1, of)),
            }
        }
        runs
    }

    /// The inverse of [`Edit::to_runs`]; `None` if a run is invalid.
    pub fn from_runs(runs: &[(usize, u8)]) -> Option<Self> {
        const MAX: usize = u32::MAX as usize;
        let mut gaussians = 0;
        let mut sets = [const { Vec::new() }; 3];
        for (length, of) in runs {
            let set = match *of {
                0 => None,
                SELECTED => Some(0),
                HIDDEN => Some(1),
                DELETED => Some(2),
                _ => return None,
            };
            if *length > MAX - gaussians {
                return None;
            }
            let next = gaussians + length;
            sets.iter_mut().for_each(|words: &mut Vec<u32>| words.resize(next.div_ceil(32), 0));
            if let Some(set) = set {
                (gaussians..next).for_each(|i| sets[set][i / 32] |= 1 << (i % 32));
            }
            gaussians = next;
        }
        let [selected, hidden, deleted] = sets.map(Set::from);
        Some(Self::new(gaussians).with(selected, hidden, deleted))
    }
}

/// The set of the Gaussians of `count` for which `is_inside` is true.
pub fn set_of(count: usize, is_inside: impl Fn(usize) -> bool + Sync) -> Vec<u32> {
    let word = |first: usize| {
        let bits = (first..count.min(first + 32)).filter(|i| is_inside(*i)).map(|i| 1 << (i - first));
        bits.fold(0, |word, bit: u32| word | bit)
    };
    (0..count).into_par_iter().step_by(32).map(word).collect()
}

/// The sets of several scenes as that of the scenes joined: `count` Gaussians each, in their order.
pub fn joined_sets(sets: impl Iterator<Item = (usize, Vec<u32>)>) -> Vec<u32> {
    let (mut all, mut begin): (Vec<u32>, usize) = (Vec::new(), 0);
    for (count, words) in sets {
        all.resize((begin + count).div_ceil(32), 0);
        let (first, shift) = (begin / 32, begin % 32);
        for (i, word) in words.iter().enumerate() {
            all[first + i] |= word << shift;
            if shift > 0 && word >> (32 - shift) != 0 {
                all[first + i + 1] |= word >> (32 - shift);
            }
        }
        begin += count;
    }
    all
}

/// The part of a set that is of the `count` Gaussians from `begin` on.
pub fn part_of_set(set: &[u32], begin: usize, count: usize) -> Vec<u32> {
    let (first, shift) = (begin / 32, begin % 32);
    let word = |i: usize| {
        let low = set[first + i] >> shift;
        let high = if shift > 0 { set.get(first + i + 1).copied().unwrap_or(0) << (32 - shift) } else { 0 };
        let left = count - 32 * i;
        (low | high) & if left < 32 { (1 << left) - 1 } else { u32::MAX }
    };
    (0..count.div_ceil(32)).map(word).collect()
}

/// A property by which Gaussians are selected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Property {
    Opacity,
    /// The largest standard deviation, world units of the file.
    Scale,
    /// The largest standard deviation over the smallest.
    Anisotropy,
    /// The largest alpha times transmittance at a pixel of the view.
    Contribution,
    /// The distance from the eighth nearest centre, over the median of all: large for what floats alone.
    Isolation,
    /// The largest difference of a channel from this colour, without spherical harmonics of a degree above 0.
    Colour([f32; 3]),
}

impl Property {
    /// The properties that need no colour, with their names.
    pub const ALL: [(Self, &str); 5] = [
        (Self::Opacity, "opacity"),
        (Self::Scale, "largest scale"),
        (Self::Anisotropy, "anisotropy"),
        (Self::Contribution, "contribution"),
        (Self::Isolation, "isolation"),
    ];

    pub fn name(self) -> &'static str {
        Self::ALL.iter().find(|(property, _)| *property == self).map_or("distance from a colour", |(_, name)| name)
    }

    /// The property of a Gaussian.
    ///
    /// # Panics
    /// For a contribution and an isolation, which do not depend on the Gaussian alone.
    pub fn value(self, gaussians: &Gaussians, index: usize) -> f32 {
        let scales = gaussians.scales()[index];
        let (low, high) = scales.iter().fold((f32::MAX, 0.0), |(low, high): (f32, f32), s| (low.min(*s), high.max(*s)));
        match self {
            Self::Opacity => gaussians.opacities()[index],
            Self::Scale => high,
            Self::Anisotropy => high / low.max(f32::MIN_POSITIVE),
            Self::Contribution | Self::Isolation => unreachable!("it does not depend on the Gaussian alone"),
            Self::Colour(of) => {
                let own = base_colour(gaussians, index);
                own.iter().zip(of).map(|(own, of)| (own - of).abs()).fold(0.0, f32::max)
            }
        }
    }
}

/// The colour of a Gaussian without spherical harmonics of a degree above 0.
pub fn base_colour(gaussians: &Gaussians, index: usize) -> [f32; 3] {
    let sum = |coefficient: f32| (0.5 + harmonics::C0 * f64::from(coefficient)).max(0.0) as f32;
    gaussians.sh(index)[0].map(sum)
}

/// A set of Gaussians to select.
#[derive(Clone, Debug, PartialEq)]
pub enum Selection {
    /// Centres inside an outline in the picture.
    Outline(Outline),
    /// Centres within a ball of the world: its centre and radius.
    Ball(DVec3, f64),
    /// Centres within a box of the world: its least and its greatest corner.
    Box(DVec3, DVec3),
    /// A property within a range.
    Values(Property, RangeInclusive<f32>),
}

impl Selection {
    /// The figure that selects these Gaussians.
    pub fn figure(&self) -> Figure {
        match self.clone() {
            Self::Outline(outline) => Figure::Outline(outline),
            Self::Ball(centre, radius) => Figure::Ball(centre, radius),
            Self::Box(low, high) => Figure::Box(low, high),
            Self::Values(_, range) => Figure::Values(range),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn selections_combine() {
        let of = |is_inside: fn(usize) -> bool| set_of(6, is_inside);
        let edit = Edit::new(6).combined(SelectionMode::Replace, &of(|i| i < 3));
        assert_eq!(edit.counts(), Counts { selected: 3, hidden: 0, deleted: 0 });
        let added = edit.combined(SelectionMode::Add, &of(|i| i == 4));
        assert_eq!(added.selected(), [0b10111]);
        let fewer = added.combined(SelectionMode::Subtract, &of(|i| i < 2));
        assert_eq!(fewer.counts().selected, 2);
        assert_eq!(fewer.changed(Change::Invert).counts().selected, 4);
        // Gaussians that are not drawn are not selected.
        let hidden = fewer.changed(Change::Hide);
        assert_eq!(hidden.counts(), Counts { selected: 0, hidden: 2, deleted: 0 });
        assert_eq!(hidden.drawn(), [0, 1, 3, 5]);
        assert_eq!(hidden.kept().len(), 6);
        assert_eq!(hidden.combined(SelectionMode::Replace, &of(|_| true)).selected(), [0b101011]);
        let all = hidden.changed(Change::SelectAll).changed(Change::Delete);
        assert_eq!((all.drawn().len(), all.kept()), (0, vec![2, 4]), "hidden Gaussians are kept");
        assert_eq!(all.changed(Change::ShowHidden).drawn(), [2, 4]);
        let cropped = fewer.changed(Change::Crop);
        assert_eq!((cropped.drawn(), cropped.counts().selected), (vec![2, 4], 2));
        assert!(cropped.changed(Change::SelectNone).draws_same(&cropped) && !cropped.draws_same(&fewer));
        let again = Edit::from_runs(&all.to_runs());
        assert!(again == Some(all.clone()));
        assert!(Edit::from_runs(&[(3, 8)]).is_none() && Edit::from_runs(&[(3, 5)]).is_none());
        assert!(Edit::from_runs(&[(usize::MAX, 0)]).is_none());
        // A selection alone shares the sets of what is drawn.
        assert_eq!((cropped.changed(Change::Invert).bytes_beside(Some(&cropped)), cropped.bytes_beside(None)), (4, 12));
    }

    #[test]
    fn sets_of_scenes_are_joined_and_parted() {
        let counts = [5, 32, 0, 70, 27, 64, 1];
        let sets: Vec<_> = counts.iter().map(|count| set_of(*count, |i| (i * i + count) % 3 == 0)).collect();
        let joined = joined_sets(counts.into_iter().zip(sets.clone()));
        assert_eq!(joined.len(), counts.iter().sum::<usize>().div_ceil(32));
        let mut begin = 0;
        for (count, set) in counts.into_iter().zip(sets) {
            assert_eq!(part_of_set(&joined, begin, count), set, "{count} from {begin}");
            begin += count;
        }
    }
}
