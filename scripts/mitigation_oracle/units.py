"""Mitigations that watch units and reset some of them."""

from collections import Counter

import torch
from torch import nn

from .common import MAX_NORM, Minibatch, Net, Tensors, brief, draw, flat, load, new_adam, samples, short
from .updates import UPDATES, Start

FATES = ["keep", "new", "zero", "value"]
KEEP, NEW, ZERO, VALUE = range(4)


def named(fate: Tensors) -> list[str]:
    """What becomes of each parameter, in words."""
    return [FATES[int(v)] for v in flat(fate)]


def renewed(net: Net, units: list[torch.Tensor]) -> list[str]:
    """The fates when these units, a mask for each layer, get new weights in, a bias of 0 and, last, 0 weights out."""
    fate = [torch.zeros_like(p) for p in net.parameters()]
    for layer, mask in enumerate(units):
        fate[2 * layer][mask, :] = NEW
        fate[2 * layer + 1][mask] = ZERO
    for layer, mask in enumerate(units):
        fate[2 * layer + 2][:, mask] = ZERO
    return named(fate)


def redo(threshold: float) -> dict:
    """Sokar et al. 2023, equation 1 and Algorithm 1; what becomes of each parameter: keep, new or zero."""
    net = Net()
    begin = draw(0.5, net)
    for layer, units in ((0, [1, 3]), (1, [2])):
        begin[2 * layer + 1][units] = -3.0  # so low a bias that these units are silent or nearly so
    load(net, begin)
    inputs, active = samples()
    scores = []
    for h in net.hidden(inputs):
        magnitude = h.abs().mean(0)
        scores.append(magnitude / (magnitude.mean() + 1e-9))
    return {
        "threshold": threshold,
        "begin": flat(begin),
        "inputs": active,
        "scores": [score.tolist() for score in scores],
        "fate": renewed(net, [score <= threshold for score in scores]),
    }


def redo_saturation(share: float, level: float = 0.99) -> dict:
    """Of this project, for tanh: a unit is saturated if |h| > level in at least this share of the samples."""
    net = Net("tanh")
    begin = draw(0.5, net)
    for layer, units, bias in ((0, [1], 6.0), (0, [4], 2.3), (1, [2], -7.0), (1, [0], 2.5)):
        begin[2 * layer + 1][units] = bias
    load(net, begin)
    inputs, active = samples()
    hidden = net.hidden(inputs)
    assert all(((h.abs() - level).abs() > 1e-4).all() for h in hidden), "no activation lies at the level"
    shares = [(h.abs() > level).float().mean(0) for h in hidden]
    return {
        "level": level,
        "share": share,
        "begin": brief(begin),
        "inputs": active,
        "shares": [s.tolist() for s in shares],
        "fate": renewed(net, [s >= share for s in shares]),
    }


class ContinualBackprop:
    """Dohare et al. 2024, as in the authors' code: generate and test after each update, hidden layer by hidden layer.

    Age counts updates. utility <- d * utility + (1 - d) * mean |weights out| * mean |h|, h of the minibatch before the
    update and weights after it; activation <- d * activation + (1 - d) * mean h; both are divided by 1 - d^age where
    they are used. Units older than `maturity` are eligible, and rate * (their number) is added to `accumulated`; its
    whole part is how many of them, those of least utility, are replaced.
    """

    def __init__(self, rate: float, maturity: int, decay: float) -> None:
        self.rate, self.maturity, self.decay = rate, maturity, decay
        sizes = [layer.out_features for layer in Net().layers[:-1]]
        self.utility = [torch.zeros(n) for n in sizes]
        self.activation = [torch.zeros(n) for n in sizes]
        self.age = [torch.zeros(n) for n in sizes]
        self.accumulated = [0.0 for _ in sizes]

    def test(self, net: Net, hidden: Tensors) -> tuple[list[list[int]], Tensors]:
        """The units to replace in each layer, and the corrected mean activations of all of them."""
        chosen, corrected = [], []
        for layer, h in enumerate(hidden):
            self.age[layer] += 1
            correction = 1 - self.decay ** self.age[layer].double()
            out = net.layers[layer + 1].weight.detach().abs().mean(0)
            self.utility[layer] = self.decay * self.utility[layer] + (1 - self.decay) * out * h.abs().mean(0)
            self.activation[layer] = self.decay * self.activation[layer] + (1 - self.decay) * h.mean(0)
            corrected.append((self.activation[layer] / correction).float())
            eligible = torch.where(self.age[layer] > self.maturity)[0]
            self.accumulated[layer] += self.rate * len(eligible)
            count = int(self.accumulated[layer])
            self.accumulated[layer] -= count
            utility = (self.utility[layer] / correction)[eligible]
            chosen.append(sorted(eligible[utility.argsort()[:count]].tolist()))
        return chosen, corrected

    def generate(self, net: Net, chosen: list[list[int]], corrected: Tensors | None) -> tuple[Tensors, Tensors]:
        """The fate of each parameter, and its value where that is `value`; layers are written from the first on.

        With `corrected`, what a replaced unit gave on average goes into the biases of the next layer.
        """
        fate = [torch.zeros_like(p) for p in net.parameters()]
        values = [p.detach().clone() for p in net.parameters()]
        for layer, units in enumerate(chosen):
            if not units:
                continue
            fate[2 * layer][units, :] = NEW
            fate[2 * layer + 1][units] = ZERO
            if corrected is not None:
                fate[2 * layer + 3][:] = VALUE
                values[2 * layer + 3] += values[2 * layer + 2][:, units] @ corrected[layer][units]
            fate[2 * layer + 2][:, units] = ZERO
        return fate, values

    def forget(self, chosen: list[list[int]]) -> None:
        """Replaced units begin anew."""
        for layer, units in enumerate(chosen):
            for state in (self.utility, self.activation, self.age):
                state[layer][units] = 0.0

    def state(self) -> dict:
        """As the fixture has it."""
        return {
            "utility": [short(u.tolist()) for u in self.utility],
            "activation": [short(a.tolist()) for a in self.activation],
            "age": [[int(a) for a in ages] for ages in self.age],
            "accumulated": list(self.accumulated),
        }


def continual_backprop(start: Start, minibatches: list[Minibatch], rate: float, maturity: int, decay: float) -> dict:
    """Ten updates on ten minibatches; units are replaced after the last one only."""
    net, target = load(Net(), start.begin), load(Net(), start.frozen)
    adam = new_adam(net)
    method = ContinualBackprop(rate, maturity, decay)
    states, norms = [], []
    for update, minibatch in enumerate(minibatches, start=1):
        hidden = [h.detach() for h in net.hidden(minibatch.inputs)]
        adam.zero_grad()
        minibatch.loss(net, target).backward()
        norms.append(float(nn.utils.clip_grad_norm_(net.parameters(), MAX_NORM)))
        adam.step()
        chosen, corrected = method.test(net, hidden)
        assert update == UPDATES or not any(chosen), "nothing random happens before the last update"
        if update == UPDATES:
            before = method.state()
        method.forget(chosen)
        states.append(method.state())
    plain, _ = method.generate(net, chosen, None)
    moved, values = method.generate(net, chosen, corrected)
    return {
        "rate": rate,
        "maturity": maturity,
        "decay": decay,
        "norms": short(norms),
        "states": states,
        "before_replacement": before,
        "replaced": chosen,
        "parameters": brief(list(net.parameters())),
        "fate": named(plain),
        "fate_with_transfer": named(moved),
        "values_with_transfer": [
            value if fate == VALUE else None for value, fate in zip(brief(values), flat(moved), strict=True)
        ],
    }


def self_normalised_resets(percentile: float, interval: int) -> dict:
    """Farias & Jozefiak 2025, as in the authors' code for minibatches, without the network.

    A unit that fires in any sample notes its age and has age 0; a silent one ages by the size of the minibatch. Then
    units as old as their threshold note their age, too, and are reset: age 0. Then, after every `interval` minibatches,
    the threshold becomes the least noted age q with a share of at least `percentile` of all noted ages at or below q,
    if q is less than the threshold; otherwise the threshold is doubled. Ages of 0 and above `largest` are not counted;
    nothing noted: q = 1. It stays within the size of a minibatch and `largest`. What was noted is forgotten.
    """
    units, size, minibatches, first, largest = 5, 4, 40, 20, 36
    firing = torch.tensor([0.5, 0.12, 0.05, 0.03, 0.4])
    h = torch.relu(torch.rand(minibatches, size, units) - (1 - firing))
    h[16:, :, 4] = 0.0  # dies
    h = (100 * h).round() / 100
    ages, thresholds = [0] * units, [first] * units
    noted: list[Counter[int]] = [Counter() for _ in range(units)]
    states = []
    for index, minibatch in enumerate(h, start=1):
        reset = []
        for unit in range(units):
            if (minibatch[:, unit] > 0).any():
                noted[unit][ages[unit]] += 1
                ages[unit] = 0
            else:
                ages[unit] += size
            if ages[unit] >= thresholds[unit]:
                noted[unit][ages[unit]] += 1
                ages[unit] = 0
                reset.append(unit)
        if index % interval == 0:
            for unit in range(units):
                counted = sorted(age for age in noted[unit].elements() if 0 < age <= largest)
                shares = [(age, (n + 1) / len(counted)) for n, age in enumerate(counted)]
                assert all(abs(share - percentile) > 1e-3 for _, share in shares), "no share lies at the percentile"
                q = next((age for age, share in shares if share >= percentile), 1)
                threshold = q if q < thresholds[unit] else 2 * thresholds[unit]
                thresholds[unit] = max(size, min(threshold, largest))
                noted[unit].clear()
        states.append(
            {
                "age": list(ages),
                "threshold": list(thresholds),
                "noted": [sorted([age, count] for age, count in unit.items()) for unit in noted],
                "reset": reset,
            }
        )
    assert any(state["reset"] for state in states)
    return {
        "percentile": percentile,
        "interval": interval,
        "first_threshold": first,
        "largest": largest,
        "samples": size,
        "activations": [[short(row) for row in minibatch] for minibatch in h.tolist()],
        "states": states,
    }
