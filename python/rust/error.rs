//! The exceptions that Gymnasium's users expect.

use std::fmt::Display;

use pyo3::PyErr;
use pyo3::exceptions::PyValueError;

pyo3::import_exception!(gymnasium.error, InvalidAction);
pyo3::import_exception!(gymnasium.error, ResetNeeded);

/// A `ValueError` that says what `error` says.
pub(crate) fn value_error(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// For `step` before `reset`.
pub(crate) fn not_reset() -> PyErr {
    ResetNeeded::new_err("there is no episode yet; call reset() first")
}
