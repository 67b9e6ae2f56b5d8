//! How many decisions an update changes, at once and for each of its gradient steps.

use super::{Loss, Measure, Of, Update};

pub(super) const MEASURES: &[Measure] = &[
    Measure {
        name: "policy_churn",
        title: "policy churn",
        unit: "share of states",
        range: (0.0, 1.0),
        formula: "share of the states whose greedy action the update changed",
        source: "Schaul et al. 2022",
        loss: Loss::Unclear,
        of: Of::Choices(share_changed),
    },
    Measure {
        name: "policy_churn_per_step",
        title: "policy churn per gradient step",
        unit: "share of states",
        range: (0.0, 1.0),
        formula: "`policy_churn` divided by the gradient steps of the update",
        source: "after Schaul et al. 2022",
        loss: Loss::Unclear,
        of: Of::Choices(share_changed_per_step),
    },
];

fn share_changed(update: &Update) -> f64 {
    let changed = update.greedy_before.iter().zip(&update.greedy_after).filter(|(before, after)| before != after);
    changed.count() as f64 / update.greedy_before.len() as f64
}

/// What each gradient step changes on average, at least: a state may change and change back. NaN without any step.
fn share_changed_per_step(update: &Update) -> f64 {
    if update.steps == 0 { f64::NAN } else { share_changed(update) / update.steps as f64 }
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::update;
    use super::*;

    #[test]
    fn by_hand() {
        let (greedy_before, greedy_after) = (vec![0, 1, 2, 3], vec![0, 2, 2, 3]);
        let update = Update { greedy_before, greedy_after, steps: 320, ..update() };
        assert_eq!(share_changed(&update), 0.25);
        assert_eq!(share_changed_per_step(&update), 0.00078125);
    }

    #[test]
    fn without_a_step_there_is_no_churn_per_step() {
        assert!(share_changed_per_step(&Update { steps: 0, ..update() }).is_nan());
    }
}
