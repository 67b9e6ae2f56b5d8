"""Churn reduction: outputs on a reference batch are held to those of the network before; in double precision."""

import torch

from .common import Net, brief, draw, load, samples, short
from .updates import Start


def gradient(net: Net, loss: torch.Tensor) -> list[float]:
    """Of a loss, with respect to all parameters."""
    return brief([g.float() for g in torch.autograd.grad(loss, list(net.parameters()))])


def policy(start: Start) -> dict:
    """Tang et al. 2025, PPO: mean over samples of KL(previous || current), and the cross-entropy of their code.

    The network is a tower of tanh. Both losses have the same gradient but for the 1e-8 in the logarithm of the second.
    """
    net = load(Net("tanh"), start.begin).double()
    previous = [p + d for p, d in zip(start.begin, draw(0.1, Net()), strict=True)]
    inputs, active = samples()
    with torch.no_grad():
        before = torch.log_softmax(load(Net("tanh"), previous).double()(inputs.double()), 1)
    now = torch.log_softmax(net(inputs.double()), 1)
    divergence = (before.exp() * (before - now)).sum(1).mean()
    cross_entropy = -(before.exp() * (now.exp() + 1e-8).log()).sum(1).mean()
    return {
        "begin": brief(start.begin),
        "previous": brief(previous),
        "inputs": active,
        "divergence": divergence.item(),
        "cross_entropy": cross_entropy.item(),
        "gradient": gradient(net, divergence),
    }


def values(start: Start) -> dict:
    """Tang et al. 2025, DQN: mean over samples and actions of (Q - previous Q)^2; the network is of ReLU."""
    net = load(Net(), start.begin).double()
    previous = [p + d for p, d in zip(start.begin, draw(0.1, Net()), strict=True)]
    inputs, active = samples()
    with torch.no_grad():
        before = load(Net(), previous).double()(inputs.double())
    loss = ((net(inputs.double()) - before) ** 2).mean()
    return {
        "begin": brief(start.begin),
        "previous": brief(previous),
        "inputs": active,
        "loss": loss.item(),
        "gradient": gradient(net, loss),
    }


def coefficients(first: float, scale: float, warm_up: int, window: int, least: float | None) -> dict:
    """The coefficient after each of eight records of both losses: from record `warm_up` on it is scaled.

    coefficient = scale * mean |loss| / (mean churn + 1e-8), both over the last `window` records, and at least `least`.
    """
    losses, churns = torch.randn(8).tolist(), (0.1 * torch.rand(8)).tolist()
    after = []
    coefficient = first
    for count in range(1, 9):
        if count >= warm_up:
            recent, churn = losses[:count][-window:], churns[:count][-window:]
            mean = sum(abs(loss) for loss in recent) / len(recent)
            coefficient = scale * mean / (sum(churn) / len(churn) + 1e-8)
            coefficient = coefficient if least is None else max(coefficient, least)
        after.append(coefficient)
    return {
        "first": first,
        "scale": scale,
        "warm_up": warm_up,
        "window": window,
        "least": least,
        "losses": short(losses),
        "churns": short(churns),
        "coefficients": after,
    }
