//! A part of a run, for one of several machines.
//!
//! Screen s of the k-th N is in part (s + k) mod n: each part has its share of every N, which cost very
//! different times, and odd screens do not all fall to the first part. Where a screen goes depends neither on how
//! many there are nor on what has been run, and its outcome not on where it goes.

use std::fmt;
use std::str::FromStr;

/// Most parts: beyond any cluster.
const MOST: u32 = 1_000_000;

/// One part of so many.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shard {
    /// From 1 to `count`.
    index: u32,
    count: u32,
}

impl Shard {
    /// Whether `screen` of N number `place` by increasing N, from 0, is in this part.
    pub fn holds(&self, place: usize, screen: u32) -> bool {
        (u64::from(screen) + place as u64) % u64::from(self.count) == u64::from(self.index - 1)
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/');
        let number = |part: &str| part.trim().parse::<u32>().ok();
        match parts.and_then(|(index, count)| Some((number(index)?, number(count)?))) {
            Some((index, count)) if (1..=count).contains(&index) && count <= MOST => {
                Ok(Self { index, count })
            }
            _ => Err(format!("must be i/n, such as 2/8, i from 1 to n, n at most {MOST}")),
        }
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_screen_is_in_one_part() {
        for count in 1..=9 {
            let parts: Vec<Shard> =
                (1..=count).map(|i| format!("{i}/{count}").parse().unwrap()).collect();
            for place in 0..4 {
                let mut shares = vec![0; parts.len()];
                for screen in 0..100 {
                    let held: Vec<_> =
                        (0..parts.len()).filter(|&k| parts[k].holds(place, screen)).collect();
                    assert_eq!(held.len(), 1);
                    shares[held[0]] += 1;
                }
                let (least, most) = (shares.iter().min(), shares.iter().max());
                assert!(most.unwrap() - least.unwrap() <= 1, "{shares:?}");
            }
        }
    }

    #[test]
    fn names_lead_back() {
        assert_eq!("2/8".parse::<Shard>().unwrap().to_string(), "2/8");
        for wrong in ["", "1", "0/4", "5/4", "1/0", "-1/4", "1/2/3", "1/1000001", "a/b"] {
            let error = wrong.parse::<Shard>().unwrap_err();
            assert!(error.contains("i/n"), "{wrong}: {error}");
        }
    }
}
