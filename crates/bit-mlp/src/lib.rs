//! Multilayer perceptrons on binary inputs over one flat parameter slice.
