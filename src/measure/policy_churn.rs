//! How many decisions an update changes.

use super::{Loss, Measure, Of, Update};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "policy_churn",
    title: "policy churn",
    unit: "share of states",
    range: (0.0, 1.0),
    formula: "share of the states whose greedy action the update changed",
    source: "Schaul et al. 2022",
    loss: Loss::Unclear,
    of: Of::Update(share_changed),
}];

fn share_changed(update: &Update) -> f64 {
    let changed = update.greedy_before.iter().zip(&update.greedy_after).filter(|(before, after)| before != after);
    changed.count() as f64 / update.greedy_before.len() as f64
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::update;
    use super::*;

    #[test]
    fn by_hand() {
        let (greedy_before, greedy_after) = (vec![0, 1, 2, 3], vec![0, 2, 2, 3]);
        assert_eq!(share_changed(&Update { greedy_before, greedy_after, ..update() }), 0.25);
    }
}
