//! The size of the gradient.

use super::{Loss, Measure, Of};

pub(super) const MEASURES: &[Measure] = &[Measure {
    name: "grad_norm",
    title: "gradient norm before clipping",
    unit: "",
    range: (0.0, f64::INFINITY),
    formula: "`train/grad_norm` of the update",
    source: "",
    loss: Loss::Unclear,
    of: Of::Update(|update| update.grad_norm),
}];

#[cfg(test)]
mod tests {
    use super::super::sample::tests::{acting, update};
    use super::super::{Head, Sample, States, Update, columns};

    #[test]
    fn it_is_the_number_of_the_log() {
        let update = Some(Update { grad_norm: 0.25, ..update() });
        let acting = acting(Head::Logits, vec![0.0; 4]);
        let sample = Sample { states: States::Reference, update, acting, layers: Vec::new() };
        assert_eq!(columns(&sample)[0], ("plasticity/grad_norm".to_owned(), 0.25));
    }
}
