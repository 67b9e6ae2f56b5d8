//! Hyper-parameters for TensorBoard's HParams tab: summaries that hold metadata of the plugin `hparams` and no value.
//!
//! Source of the messages: `tensorboard/plugins/hparams/plugin_data.proto` and `api.proto`.

use crate::message::Message;

/// The plugin's name, and the version of its messages.
const PLUGIN: (&str, u64) = ("hparams", 0);
/// `DT_FLOAT` of TensorFlow's `types.proto`.
const DT_FLOAT: u64 = 1;

/// A hyper-parameter's value.
#[derive(Clone, Debug, PartialEq)]
pub enum HParam {
    /// Text.
    Text(String),
    /// A number.
    Number(f64),
    /// True or false.
    Bool(bool),
}

/// A run as a row of the HParams tab.
#[derive(Clone, Copy, Debug, Default)]
pub struct HParams<'a> {
    /// Runs of one group are one row, its metrics averaged: the seeds of an arm, say. An empty name is no group.
    pub group: &'a str,
    /// Hyper-parameters by name.
    pub values: &'a [(&'a str, HParam)],
    /// Tags of the scalars that are shown beside them.
    ///
    /// TensorBoard takes names of hyper-parameters and metrics from the first run that it finds in a folder, so that
    /// runs of one folder should all name the same.
    pub metrics: &'a [&'a str],
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SessionStatus {
    /// It has done all it was to do.
    Success = 1,
    /// It cannot go on.
    Failure = 2,
}

impl HParam {
    /// As `google.protobuf.Value`.
    fn to_value(&self) -> Message {
        match self {
            Self::Number(number) => Message::new().double(2, *number),
            Self::Text(text) => Message::new().text(3, text),
            Self::Bool(truth) => Message::new().int(4, u64::from(*truth)),
        }
    }

    /// As `DataType`.
    fn data_type(&self) -> u64 {
        match self {
            Self::Text(_) => 1,
            Self::Bool(_) => 2,
            Self::Number(_) => 3,
        }
    }
}

impl HParams<'_> {
    /// The summary that declares names and types: `Experiment`.
    pub(crate) fn experiment(&self) -> Message {
        let declared = self.values.iter().fold(Message::new(), |all, (name, value)| {
            all.message(4, &Message::new().text(1, name).int(4, value.data_type()))
        });
        let experiment = self.metrics.iter().fold(declared, |all, tag| {
            let name = Message::new().text(2, tag);
            all.message(5, &Message::new().message(1, &name))
        });
        summary("_hparams_/experiment", 2, &experiment)
    }

    /// The summary with the run's values: `SessionStartInfo`.
    pub(crate) fn session_start(&self, wall_time: f64) -> Message {
        // A map is a repeated message of key and value.
        let values = self.values.iter().fold(Message::new(), |all, (name, value)| {
            all.message(1, &Message::new().text(1, name).message(2, &value.to_value()))
        });
        summary("_hparams_/session_start_info", 3, &values.text(4, self.group).double(5, wall_time))
    }
}

/// The summary that tells a run's end: `SessionEndInfo`.
pub(crate) fn session_end(wall_time: f64, status: SessionStatus) -> Message {
    summary("_hparams_/session_end_info", 4, &Message::new().int(1, status as u64).double(2, wall_time))
}

/// A `Summary.Value` with `data` as field `field` of the plugin's data, and an empty tensor, since a value must be there.
fn summary(tag: &str, field: u32, data: &Message) -> Message {
    let (name, version) = PLUGIN;
    let content = Message::new().int(1, version).message(field, data);
    let plugin_data = Message::new().text(1, name).message(2, &content);
    let metadata = Message::new().message(1, &plugin_data);
    let no_values = Message::new().message(2, &Message::new().int(1, 0));
    let tensor = Message::new().int(1, DT_FLOAT).message(2, &no_values);
    Message::new().text(1, tag).message(9, &metadata).message(8, &tensor)
}
