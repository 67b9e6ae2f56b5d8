//! Forward and backward against a plain reference in `f64`, and the reference's gradient against
//! finite differences.

mod reference;

use std::iter;

use bit_mlp::{Activation, BitBatch, Mlp, Prepared, Shape, Workspace};
use chacha20::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

const ACTIVATIONS: [Activation; 4] = [Activation::Tanh, Activation::Relu, Activation::Crelu, Activation::Fourier];

/// A random network with parameters, samples and a loss gradient at the outputs.
struct Case {
    mlp: Mlp,
    params: Vec<f32>,
    batch: BitBatch,
    /// `[B, outputs]`
    d_outputs: Vec<f32>,
}

impl Case {
    /// `count` of them, the first with products that are blocked for the caches and read weights in
    /// place.
    fn several(rng: &mut ChaCha8Rng, count: usize) -> impl Iterator<Item = Self> {
        (0..count).map(|i| if i == 0 { Self::of_sizes(rng, &[40, 272, 256, 272, 5]) } else { Self::random(rng) })
    }

    fn random(rng: &mut ChaCha8Rng) -> Self {
        let depth = rng.random_range(0..=3);
        let most = if rng.random_bool(0.2) { 400 } else { 70 };
        let mut sizes: Vec<usize> = iter::repeat_with(|| rng.random_range(1..=most)).take(depth + 2).collect();
        if rng.random_bool(0.3) {
            sizes.iter_mut().for_each(|size| *size = size.next_multiple_of(16)); // no padding
        }
        Self::of_sizes(rng, &sizes)
    }

    fn of_sizes(rng: &mut ChaCha8Rng, sizes: &[usize]) -> Self {
        let widest = sizes.iter().fold(70, |widest, &size| widest.max(size));
        let activation = ACTIVATIONS[rng.random_range(0..ACTIVATIONS.len())];
        let [inputs, hidden @ .., outputs] = sizes else { panic!("too few sizes: {sizes:?}") };
        let shape = Shape { inputs: *inputs, hidden, outputs: *outputs, activation, layer_norm: rng.random() };
        let mlp = Mlp::from_shape(shape, rng.random_range(0..40));
        let params = uniform(rng, mlp.range().end + 5, 3.3 / (widest as f32).sqrt());

        let mut batch = BitBatch::default();
        let constant_share = if rng.random() { 0.2 } else { 0.0 };
        let (constant, free): (Vec<u16>, Vec<u16>) =
            (0..mlp.inputs() as u16).partition(|_| rng.random_bool(constant_share));
        batch.set_constant(&constant);
        for _ in 0..rng.random_range(1..=70) {
            let share = rng.random_range(0.0..0.5);
            batch.push_with(|active| active.extend(free.iter().filter(|_| rng.random_bool(share))));
        }
        let d_outputs = uniform(rng, batch.len() * mlp.outputs(), 1.0);
        Self { mlp, params, batch, d_outputs }
    }

    /// `[B, inputs]`
    fn dense_inputs(&self) -> Vec<Vec<f64>> {
        let dense = |sample: &[u16]| {
            let mut input = vec![0.0; self.mlp.inputs()];
            sample.iter().chain(self.batch.constant()).for_each(|&index| input[usize::from(index)] = 1.0);
            input
        };
        self.batch.all().samples().map(dense).collect()
    }
}

fn uniform(rng: &mut ChaCha8Rng, len: usize, bound: f32) -> Vec<f32> {
    iter::repeat_with(|| rng.random_range(-bound..bound)).take(len).collect()
}

fn widen(values: &[f32]) -> Vec<f64> {
    values.iter().map(|&value| f64::from(value)).collect()
}

fn reference_outputs(mlp: &Mlp, params: &[f64], input: &[f64]) -> Vec<f64> {
    reference::forward(mlp, params, input).pop().expect("outputs").outputs
}

#[track_caller]
fn assert_close(ours: &[f32], reference: &[f64], tolerance: f64) {
    assert_eq!(ours.len(), reference.len());
    for (index, (&ours, &reference)) in ours.iter().zip(reference).enumerate() {
        let error = (f64::from(ours) - reference).abs();
        assert!(error <= tolerance * (1.0 + reference.abs()), "at {index}: {ours} instead of {reference}");
    }
}

#[test]
fn forward_and_backward_equal_the_reference() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut workspace = Workspace::default(); // one for all, as networks and batches may take turns
    for case in Case::several(&mut rng, 150) {
        let Case { mlp, params, batch, d_outputs } = &case;
        let wide = widen(params);
        let inputs = case.dense_inputs();

        let outputs = mlp.forward(params, batch.all(), &mut workspace);
        let expected: Vec<f64> = inputs.iter().flat_map(|x| reference_outputs(mlp, &wide, x)).collect();
        assert_close(outputs, &expected, 2e-5);
        for (b, x) in inputs.iter().enumerate() {
            for (index, expected) in reference::forward(mlp, &wide, x).iter().enumerate() {
                assert_close(workspace.activations(index).row(b), &expected.outputs, 2e-5);
            }
        }

        let mut grads = vec![7.0; params.len()];
        mlp.backward(params, batch.all(), d_outputs, &mut workspace, &mut grads);
        let mut expected = vec![0.0; params.len()];
        for (x, d_output) in inputs.iter().zip(d_outputs.chunks(mlp.outputs())) {
            reference::backward(mlp, &wide, x, &widen(d_output), &mut expected);
        }
        let range = mlp.range();
        assert_close(&grads[range.clone()], &expected[range.clone()], 1e-4);
        assert!(grads[..range.start].iter().chain(&grads[range.end..]).all(|&g| g == 7.0), "wrote beyond its range");
    }
}

#[test]
fn the_reference_gradient_equals_finite_differences() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    for (activation, layer_norm) in
        ACTIVATIONS.into_iter().flat_map(|activation| [(activation, false), (activation, true)])
    {
        let shape = Shape { inputs: 9, hidden: &[7, 5], outputs: 3, activation, layer_norm };
        let mlp = Mlp::from_shape(shape, 0);
        let params = widen(&uniform(&mut rng, mlp.num_parameters(), 0.8));
        let input: Vec<f64> = (0..9).map(|index| f64::from(index % 3 == 0)).collect();
        let d_output = [0.7, -1.1, 0.3];
        let loss = |params: &[f64]| -> f64 {
            let outputs = reference_outputs(&mlp, params, &input);
            outputs.iter().zip(d_output).map(|(output, d_output)| output * d_output).sum()
        };
        let mut grads = vec![0.0; params.len()];
        reference::backward(&mlp, &params, &input, &d_output, &mut grads);
        for (index, gradient) in grads.iter().enumerate() {
            let shifted = |by: f64| {
                let mut params = params.clone();
                params[index] += by;
                loss(&params)
            };
            let difference = (shifted(1e-6) - shifted(-1e-6)) / 2e-6;
            let error = (gradient - difference).abs();
            assert!(error < 1e-8, "{shape:?} at {index}: {gradient} instead of {difference}");
        }
    }
}

#[test]
fn one_sample_equals_the_batch_bit_for_bit() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut workspace = Workspace::default();
    for Case { mlp, params, batch, .. } in Case::several(&mut rng, 100) {
        let outputs = mlp.forward(&params, batch.all(), &mut workspace);
        let mut prepared = Prepared::new(&mlp, &params, batch.constant());
        for (sample, outputs) in batch.all().samples().zip(outputs.chunks(mlp.outputs())) {
            assert_eq!(prepared.forward_one(&params, sample), outputs);
        }
    }
}

#[test]
fn activations_are_those_of_the_last_forward_pass() {
    let mut rng = ChaCha8Rng::seed_from_u64(6);
    let mut workspace = Workspace::default();
    // A deeper network and a larger batch before must leave nothing behind.
    for (sizes, samples) in [(&[30, 20, 64, 7, 3][..], 9), (&[12, 16, 5], 4), (&[12, 5], 0)] {
        let mlp = Mlp::new(sizes, Activation::Tanh, 2);
        let params = uniform(&mut rng, mlp.range().end, 0.5);
        let mut batch = BitBatch::default();
        (0..samples).for_each(|sample| batch.push_sample(&[sample, sample + 1]));
        let outputs = mlp.forward(&params, batch.all(), &mut workspace).to_vec();
        for (index, block) in mlp.blocks().iter().enumerate() {
            let activations = workspace.activations(index);
            assert_eq!((activations.len(), activations.width()), (batch.len(), block.outputs()));
            assert_eq!(activations.is_empty(), batch.is_empty());
            assert!(activations.rows().enumerate().all(|(b, row)| row == activations.row(b)));
        }
        assert_eq!(workspace.activations(mlp.blocks().len() - 1).rows().collect::<Vec<_>>().concat(), outputs);
        assert!(std::panic::catch_unwind(|| workspace.activations(mlp.blocks().len()).len()).is_err());
    }
}

#[test]
fn an_empty_batch_has_no_outputs_and_no_gradient() {
    for layer_norm in [false, true] {
        let shape =
            Shape { inputs: 40, hidden: &[128, 256, 256], outputs: 4, activation: Activation::Tanh, layer_norm };
        let mlp = Mlp::from_shape(shape, 0);
        let params = vec![0.1; mlp.num_parameters()];
        let batch = BitBatch::default();
        let mut workspace = Workspace::default();
        assert!(mlp.forward(&params, batch.all(), &mut workspace).is_empty());
        let mut grads = vec![7.0; params.len()];
        mlp.backward(&params, batch.all(), &[], &mut workspace, &mut grads);
        assert!(grads.iter().all(|&g| g == 0.0));
    }
}

#[test]
fn refreshing_equals_preparing_anew() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let Case { mlp, params, batch, .. } = Case::random(&mut rng);
    let mut prepared = Prepared::new(&mlp, &vec![0.5; params.len()], &[0]);
    prepared.refresh(&params, batch.constant());
    let mut fresh = Prepared::new(&mlp, &params, batch.constant());
    assert_eq!(prepared.forward_one(&params, batch.sample(0)), fresh.forward_one(&params, batch.sample(0)));
}

#[test]
fn a_selection_equals_a_copy() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    for _ in 0..30 {
        let Case { mlp, params, batch, .. } = Case::random(&mut rng);
        let len = rng.random_range(1..=70);
        let index = || rng.random_range(0..batch.len() as u32);
        let selection: Vec<u32> = iter::repeat_with(index).take(len).collect();
        let mut copy = BitBatch::default();
        copy.set_constant(batch.constant());
        selection.iter().for_each(|&index| copy.push_sample(batch.sample(index as usize)));

        let d_outputs = uniform(&mut rng, selection.len() * mlp.outputs(), 1.0);
        let [selected, copied] = [batch.select(&selection), copy.all()].map(|batch| {
            let mut workspace = Workspace::default();
            let mut grads = vec![0.0; params.len()];
            let outputs = mlp.forward(&params, batch, &mut workspace).to_vec();
            mlp.backward(&params, batch, &d_outputs, &mut workspace, &mut grads);
            (outputs, grads)
        });
        assert_eq!(selected, copied);
    }
}

#[test]
fn inputs_that_are_never_active_have_no_gradient() {
    let mlp = Mlp::new(&[6, 5, 2], Activation::Relu, 0);
    let mut batch = BitBatch::default();
    batch.set_constant(&[1]);
    batch.push_sample(&[3]);
    batch.push_sample(&[]);
    let params = vec![0.3; mlp.num_parameters()];
    let mut grads = vec![f32::NAN; params.len()];
    let mut workspace = Workspace::default();
    mlp.forward(&params, batch.all(), &mut workspace);
    mlp.backward(&params, batch.all(), &[1.0, 2.0, 3.0, 4.0], &mut workspace, &mut grads);
    let zero = |input: usize| grads[input * 5..][..5].iter().all(|&g| g == 0.0);
    assert_eq!([0, 1, 2, 3, 4, 5].map(zero), [true, false, true, false, true, true]);
}

#[test]
fn nan_in_a_parameter_reaches_the_outputs() {
    for activation in ACTIVATIONS {
        let mlp = Mlp::new(&[3, 4, 2], activation, 0);
        let mut params = vec![0.1; mlp.num_parameters()];
        params[1] = f32::NAN;
        let mut batch = BitBatch::default();
        batch.push_sample(&[0]);
        let mut workspace = Workspace::default();
        assert!(mlp.forward(&params, batch.all(), &mut workspace).iter().all(|output| output.is_nan()));
    }
}
