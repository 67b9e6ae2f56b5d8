//! How far an update moves the parameters.

use super::{Loss, Measure, Of, Update};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "update_norm",
    title: "update norm",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "‖θ_after − θ_before‖₂ of the update, over all parameters",
    source: "",
    loss: Loss::Unclear,
    of: Of::Update(distance),
}];

fn distance(update: &Update) -> f64 {
    let square = |(b, a): (&f32, &f32)| (f64::from(*a) - f64::from(*b)).powi(2);
    update.before.iter().zip(update.after).map(square).sum::<f64>().sqrt()
}

#[cfg(test)]
mod tests {
    use super::super::sample::tests::update;
    use super::*;

    #[test]
    fn by_hand() {
        assert_eq!(distance(&Update { before: &[1.0, 2.0, 0.5], after: &[4.0, -2.0, 0.5], ..update() }), 5.0);
    }
}
