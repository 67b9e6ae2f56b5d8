//! A set of cells as bits.

use serde::{Deserialize, Serialize};

/// A set of the cells of one map: bit `cell % 64` of word `cell / 64`.
///
/// Maps of up to 64 cells, such as the paper's, keep their one word in place, so that copying a
/// state allocates nothing. Serialised as the list of words.
#[derive(Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(into = "Vec<u64>", from = "Vec<u64>")]
pub struct CellSet(Words);

#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Words {
    One(u64),
    /// Never of length one, so that equal sets have equal representations.
    Many(Box<[u64]>),
}

impl CellSet {
    /// The empty set for a map of `cells` cells.
    pub fn new(cells: usize) -> CellSet {
        if cells <= 64 { CellSet(Words::One(0)) } else { CellSet(Words::Many(vec![0; cells.div_ceil(64)].into())) }
    }

    /// Whether `cell` is in the set.
    ///
    /// # Panics
    /// If `cell` lies beyond the last word; as do the other methods.
    #[inline]
    pub fn contains(&self, cell: usize) -> bool {
        self.words()[cell / 64] >> (cell % 64) & 1 == 1
    }

    /// Adds `cell`; returns whether it was absent.
    #[inline]
    pub fn insert(&mut self, cell: usize) -> bool {
        let word = &mut self.words_mut()[cell / 64];
        let absent = *word >> (cell % 64) & 1 == 0;
        *word |= 1 << (cell % 64);
        absent
    }

    /// Removes every cell.
    #[inline]
    pub fn clear(&mut self) {
        self.words_mut().fill(0);
    }

    /// How many cells are in the set.
    pub fn count(&self) -> usize {
        self.words().iter().map(|word| word.count_ones() as usize).sum()
    }

    /// The cells of the set, ascending.
    #[inline]
    pub fn iter(&self) -> Cells<'_> {
        Cells::of(self.words())
    }

    /// The words, lowest cells first.
    #[inline]
    pub fn words(&self) -> &[u64] {
        match &self.0 {
            Words::One(word) => std::slice::from_ref(word),
            Words::Many(words) => words,
        }
    }

    #[inline]
    fn words_mut(&mut self) -> &mut [u64] {
        match &mut self.0 {
            Words::One(word) => std::slice::from_mut(word),
            Words::Many(words) => words,
        }
    }
}

/// The cells of a [`CellSet`], ascending.
#[derive(Clone, Debug)]
pub struct Cells<'a> {
    /// What is left of the current word.
    bits: u64,
    /// The cell of the current word's lowest bit.
    base: usize,
    later: &'a [u64],
}

impl<'a> Cells<'a> {
    /// The positions of the ones in `words`, lowest first.
    #[inline]
    pub fn of(words: &'a [u64]) -> Cells<'a> {
        let (&bits, later) = words.split_first().unwrap_or((&0, &[]));
        Cells { bits, base: 0, later }
    }
}

impl Iterator for Cells<'_> {
    type Item = usize;

    #[inline]
    fn next(&mut self) -> Option<usize> {
        while self.bits == 0 {
            let (&bits, later) = self.later.split_first()?;
            (self.bits, self.later) = (bits, later);
            self.base += 64;
        }
        let cell = self.base + self.bits.trailing_zeros() as usize;
        self.bits &= self.bits - 1;
        Some(cell)
    }
}

impl Clone for CellSet {
    fn clone(&self) -> CellSet {
        CellSet(self.0.clone())
    }

    /// Reuses the memory of `self`, unlike the derived implementation for an enum.
    fn clone_from(&mut self, source: &CellSet) {
        match (&mut self.0, &source.0) {
            (Words::Many(to), Words::Many(from)) => to.clone_from(from),
            (to, from) => *to = from.clone(),
        }
    }
}

impl From<CellSet> for Vec<u64> {
    fn from(set: CellSet) -> Vec<u64> {
        set.words().to_vec()
    }
}

impl From<Vec<u64>> for CellSet {
    /// Any list of words is some set; whether it fits a level is for
    /// [`State`](crate::State)'s check against that level.
    fn from(words: Vec<u64>) -> CellSet {
        match words[..] {
            [] => CellSet(Words::One(0)),
            [word] => CellSet(Words::One(word)),
            _ => CellSet(Words::Many(words.into())),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_cross_word_boundaries() {
        for cells in [1, 63, 64, 65, 128, 129, 1000] {
            let mut set = CellSet::new(cells);
            assert_eq!(set.words().len(), cells.div_ceil(64));
            let members: Vec<usize> = (0..cells).filter(|cell| cell % 7 == 0 || cell % 64 == 63).collect();
            for &cell in &members {
                assert!(set.insert(cell));
                assert!(!set.insert(cell));
            }
            assert_eq!(set.iter().collect::<Vec<_>>(), members);
            assert_eq!(set.count(), members.len());
            assert_eq!(CellSet::from(Vec::from(set.clone())), set);
            set.clear();
            assert_eq!(set, CellSet::new(cells));
        }
    }
}
