//! Every kind of block against PyTorch: the outputs and gradients that scripts/block-oracle wrote.

use bit_mlp::{Activation, BitBatch, Mlp, Prepared, Shape, Workspace};
use serde::Deserialize;

#[derive(Deserialize)]
struct Case {
    activation: String,
    layer_norm: bool,
    sizes: Vec<usize>,
    parameters: Vec<f32>,
    samples: Vec<Vec<u16>>,
    /// `[B, outputs]`, as `outputs`.
    d_outputs: Vec<f32>,
    outputs: Vec<f64>,
    gradients: Vec<f64>,
}

impl Case {
    fn mlp(&self) -> Mlp {
        let activation = match self.activation.as_str() {
            "tanh" => Activation::Tanh,
            "relu" => Activation::Relu,
            "crelu" => Activation::Crelu,
            "fourier" => Activation::Fourier,
            other => panic!("unknown activation {other}"),
        };
        let [inputs, hidden @ .., outputs] = self.sizes.as_slice() else { panic!("too few sizes") };
        let shape = Shape { inputs: *inputs, hidden, outputs: *outputs, activation, layer_norm: self.layer_norm };
        Mlp::from_shape(shape, 0)
    }
}

/// Compares to 10⁻⁵ of the largest value.
#[track_caller]
fn assert_close(what: &str, ours: &[f32], theirs: &[f64]) {
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let largest = theirs.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    for (index, (&ours, theirs)) in ours.iter().zip(theirs).enumerate() {
        let error = (f64::from(ours) - theirs).abs();
        assert!(error <= 1e-5 * largest, "{what} at {index}: {ours} instead of {theirs}");
    }
}

#[test]
fn outputs_and_gradients_equal_pytorch() {
    let cases: Vec<Case> = serde_json::from_str(include_str!("fixtures/blocks.json")).expect("the fixture is readable");
    assert_eq!(cases.len(), 8, "four activations, with normalisation and without");
    for case in cases {
        let what = format!("{}, layer_norm {}", case.activation, case.layer_norm);
        let mlp = case.mlp();
        let (constant, _): (Vec<u16>, Vec<u16>) =
            case.samples[0].iter().partition(|input| case.samples.iter().all(|sample| sample.contains(input)));
        assert!(!constant.is_empty(), "one input is 1 in every sample");
        let mut batch = BitBatch::default();
        batch.set_constant(&constant);
        for sample in &case.samples {
            batch.push_with(|active| active.extend(sample.iter().filter(|input| !constant.contains(input))));
        }

        let mut workspace = Workspace::default();
        let outputs = mlp.forward(&case.parameters, batch.all(), &mut workspace);
        assert_close(&what, outputs, &case.outputs);
        let mut prepared = Prepared::new(&mlp, &case.parameters, batch.constant());
        for (sample, outputs) in batch.all().samples().zip(case.outputs.chunks(mlp.outputs())) {
            assert_close(&what, prepared.forward_one(&case.parameters, sample), outputs);
        }
        let mut grads = vec![0.0; mlp.num_parameters()];
        mlp.backward(&case.parameters, batch.all(), &case.d_outputs, &mut workspace, &mut grads);
        for block in mlp.blocks() {
            for place in block.places() {
                assert_close(&format!("{what}: {place:?}"), &grads[place.range.clone()], &case.gradients[place.range]);
            }
        }
    }
}
