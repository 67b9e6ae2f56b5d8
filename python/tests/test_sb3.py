"""The converters, against Stable-Baselines3 itself."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest

from conftest import SB3_FIXTURES, assert_equal, random_checkpoint
from cpp_rl_gym.checkpoint import CheckpointError, read, write
from cpp_rl_gym.sb3 import export_zip, import_zip, main
from oracle import REPOSITORY, OracleEnv, read_map

torch = pytest.importorskip("torch", reason="needs torch: run scripts/test-sb3")
sb3 = pytest.importorskip("stable_baselines3", reason="needs stable-baselines3: run scripts/test-sb3")

torch.set_num_threads(1)
REFERENCE = Path(os.environ.get("CPP_RL_REFERENCE", REPOSITORY.parent / "shared" / "reference")) / "sb3"
CLASSES = {"ppo": sb3.PPO, "dqn": sb3.DQN}
MAP = ["T..#.", ".#..T", ".T..."]
PPO_L2 = {"optimizer_class": torch.optim.AdamW, "optimizer_kwargs": {"weight_decay": 1e-4, "eps": 1e-8}}


def trained(algorithm: str, steps: int = 130, **arguments: object) -> object:
    """A Stable-Baselines3 model after a few updates on a map that is not square."""
    arguments |= {"ppo": {"n_steps": 64, "n_epochs": 2}, "dqn": {"target_update_interval": 50}}[algorithm]
    model = CLASSES[algorithm]("MlpPolicy", OracleEnv(MAP), seed=5, device="cpu", **arguments)
    return model.learn(steps) if steps else model


def saved(model: object, path: Path) -> Path:
    model.save(path)
    return path


def assert_same_parameters(left: object, right: object) -> None:
    """Every tensor of the policy and of its optimiser, bit by bit, and the optimiser's settings."""
    ours, theirs = left.policy.state_dict(), right.policy.state_dict()
    assert list(ours) == list(theirs) and all(torch.equal(ours[name], theirs[name]) for name in ours)
    ours, theirs = left.policy.optimizer.state_dict(), right.policy.optimizer.state_dict()
    assert type(left.policy.optimizer) is type(right.policy.optimizer)
    assert [{**group, "lr": 0} for group in ours["param_groups"]] == [{**g, "lr": 0} for g in theirs["param_groups"]]
    assert ours["state"].keys() == theirs["state"].keys()
    for i, entry in ours["state"].items():
        assert all(torch.equal(entry[name], theirs["state"][i][name]) for name in entry)


def every_observation(rows: list[str]) -> np.ndarray:
    """Observations ``[B, 4, H, W]`` along random walks."""
    env, random = OracleEnv(rows), np.random.default_rng(0)
    observations = [env.reset(seed=3)[0]]
    for _ in range(400):
        observation, _, terminated, truncated, _ = env.step(random.integers(4))
        observations.append(env.reset()[0] if terminated or truncated else observation)
    return np.stack(observations)


@pytest.mark.parametrize(
    ("algorithm", "arguments"),
    [
        ("ppo", {}),
        ("ppo", {"policy_kwargs": PPO_L2}),
        ("ppo", {"policy_kwargs": {"net_arch": {"pi": [8], "vf": [7, 6, 5]}, "activation_fn": torch.nn.ReLU}}),
        ("dqn", {}),
        ("dqn", {"policy_kwargs": {"net_arch": [], "activation_fn": torch.nn.Tanh}}),
    ],
)
def test_there_and_back(folder: Path, algorithm: str, arguments: dict) -> None:
    model = trained(algorithm, **arguments)
    checkpoint = import_zip(saved(model, folder / "a.zip"), level="x", stage=2)
    assert (checkpoint.height, checkpoint.width, checkpoint.level, checkpoint.stage) == (3, 5, "x", 2)
    assert checkpoint.num_timesteps == model.num_timesteps and checkpoint.seed == 5
    assert checkpoint.adam_step > 0 and checkpoint.source == f"stable-baselines3 {sb3.__version__}"
    write(checkpoint, folder / "b.safetensors")
    export_zip(read(folder / "b.safetensors"), folder / "c.zip", l2="optimizer_class" in model.policy_kwargs)
    loaded = CLASSES[algorithm].load(folder / "c.zip", env=OracleEnv(MAP))
    assert_same_parameters(model, loaded)
    back = import_zip(folder / "c.zip", level="x", stage=2)
    back.source = checkpoint.source  # the zip was not Stable-Baselines3's
    assert_equal(back, checkpoint)
    observations = every_observation(MAP)
    expected = model.predict(observations, deterministic=True)[0]
    np.testing.assert_array_equal(loaded.predict(observations, deterministic=True)[0], expected)
    tower = {"ppo": "policy", "dqn": "q"}[algorithm]
    np.testing.assert_array_equal(checkpoint.forward(tower, observations).argmax(1), expected)
    loaded.learn(200)  # an exported model trains on


@pytest.mark.parametrize("algorithm", ["ppo", "dqn"])
@pytest.mark.parametrize("optimizer", [True, False])
def test_back_and_there(folder: Path, algorithm: str, optimizer: bool) -> None:
    checkpoint = random_checkpoint(algorithm, optimizer=optimizer)
    export_zip(checkpoint, folder / "a.zip")
    loaded = CLASSES[algorithm].load(folder / "a.zip")
    back = import_zip(folder / "a.zip", level=checkpoint.level, stage=checkpoint.stage)
    assert back.seed is None  # 2**40 is no seed for Stable-Baselines3
    back.seed, back.source = checkpoint.seed, checkpoint.source
    assert_equal(back, checkpoint)
    observations = np.random.default_rng(1).integers(0, 2, (50, 4, 2, 3)).astype(np.float32)
    with torch.no_grad():
        if algorithm == "ppo":
            policy = loaded.policy.get_distribution(torch.from_numpy(observations)).distribution.logits
            value = loaded.policy.predict_values(torch.from_numpy(observations))
            outputs = {"policy": policy, "value": value}
        else:
            outputs = {
                "q": loaded.q_net(torch.from_numpy(observations)),
                "target/q": loaded.q_net_target(torch.from_numpy(observations)),
            }
    for tower, output in outputs.items():
        mine = checkpoint.forward(tower, observations)
        if tower == "policy":  # torch's Categorical normalises its logits
            mine = mine - np.log(np.exp(mine).sum(1, keepdims=True))
        np.testing.assert_allclose(mine, output.numpy(), atol=1e-5)


def test_a_model_that_never_trained_has_no_optimiser_state(folder: Path) -> None:
    checkpoint = import_zip(saved(trained("dqn", steps=0), folder / "a.zip"))
    assert checkpoint.adam_step == 0 and checkpoint.counters == {"updates": 0, "target_calls": 0}
    assert not any(name.startswith("exp_avg") for name in checkpoint.tensors)


def test_the_optimiser_can_be_left_out(folder: Path) -> None:
    other = {"optimizer_class": torch.optim.SGD, "optimizer_kwargs": {"momentum": 0.5}}
    path = saved(trained("ppo", policy_kwargs=other), folder / "a.zip")
    with pytest.raises(CheckpointError, match=r"not Adam or AdamW .*; pass --no-optimizer"):
        import_zip(path)
    assert import_zip(path, optimizer=False).adam_step == 0


def test_flat_observations_need_a_grid(folder: Path) -> None:
    import gymnasium as gym

    def flat(rows: list[str], name: str) -> Path:
        return saved(sb3.PPO("MlpPolicy", gym.wrappers.FlattenObservation(OracleEnv(rows))), folder / name)

    square = import_zip(flat(["..", ".T"], "square.zip"))
    assert (square.height, square.width) == (2, 2)
    wide = flat(MAP, "wide.zip")
    with pytest.raises(CheckpointError, match="60 inputs, which is not 4 x height x width; pass --height and --width"):
        import_zip(wide)
    with pytest.raises(CheckpointError, match="not 4 x height x width as given"):
        import_zip(wide, height=4)
    assert import_zip(wide, height=3).width == import_zip(wide, height=3, width=5).width == 5
    with pytest.raises(CheckpointError, match="maps are 3 x 5; leave --height and --width out"):
        import_zip(saved(trained("ppo", steps=0), folder / "a.zip"), height=5, width=3)


class Pictures(OracleEnv):
    """The same map as a picture of 36 x 36 pixels."""

    def __init__(self) -> None:
        import gymnasium as gym

        super().__init__(MAP)
        self.observation_space = gym.spaces.Box(0, 255, (3, 36, 36), np.uint8)


def test_other_models_are_refused(folder: Path) -> None:
    models = {
        "neither a PPO nor a DQN": sb3.A2C("MlpPolicy", OracleEnv(MAP)),
        "a CNN policy": sb3.PPO("CnnPolicy", Pictures()),
        "its activation is GELU": trained("dqn", steps=0, policy_kwargs={"activation_fn": torch.nn.GELU}),
        "continuous": sb3.PPO("MlpPolicy", "Pendulum-v1"),
        "uint8": sb3.PPO("MlpPolicy", Pictures()),
        "neither a PPO nor": sb3.SAC("MlpPolicy", "Pendulum-v1"),
    }
    for message, model in models.items():
        with pytest.raises(CheckpointError, match=message):
            import_zip(saved(model, folder / "a.zip"))


def changed(source: Path, target: Path, **members: bytes | None) -> Path:
    """A copy of a zip with members replaced or (None) removed."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            content = members.get(name.replace(".", "_"), old.read(name))
            if content is not None:
                new.writestr(name, content)
    return target


def test_damaged_zips_are_refused(folder: Path) -> None:
    good = saved(trained("ppo"), folder / "good.zip")
    raw = good.read_bytes()
    (folder / "short.zip").write_bytes(raw[: len(raw) // 2])
    with zipfile.ZipFile(good) as archive:
        at = archive.getinfo("policy.pth").header_offset + 5000
        weights = torch.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
    (folder / "flipped.zip").write_bytes(raw[:at] + bytes([raw[at] ^ 255]) + raw[at + 1 :])
    renamed = io.BytesIO()
    torch.save({("surprise" if name == "action_net.bias" else name): w for name, w in weights.items()}, renamed)
    extra = io.BytesIO()
    torch.save(weights | {"mlp_extractor.shared_net.0.bias": torch.zeros(3)}, extra)
    cases = {
        "damaged": [folder / "short.zip", folder / "flipped.zip", changed(good, folder / "1.zip", data=b"{")],
        "the archive lacks policy.pth": [changed(good, folder / "2.zip", policy_pth=None)],
        "lacks action_net.bias": [changed(good, folder / "3.zip", policy_pth=renamed.getvalue())],
        "not: mlp_extractor.shared_net.0.bias": [changed(good, folder / "4.zip", policy_pth=extra.getvalue())],
        "cannot be read": [folder / "absent.zip", folder],
    }
    for message, paths in cases.items():
        for path in paths:
            with pytest.raises(CheckpointError, match=message) as error:
                import_zip(path)
            assert str(error.value).startswith(f"{path}: ")


def test_the_command_line(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    saved(trained("dqn"), folder / "a.zip")
    there = ["import", str(folder / "a.zip"), str(folder / "b.safetensors")]
    assert main([*there, "--level", "9", "--stage", "4"]) == 0
    assert (read(folder / "b.safetensors").level, read(folder / "b.safetensors").stage) == ("9", 4)
    assert main(there) == 2
    assert "error: " in capsys.readouterr().err
    assert main([*there, "--force"]) == 0
    back = ["export", str(folder / "b.safetensors"), str(folder / "c.zip")]
    assert main(back) == 0
    assert main(["export", str(folder / "a.zip"), str(folder / "d.zip")]) == 2
    assert "not a cpp-rl checkpoint" in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir()) == ["a.zip", "b.safetensors", "c.zip"]


def test_a_missing_package_is_named(folder: Path) -> None:
    (folder / "safetensors.py").write_text("raise ImportError('not here')")
    export_zip(random_checkpoint(), folder / "a.zip")
    path = os.pathsep.join([str(folder), str(REPOSITORY / "python" / "src")])
    command = [sys.executable, "-m", "cpp_rl_gym.sb3", "import", str(folder / "a.zip"), str(folder / "b.safetensors")]
    run = subprocess.run(command, env=os.environ | {"PYTHONPATH": path}, capture_output=True, text=True, check=False)
    assert run.returncode == 1
    assert run.stderr == "error: this needs the package safetensors; install it with: pip install safetensors\n"


@pytest.mark.parametrize("name", ["ppo_level0", "dqn_level0"])
def test_exported_fixtures_earn_what_was_measured(folder: Path, name: str, returns: dict) -> None:
    export_zip(read(SB3_FIXTURES / f"{name}.safetensors"), folder / "a.zip")
    assert exhaustive(CLASSES[name[:3]].load(folder / "a.zip")) == returns[name]


@pytest.mark.parametrize("name", ["ppo_level0", "dqn_level0"])
def test_the_original_models(folder: Path, name: str, returns: dict) -> None:
    original = REFERENCE / f"{name}.zip"
    if not original.exists():
        pytest.skip("shared/reference is not here")
    assert json.loads((REFERENCE / "returns.json").read_text()) == json.loads(
        (SB3_FIXTURES / "returns.json").read_text()
    )
    model = CLASSES[name[:3]].load(original)
    assert exhaustive(model) == returns[name]
    checkpoint = read(SB3_FIXTURES / f"{name}.safetensors")
    imported = import_zip(original, level="0")
    assert imported.counters["updates"] == model._n_updates
    imported.counters = checkpoint.counters  # the fixture is older than the count of updates
    assert_equal(imported, checkpoint)
    export_zip(checkpoint, folder / "a.zip")
    assert_same_parameters(model, CLASSES[name[:3]].load(folder / "a.zip"))
    observations = every_observation(read_map("0"))
    actions = checkpoint.forward({"p": "policy", "d": "q"}[name[0]], observations).argmax(1)
    np.testing.assert_array_equal(actions, model.predict(observations, deterministic=True)[0])


def exhaustive(model: object) -> dict[tuple[int, int], float]:
    """Return of the deterministic policy from every start of level 0."""
    env, earned = OracleEnv(read_map("0")), {}
    for start in env.starts():
        observation, _ = env.reset(options={"start": start})
        earned[start], done = 0.0, False
        while not done:
            action, _ = model.predict(observation, deterministic=True)
            observation, reward, terminated, truncated, _ = env.step(int(action))
            earned[start] += reward
            done = terminated or truncated
    return earned
