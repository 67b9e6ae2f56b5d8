"""tests/fixtures/sb3 means what its README says: PPO, DQN, Adam and GAE written out in NumPy arrive at every number."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from conftest import SB3_FIXTURES
from cpp_rl_gym.checkpoint import read

numpy_io = pytest.importorskip("safetensors.numpy", reason="the fixtures are safetensors files")

Tensors = dict[str, np.ndarray]


def case(name: str) -> tuple[dict[str, Any], Tensors]:
    facts = json.loads((SB3_FIXTURES / f"{name}.json").read_text())
    return facts, numpy_io.load_file(SB3_FIXTURES / f"{name}.safetensors")


def under(tensors: Tensors, prefix: str) -> Tensors:
    """The tensors below a prefix, in double precision."""
    below = {name.removeprefix(prefix): t for name, t in tensors.items() if name.startswith(prefix)}
    return {name: tensor.astype(np.float64) for name, tensor in below.items()}


def beginning(facts: dict[str, Any], tensors: Tensors) -> tuple[Tensors, Tensors, Tensors]:
    """Parameters and Adam's moments before the first update."""
    if "starts_from" in facts:
        stored = read(SB3_FIXTURES / facts["starts_from"]).tensors
        parameters = under({n: t for n, t in stored.items() if not n.startswith("exp_avg")}, "")
        return parameters, under(stored, "exp_avg/"), under(stored, "exp_avg_sq/")
    parameters = under(tensors, "initial/")
    return parameters, *({name: np.zeros_like(p) for name, p in parameters.items()} for _ in range(2))


def depth(parameters: Tensors, tower: str) -> int:
    return sum(name.startswith(f"{tower}.") for name in parameters) // 2


def forward(parameters: Tensors, tower: str, x: np.ndarray, activation: str) -> list[np.ndarray]:
    """Input, every hidden layer's output, and the tower's output."""
    layers = [x.reshape(len(x), -1).astype(np.float64)]
    for i in range(depth(parameters, tower)):
        y = layers[-1] @ parameters[f"{tower}.{i}.weight"] + parameters[f"{tower}.{i}.bias"]
        if i + 1 < depth(parameters, tower):
            y = np.tanh(y) if activation == "tanh" else np.maximum(y, 0)
        layers.append(y)
    return layers


def backward(parameters: Tensors, tower: str, layers: list[np.ndarray], d: np.ndarray, activation: str) -> Tensors:
    """Gradients of a tower for the gradient `d` of its output."""
    gradients = {}
    for i in reversed(range(depth(parameters, tower))):
        gradients |= {f"{tower}.{i}.weight": layers[i].T @ d, f"{tower}.{i}.bias": d.sum(0)}
        d = d @ parameters[f"{tower}.{i}.weight"].T
        d = d * ((1 - layers[i] ** 2) if activation == "tanh" else (layers[i] > 0))
    return gradients


def clip(gradients: Tensors, largest: float) -> tuple[float, Tensors]:
    norm = float(np.sqrt(sum((g**2).sum() for g in gradients.values())))
    factor = min(1.0, largest / (norm + 1e-6))
    return norm, {name: factor * g for name, g in gradients.items()}


def adam(facts: dict[str, Any], step: int, p: Tensors, g: Tensors, m: Tensors, v: Tensors) -> None:
    """One step in place; weight decay is added to the clipped gradient (Adam) or shrinks the weights (AdamW)."""
    settings = facts["optimizer"]
    (b1, b2), lr, decay = settings["betas"], settings["lr"], settings["weight_decay"]
    for name, gradient in g.items():
        if settings["class"] == "AdamW":
            p[name] *= 1 - lr * decay
        else:
            gradient = gradient + decay * p[name]
        m[name] = b1 * m[name] + (1 - b1) * gradient
        v[name] = b2 * v[name] + (1 - b2) * gradient**2
        p[name] -= lr / (1 - b1**step) * m[name] / (np.sqrt(v[name] / (1 - b2**step)) + settings["eps"])


def check_update(tensors: Tensors, i: int, raw: Tensors, clipped: Tensors, p: Tensors) -> None:
    """Compares with what is stored of update `i` (from 1)."""
    stored = [(f"after_{i}/", p)] + [("gradient/", raw), ("clipped/", clipped)] * (i == 1)
    for prefix, mine in stored:
        for name, tensor in under(tensors, prefix).items():
            np.testing.assert_allclose(mine[name], tensor, rtol=2e-4, atol=2e-6, err_msg=prefix + name)


@pytest.mark.parametrize("name", ["ppo", "ppo_l2_study", "ppo_adamw", "ppo_l2_coupled", "ppo_study"])
def test_ppo(name: str) -> None:
    facts, tensors = case(name)
    a = facts["arguments"]
    p, m, v = beginning(facts, tensors)
    for i, (batch, row) in enumerate(zip(tensors["minibatches"], facts["updates"], strict=True), start=1):
        x, action = tensors["observations"][batch], tensors["actions"][batch]
        old, returns = tensors["old_log_probs"][batch], tensors["returns"][batch]
        advantages = tensors["advantages"][batch].astype(np.float64)
        advantages = (advantages - advantages.mean()) / (advantages.std(ddof=1) + 1e-8)
        policy, value = forward(p, "policy", x, "tanh"), forward(p, "value", x, "tanh")
        log_all = policy[-1] - np.log(np.exp(policy[-1]).sum(1, keepdims=True))
        probability, chosen = np.exp(log_all), np.eye(4)[action]
        log_ratio = (log_all * chosen).sum(1) - old
        ratio, entropy = np.exp(log_ratio), -(probability * log_all).sum(1)
        limited = np.clip(ratio, 1 - a["clip_range"], 1 + a["clip_range"])
        terms = {
            "policy_gradient_loss": -np.minimum(advantages * ratio, advantages * limited).mean(),
            "value_loss": ((returns - value[-1][:, 0]) ** 2).mean(),
            "entropy_loss": -entropy.mean(),
            "approx_kl": (ratio - 1 - log_ratio).mean(),
            "clip_fraction": (abs(ratio - 1) > a["clip_range"]).mean(),
        }
        terms["loss"] = terms["policy_gradient_loss"] + a["ent_coef"] * terms["entropy_loss"]
        terms["loss"] += a["vf_coef"] * terms["value_loss"]
        follows = (
            (advantages * ratio <= advantages * limited) * advantages * ratio
        )  # the gradient of a clipped one is 0
        d_policy = -follows[:, None] * (chosen - probability)
        d_policy += a["ent_coef"] * probability * (log_all + entropy[:, None])
        d_value = 2 * a["vf_coef"] * (value[-1] - returns[:, None])
        raw = backward(p, "policy", policy, d_policy / len(batch), "tanh")
        raw |= backward(p, "value", value, d_value / len(batch), "tanh")
        norm, clipped = clip(raw, a["max_grad_norm"])
        for key, mine in (terms | {"gradient_norm": norm}).items():
            assert mine == pytest.approx(row[key], rel=2e-4, abs=2e-6), (i, key)
        adam(facts, facts["adam_step"] + i, p, clipped, m, v)
        check_update(tensors, i, raw, clipped, p)
    for prefix, mine in (("exp_avg/", m), ("exp_avg_sq/", v)):
        for key, tensor in under(tensors, prefix).items():
            np.testing.assert_allclose(mine[key], tensor, rtol=1e-3, atol=1e-6, err_msg=prefix + key)
    logged, rows = facts["logged"], facts["updates"]
    last_epoch = rows[-len(rows) // a["n_epochs"] :]
    assert logged["train/approx_kl"] == pytest.approx(np.mean([row["approx_kl"] for row in last_epoch]))
    assert logged["train/loss"] == rows[-1]["loss"] and logged["train/n_updates"] % a["n_epochs"] == 0
    for key in ("policy_gradient_loss", "value_loss", "entropy_loss", "clip_fraction"):
        assert logged[f"train/{key}"] == pytest.approx(np.mean([row[key] for row in rows]))
    error = tensors["returns"] - tensors["old_values"]
    explained = 1 - error.var() / tensors["returns"].var()
    assert logged["train/explained_variance"] == pytest.approx(explained, rel=1e-5)


@pytest.mark.parametrize("name", ["dqn", "dqn_clipped", "dqn_study"])
def test_dqn(name: str) -> None:
    facts, tensors = case(name)
    a = facts["arguments"]
    p, m, v = beginning(facts, tensors)
    target = {key.removeprefix("target/"): t for key, t in p.items() if key.startswith("target/")}
    p = {key: t for key, t in p.items() if key in target}
    for i, row in enumerate(facts["updates"], start=1):
        batch = {
            key: tensors[key][i - 1] for key in ("observations", "next_observations", "actions", "rewards", "dones")
        }
        next_q = forward(target, "q", batch["next_observations"], "relu")[-1].max(1)
        goal = batch["rewards"] + (1 - batch["dones"]) * a["gamma"] * next_q
        layers, chosen = forward(p, "q", batch["observations"], "relu"), np.eye(4)[batch["actions"]]
        error = (layers[-1] * chosen).sum(1) - goal
        huber = np.where(abs(error) < 1, error**2 / 2, abs(error) - 0.5)
        np.testing.assert_allclose(goal, tensors["target_q_values"][i - 1], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(error + goal, tensors["current_q_values"][i - 1], rtol=1e-4, atol=1e-5)
        raw = backward(p, "q", layers, np.clip(error, -1, 1)[:, None] * chosen / len(error), "relu")
        norm, clipped = clip(raw, a["max_grad_norm"])
        assert huber.mean() == pytest.approx(row["loss"], rel=1e-4)
        assert norm == pytest.approx(row["gradient_norm"], rel=1e-4)
        adam(facts, facts["adam_step"] + i, p, clipped, m, v)
        check_update(tensors, i, raw, clipped, p)
        if i == facts["copy_after_update"]:
            target = {key: tensor.copy() for key, tensor in p.items()}


def test_clipping_acts_in_some_cases_and_not_in_others() -> None:
    norms = {name: [row["gradient_norm"] for row in case(name)[0]["updates"]] for name in ("ppo", "dqn", "dqn_clipped")}
    assert min(norms["ppo"]) < 0.5 < max(norms["ppo"])
    assert max(norms["dqn"]) < 10 < min(norms["dqn_clipped"])


def test_gae() -> None:
    facts, t = case("gae")
    timed_out = (t["truncated"] == 1) & (t["terminated"] == 0)
    rewards = t["rewards"] + facts["gamma"] * np.where(timed_out, t["terminal_values"], 0)
    np.testing.assert_allclose(rewards, t["bootstrapped_rewards"], atol=1e-5)
    done = t["terminated"] | t["truncated"]
    np.testing.assert_array_equal(done[:-1], t["episode_starts"][1:])
    np.testing.assert_array_equal(done[-1], t["last_dones"])
    advantage, following = 0.0, t["last_values"]
    for step in reversed(range(len(done))):
        delta = rewards[step] + facts["gamma"] * (1 - done[step]) * following - t["values"][step]
        advantage = delta + facts["gamma"] * facts["gae_lambda"] * (1 - done[step]) * advantage
        following = t["values"][step]
        np.testing.assert_allclose(advantage, t["advantages"][step], rtol=1e-4, atol=1e-5)
    np.testing.assert_array_equal(t["advantages"] + t["values"], t["returns"])


def test_exploration() -> None:
    facts = json.loads((SB3_FIXTURES / "exploration.json").read_text())
    names = ("exploration_initial_eps", "exploration_final_eps", "exploration_fraction")
    first, last, share = (facts["arguments"][name] for name in names)
    for row in facts["rates"]:
        expected = max(last, first + (last - first) * row["timestep"] / (share * row["total"]))
        assert row["exploration_rate"] == pytest.approx(expected, abs=1e-12)
