"""Stable-Baselines3 models to cpp-rl checkpoints and back.

    python -m cpp_rl_gym.sb3 import MODEL.zip OUT.safetensors
    python -m cpp_rl_gym.sb3 export CHECKPOINT OUT.zip

PPO and DQN with ``MlpPolicy`` on a flattened ``[4, H, W]`` observation, optimiser state included. What mitigations keep
is not exported. Neither are networks that ``MlpPolicy`` cannot be, and agents with another sensor. Both ways need
safetensors; neither needs Stable-Baselines3 or PyTorch, and importing runs no code of the zip. The names follow
Stable-Baselines3's ``common/policies.py``, ``dqn/policies.py`` and ``common/save_util.py``.
"""

from __future__ import annotations

import argparse
import base64
import importlib
import io
import json
import math
import pickle
import sys
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from cpp_rl_gym import pth
from cpp_rl_gym.checkpoint import (
    CHANNELS,
    Activation,
    Checkpoint,
    CheckpointError,
    MissingPackageError,
    read,
    refuse_existing,
    write,
    write_aside,
)

Algorithm = Literal["ppo", "dqn"]

# The paper's hyper-parameters; they are not part of a checkpoint, so an exported model carries these.
LEARNING_RATE = 1e-4
BETAS = (0.9, 0.999)  # of Adam
PPO_ARGUMENTS = {
    "learning_rate": LEARNING_RATE,
    "n_steps": 2048,
    "batch_size": 64,
    "n_epochs": 10,
    "gamma": 0.99,
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "ent_coef": 0.01,
    "vf_coef": 0.5,
    "max_grad_norm": 0.5,
}
DQN_ARGUMENTS = {
    "learning_rate": LEARNING_RATE,
    "buffer_size": 100_000,
    "learning_starts": 100,
    "batch_size": 32,
    "gamma": 0.99,
    "train_freq": 4,
    "gradient_steps": 1,
    "target_update_interval": 10_000,
    "exploration_fraction": 0.1,
    "exploration_initial_eps": 1.0,
    "exploration_final_eps": 0.05,
    "max_grad_norm": 10,
}
L2_OPTIMIZER = {"weight_decay": 1e-4, "eps": 1e-8}  # of AdamW, for the paper's PPO with L2
DEFAULT_EPS = {"ppo": 1e-5, "dqn": 1e-8}  # Adam's eps in Stable-Baselines3's policies
POLICY = {
    "ppo": ("stable_baselines3.common.policies", "ActorCriticPolicy"),
    "dqn": ("stable_baselines3.dqn.policies", "DQNPolicy"),
}
ACTIVATIONS: dict[Activation, str] = {"tanh": "Tanh", "relu": "ReLU"}
DEFAULT_ACTIVATION: dict[Algorithm, Activation] = {"ppo": "tanh", "dqn": "relu"}

Names = list[tuple[str, str]]  # (ours, Stable-Baselines3's) for every trained tensor, in its optimiser's order


def parameter_names(algorithm: str, layers: dict[str, int]) -> Names:
    """Pairs of tensor names in the order of ``policy.optimizer``'s parameters; ``layers`` counts a tower's layers."""
    if algorithm == "dqn":
        theirs = {"q": [f"q_net.q_net.{2 * i}" for i in range(layers["q"])]}
        order = [("q", i) for i in range(layers["q"])]
    else:
        theirs = {
            tower: [f"mlp_extractor.{tower}_net.{2 * i}" for i in range(layers[tower] - 1)] + [head]
            for tower, head in (("policy", "action_net"), ("value", "value_net"))
        }
        order = [(tower, i) for tower in theirs for i in range(layers[tower] - 1)]
        order += [(tower, layers[tower] - 1) for tower in theirs]
    return [(f"{t}.{i}.{part}", f"{theirs[t][i]}.{part}") for t, i in order for part in ("weight", "bias")]


# -------------------- import


def import_zip(
    path: str | Path,
    *,
    height: int | None = None,
    width: int | None = None,
    level: str | None = None,
    stage: int | None = None,
    optimizer: bool = True,
) -> Checkpoint:
    """Reads a model that ``PPO.save`` or ``DQN.save`` wrote.

    ``height`` and ``width`` are needed where its observation space is neither ``[4, H, W]`` nor a square flattened.
    ``optimizer=False`` leaves the optimiser's state out. Raises :class:`CheckpointError` for anything else than a PPO
    or DQN model with separate plain MLPs.
    """

    def fail(what: str) -> CheckpointError:
        return CheckpointError(f"{path}: {what}")

    data, params, moments, version = _open_zip(path, fail)
    algorithm, layers = _recognise(data, params, fail)
    names = parameter_names(algorithm, layers)
    copies = [(f"target/{ours}", theirs.replace("q_net.", "q_net_target.", 1)) for ours, theirs in names]
    wanted = dict(names + copies) if algorithm == "dqn" else dict(names)
    if missing := sorted(set(wanted.values()) - params.keys()):
        raise fail(f"its policy lacks {', '.join(missing)}; only MlpPolicy with separate towers can be imported")
    if unknown := sorted(params.keys() - set(wanted.values())):
        raise fail(f"its policy has tensors that an MlpPolicy has not: {', '.join(unknown)}; it cannot be imported")
    tensors = {ours: _transposed(params[theirs]) for ours, theirs in wanted.items()}

    towers = {}
    for tower, count in layers.items():
        weights = [tensors[f"{tower}.{i}.weight"] for i in range(count)]
        towers[tower] = (int(weights[0].shape[0]), *(int(weight.shape[1]) for weight in weights))
    inputs = next(iter(towers.values()))[0]
    height, width = _grid(data.get("observation_space"), inputs, height, width, fail)
    step = 0
    if optimizer and moments is not None:
        step = _import_moments(tensors, names, moments, fail)
    checkpoint = Checkpoint(
        algorithm=algorithm,
        activation=_activation(data, algorithm, fail),
        towers=towers,
        height=height,
        width=width,
        tensors=tensors,
        adam_step=step,
        num_timesteps=int(data.get("num_timesteps") or 0),
        seed=data.get("seed"),
        stage=stage,
        level=level,
        source=f"stable-baselines3 {version}",
        counters={"updates": int(data.get("_n_updates") or 0), "target_calls": int(data.get("_n_calls") or 0)},
    )
    if fault := checkpoint.fault():
        raise fail(f"its tensors do not fit together: {fault}")
    return checkpoint


def _open_zip(path: str | Path, fail: Any) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any] | None, str]:
    """The JSON of constructor arguments, the policy's and the optimiser's state, and the writer's version."""

    def load(name: str) -> dict[str, Any]:
        state: dict[str, Any] = pth.load(archive.read(name))
        return state

    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.namelist()
            if lacking := [name for name in ("data", "policy.pth") if name not in members]:
                raise fail(f"not a Stable-Baselines3 model: the archive lacks {' and '.join(lacking)}")
            data, params = json.loads(archive.read("data")), load("policy.pth")
            moments = load("policy.optimizer.pth") if "policy.optimizer.pth" in members else None
            version = "_stable_baselines3_version"
            version = archive.read(version).decode().strip() if version in members else "of unknown version"
    except CheckpointError:
        raise
    except OSError as error:
        raise fail(f"cannot be read ({error.strerror})") from error
    except zipfile.BadZipFile as error:
        raise fail(f"not a Stable-Baselines3 model, or damaged ({error}); copy or save it again") from error
    except Exception as error:  # zlib's and pickle's errors have no common base
        raise fail(f"damaged ({type(error).__name__}: {error}); copy or save it again") from error
    return data, params, moments, version


def _recognise(data: dict[str, Any], params: dict[str, Any], fail: Any) -> tuple[Algorithm, dict[str, int]]:
    """The algorithm, and how many layers each tower has."""

    def count(prefix: str) -> int:
        return sum(name.startswith(prefix) and name.endswith(".weight") for name in params)

    if any(".cnn." in name or name.startswith("cnn.") for name in params):
        raise fail("a CNN policy; only MlpPolicy can be imported")
    if any(name.startswith("q_net.q_net.") for name in params) and "exploration_fraction" in data:
        return "dqn", {"q": count("q_net.q_net.")}
    if "action_net.weight" in params and "clip_range" in data and "n_epochs" in data:
        if "log_std" in params:
            raise fail("its actions are continuous; cpp-rl has four discrete actions")
        return "ppo", {tower: count(f"mlp_extractor.{tower}_net.") + 1 for tower in ("policy", "value")}
    raise fail("neither a PPO nor a DQN model; other algorithms cannot be imported")


def _activation(data: dict[str, Any], algorithm: Algorithm, fail: Any) -> Activation:
    """The activation that ``policy_kwargs`` names (a class is stored as its printed form), or the default."""
    named = (data.get("policy_kwargs") or {}).get("activation_fn")
    if named is None:
        return DEFAULT_ACTIVATION[algorithm]
    known = {theirs: ours for ours, theirs in ACTIVATIONS.items()}
    last = str(named).removesuffix("'>").rpartition(".")[2]
    if last not in known:
        raise fail(f"its activation is {last}; only Tanh and ReLU can be imported")
    return known[last]


def _grid(space: Any, inputs: int, height: int | None, width: int | None, fail: Any) -> tuple[int, int]:
    """Height and width of the map, from the observation space or as given."""
    shape = list(space.get("_shape") or []) if isinstance(space, dict) else []
    if len(shape) == 3 and space.get("dtype") == "uint8":
        raise fail("its observations are uint8 images, which Stable-Baselines3 scales by 1/255; train on float32")
    given = (height, width)
    if len(shape) == 3 and shape[0] == CHANNELS:
        height, width = height or shape[1], width or shape[2]
        if [height, width] != shape[1:]:
            raise fail(f"its maps are {shape[1]} x {shape[2]}; leave --height and --width out")
    elif height is None and width is None:
        height = width = math.isqrt(inputs // CHANNELS)
    else:
        height = height or inputs // (CHANNELS * width)  # type: ignore[operator] # one of them is given
        width = width or inputs // (CHANNELS * height)
    if CHANNELS * height * width != inputs:
        what = f"its networks take {inputs} inputs, which is not 4 x height x width"
        raise fail(f"{what}; pass --height and --width" if given == (None, None) else f"{what} as given")
    return height, width


def _import_moments(tensors: dict[str, np.ndarray], names: Names, moments: dict[str, Any], fail: Any) -> int:
    """Adds Adam's moments to ``tensors`` and returns its count of steps (0: the optimiser never stepped)."""
    state, ids = moments["state"], [i for group in moments["param_groups"] for i in group["params"]]
    if not state:
        return 0
    remedy = "pass --no-optimizer to import the weights alone"
    # Before Stable-Baselines3 2.4 DQN's optimiser listed the target network too, behind the online one, without state.
    entries = [state.get(i) for i in ids]
    if any(entries[len(names) :]) or len(entries) not in (len(names), 2 * len(names)):
        raise fail(f"its optimiser holds {len(entries)} tensors where the policy has {len(names)}; {remedy}")
    steps = set()
    for (ours, _), entry in zip(names, entries, strict=False):
        if entry is None or set(entry) != {"step", "exp_avg", "exp_avg_sq"}:
            raise fail(f"its optimiser is not Adam or AdamW (state of {ours}: {sorted(entry or {})}); {remedy}")
        steps.add(int(entry["step"]))
        for moment in ("exp_avg", "exp_avg_sq"):
            tensors[f"{moment}/{ours}"] = _transposed(entry[moment])
    if len(steps) != 1:
        raise fail(f"its tensors were updated different numbers of times ({sorted(steps)}); {remedy}")
    return steps.pop()


def _transposed(tensor: np.ndarray) -> np.ndarray:
    """A weight ``[out, in]`` as ``[in, out]`` or back, a bias as it is; C-contiguous float32."""
    return np.ascontiguousarray(tensor.T, np.float32)


# -------------------- export


def export_zip(checkpoint: Checkpoint, path: str | Path, *, l2: bool = False, force: bool = False) -> None:
    """Writes a checkpoint as a zip that ``PPO.load`` or ``DQN.load`` reads, with the paper's hyper-parameters.

    ``l2`` chooses the optimiser of the paper's PPO with L2 (AdamW, weight decay 1e-4, eps 1e-8) instead of the
    algorithm's default Adam. A checkpoint does not say which it was trained with, nor with which learning rate and betas.
    """
    write_aside(path, _to_zip(checkpoint, l2=l2), force=force)


def export_model(checkpoint: Checkpoint, *, l2: bool = False) -> Any:
    """The Stable-Baselines3 model of a checkpoint, as :func:`export_zip` writes it; needs stable-baselines3."""
    sb3 = _require("stable_baselines3")
    return {"ppo": sb3.PPO, "dqn": sb3.DQN}[checkpoint.algorithm].load(
        io.BytesIO(_to_zip(checkpoint, l2=l2)), device="cpu"
    )


def _to_zip(c: Checkpoint, *, l2: bool) -> bytes:
    """The bytes of the zip: constructor arguments, the policy's and the optimiser's state."""
    if fault := c.fault():
        raise ValueError(f"not a valid checkpoint: {fault}")
    cannot = "this checkpoint cannot be exported, since MlpPolicy of Stable-Baselines3"
    if c.layer_norm:
        raise CheckpointError(f"{cannot} has no normalised layers (layer_norm)")
    if c.activation not in ACTIVATIONS:
        raise CheckpointError(f"{cannot} has no activation {c.activation}")
    if c.sensor != "full":
        raise CheckpointError(f"{cannot} would not know its sensor {c.sensor}; only agents with the sensor full can be")
    names = parameter_names(c.algorithm, {tower: len(sizes) - 1 for tower, sizes in c.towers.items()})
    policy = {theirs: _transposed(c.tensors[ours]) for ours, theirs in names}
    if c.algorithm == "dqn":
        copies = ((f"target/{ours}", theirs.replace("q_net.", "q_net_target.", 1)) for ours, theirs in names)
        policy |= {theirs: _transposed(c.tensors[ours]) for ours, theirs in copies}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        archive.writestr("data", json.dumps(_arguments(c, l2=l2), indent=4))
        archive.writestr("policy.pth", pth.save(policy))
        archive.writestr("policy.optimizer.pth", pth.save(_optimizer(c, names, l2=l2)))
    return buffer.getvalue()


def _arguments(c: Checkpoint, *, l2: bool) -> dict[str, Any]:
    """The attributes of the model that are not tensors."""
    gymnasium = _require("gymnasium")
    hidden = {tower: list(sizes[1:-1]) for tower, sizes in c.towers.items()}
    activation = ACTIVATIONS[c.activation]
    policy_kwargs: dict[str, Any] = {
        "net_arch": hidden["q"] if c.algorithm == "dqn" else {"pi": hidden["policy"], "vf": hidden["value"]},
        "activation_fn": pth.Name("torch.nn.modules.activation", activation),
    }
    if l2:
        policy_kwargs["optimizer_class"] = pth.Name("torch.optim.adamw", "AdamW")
        policy_kwargs["optimizer_kwargs"] = {"weight_decay": L2_OPTIMIZER["weight_decay"], "eps": L2_OPTIMIZER["eps"]}
    observations = gymnasium.spaces.Box(0.0, 1.0, (CHANNELS, c.height, c.width), np.float32)
    actions = gymnasium.spaces.Discrete(next(iter(c.towers.values()))[-1])
    printed = {"activation_fn": f"<class 'torch.nn.modules.activation.{activation}'>"}
    shape = {"_shape": [CHANNELS, c.height, c.width], "dtype": "float32"}
    model = {
        "policy_class": _serialized(pth.dumps(pth.Name(*POLICY[c.algorithm])), {}),
        "policy_kwargs": _serialized(pth.dumps(policy_kwargs), {"net_arch": policy_kwargs["net_arch"], **printed}),
        "observation_space": _serialized(pickle.dumps(observations), shape),
        "action_space": _serialized(pickle.dumps(actions), {}),
        "n_envs": 1,
        "verbose": 0,
        "num_timesteps": c.num_timesteps,
        "seed": c.seed if c.seed is not None and c.seed < 2**32 else None,  # NumPy's legacy generator takes 32 bits
        "_n_updates": c.counters.get("updates", 0),
    }
    if c.algorithm == "ppo":
        return model | PPO_ARGUMENTS
    clock = {"_n_calls": c.counters.get("target_calls", 0), "exploration_rate": DQN_ARGUMENTS["exploration_final_eps"]}
    return model | clock | DQN_ARGUMENTS


def _serialized(pickled: bytes, shown: dict[str, Any]) -> dict[str, Any]:
    """A pickled attribute as Stable-Baselines3 keeps it in JSON; ``shown`` can be read without unpickling."""
    return {":serialized:": base64.b64encode(pickled).decode(), **shown}


def _optimizer(c: Checkpoint, names: Names, *, l2: bool) -> dict[str, Any]:
    """The state of torch's Adam or AdamW, its parameters numbered in the order of ``names``."""
    settings = L2_OPTIMIZER if l2 else {"weight_decay": 0, "eps": DEFAULT_EPS[c.algorithm]}
    flags = {"amsgrad": False, "maximize": False, "foreach": None, "capturable": False, "differentiable": False}
    group: dict[str, Any] = {"lr": LEARNING_RATE, "betas": BETAS, **settings, **flags, "fused": None}
    group |= {"decoupled_weight_decay": l2, "params": list(range(len(names)))}

    def entry(ours: str) -> dict[str, Any]:
        step = np.array(c.adam_step, np.float32)
        return {"step": step} | {m: _transposed(c.tensors[f"{m}/{ours}"]) for m in ("exp_avg", "exp_avg_sq")}

    state = {i: entry(ours) for i, (ours, _) in enumerate(names)} if c.adam_step else {}
    return {"state": state, "param_groups": [group]}


def _require(package: str) -> Any:
    try:
        return importlib.import_module(package)
    except ImportError as error:
        raise MissingPackageError(package.replace("_", "-")) from error


# -------------------- command line


def main(argv: Sequence[str] | None = None) -> int:
    """Runs the command line; returns the exit code (0 done, 2 the input is wrong, 1 anything else)."""
    parser = argparse.ArgumentParser(prog="python -m cpp_rl_gym.sb3", description=__doc__.splitlines()[0])
    commands = parser.add_subparsers(dest="command", required=True)
    take = commands.add_parser("import", help="a Stable-Baselines3 zip to a checkpoint")
    take.add_argument("input", metavar="IN.zip", type=Path)
    take.add_argument("output", metavar="OUT.safetensors", type=Path)
    take.add_argument("--height", type=_positive, help="rows of the map, where the zip does not say")
    take.add_argument("--width", type=_positive, help="columns of the map, where the zip does not say")
    take.add_argument("--level", help="the level it was trained on, to be noted in the checkpoint")
    take.add_argument("--stage", type=int, help="the stage of its curriculum, to be noted in the checkpoint")
    take.add_argument("--no-optimizer", action="store_true", help="leave the optimiser's state out")
    give = commands.add_parser("export", help="a checkpoint to a Stable-Baselines3 zip")
    give.add_argument("input", metavar="CHECKPOINT", type=Path)
    give.add_argument("output", metavar="OUT.zip", type=Path)
    give.add_argument("--l2", action="store_true", help="optimiser of the paper's PPO with L2 (AdamW) instead of Adam")
    for command in (take, give):
        command.add_argument("--force", action="store_true", help="replace an existing output")
    options = parser.parse_args(argv)
    try:
        refuse_existing(options.output, force=options.force)
        if options.command == "import":
            checkpoint = import_zip(
                options.input,
                height=options.height,
                width=options.width,
                level=options.level,
                stage=options.stage,
                optimizer=not options.no_optimizer,
            )
            write(checkpoint, options.output, force=options.force)
        else:
            checkpoint = read(options.input)
            export_zip(checkpoint, options.output, l2=options.l2, force=options.force)
    except (CheckpointError, MissingPackageError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, CheckpointError) else 1
    towers = ", ".join(f"{tower} {'-'.join(map(str, sizes))}" for tower, sizes in checkpoint.towers.items())
    print(f"{options.output}: {checkpoint.algorithm}, {towers}, {checkpoint.num_timesteps} timesteps", file=sys.stderr)
    return 0


def _positive(text: str) -> int:
    if (value := int(text)) < 1:
        raise ValueError(text)
    return value


if __name__ == "__main__":
    sys.exit(main())
