//! `--shard K/N`: the part of the cameras that one of N runs draws. The runs need not know of each other.

use std::fmt;
use std::str::FromStr;

use anyhow::{Error, Result, anyhow};

/// One of several runs, each of which draws a part of the cameras.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shard {
    /// From 1 to `count`.
    number: usize,
    count: usize,
}

impl Shard {
    /// What this shard takes of `all`: every `count`th element. Neighbours, which often take equally long to draw, are
    /// in different shards.
    pub fn part<T>(self, all: Vec<T>) -> Vec<T> {
        all.into_iter().skip(self.number - 1).step_by(self.count).collect()
    }
}

impl FromStr for Shard {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        let numbers = text.split_once('/').and_then(|(k, n)| Some((k.parse().ok()?, n.parse().ok()?)));
        let shard = numbers.map(|(number, count)| Self { number, count });
        let is_possible = |shard: &Self| (1..=shard.count).contains(&shard.number);
        shard.filter(is_possible).ok_or_else(|| anyhow!("expected K/N, the shard K of N, with K from 1 to N, like 3/8"))
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_take_every_camera_once_and_equally_many() {
        let all: Vec<usize> = (0..97).collect();
        for count in 1..=64 {
            let shards = (1..=count).map(|number| Shard { number, count });
            let parts: Vec<Vec<usize>> = shards.map(|shard| shard.part(all.clone())).collect();
            let sizes = || parts.iter().map(Vec::len);
            assert!(sizes().max().unwrap() - sizes().min().unwrap() <= 1, "{count}");
            let mut taken = parts.concat();
            taken.sort_unstable();
            assert_eq!(taken, all, "{count}");
        }
        assert_eq!("2/3".parse::<Shard>().unwrap().part(all)[..3], [1, 4, 7]);
        assert_eq!("5/8".parse::<Shard>().unwrap().part(vec![0, 1, 2]), [0; 0]);
    }

    #[test]
    fn a_shard_is_one_of_its_number() {
        for wrong in ["0/3", "4/3", "1/0", "0/0", "-1/3", "1", "1/", "/3", "1/2/3", "a/b", "1.5/3", "", "1 / 3"] {
            assert!(wrong.parse::<Shard>().is_err(), "{wrong}");
        }
        assert_eq!("12/12".parse::<Shard>().unwrap().to_string(), "12/12");
    }
}
