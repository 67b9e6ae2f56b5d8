//! Held–Karp dynamic programming: shortest tours through every subset of targets.

/// A set of targets: bit `t` for target `t`.
type Subset = u32;

/// The length of what does not exist. No tour is as long: walking around a spanning tree of the map
/// visits everything in less than twice its cells, so tours and tours plus a leg stay below
/// 3 · 2¹⁴ steps.
const NONE: u16 = u16::MAX;

/// The lengths of the shortest tours from every target through every set of targets.
#[derive(Clone, Debug)]
pub(super) struct Tours {
    /// n, the number of targets.
    count: usize,
    /// Steps between targets, `[n, n]`.
    legs: Vec<u16>,
    /// Steps of the shortest tour that starts on a target of a set and visits the set, `[2^n, n]`;
    /// [`NONE`] for targets that are not in the set.
    lengths: Vec<u16>,
    /// The shortest tour from each target by number of targets visited, `[n + 1, n]`.
    shortest: Vec<Tour>,
}

/// A tour: its steps, and the targets that it visits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Tour {
    pub(super) length: u16,
    subset: Subset,
}

impl Tours {
    /// Fills the tables for `count` targets, `legs[i * count + j]` steps apart: O(2ⁿ n²) time,
    /// 2ⁿ · n · 2 bytes.
    pub(super) fn new(count: usize, legs: Vec<u16>) -> Tours {
        let mut lengths = vec![NONE; count << count];
        let mut shortest = vec![Tour { length: NONE, subset: 0 }; (count + 1) * count];
        // Subsets come after their own subsets.
        for subset in 1..1usize << count {
            for first in (0..count).filter(|first| subset >> first & 1 == 1) {
                let rest = subset ^ 1 << first;
                // Runs over all targets, those outside `rest` standing at NONE: without a branch,
                // the loop is one of vector instructions.
                let onward = &lengths[rest * count..][..count];
                let from_first = &legs[first * count..][..count];
                let sums = from_first.iter().zip(onward).map(|(leg, tour)| leg.saturating_add(*tour));
                let length = if rest == 0 { 0 } else { sums.fold(NONE, u16::min) };
                lengths[subset * count + first] = length;

                let record = &mut shortest[subset.count_ones() as usize * count + first];
                if length < record.length {
                    *record = Tour { length, subset: subset as Subset };
                }
            }
        }
        Tours { count, legs, lengths, shortest }
    }

    /// The shortest tour from `first` through `targets` targets, itself included.
    pub(super) fn shortest(&self, targets: usize, first: usize) -> Tour {
        self.shortest[targets * self.count + first]
    }

    /// The targets of that tour, in order.
    pub(super) fn order(&self, targets: usize, first: usize) -> Vec<usize> {
        let mut left = self.shortest(targets, first).subset;
        let mut order = Vec::with_capacity(targets);
        let mut next = Some(first);
        while let Some(target) = next {
            order.push(target);
            left &= !(1 << target);
            let onward = |&after: &usize| {
                let tour = self.lengths[left as usize * self.count + after];
                self.legs[target * self.count + after].saturating_add(tour)
            };
            next = (0..self.count).filter(|after| left >> after & 1 == 1).min_by_key(onward);
        }
        order
    }
}
