"""The learner's own net and optimiser against Torch's."""

from __future__ import annotations

import copy
from itertools import pairwise

import numpy as np
import pytest
import torch

from safe_inspect.experiments.learning.ppo_nets import FastAdam
from safe_inspect.experiments.modules.tanh_net import TanhNet, linear_layers, tanh_gradient, tanh_in_place


def net_of(sizes, seed=0):
    """Return linear layers of some widths with tanh between them."""
    torch.manual_seed(seed)
    modules = []
    for before, after in pairwise(sizes):
        modules += [torch.nn.Linear(before, after), torch.nn.Tanh()]
    return torch.nn.Sequential(*modules[:-1])


def test_the_fast_tanh_and_its_gradient():
    x = np.linspace(-12.0, 12.0, 40_000).astype(np.float32)
    y, sums = x.copy(), np.empty(4, dtype=np.float32)
    tanh_in_place(y)
    exact = np.tanh(x.astype(np.float64))
    np.testing.assert_allclose(y, exact, atol=5e-7)
    push = np.random.default_rng(0).normal(size=(10_000, 4)).astype(np.float32)
    gradient = push.copy()
    tanh_gradient(y.reshape(-1, 4), gradient, sums)
    expected = push * (1.0 - exact.reshape(-1, 4) ** 2)
    np.testing.assert_allclose(gradient, expected, atol=4e-6)
    np.testing.assert_allclose(sums, expected.sum(axis=0), atol=1e-2)


@pytest.mark.parametrize("sizes", [(3, 2), (11, 16, 6), (7, 20, 33, 4), (5, 32, 32, 32, 8)])
@pytest.mark.parametrize("limit", [None, 0.05])
def test_outputs_and_gradients_are_those_of_autograd(sizes, limit):
    module = net_of(sizes)
    net = TanhNet(linear_layers(module[:-1], module[-1:]), 50, limit)
    generator = torch.Generator().manual_seed(1)
    for _ in range(3):  # the arrays are used again
        batch = torch.randn((50, sizes[0]), generator=generator)
        push = torch.randn((50, sizes[-1]), generator=generator)
        expected = module(batch)
        if limit is not None:
            means, logarithms = expected.chunk(2, dim=-1)
            assert (logarithms.abs() > limit).any()
            expected = torch.cat((means, logarithms.clamp(-limit, limit)), dim=-1)
        gradients = torch.autograd.grad(expected, list(module.parameters()), push)
        with torch.no_grad():
            found = net.forward(batch)
            np.testing.assert_allclose(found, expected, atol=2e-6)
            for mine, theirs in zip(net.backward(push.clone()), gradients, strict=True):
                np.testing.assert_allclose(mine, theirs, atol=2e-5)
            for parameter in module.parameters():
                parameter += 0.01  # the layers' parameters are the net's


def test_what_the_net_does_not_serve():
    linear, tanh = torch.nn.Linear, torch.nn.Tanh
    assert linear_layers([linear(3, 4), torch.nn.ReLU()], [linear(4, 2)]) is None
    assert linear_layers([linear(3, 4, bias=False), tanh()], [linear(4, 2)]) is None
    assert linear_layers([linear(3, 4), tanh()], [linear(4, 2).double()]) is None
    assert linear_layers([linear(3, 4)], [linear(4, 2)]) is None
    assert len(linear_layers([linear(3, 4), tanh()], [linear(4, 2)])) == 2


@pytest.mark.parametrize("settings", [{}, {"lr": 0.1, "betas": (0.5, 0.9), "eps": 1e-3}])
def test_the_optimiser_steps_as_torchs_and_shares_its_state(settings):
    mine, theirs = net_of((5, 16, 3)), net_of((5, 16, 3))
    optimisers = [torch.optim.Adam(net.parameters(), **{"lr": 1e-2, **settings}) for net in (mine, theirs)]
    generator = torch.Generator().manual_seed(2)

    def gradients():
        return [torch.randn(parameter.shape, generator=generator) for parameter in mine.parameters()]

    def step(net, optimiser, found):
        for parameter, gradient in zip(net.parameters(), found, strict=True):
            parameter.grad = gradient.clone()
        optimiser.step()

    first = gradients()
    step(mine, optimisers[0], first)  # a state that Torch has begun
    step(theirs, optimisers[1], first)
    fast = FastAdam(optimisers[0], list(mine.parameters()))
    for count in range(60):
        if count == 30:
            for optimiser in optimisers:
                optimiser.param_groups[0]["lr"] = 3e-3  # a schedule
        found = gradients()
        fast.step(found)
        step(theirs, optimisers[1], found)
    for mine_, theirs_ in zip(mine.parameters(), theirs.parameters(), strict=True):
        np.testing.assert_allclose(mine_.detach(), theirs_.detach(), atol=2e-6, rtol=2e-5)
    states = [copy.deepcopy(optimiser.state_dict()["state"]) for optimiser in optimisers]
    for index, state in states[1].items():
        assert float(states[0][index]["step"]) == float(state["step"]) == 61.0
        for name in ("exp_avg", "exp_avg_sq"):
            np.testing.assert_allclose(states[0][index][name], state[name], atol=1e-6)
