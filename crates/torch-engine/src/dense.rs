//! From slices to tensors and back.

use bit_mlp::Batch;
use tch::{Device, Tensor};

/// Binary samples as floats `[S, B, inputs]`; rows with fewer samples than others are padded with zeros.
pub fn dense(inputs: usize, batches: &[Batch<'_>]) -> Tensor {
    let samples = batches.iter().map(Batch::len).max().unwrap_or(0);
    let mut floats = vec![0.0f32; batches.len() * samples * inputs];
    for (s, batch) in batches.iter().enumerate() {
        for b in 0..batch.len() {
            let out = &mut floats[(s * samples + b) * inputs..][..inputs];
            batch.constant().iter().chain(batch.sample(b)).for_each(|&i| out[usize::from(i)] = 1.0);
        }
    }
    Tensor::from_slice(&floats).view([batches.len() as i64, samples as i64, inputs as i64])
}

/// Equally long rows as one `[S, n]` tensor.
pub fn stack<'a>(rows: impl Iterator<Item = &'a [f32]>, device: Device) -> Tensor {
    let rows: Vec<&[f32]> = rows.collect();
    Tensor::from_slice(&rows.concat()).view([rows.len() as i64, -1]).to_device(device)
}

/// All values in row-major order.
pub fn to_vec(tensor: &Tensor) -> Vec<f32> {
    let flat = tensor.detach().to_device(Device::Cpu).contiguous();
    let mut values = vec![0.0; flat.numel()];
    flat.copy_data(&mut values, flat.numel());
    values
}
