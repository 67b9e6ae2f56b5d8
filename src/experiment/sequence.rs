//! Sequences: the orders in which levels come, cycles of them, and shifts by seed.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use coverage_env::Level;

use super::curriculum::{self, Curriculum, LEVEL, ONLY};
use super::timesteps::Timesteps;
use crate::config::check_name;
use crate::error::UserError;

/// Names that are longer are numbers instead.
const MAX_NAME: usize = 40;

/// The sequences that an arm is trained through.
#[derive(Clone, Debug)]
pub struct Sequences {
    /// At least one.
    orders: Vec<Order>,
    /// How many times the levels of an order come.
    repeat: usize,
    /// None for the arm's setting.
    timesteps: Option<Timesteps>,
    through: Through,
}

/// Which seeds go through which orders.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Through {
    /// Every seed through every order.
    #[default]
    All,
    /// The same, but each seed begins at a place of its own: an order is rotated by the seed.
    Shifted,
    /// Each seed through one order: seed s through that at place s, modulo their number.
    InTurn,
}

/// One order of levels.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Order {
    /// The name that the file gives it.
    pub name: Option<String>,
    /// The levels of a cycle.
    pub levels: Vec<Arc<Level>>,
}

impl Sequences {
    /// Checks that they are possible.
    ///
    /// # Errors
    /// Levels that do not fit together, too many stages, a list of timesteps of another length, orders or names that stand
    /// twice, and names that are not to be folders'.
    pub fn new(
        orders: Vec<Order>,
        repeat: usize,
        timesteps: Option<Timesteps>,
        through: Through,
    ) -> Result<Self, UserError> {
        let sequences = Self { orders, repeat, timesteps, through };
        let all: Vec<Arc<Level>> = sequences.orders.iter().flat_map(|order| order.levels.iter().cloned()).collect();
        curriculum::distinct(&all)?;
        let mut seen = BTreeSet::new();
        for (index, order) in sequences.orders.iter().enumerate() {
            sequences.curriculum(index, 0, 1)?;
            let names: Vec<&str> = order.levels.iter().map(|level| level.name()).collect();
            let list = names.join(", ");
            if !seen.insert(names) {
                return Err(UserError::new(format!("order: [{list}] stands twice: drop one of the two")));
            }
        }
        for name in sequences.orders.iter().filter_map(|order| order.name.as_deref()) {
            check_name(name).map_err(|problem| UserError::new(format!("order: {problem}")))?;
            if name.starts_with(LEVEL) {
                let problem = format!("order: {name}: names that begin with {LEVEL} are those of single levels");
                return Err(UserError::new(problem + ": choose another"));
            }
        }
        let mut names = BTreeSet::new();
        for (index, order) in sequences.orders.iter().enumerate() {
            let name = sequences.name(index, 0, &order.levels);
            if names.contains(&name) {
                return Err(UserError::new(format!("order: the name {name} stands twice: choose another")));
            }
            names.insert(name);
        }
        Ok(sequences)
    }

    /// The same with these timesteps for every stage.
    pub fn with_timesteps(self, timesteps: u64) -> Self {
        Self { timesteps: Some(Timesteps::Each(timesteps)), ..self }
    }

    /// What it says of timesteps itself.
    pub fn timesteps(&self) -> Option<&Timesteps> {
        self.timesteps.as_ref()
    }

    /// How many orders there are, shifts aside.
    pub fn len(&self) -> usize {
        self.orders.len()
    }

    /// Stages of the shortest of them.
    pub fn fewest_stages(&self) -> usize {
        self.orders.iter().map(|order| order.levels.len() * self.repeat).min().unwrap_or(0)
    }

    /// One of their levels; all have one size.
    pub fn first_level(&self) -> &Level {
        &self.orders[0].levels[0]
    }

    /// Whether there is none, which cannot be.
    pub fn is_empty(&self) -> bool {
        self.orders.is_empty()
    }

    /// Every sequence with those of `seeds` that go through it; `timesteps` where it does not say its own.
    ///
    /// # Errors
    /// None that [`new`](Self::new) does not have.
    pub fn curricula(&self, seeds: &[u64], timesteps: u64) -> Result<Vec<(Curriculum, Vec<u64>)>, UserError> {
        let mut curricula = Vec::new();
        for (index, order) in self.orders.iter().enumerate() {
            let mut by_shift: BTreeMap<usize, Vec<u64>> = BTreeMap::new();
            for &seed in seeds {
                let modulo = |number: usize| (seed % number as u64) as usize;
                let shift = match self.through {
                    Through::All => 0,
                    Through::Shifted => modulo(order.levels.len()),
                    Through::InTurn if modulo(self.orders.len()) == index => 0,
                    Through::InTurn => continue,
                };
                by_shift.entry(shift).or_default().push(seed);
            }
            for (shift, seeds) in by_shift {
                curricula.push((self.curriculum(index, shift, timesteps)?, seeds));
            }
        }
        Ok(curricula)
    }

    /// Every level alone, as long as its longest stage in any of the sequences.
    pub fn single_levels(&self, timesteps: u64) -> Vec<(Arc<Level>, u64)> {
        let mut levels: Vec<(Arc<Level>, u64)> = Vec::new();
        for order in &self.orders {
            let cycle = order.levels.len();
            let own = self.timesteps.clone().unwrap_or(Timesteps::Each(timesteps));
            let of_stages = own.of_stages(cycle * self.repeat, cycle).unwrap_or_default();
            for (stage, timesteps) in of_stages.into_iter().enumerate() {
                // With shifts by seed every level comes at every place.
                let timesteps = if self.through == Through::Shifted { own.longest() } else { timesteps };
                let level = &order.levels[stage % cycle];
                match levels.iter_mut().find(|(known, _)| known.name() == level.name()) {
                    Some((_, longest)) => *longest = timesteps.max(*longest),
                    None => levels.push((level.clone(), timesteps)),
                }
            }
        }
        levels
    }

    /// The sequence of an order that is rotated by `shift` places.
    fn curriculum(&self, index: usize, shift: usize, timesteps: u64) -> Result<Curriculum, UserError> {
        let mut levels = self.orders[index].levels.clone();
        let cycle = levels.len();
        levels.rotate_left(shift);
        let name = self.name(index, shift, &levels);
        let own = self.timesteps.clone().unwrap_or(Timesteps::Each(timesteps));
        let stages = cycle.saturating_mul(self.repeat).min(1 << 20);
        let timesteps = own.of_stages(stages, cycle).map_err(UserError::new)?;
        Curriculum::sequence(name, levels.into_iter().cycle().zip(timesteps).collect())
    }

    /// `curriculum` where there is only one; else the order's own name, its levels' names, or its number.
    fn name(&self, index: usize, shift: usize, levels: &[Arc<Level>]) -> String {
        let order = &self.orders[index];
        let shifts = self.through == Through::Shifted;
        let is_only = self.orders.len() == 1 && !shifts;
        let of_levels = order_name(levels);
        match (&order.name, of_levels) {
            (None, _) if is_only => ONLY.to_owned(),
            (Some(name), _) if shifts => format!("{name}-shift-{shift}"),
            (Some(name), _) => name.clone(),
            (None, Some(of_levels)) => of_levels,
            (None, None) => {
                let digits = self.orders.len().to_string().len();
                let number = format!("order-{:0digits$}", index + 1);
                if shifts { format!("{number}-shift-{shift}") } else { number }
            }
        }
    }
}

/// `order-01234`, or `order-a1-b1` where a name has several characters; none where that is long or not to be a folder's.
fn order_name(levels: &[Arc<Level>]) -> Option<String> {
    let names: Vec<&str> = levels.iter().map(|level| level.name()).collect();
    // Names with a dash would make `a-b, c` and `a, b-c` one name.
    let plain = names.iter().all(|name| !name.contains('-'));
    let between = if names.iter().all(|name| name.chars().count() == 1) { "" } else { "-" };
    let name = format!("order-{}", names.join(between));
    (plain && name.len() <= MAX_NAME && check_name(&name).is_ok()).then_some(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn levels(names: &str) -> Vec<Arc<Level>> {
        names.split(' ').map(|name| Arc::new(Level::from_map(name, "..T\n...").unwrap())).collect()
    }

    fn order(names: &str) -> Order {
        Order { name: None, levels: levels(names) }
    }

    /// Names, stages and seeds of every sequence.
    fn all(sequences: &Sequences, seeds: &[u64]) -> Vec<String> {
        let show = |(curriculum, seeds): &(Curriculum, Vec<u64>)| {
            let stages = curriculum.stages.iter().map(|s| format!("{}{}", s.level.name(), s.timesteps));
            format!("{}: {} for {seeds:?}", curriculum.name, stages.collect::<Vec<_>>().join(" "))
        };
        sequences.curricula(seeds, 9).unwrap().iter().map(show).collect()
    }

    #[test]
    fn one_sequence_is_the_curriculum_and_several_have_names() {
        let one = Sequences::new(vec![order("a b a")], 1, None, Through::All).unwrap();
        assert_eq!(all(&one, &[0, 3]), ["curriculum: a9 b9 a9 for [0, 3]"]);
        let named = Order { name: Some("back".to_owned()), levels: levels("b a") };
        let two = Sequences::new(vec![order("a b"), named], 1, None, Through::All).unwrap();
        assert_eq!(all(&two, &[0]), ["order-ab: a9 b9 for [0]", "back: b9 a9 for [0]"]);
        let dashes = Sequences::new(vec![order("a-b c"), order("c a-b")], 1, None, Through::All).unwrap();
        assert_eq!(all(&dashes, &[0]), ["order-1: a-b9 c9 for [0]", "order-2: c9 a-b9 for [0]"]);
        let long = Sequences::new(vec![order("aa b"), order("b aa")], 1, None, Through::All).unwrap();
        assert_eq!(all(&long, &[0]), ["order-aa-b: aa9 b9 for [0]", "order-b-aa: b9 aa9 for [0]"]);
    }

    #[test]
    fn cycles_repeat_and_have_timesteps_by_stage() {
        let timesteps = Some(Timesteps::List(vec![1, 2]));
        let cycles = Sequences::new(vec![order("a b")], 2, timesteps, Through::All).unwrap();
        assert_eq!(all(&cycles, &[0]), ["curriculum: a1 b2 a1 b2 for [0]"]);
        let each =
            Sequences::new(vec![order("a b")], 2, Some(Timesteps::List(vec![1, 2, 3, 4])), Through::All).unwrap();
        assert_eq!(all(&each, &[0]), ["curriculum: a1 b2 a3 b4 for [0]"]);
        let alone: Vec<(String, u64)> =
            each.single_levels(9).iter().map(|(level, timesteps)| (level.name().to_owned(), *timesteps)).collect();
        assert_eq!(alone, [("a".to_owned(), 3), ("b".to_owned(), 4)]);
        assert_eq!(all(&each.with_timesteps(5), &[0]), ["curriculum: a5 b5 a5 b5 for [0]"]);
    }

    #[test]
    fn a_seed_begins_at_its_own_place() {
        let shifted =
            Sequences::new(vec![order("a b c")], 1, Some(Timesteps::List(vec![1, 2, 3])), Through::Shifted).unwrap();
        let expected = ["order-abc: a1 b2 c3 for [0, 3]", "order-bca: b1 c2 a3 for [1, 4]"];
        assert_eq!(all(&shifted, &[0, 1, 3, 4]), expected);
        // Whatever seeds there are, the sequence has the same name.
        assert_eq!(all(&shifted, &[1]), ["order-bca: b1 c2 a3 for [1]"]);
        assert!(shifted.single_levels(9).iter().all(|(_, timesteps)| *timesteps == 3));
        let named = Order { name: Some("x".to_owned()), levels: levels("a b") };
        let named = Sequences::new(vec![named], 1, None, Through::Shifted).unwrap();
        assert_eq!(all(&named, &[5]), ["x-shift-1: b9 a9 for [5]"]);
    }

    #[test]
    fn seeds_take_orders_in_turn() {
        let turns = Sequences::new(vec![order("a b"), order("b a")], 1, None, Through::InTurn).unwrap();
        let expected = ["order-ab: a9 b9 for [0, 2]", "order-ba: b9 a9 for [5]"];
        assert_eq!(all(&turns, &[0, 2, 5]), expected);
        assert_eq!(all(&turns, &[1]), ["order-ba: b9 a9 for [1]"]);
    }

    #[test]
    fn what_is_not_possible_is_refused() {
        let refused = |orders: Vec<Order>, repeat, timesteps| {
            Sequences::new(orders, repeat, timesteps, Through::All).map(drop).unwrap_err().to_string()
        };
        let named = |name: &str, levels: &str| Order { name: Some(name.to_owned()), ..order(levels) };
        assert!(refused(vec![order("a b"), order("a b")], 1, None).contains("[a, b] stands twice"));
        let list = Some(Timesteps::List(vec![1, 2, 3]));
        assert!(refused(vec![order("a b")], 1, list).contains("a list of 2, got a list of 3"));
        assert!(refused(vec![order("a b")], 40_000, None).contains("stages are too many"));
        assert!(refused(vec![named("x", "a b"), named("x", "b a")], 1, None).contains("the name x stands twice"));
        assert!(refused(vec![named("level-1", "a b")], 1, None).contains("those of single levels"));
        assert!(refused(vec![named("a/b", "a b")], 1, None).contains("expected 1 to 64 letters"));
    }
}
