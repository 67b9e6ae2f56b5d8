//! An agent as tensors, alike in checkpoints and snapshots.

use std::collections::BTreeMap;

use safetensors::tensor::Dtype;

use super::container::{self, Container, Tensor, not_ours};
use crate::agent::network::TensorPlace;
use crate::agent::state::{AdamState, AgentState, Counters, Kept};

/// What the names of [lists](Kept::lists) begin with.
const LIST: &str = "extra/";
/// What the names of [buffers](Kept::buffers) begin with.
const BUFFER: &str = "buffer/";
const EXP_AVG: &str = "exp_avg/";
const EXP_AVG_SQ: &str = "exp_avg_sq/";

/// What the header of a file says of its agent.
pub(super) struct Described {
    pub seed: u64,
    pub adam_step: u64,
    pub counters: Counters,
    pub numbers: BTreeMap<String, u64>,
}

/// The tensors of an agent whose parameters lie in these places.
pub(super) fn tensors(agent: &AgentState, places: &[TensorPlace], with_adam: bool) -> Vec<Tensor> {
    let mut tensors: Vec<Tensor> = Tensor::network("", places, &agent.parameters).collect();
    if with_adam {
        tensors.extend(Tensor::network(EXP_AVG, places, &agent.adam.exp_avg));
        tensors.extend(Tensor::network(EXP_AVG_SQ, places, &agent.adam.exp_avg_sq));
    }
    for (name, copy) in &agent.kept.copies {
        tensors.extend(Tensor::network(&format!("{name}/"), places, copy));
    }
    let list = |(name, list): (&String, &Vec<f32>)| Tensor::floats(format!("{LIST}{name}"), &[list.len()], list);
    tensors.extend(agent.kept.lists.iter().map(list));
    let buffers = agent.kept.buffers.iter();
    tensors.extend(buffers.map(|(name, buffer)| Tensor::buffer(format!("{BUFFER}{name}"), buffer)));
    tensors
}

/// Takes an agent out of a file; also says whether its optimiser state was there.
///
/// # Errors
/// Tensors that are missing, or of another shape.
pub(super) fn take(
    file: &mut Container<'_>,
    places: &[TensorPlace],
    described: Described,
) -> Result<(AgentState, bool), String> {
    let parameters = file.network("", places)?.ok_or_else(|| not_ours("its weights are missing"))?;
    let moments = file.network(EXP_AVG, places)?.zip(file.network(EXP_AVG_SQ, places)?);
    let has_adam = moments.is_some();
    let adam = match moments {
        Some((exp_avg, exp_avg_sq)) => AdamState { exp_avg, exp_avg_sq, step: described.adam_step },
        None => AdamState::new(parameters.len()),
    };
    let mut kept = Kept { numbers: described.numbers, ..Kept::default() };
    for prefix in file.prefixes_of(&places[0].name) {
        if let Some(copy) = file.network(&prefix, places)? {
            kept.copies.insert(prefix.trim_end_matches('/').to_owned(), copy);
        }
    }
    for name in file.left().filter(|name| name.starts_with(LIST)).collect::<Vec<_>>() {
        let shape = file.shape(&name).unwrap_or_default();
        if let (1, Some(bytes)) = (shape.len(), file.take(&name, Dtype::F32, &shape)?) {
            kept.lists.insert(name[LIST.len()..].to_owned(), container::floats(bytes).collect());
        }
    }
    for name in file.left().filter(|name| name.starts_with(BUFFER)).collect::<Vec<_>>() {
        if let Some(buffer) = file.buffer(&name)? {
            kept.buffers.insert(&name[BUFFER.len()..], buffer);
        }
    }
    let agent = AgentState { seed: described.seed, parameters, adam, kept, counters: described.counters };
    Ok((agent, has_adam))
}
