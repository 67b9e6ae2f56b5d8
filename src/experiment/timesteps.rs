//! How long each stage of a sequence is.

use std::ops::RangeInclusive;
use std::str::FromStr;

/// The timesteps that a stage can have.
pub const POSSIBLE: RangeInclusive<u64> = 1..=1_000_000_000_000;

/// Timesteps of the stages of a sequence.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Timesteps {
    /// The same for every stage.
    Each(u64),
    /// Stage by stage, by its place in the sequence.
    List(Vec<u64>),
}

impl Timesteps {
    /// The timesteps of each of so many stages, which come in cycles of `cycle` stages. A list is as long as all stages, or
    /// as one cycle, for which it repeats.
    ///
    /// # Errors
    /// A list of another length: says which is possible.
    pub fn of_stages(&self, stages: usize, cycle: usize) -> Result<Vec<u64>, String> {
        match self {
            Self::Each(timesteps) => Ok(vec![*timesteps; stages]),
            Self::List(list) if list.len() == stages || list.len() == cycle => {
                Ok(list.iter().copied().cycle().take(stages).collect())
            }
            Self::List(list) => {
                let all = if stages == cycle { String::new() } else { format!(" or {stages}, one for each stage") };
                let entries = list.len();
                Err(format!("timesteps: expected one number, or a list of {cycle}{all}, got a list of {entries}"))
            }
        }
    }

    /// The largest number in it.
    pub fn longest(&self) -> u64 {
        match self {
            Self::Each(timesteps) => *timesteps,
            Self::List(list) => list.iter().copied().max().unwrap_or(0),
        }
    }
}

impl FromStr for Timesteps {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = "expected a number such as 500000, or one for each stage such as 100000,200000";
        let numbers = text.split(',').map(|part| part.trim().parse::<u64>().map_err(|_| expected.to_owned()));
        match numbers.collect::<Result<Vec<u64>, _>>()?[..] {
            // What is not possible is told as it is of the setting of that name.
            [one] => Ok(Self::Each(one)),
            ref list => match list.iter().find(|number| !POSSIBLE.contains(number)) {
                Some(number) => {
                    Err(format!("expected numbers from {} to {}, got {number}", POSSIBLE.start(), POSSIBLE.end()))
                }
                None => Ok(Self::List(list.to_vec())),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_is_for_all_stages_and_a_list_for_each() {
        assert_eq!("500000".parse(), Ok(Timesteps::Each(500_000)));
        assert_eq!("1, 2,3".parse(), Ok(Timesteps::List(vec![1, 2, 3])));
        for wrong in ["", "x", "1,,2", "-5", "1,0", "1.5"] {
            assert!(wrong.parse::<Timesteps>().is_err(), "{wrong}");
        }
        assert_eq!(Timesteps::Each(7).of_stages(3, 3), Ok(vec![7; 3]));
        let list = Timesteps::List(vec![1, 2]);
        assert_eq!(list.of_stages(2, 2), Ok(vec![1, 2]));
        assert_eq!(list.of_stages(4, 2), Ok(vec![1, 2, 1, 2]));
        assert_eq!(list.of_stages(2, 1), Ok(vec![1, 2]));
        let error = list.of_stages(6, 3).unwrap_err();
        assert!(error.contains("a list of 3 or 6, one for each stage, got a list of 2"), "{error}");
    }
}
