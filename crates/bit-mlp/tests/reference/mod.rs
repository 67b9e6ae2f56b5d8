//! The networks in plain `f64`, one sample at a time, from the formulas.

use bit_mlp::{Activation, Block, Mlp, Norm};

/// What a layer computes for one sample.
pub struct Layer {
    /// `[inputs]`: what enters.
    pub inputs: Vec<f64>,
    /// `[width]`: the sums, normalised before scale and shift where the layer does so.
    pub sums: Vec<f64>,
    /// The square root of variance + ε that the centred sums were divided by.
    pub deviation: f64,
    /// `[outputs]`: what leaves.
    pub outputs: Vec<f64>,
}

/// Every layer's part, from the inputs to the outputs.
pub fn forward(mlp: &Mlp, params: &[f64], input: &[f64]) -> Vec<Layer> {
    let mut layers: Vec<Layer> = Vec::new();
    for block in mlp.blocks() {
        let inputs = layers.last().map_or(input, |below| &below.outputs).to_vec();
        layers.push(layer(block, params, inputs));
    }
    layers
}

fn layer(block: &Block, params: &[f64], inputs: Vec<f64>) -> Layer {
    let weight = &params[block.weight.clone()];
    let mut sums = params[block.bias.clone()].to_vec();
    for (i, x) in inputs.iter().enumerate() {
        for (o, sum) in sums.iter_mut().enumerate() {
            *sum += x * weight[i * block.width + o];
        }
    }
    let mut deviation = 1.0;
    let mut values = sums.clone();
    if let Some(norm) = &block.norm {
        let centre = mean(&sums);
        sums.iter_mut().for_each(|sum| *sum -= centre);
        let squares: Vec<f64> = sums.iter().map(|sum| sum * sum).collect();
        deviation = (mean(&squares) + f64::from(Norm::EPSILON)).sqrt();
        sums.iter_mut().for_each(|sum| *sum /= deviation);
        for (o, value) in values.iter_mut().enumerate() {
            *value = sums[o] * params[norm.scale.start + o] + params[norm.shift.start + o];
        }
    }
    let outputs = match block.activation {
        None => values,
        Some(Activation::Tanh) => values.into_iter().map(f64::tanh).collect(),
        Some(Activation::Relu) => values.into_iter().map(|x| x.max(0.0)).collect(),
        Some(Activation::Crelu) => {
            values.iter().copied().chain(values.iter().map(|x| -x)).map(|x| x.max(0.0)).collect()
        }
        Some(Activation::Fourier) => values.iter().map(|x| x.sin()).chain(values.iter().map(|x| x.cos())).collect(),
    };
    Layer { inputs, sums, deviation, outputs }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Adds one sample's gradient to `grads`.
pub fn backward(mlp: &Mlp, params: &[f64], input: &[f64], d_output: &[f64], grads: &mut [f64]) {
    let mut delta = d_output.to_vec();
    for (block, layer) in mlp.blocks().iter().zip(forward(mlp, params, input)).rev() {
        let weight = &params[block.weight.clone()];
        let outputs = &layer.outputs;
        delta = match block.activation {
            None => delta,
            Some(Activation::Tanh) => delta.iter().zip(outputs).map(|(d, y)| d * (1.0 - y * y)).collect(),
            Some(Activation::Relu) => delta.iter().zip(outputs).map(|(d, y)| d * f64::from(*y > 0.0)).collect(),
            Some(Activation::Crelu) => {
                let slope = |o: usize| f64::from(outputs[o] > 0.0);
                let n = block.width;
                (0..n).map(|o| delta[o] * slope(o) - delta[n + o] * slope(n + o)).collect()
            }
            Some(Activation::Fourier) => {
                let n = block.width;
                (0..n).map(|o| delta[o] * outputs[n + o] - delta[n + o] * outputs[o]).collect()
            }
        };
        if let Some(norm) = &block.norm {
            for (o, d) in delta.iter_mut().enumerate() {
                grads[norm.shift.start + o] += *d;
                grads[norm.scale.start + o] += *d * layer.sums[o];
                *d *= params[norm.scale.start + o];
            }
            // The Jacobian of the normalised sums, entry by entry.
            let n = block.width as f64;
            let through = |to: usize| -> f64 {
                let entry = |from: usize| {
                    (f64::from(from == to) - 1.0 / n - layer.sums[from] * layer.sums[to] / n) / layer.deviation
                };
                delta.iter().enumerate().map(|(from, d)| d * entry(from)).sum()
            };
            delta = (0..block.width).map(through).collect();
        }
        let mut below = vec![0.0; block.inputs];
        for (o, d) in delta.iter().enumerate() {
            grads[block.bias.start + o] += d;
            for (i, below) in below.iter_mut().enumerate() {
                grads[block.weight.start + i * block.width + o] += layer.inputs[i] * d;
                *below += d * weight[i * block.width + o];
            }
        }
        delta = below;
    }
}
