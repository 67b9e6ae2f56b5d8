//! Binary inputs, stored as the indices of the inputs that are 1.

/// Samples of binary inputs, each given by the indices of its active inputs.
///
/// Inputs that are active in every sample (the map: free cells and targets) are stored once, as the
/// *constant* ones. A sample lists only what else is active in it (the agent, the visited cells).
/// An index must not appear twice, neither in a list nor in the constant and a sample's list:
/// inputs are added, so it would count as an input of value 2.
#[derive(Clone, Debug)]
pub struct BitBatch {
    constant: Vec<u16>,
    /// The samples' lists, end to end.
    active: Vec<u16>,
    /// `[len + 1]`: sample `i` is `active[offsets[i]..offsets[i + 1]]`.
    offsets: Vec<u32>,
}

impl Default for BitBatch {
    fn default() -> Self {
        Self { constant: Vec::new(), active: Vec::new(), offsets: vec![0] }
    }
}

impl BitBatch {
    /// Forgets the samples and keeps the constant inputs and the memory.
    pub fn clear(&mut self) {
        self.active.clear();
        self.offsets.truncate(1);
    }

    /// Sets the inputs that are active in every sample, those already stored included.
    pub fn set_constant(&mut self, indices: &[u16]) {
        self.constant.clear();
        self.constant.extend_from_slice(indices);
    }

    /// Appends a sample with these active inputs.
    pub fn push_sample(&mut self, indices: &[u16]) {
        self.push_with(|active| active.extend_from_slice(indices));
    }

    /// Appends a sample whose active inputs `write` pushes to the vector that it is given (and must
    /// only push to).
    pub fn push_with(&mut self, write: impl FnOnce(&mut Vec<u16>)) {
        let start = self.active.len();
        write(&mut self.active);
        assert!(self.active.len() >= start, "`write` took away indices of earlier samples");
        self.offsets.push(u32::try_from(self.active.len()).expect("at most 2³² active inputs in one batch"));
    }

    /// Number of samples.
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The inputs that are active in every sample.
    pub fn constant(&self) -> &[u16] {
        &self.constant
    }

    /// The further active inputs of sample `index`.
    pub fn sample(&self, index: usize) -> &[u16] {
        &self.active[self.offsets[index] as usize..self.offsets[index + 1] as usize]
    }

    /// All samples, in order.
    pub fn all(&self) -> Batch<'_> {
        Batch { bits: self, selection: None }
    }

    /// The samples with these indices, in this order: a minibatch, without a copy.
    pub fn select<'a>(&'a self, selection: &'a [u32]) -> Batch<'a> {
        Batch { bits: self, selection: Some(selection) }
    }
}

/// A view of the samples of a [`BitBatch`]: all of them, or a selection.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    bits: &'a BitBatch,
    selection: Option<&'a [u32]>,
}

impl<'a> Batch<'a> {
    /// Number of samples, the `B` of all shapes.
    pub fn len(&self) -> usize {
        self.selection.map_or(self.bits.len(), <[u32]>::len)
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The inputs that are active in every sample.
    pub fn constant(&self) -> &'a [u16] {
        self.bits.constant()
    }

    /// The further active inputs of the view's sample `index`.
    pub fn sample(&self, index: usize) -> &'a [u16] {
        self.bits.sample(self.selection.map_or(index, |selection| selection[index] as usize))
    }

    /// The further active inputs of every sample, in order.
    pub fn samples(self) -> impl ExactSizeIterator<Item = &'a [u16]> + Clone {
        (0..self.len()).map(move |index| self.sample(index))
    }
}
