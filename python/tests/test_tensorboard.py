"""The event files of crates/event-file, read by TensorBoard itself.

The file is a fixture of the crate, whose tests hold the writer to it byte by byte.
"""

from __future__ import annotations

import csv
import math
import struct
from pathlib import Path

import numpy as np
import pytest

from oracle import REPOSITORY
from support import cpp_rl

pytest.importorskip("tensorboard", reason="its reader is what is tested with")

from tensorboard.backend.event_processing.event_accumulator import STORE_EVERYTHING_SIZE_GUIDANCE, EventAccumulator
from tensorboard.backend.event_processing.event_file_loader import EventFileLoader
from tensorboard.plugins.hparams import api_pb2, metadata
from tensorboard.util import tensor_util

FIXTURE = REPOSITORY / "crates" / "event-file" / "tests" / "fixtures" / "events.out.tfevents.1700000000.all"


def read(path: Path) -> EventAccumulator:
    return EventAccumulator(str(path), size_guidance=STORE_EVERYTHING_SIZE_GUIDANCE).Reload()


def record_ends(raw: bytes) -> list[int]:
    ends, at = [], 0
    while at < len(raw):
        at += 16 + struct.unpack_from("<Q", raw, at)[0]
        ends.append(at)
    return ends


def test_scalars_are_read() -> None:
    events = read(FIXTURE)
    assert events.Tags()["scalars"] == ["rollout/ep_rew_mean", "train/loss", "train/grad_norm"]
    rows = [(event.step, event.wall_time, event.value) for event in events.Scalars("rollout/ep_rew_mean")]
    assert rows == [(2048 * row, 1_700_000_000.5 + row, -200 + row) for row in (1, 2, 3)]
    *losses, last = events.Scalars("train/loss")
    assert [event.value for event in losses] == [0.5, 0.25, 0.125]
    assert (last.step, math.isnan(last.value)) == (8192, True)
    assert events.Scalars("train/grad_norm")[0].value == math.inf


def test_histograms_are_read() -> None:
    events = read(FIXTURE)
    [event] = events.Histograms("weights/policy.0")
    found, weights = event.histogram_value, (np.arange(1000) - 300) / 256
    assert (event.step, found.min, found.max, found.num) == (6144, weights.min(), weights.max(), 1000)
    assert found.sum == pytest.approx(weights.sum())
    assert found.sum_squares == pytest.approx((weights**2).sum())
    limits, left = np.array(found.bucket_limit), -math.inf
    assert np.all(np.diff(limits) > 0)
    for limit, count in zip(limits, found.bucket, strict=True):
        assert count == np.sum((weights >= left) & (weights < limit))
        left = limit
    ruined = events.Histograms("weights/ruined")[0].histogram_value
    assert (ruined.num, ruined.min, ruined.max, sum(ruined.bucket)) == (2, 2, 2, 2)
    assert events.Histograms("weights/none")[0].histogram_value.num == 0


def test_charts_get_the_histograms() -> None:
    """As the plugin draws them: left and right ends and counts."""
    tensors = {
        value.tag: tensor_util.make_ndarray(value.tensor)
        for event in EventFileLoader(str(FIXTURE)).Load()
        for value in event.summary.value
        if value.metadata.plugin_data.plugin_name == "histograms"
    }
    weights = tensors["weights/policy.0"]
    assert weights[0, 0] == np.float32(-300 / 256)
    assert weights[-1, 1] == np.float32(699 / 256)
    assert np.array_equal(weights[1:, 0], weights[:-1, 1])
    assert weights[:, 2].sum() == 1000
    assert tensors["weights/ruined"].tolist() == [[2, 2, 2]]
    assert tensors["weights/none"].shape == (0, 3)


def test_hyper_parameters_are_read() -> None:
    tags = read(FIXTURE).summary_metadata
    content = {tag: tags[tag].plugin_data.content for tag in tags if tag.startswith("_hparams_/")}
    experiment = metadata.parse_experiment_plugin_data(content[metadata.EXPERIMENT_TAG])
    assert [(info.name, api_pb2.DataType.Name(info.type)) for info in experiment.hparam_infos] == [
        ("algorithm", "DATA_TYPE_STRING"),
        ("gamma", "DATA_TYPE_FLOAT64"),
        ("normalize_advantage", "DATA_TYPE_BOOL"),
    ]
    assert [info.name.tag for info in experiment.metric_infos] == ["rollout/ep_rew_mean", "train/loss"]
    start = metadata.parse_session_start_info_plugin_data(content[metadata.SESSION_START_INFO_TAG])
    values = {name: getattr(value, value.WhichOneof("kind")) for name, value in start.hparams.items()}
    assert values == {"algorithm": "ppo", "gamma": 0.99, "normalize_advantage": True}
    assert (start.group_name, start.start_time_secs) == ("ppo", 1_700_000_000.25)
    end = metadata.parse_session_end_info_plugin_data(content[metadata.SESSION_END_INFO_TAG])
    assert (end.status, end.end_time_secs) == (api_pb2.STATUS_SUCCESS, 1_700_000_006)


def test_the_hparams_tab_lists_the_run(tmp_path: Path) -> None:
    """Through the data provider and backend of TensorBoard's own plugin."""
    from tensorboard.backend.event_processing.data_provider import MultiplexerDataProvider
    from tensorboard.backend.event_processing.plugin_event_multiplexer import EventMultiplexer
    from tensorboard.context import RequestContext
    from tensorboard.plugins.base_plugin import TBContext
    from tensorboard.plugins.hparams import backend_context, list_session_groups

    for seed in (0, 1):
        (tmp_path / f"seed-{seed}").mkdir()
        (tmp_path / f"seed-{seed}" / FIXTURE.name).write_bytes(FIXTURE.read_bytes())
    multiplexer = EventMultiplexer().AddRunsFromDirectory(str(tmp_path))
    multiplexer.Reload()
    context = backend_context.Context(
        TBContext(data_provider=MultiplexerDataProvider(multiplexer, str(tmp_path)), multiplexer=multiplexer)
    )
    request, id_ = RequestContext(), str(tmp_path)
    tags = context.hparams_metadata(request, id_)
    experiment = context.experiment_from_metadata(
        request, id_, True, tags, context.hparams_from_data_provider(request, id_, None)
    )
    sessions = list_session_groups.Handler(
        request,
        context,
        id_,
        api_pb2.ListSessionGroupsRequest(
            allowed_statuses=[api_pb2.STATUS_SUCCESS],
            aggregation_type=api_pb2.AGGREGATION_AVG,
            start_index=0,
            slice_size=10,
        ),
    ).run()
    assert [info.name for info in experiment.hparam_infos] == ["algorithm", "gamma", "normalize_advantage"]
    [group] = sessions.session_groups
    assert group.name == "ppo"
    assert [session.name for session in group.sessions] == ["seed-0", "seed-1"]
    metrics = {value.name.tag: value.value for value in group.metric_values}
    assert metrics["rollout/ep_rew_mean"] == -197


def test_every_record_is_an_end(tmp_path: Path) -> None:
    """A file that was cut after any record is read up to there, and further once it is continued."""
    raw, steps = FIXTURE.read_bytes(), [2048, 4096, 6144, 8192]
    whole, path = read(FIXTURE), tmp_path / FIXTURE.name
    # The losses in: version, hyper-parameters, three rows, histograms, a row, the end.
    for end, losses in zip(record_ends(raw), (0, 0, 1, 2, 3, 3, 4, 4), strict=True):
        path.write_bytes(raw[:end])
        events = read(path)
        found = events.Scalars("train/loss") if "train/loss" in events.Tags()["scalars"] else []
        assert [event.step for event in found] == steps[:losses]
        with path.open("ab") as file:
            file.write(raw[end:])
        events.Reload()
        assert events.Tags() == whole.Tags()
        assert [event.step for event in events.Scalars("train/loss")] == steps


@pytest.mark.parametrize("algorithm", ["ppo", "dqn"])
def test_a_run_is_read(algorithm: str, tmp_path: Path) -> None:
    """What cpp-rl itself writes while it trains, interrupted by nothing: every column of its logs, and histograms."""
    cpp_rl("-q", "train", "--algo", algorithm, "--level", "0", "--timesteps", "6144", "--out", tmp_path)
    run = tmp_path / algorithm / "level-0" / "seed-0"
    [path] = (run / "tb").iterdir()
    events = read(path)
    for log, steps in (("progress.csv", "cumulative_timesteps"), ("plasticity.csv", "cumulative_timesteps")):
        with (run / log).open() as file:
            rows = list(csv.DictReader(file))
        assert rows
        tags = [column for column in rows[0] if "/" in column and not column.startswith("time/")]
        assert tags
        for tag in tags:
            found = [(event.step, event.value) for event in events.Scalars(tag)]
            expected = [(int(row[steps]), float(row[tag])) for row in rows]
            assert [step for step, _ in found] == [step for step, _ in expected]
            assert np.allclose([value for _, value in found], [value for _, value in expected], equal_nan=True), tag
    assert [event.step for event in events.Scalars("time/fps")] == [2048, 4096, 6144]
    assert [event.step for event in events.Scalars("evaluation/level-0/mean_return")] == [0, 6144]
    tower = {"ppo": "policy", "dqn": "q"}[algorithm]
    assert events.Histograms(f"weights/{tower}.0")[-1].histogram_value.num == 256 * 64
    assert events.Histograms(f"activations/{tower}.1")[-1].histogram_value.num == 512 * 64
    start = events.summary_metadata["_hparams_/session_start_info"].plugin_data.content
    hparams = metadata.parse_session_start_info_plugin_data(start).hparams
    assert (hparams["arm"].string_value, hparams["seed"].number_value) == (algorithm, 0)
    assert hparams["learning_rate"].number_value == 1e-4
