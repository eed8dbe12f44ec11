"""Networks that draw a BTF from planes of features, and their training.

TriplePlanes are Fan et al. 2023 with a third plane over the difference vector (Xu et al. 2024).
"""

import math
import time

import numpy as np
import torch
from torch import nn
from torch.nn import functional

MU = 60.0  # of the μ-law: about the curve of a display


def encode(linear):
    return torch.log1p(MU * linear.clamp(min=0)) / math.log1p(MU)


def decode(coded):
    return torch.expm1(coded.clamp(min=0) * math.log1p(MU)) / MU


def sample(plane, at):
    """Bilinear values of a plane (channels × rows × columns) at N × 2 places: channels × N."""
    found = functional.grid_sample(
        plane[None], at[None, None], padding_mode="border", align_corners=False
    )
    return found[0, :, 0]


def half_and_difference(view, light):
    """x and y of the half vector, and of the light in the frame whose z axis is the half vector,
    reached by the shortest rotation (Rusinkiewicz 1998, without the jump at the pole)."""
    half = functional.normalize(view + light, dim=-1)
    x, y, z = half.unbind(-1)
    along = half[:, :2]
    dot = (light[:, :2] * along).sum(-1)
    # Rotation of the light about half × z, by Rodrigues' formula.
    scale = dot / (1 + z) + light[:, 2]
    return along, light[:, :2] - along * scale[:, None]


class Network(nn.Module):
    """Layers on columns: inputs × N to outputs × N."""

    def __init__(self, sizes):
        super().__init__()
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for n, m in zip(sizes, sizes[1:]):
            self.weights.append(nn.Parameter(torch.randn(m, n) * math.sqrt(2 / n)))
            self.biases.append(nn.Parameter(torch.zeros(m, 1)))

    def forward(self, x):
        last = len(self.weights) - 1
        for k, (weight, bias) in enumerate(zip(self.weights, self.biases)):
            x = torch.addmm(bias, weight, x)
            x = functional.leaky_relu(x, 0.01) if k < last else x
        return x


class TriplePlanes(nn.Module):
    """Planes over the surface, the half vector and the difference vector, and a network.

    parallax   the plane over the surface is read where the MDF says that the ray ends
    shading    the network also has light_features(), and its colours are a + b (n·l where lit)
    """

    def __init__(
        self, size, channels=24, angular=(16, 8), hidden=32, parallax=False, shading=False
    ):
        super().__init__()
        resolution, n = angular
        self.parallax, self.shading = parallax, shading
        self.surface = nn.Parameter(torch.randn(channels, size, size) * 0.1)
        self.halves = nn.Parameter(torch.randn(n, resolution, resolution) * 0.1)
        self.differences = nn.Parameter(torch.randn(n, resolution, resolution) * 0.1)
        inputs = channels + 2 * n + (3 if shading else 0)
        self.network = Network([inputs, hidden, hidden, 6 if shading else 3])
        with torch.no_grad():
            self.network.weights[-1] *= 0.1
            self.network.biases[-1] += 0.5

    def planes(self):
        return [self.surface, self.halves, self.differences]

    def surfaces(self):
        return [self.surface]

    def forward(self, data):
        half, difference = half_and_difference(data["view"], data["light"])
        if self.parallax:
            place = data["place"]
            rays = place.shape[1]
            surface = sample(self.surface, place.reshape(-1, 2))
            surface = surface.reshape(len(self.surface), -1, rays).mean(-1) if rays > 1 else surface
        else:
            surface = sample(self.surface, data["flat"])
        inputs = [surface, sample(self.halves, half), sample(self.differences, difference)]
        if not self.shading:
            return self.network(torch.cat(inputs)).t()
        made = self.network(torch.cat([*inputs, data["lit"].t()])).t()
        linear = functional.softplus(made[:, :3], 4) * data["lit"][:, :1]
        return encode(linear + functional.softplus(made[:, 3:] - 1, 4) * 0.3)


class NeuMip(nn.Module):
    """NeuMIP (Kuznetsov et al. 2021): a texture of seven channels and a network of the view give a
    depth, and a second texture of seven channels is read where the ray is at this depth."""

    def __init__(self, size, channels=7, hidden=25):
        super().__init__()
        self.depth = nn.Parameter(torch.randn(channels, size, size) * 0.1)
        self.surface = nn.Parameter(torch.randn(channels, size, size) * 0.1)
        self.offset = Network([channels + 2, hidden, hidden, hidden, 1])
        self.network = Network([channels + 4, hidden, hidden, hidden, 3])
        with torch.no_grad():
            self.offset.weights[-1] *= 0.01
            self.network.weights[-1] *= 0.1
            self.network.biases[-1] += 0.5

    def planes(self):
        return [self.depth, self.surface]

    def surfaces(self):
        return self.planes()

    def forward(self, data):
        view, light = data["view"], data["light"]
        at = torch.cat([sample(self.depth, data["flat"]), view[:, :2].t()])
        depth = self.offset(at)[0]
        shift = view[:, :2] / view[:, 2:].clamp(min=0.2) * torch.tensor([1.0, -1.0])
        place = data["flat"] + depth[:, None] * shift
        inputs = [sample(self.surface, place), view[:, :2].t(), light[:, :2].t()]
        return self.network(torch.cat(inputs)).t()


def rounded(values, steps):
    """In 8 bits, with a scale for each row of values."""
    flat = values.reshape(len(values), -1)
    low, high = flat.min(1, keepdim=True)[0], flat.max(1, keepdim=True)[0]
    step = (high - low).clamp(min=1e-8) / steps
    return (low + torch.round((flat - low) / step) * step).reshape(values.shape)


def quantise(model):
    """Rounds planes and weights to 8 bits. Returns the bytes a texel of the planes over the surface,
    and those of everything else: a byte for each number, two half floats for the scale of each
    channel and of each row of weights, biases in half floats."""
    size, surface = 0, 0
    with torch.no_grad():
        for plane in model.planes():
            plane.copy_(rounded(plane, 255))
            size += 4 * len(plane)
        for plane in model.surfaces():
            surface += len(plane)
        for plane in model.planes()[len(model.surfaces()) :]:
            size += plane.numel()
        for network in (m for m in model.modules() if isinstance(m, Network)):
            for weight, bias in zip(network.weights, network.biases):
                weight.copy_(rounded(weight, 255))
                bias.copy_(bias.half().float())
                size += weight.numel() + 4 * len(weight) + 2 * bias.numel()
    return surface, size


class Pairs:
    """Batches of texels under pairs of a view and a light."""

    def __init__(self, captured):
        self.values = torch.from_numpy(np.ascontiguousarray(captured.values))
        n, m, self.n_views, self.n_lights, _ = self.values.shape
        self.texels = n * m
        self.values = self.values.reshape(-1, 3)
        self.lit = self.place = None  # without rays
        if hasattr(captured, "lit"):
            self.lit = torch.from_numpy(captured.lit).reshape(-1, 3)
            self.place = torch.from_numpy(captured.place).reshape(self.texels * self.n_views, -1, 2)
        self.flat = torch.from_numpy(captured.flat).reshape(-1, 2)
        self.to_view = torch.from_numpy(captured.to_view).reshape(-1, 3)
        self.to_light = torch.from_numpy(captured.to_light).reshape(-1, 3)
        self.kept_views = torch.tensor(captured.kept_views)
        self.kept_lights = torch.tensor(captured.kept_lights)

    def of(self, texel, view, light):
        texel_view = texel * self.n_views + view
        value = texel_view * self.n_lights + light
        data = {
            "flat": self.flat[texel],
            "view": self.to_view[texel_view],
            "light": self.to_light[texel * self.n_lights + light],
            "value": self.values[value],
        }
        if self.lit is not None:
            data |= {"place": self.place[texel_view], "lit": self.lit[value].float() / 127}
        return data

    def draw(self, size, random):
        def some(n):
            return torch.randint(n, (size,), generator=random)

        views = self.kept_views[some(len(self.kept_views))]
        return self.of(some(self.texels), views, self.kept_lights[some(len(self.kept_lights))])

    def picture(self, view, light):
        texels = torch.arange(self.texels)
        return self.of(texels, torch.full_like(texels, view), torch.full_like(texels, light))


def train(model, pairs, samples, batch=1024, rate=0.02, seed=1, report=None):
    """Adam with a rate that falls to a fiftieth. Returns the CPU seconds."""
    random = torch.Generator().manual_seed(seed)
    planes = model.planes()
    others = [p for p in model.parameters() if not any(p is q for q in planes)]
    optimiser = torch.optim.Adam(
        [{"params": planes, "lr": rate}, {"params": others, "lr": rate / 2}],
        eps=1e-12,
        betas=(0.9, 0.99),
    )
    rounds = samples // batch
    fall = torch.optim.lr_scheduler.LambdaLR(
        optimiser, lambda k: min(1, (k + 1) / 50) * 0.02 ** (k / rounds)
    )
    begin, sums = time.process_time(), 0.0
    for k in range(rounds):
        data = pairs.draw(batch, random)
        loss = (model(data) - encode(data["value"])).square().mean()
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        fall.step()
        sums += loss.item()
        if report and (k + 1) % report == 0:
            print(
                "%d/%d %.3e %.0f s" % (k + 1, rounds, sums / report, time.process_time() - begin),
                flush=True,
            )
            sums = 0.0
    return time.process_time() - begin
