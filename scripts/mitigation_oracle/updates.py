"""Mitigations within updates: penalties, a projection after each step, and Adam's betas."""

from collections.abc import Callable

import torch
from torch import nn

from .common import MAX_NORM, Minibatch, Net, Tensors, brief, draw, flat, load, moments, new_adam, short

UPDATES = 10
Penalty = Callable[[Net], torch.Tensor]


def l2_init(coefficient: float) -> dict:
    """Kumar et al. 2023: the loss gets coefficient * |theta - theta_0|^2, for all parameters."""
    net, target = Net(), Net()
    first, begin, frozen = draw(0.5, net), draw(0.5, net), draw(0.5, net)
    load(net, begin)
    load(target, frozen)
    minibatch = Minibatch()
    adam = new_adam(net)
    after = {}
    norms = []
    for update in range(1, UPDATES + 1):
        penalty = sum(((p - p0) ** 2).sum() for p, p0 in zip(net.parameters(), first, strict=True))
        adam.zero_grad()
        (minibatch.loss(net, target) + coefficient * penalty).backward()
        norms.append(float(nn.utils.clip_grad_norm_(net.parameters(), MAX_NORM)))
        adam.step()
        if update in (1, UPDATES):
            after[str(update)] = flat(list(net.parameters()))
    return {
        "coefficient": coefficient,
        "first": flat(first),
        "begin": flat(begin),
        "target": flat(frozen),
        **minibatch.described(),
        "norms": norms,
        "after": after,
        "exp_avg": flat(moments(adam, net)),
    }


class Start:
    """Where the cases below begin: parameters, a target network and one minibatch, the same for all."""

    def __init__(self) -> None:
        self.begin, self.frozen = draw(0.5, Net()), draw(0.5, Net())
        self.minibatch = Minibatch()

    def described(self) -> dict:
        """As the fixture has it."""
        return {"begin": brief(self.begin), "target": brief(self.frozen), **self.minibatch.described()}

    def train(
        self,
        penalty: Penalty | None = None,
        every: int = 1,
        project: Callable[[Net], None] | None = None,
        betas: tuple[float, float] = (0.9, 0.999),
    ) -> dict:
        """Updates on the minibatch.

        The gradient of `penalty` is computed in the first update and every so many from there, and added to that of
        the loss in each, before clipping. `project` acts after each step of Adam.
        """
        net, target = load(Net(), self.begin), load(Net(), self.frozen)
        adam = new_adam(net, betas)
        parameters = list(net.parameters())
        extra: Tensors = [torch.zeros_like(p) for p in parameters]
        after, norms = {}, []
        for update in range(1, UPDATES + 1):
            if penalty and (update - 1) % every == 0:
                gradients = torch.autograd.grad(penalty(net), parameters, allow_unused=True)
                extra = [torch.zeros_like(p) if g is None else g for p, g in zip(parameters, gradients, strict=True)]
            adam.zero_grad()
            self.minibatch.loss(net, target).backward()
            for parameter, more in zip(parameters, extra, strict=True):
                parameter.grad += more
            norms.append(float(nn.utils.clip_grad_norm_(parameters, MAX_NORM)))
            adam.step()
            if project:
                project(net)
            if update in (1, UPDATES):
                after[str(update)] = brief(parameters)
        return {"norms": short(norms), "after": after, "exp_avg": brief(moments(adam, net))}


def l2_init_unsquared(start: Start, coefficient: float, begins_at_first: bool) -> dict:
    """Juliani & Ash 2024: the loss gets coefficient * |theta - theta_0|, of all parameters; at 0 its gradient is 0."""
    first = [p.clone() for p in start.begin] if begins_at_first else draw(0.5, Net())

    def penalty(net: Net) -> torch.Tensor:
        away = torch.cat([(p - p0).flatten() for p, p0 in zip(net.parameters(), first, strict=True)])
        return coefficient * torch.linalg.vector_norm(away)

    return {"coefficient": coefficient, "first": brief(first), **start.train(penalty)}


def parseval(start: Start, coefficient: float, scale: float, every: int) -> dict:
    """Chung et al. 2024: coefficient * sum of |W W' - scale I|_F^2 over hidden layers, W [units, inputs]; no biases."""

    def penalty(net: Net) -> torch.Tensor:
        weights = [layer.weight for layer in net.layers[:-1]]
        return coefficient * sum(((w @ w.t() - scale * torch.eye(len(w))) ** 2).sum() for w in weights)

    return {"coefficient": coefficient, "scale": scale, "every": every, **start.train(penalty, every)}


def spectral(start: Start, coefficient: float, exponent: int) -> dict:
    """Lewandowski et al. 2025: coefficient * sum of (sigma^k - 1)^2 + |b|^(2k), over all layers.

    One power iteration before each update: v = W'u / |W'u|, u = Wv / |Wv|, sigma = u'Wv; u and v are constants to the
    gradient. `u` has an entry for each unit.
    """
    us = [nn.functional.normalize(torch.randn(layer.out_features), dim=0) for layer in Net().layers]
    first = [short(u.tolist()) for u in us]
    seen: list[Tensors] = []
    sigmas = []

    def penalty(net: Net) -> torch.Tensor:
        total = torch.zeros(())
        values = []
        for index, layer in enumerate(net.layers):
            with torch.no_grad():
                v = nn.functional.normalize(layer.weight.t() @ us[index], dim=0)
                us[index] = nn.functional.normalize(layer.weight @ v, dim=0)
            sigma = us[index] @ layer.weight @ v
            total = total + (sigma**exponent - 1) ** 2 + layer.bias.norm() ** (2 * exponent)
            values.append(float(sigma.detach()))
        seen.append(list(us))
        sigmas.append(short(values))
        return coefficient * total

    trained = start.train(penalty)
    return {
        "coefficient": coefficient,
        "exponent": exponent,
        "u": first,
        "u_after": {str(n): [short(u.tolist()) for u in seen[n - 1]] for n in (1, UPDATES)},
        "sigmas": sigmas,
        **trained,
    }


def weight_clipping(start: Start, factor: float) -> dict:
    """Elsayed et al. 2024: weights and biases are clamped to +-factor / sqrt(inputs of their layer) after each step."""

    def project(net: Net) -> None:
        with torch.no_grad():
            for layer in net.layers:
                bound = factor / layer.in_features**0.5
                layer.weight.clamp_(-bound, bound)
                layer.bias.clamp_(-bound, bound)

    return {"factor": factor, **start.train(project=project)}


def equal_betas(start: Start, beta: float) -> dict:
    """Dohare et al. 2024: both betas of Adam are the same."""
    return {"beta": beta, **start.train(betas=(beta, beta))}
