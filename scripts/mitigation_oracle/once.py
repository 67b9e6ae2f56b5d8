"""Mitigations that rewrite parameters in one application."""

from itertools import pairwise

import torch
from torch import nn

from .common import ACTIONS, HIDDEN, INPUTS, Net, Tensors, brief, draw, load, short
from .updates import Start


def soft_shrink_perturb(start: Start, shrink: float, perturb: float) -> dict:
    """Juliani & Ash 2024: theta <- shrink * theta + perturb * new after every step; here once."""
    new = draw(0.5, Net())
    after = [shrink * p + perturb * p_new for p, p_new in zip(start.begin, new, strict=True)]
    return {"shrink": shrink, "perturb": perturb, "new": brief(new), "after": brief(after)}


def normalise_and_project(covers_output: bool) -> dict:
    """Lyle et al. 2024: W <- rho W / |W|_F, rho the first norm of that layer, where a norm follows.

    Each hidden layer has weight, bias, scale and shift of a LayerNorm; the output layer weight and bias. Only weights
    are projected.
    """
    sizes = [INPUTS, *HIDDEN, ACTIONS]
    tensors: Tensors = []
    weights = []
    for index, (inputs, units) in enumerate(pairwise(sizes)):
        weights.append(len(tensors))
        tensors.append(0.5 * torch.randn(units, inputs))
        tensors += [torch.randn(units) for _ in range(3 if index < len(HIDDEN) else 1)]
    first_norms = (1 + 3 * torch.rand(len(weights))).tolist()
    after = [t.clone() for t in tensors]
    covered = weights if covers_output else weights[:-1]
    for at, first in zip(covered, first_norms, strict=False):
        after[at] *= first / tensors[at].norm()
    return {
        "covers_output": covers_output,
        "begin": brief(tensors),
        "norms": short([float(tensors[at].norm()) for at in weights]),
        "first_norms": short(first_norms),
        "after": brief(after),
    }


def newton_schulz(weight: torch.Tensor, iterations: int) -> torch.Tensor:
    """Nearly the orthogonal polar factor of a matrix, by Y <- 1.5 Y - 0.5 Y Y'Y from Y = W / |W|_F."""
    is_wide = weight.shape[1] > weight.shape[0]
    y = weight.t() if is_wide else weight
    y = y / y.norm()
    for _ in range(iterations):
        y = 1.5 * y - 0.5 * y @ (y.t() @ y)
    return y.t() if is_wide else y


def fire(begin: Tensors, iterations: int = 10) -> dict:
    """Han et al. 2026: W <- sqrt(units / inputs) * its polar factor, in every linear layer; biases stay.

    `after` is by Newton-Schulz iterations, as in the source; `polar` is exact, by a singular value decomposition in
    double precision. `singular_values` are those of `after` without the square root; a converged one is 1.
    """
    net = load(Net(), begin)
    after, polar, singular = [], [], []
    for layer in net.layers:
        weight, bias = layer.weight.detach(), layer.bias.detach()
        scale = (weight.shape[0] / weight.shape[1]) ** 0.5
        orthogonal = newton_schulz(weight, iterations)
        exact = newton_schulz(weight.double(), iterations)
        assert (orthogonal - exact).abs().max() < 1e-6, "float32 is precise enough"
        u, _, v = torch.linalg.svd(weight.double(), full_matrices=False)
        after += [scale * orthogonal, bias]
        polar += [(scale * u @ v).float(), bias]
        singular.append(short(torch.linalg.svdvals(orthogonal).tolist()))
    return {
        "iterations": iterations,
        "begin": brief(begin),
        "after": brief(after),
        "polar": brief(polar),
        "singular_values": singular,
    }


def nearly_singular(begin: Tensors) -> Tensors:
    """These parameters, with two units of the first layer nearly alike: ten iterations do not suffice there."""
    begin = [p.clone() for p in begin]
    begin[0][1] = begin[0][0] + 0.01 * nn.functional.normalize(begin[0][1], dim=0)
    return begin
