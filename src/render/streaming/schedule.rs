//! Which pages come next, and which leave for them. It takes milliseconds, so it is found beside the frames.

use std::cmp::Reverse;
use std::collections::HashSet;

use super::fallback::Family;

/// What a picture told of pages, and what was there then.
pub struct Question {
    /// Missing pages of the picture, with their priority and limit.
    pub demanded: Vec<[u32; 2]>,
    /// When, and how much, every page was wanted last, if the picture told.
    pub wanted: Option<Vec<u32>>,
    /// The number of the next picture.
    pub stamp: u16,
    /// By page.
    pub is_there: Vec<bool>,
    /// Pages that are read or brought.
    pub coming: HashSet<u32>,
    /// Pages that cannot be read.
    pub unreadable: HashSet<u32>,
    /// Pages that never leave, or do so already.
    pub kept: HashSet<u32>,
    /// Slots that nothing is coming for.
    pub free: usize,
    /// The most pages to read.
    pub most: usize,
}

/// What is to be done.
pub struct Plan {
    /// Pages to read, those that matter most first.
    pub read: Vec<u32>,
    /// Pages that leave for them.
    pub leave: Vec<u32>,
    /// The picture asked for pages that matter no more than those that are there.
    pub is_sated: bool,
}

/// Pictures after which a page that no picture wanted may leave.
const LATELY: u16 = 4;
/// Steps of codes by which a page must matter more than one that leaves for it: the eighth of a power of two.
const MARGIN: i32 = 64;

impl Plan {
    pub fn of(family: &Family, question: &Question) -> Self {
        let mut missing = missing(family, question);
        let is_idle = missing.is_empty() && question.coming.is_empty();
        missing.truncate(question.most);
        let (mut leave, mut is_sated, free) = (Vec::new(), is_idle, question.free);
        if missing.len() > free {
            if let Some(wanted) = &question.wanted {
                leave = leaving(family, question, wanted, &missing[free..]);
                is_sated |= leave.is_empty() && free == 0;
            }
            // The next picture tells what may leave, if this one did not.
            missing.truncate(free + leave.len());
        }
        Self { read: missing.into_iter().map(|(page, _)| page).collect(), leave, is_sated }
    }
}

/// The pages that are missing so that those of the picture are drawn, with what they are worth, the most first.
fn missing(family: &Family, question: &Question) -> Vec<(u32, i32)> {
    let mut wishes = family.wishes();
    for [page, word] in &question.demanded {
        family.wish(&mut wishes, *page, word & 0xffff, (word >> 16) as u16);
    }
    let Question { is_there, coming, unreadable, .. } = question;
    let is_new = |page: &u32| !is_there[*page as usize] && !coming.contains(page) && !unreadable.contains(page);
    let mut missing: Vec<_> = family.wanted(&wishes).filter(|(page, _)| is_new(page)).collect();
    missing.sort_unstable_by_key(|(page, worth)| (Reverse(*worth), *page));
    missing
}

/// The pages that leave for some of the missing ones. What is there is worth what it would be if it were missing, so
/// that no page comes and goes.
fn leaving(family: &Family, question: &Question, wanted: &[u32], missing: &[(u32, i32)]) -> Vec<u32> {
    let age = |word: u32| question.stamp.wrapping_sub((word >> 16) as u16);
    let mut wishes = family.wishes();
    for (word, page) in wanted.iter().zip(0..).filter(|(word, _)| **word != 0 && age(**word) < LATELY) {
        family.wish(&mut wishes, page, word & 0xffff, 0);
    }
    let worth = |page: u32| (family.worth(&wishes, page), Reverse(age(wanted[page as usize])), page);
    let there = question.is_there.iter().zip(0..).filter(|(is_there, _)| **is_there).map(|(_, page)| page);
    let mut there: Vec<_> = there.filter(|page| !question.kept.contains(page)).map(worth).collect();
    if missing.len() < there.len() {
        there.select_nth_unstable(missing.len());
        there.truncate(missing.len());
    }
    there.sort_unstable();
    let is_worse = |own: Option<i32>, other: i32| own.is_none_or(|own| own + MARGIN < other);
    let leaving = there.iter().zip(missing).take_while(|((own, ..), (_, other))| is_worse(*own, *other));
    leaving.map(|((.., page), _)| *page).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pagefile::{NO_PAGE, PARTS, PageLod, SAMPLES};

    /// A page in the block at `x`, whose nodes have parents with errors up to `coarsest` in page `parent`.
    fn level(x: f32, parent: u32, coarsest: u16) -> PageLod {
        PageLod {
            low: [x; 3],
            high: [x; 3],
            reference_width: 0.0,
            parent,
            highest_opacity: 1.0,
            least_error: 0,
            errors: [0; PARTS],
            parent_errors: [coarsest; PARTS],
            squared_errors: [0; PARTS],
            samples: [0; SAMPLES],
            checksum: 0,
        }
    }

    /// Four pages with parents in a fifth.
    fn family() -> Family {
        let levels = [100, 300, 900, 1600].map(|coarsest| level(1.0, 4, coarsest));
        Family::of(&[&levels[..], &[level(0.0, NO_PAGE, 0)]].concat())
    }

    fn question(is_there: [bool; 5]) -> Question {
        Question {
            demanded: Vec::new(),
            wanted: None,
            stamp: 9,
            is_there: is_there.to_vec(),
            coming: HashSet::new(),
            unreadable: HashSet::new(),
            kept: HashSet::from([4]),
            free: 0,
            most: 9,
        }
    }

    #[test]
    fn what_matters_most_is_read_first_as_far_as_there_is_room() {
        let asked = |free, most| {
            let demanded = vec![[0, 5000]];
            let coming = HashSet::from([1]);
            Plan::of(&family(), &Question { demanded, free, most, coming, ..question([false; 5]) })
        };
        let Plan { read, leave, is_sated } = asked(9, 9);
        // The demanded page needs all of its block that has errors above the limit.
        assert_eq!((read, leave, is_sated), (vec![3, 2, 0], vec![], false));
        assert_eq!(asked(9, 2).read, [3, 2]);
        let full = asked(1, 9);
        assert_eq!((full.read, full.is_sated), (vec![3], false), "what leaves is not known yet");
        let unreadable = HashSet::from([0, 1, 2, 3]);
        let nothing = Plan::of(&family(), &Question { unreadable, ..question([false; 5]) });
        assert!(nothing.read.is_empty() && nothing.is_sated);
    }

    #[test]
    fn pages_leave_for_those_that_matter_more() {
        let asked = |wanted: [u32; 5], priority: u32| {
            let question = Question {
                demanded: vec![[0, priority]],
                wanted: Some(wanted.to_vec()),
                ..question([false, true, true, true, true])
            };
            Plan::of(&family(), &question)
        };
        // Nothing was wanted lately: any page but the one that is kept may leave.
        let Plan { read, leave, .. } = asked([0; 5], 5000);
        assert_eq!((read, leave), (vec![0], vec![1]));
        // They were wanted in the picture before, by 4000 or by 6000: those with larger errors are worth more.
        let of = |priority: u32| [0, priority | 8 << 16, priority | 8 << 16, priority | 8 << 16, 0];
        let Plan { read, leave, is_sated } = asked(of(4000), 8000);
        assert_eq!((read, leave, is_sated), (vec![0], vec![1], false));
        let Plan { read, leave, is_sated } = asked(of(6000), 100);
        assert!(read.is_empty() && leave.is_empty() && is_sated);
    }
}
