"""The networks, minibatches and notation that all golden values share."""

from itertools import pairwise

import torch
from torch import nn

INPUTS, HIDDEN, ACTIONS = 24, [5, 4], 4  # a 2x3 map
BATCH, GAMMA, LEARNING_RATE, EPS, MAX_NORM = 6, 0.9, 1e-2, 1e-3, 0.7

Tensors = list[torch.Tensor]


class Net(nn.Module):
    """ReLU in the hidden layers, as our tower `q`, or tanh, as our tower `policy`."""

    def __init__(self, activation: str = "relu") -> None:
        super().__init__()
        sizes = [INPUTS, *HIDDEN, ACTIONS]
        self.layers = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))
        self.activation = getattr(torch, activation)

    def hidden(self, x: torch.Tensor) -> Tensors:
        """The activations of each hidden layer, [samples, units]."""
        values = []
        for layer in self.layers[:-1]:
            x = self.activation(layer(x))
            values.append(x)
        return values

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """The outputs, [samples, actions]."""
        return self.layers[-1](self.hidden(x)[-1])


def flat(tensors: Tensors) -> list[float]:
    """Weight and bias of each layer; our weights are [inputs, units], PyTorch's the transpose."""
    return [v for t in tensors for v in (t.t() if t.dim() == 2 else t).detach().flatten().tolist()]


def short(values: list[float]) -> list[float]:
    """These float32 numbers in nine digits, which tell them apart from all others."""
    rounded = [float(f"{v:.9g}") for v in values]
    assert torch.equal(torch.tensor(rounded), torch.tensor(values))
    return rounded


def brief(tensors: Tensors) -> list[float]:
    """As `flat`, in nine digits."""
    return short(flat(tensors))


def draw(scale: float, net: Net) -> Tensors:
    """Normal numbers in the shapes of the network's parameters."""
    return [scale * torch.randn_like(p) for p in net.parameters()]


def load(net: Net, values: Tensors) -> Net:
    """Puts these parameters into the network."""
    with torch.no_grad():
        for parameter, value in zip(net.parameters(), values, strict=True):
            parameter.copy_(value)
    return net


def samples() -> tuple[torch.Tensor, list[list[int]]]:
    """Binary inputs, and which of them are active in each sample."""
    bits = torch.rand(BATCH, INPUTS) < 0.4
    return bits.float(), [row.nonzero().flatten().tolist() for row in bits]


class Minibatch:
    """Random transitions."""

    def __init__(self) -> None:
        self.inputs, self.inputs_active = samples()
        self.following, self.following_active = samples()
        self.actions = torch.randint(ACTIONS, (BATCH,))
        self.rewards = torch.randn(BATCH)
        self.terminated = torch.rand(BATCH) < 0.3

    def loss(self, net: Net, target: Net) -> torch.Tensor:
        """DQN's: smooth L1 of the temporal-difference errors."""
        with torch.no_grad():
            targets = self.rewards + (~self.terminated) * GAMMA * target(self.following).max(1).values
        taken = net(self.inputs).gather(1, self.actions[:, None]).squeeze(1)
        return nn.functional.smooth_l1_loss(taken, targets)

    def described(self) -> dict:
        """As the fixture has it."""
        return {
            "inputs": self.inputs_active,
            "next": self.following_active,
            "actions": self.actions.tolist(),
            "rewards": self.rewards.tolist(),
            "terminated": self.terminated.tolist(),
        }


def new_adam(net: Net, betas: tuple[float, float] = (0.9, 0.999)) -> torch.optim.Adam:
    """The fixture's Adam."""
    return torch.optim.Adam(net.parameters(), lr=LEARNING_RATE, eps=EPS, betas=betas)


def moments(adam: torch.optim.Adam, net: Net) -> Tensors:
    """Adam's first moments."""
    return [adam.state[p]["exp_avg"] for p in net.parameters()]
