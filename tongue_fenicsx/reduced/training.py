# SPDX-License-Identifier: MIT
"""Training of the fading memories on many runs; needs JAX and Optax, the extra ``rom``."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..core.errors import InputError
from ..core.types import Bools, Floats
from .network import Weights, answer, fade, features

WIDTHS = 96, 128, 128
"""Functions of the two layers of memories, and of the last."""
NETWORKS = 3
FASTEST, SLOWEST = 4e-3, 0.3
"""Time constants in s that training begins with."""
LANDMARK = 0.03
"""What the square of a landmark's error counts, beside the mean square of all nodes."""
BATCH = 12
"""Runs that an iteration learns from."""


@dataclass(frozen=True)
class Sequences:
    """Runs that were followed.

    Attributes
    ----------
    h : (n_runs, n_steps) float array
        Steps in s; a run that is over before others goes on with steps at which it is not known.
    inputs : (n_runs, n_steps + 1, n_inputs) float array
        Activations at their ends, and at the beginning, as `ReducedTongue.inputs` has them.
    coordinates : (n_runs, n_steps + 1, n_modes) float array
        In mm.
    known : (n_runs, n_steps + 1) bool array
        Where there are coordinates.
    apart, odd : int
        How many of the inputs, the last ones, are differences of sides, and how many of the coordinates, the last ones, of odd shapes: both
        change their sign in the mirror.
    landmarks : (n_modes, n) float array, optional
        Displacements of landmarks, each of three numbers, in each shape; each landmark counts by `LANDMARK`.
    """

    h: Floats
    inputs: Floats
    coordinates: Floats
    known: Bools
    apart: int = 0
    odd: int = 0
    landmarks: Floats | None = None


def initial(n_inputs: int, n_modes: int, seed: int) -> dict[str, Floats]:
    """Weights of `NETWORKS` networks, drawn at random."""
    random = np.random.default_rng(seed)
    sees = np.cumsum([n_inputs, *WIDTHS[:2]])

    def drawn(rows: int, columns: int, size: float) -> Floats:
        return np.asarray(size * random.standard_normal((NETWORKS, rows, columns)) / np.sqrt(rows))

    weights: dict[str, Floats] = {}
    for layer, (rows, columns) in enumerate(zip(sees, WIDTHS, strict=True), 1):
        weights[f"W{layer}"] = drawn(rows, columns, 2.0 if layer == 1 else 1.0)
        weights[f"b{layer}"] = drawn(1, columns, 0.5)
    for layer, columns in enumerate(WIDTHS[:2], 1):
        weights[f"log_tau{layer}"] = np.tile(np.linspace(np.log(FASTEST), np.log(SLOWEST), columns), (NETWORKS, 1, 1))
    return weights | {"V": drawn(sees[-1], n_modes, 0.3), "U": drawn(WIDTHS[-1], n_modes, 0.3)}


def train(
    runs: Sequences, *, iterations: int, seed: int, report: Callable[[int, float], object], begin: Weights | None = None
) -> dict[str, Floats]:
    """Weights with which networks follow runs.

    Parameters
    ----------
    runs : Sequences
        From rest.
    iterations : int
        Of Adam (Kingma and Ba 2015), with a rate that falls as a cosine does.
    seed : int
        Of the weights that it begins with, and of the order of the runs.
    report : callable
        Is told now and then the number of the iteration and the root mean square of the error in mm.
    begin : Weights, optional
        To begin with, instead of weights at random.

    Raises
    ------
    InputError
        If JAX or Optax is not installed.
    """
    try:
        import jax
        import jax.numpy as jnp
        import optax
    except ImportError as missing:
        raise InputError(f'tongue rom train needs {missing.name}; pip install "tongue_fenicsx[rom]" installs it.') from missing

    def remember(tau: Any, seen: Any, h: Any) -> Any:  # seen (networks, runs, times, functions)
        along = jnp.moveaxis(seen, 2, 0)

        def go(memory: Any, step: tuple[Any, Any, Any]) -> tuple[Any, Any]:
            memory = fade(tau, memory, *step, jnp.exp)
            return memory, memory

        _, memories = jax.lax.scan(go, jnp.zeros_like(along[0]), (along[:-1], along[1:], h.T[:, :, None]))
        return jnp.moveaxis(jnp.concatenate([jnp.zeros_like(along[:1]), memories]), 0, 2)

    landmarks = 0.0 if runs.landmarks is None else LANDMARK * runs.landmarks @ runs.landmarks.T
    metric = np.asarray(np.eye(runs.coordinates.shape[2]) + landmarks, dtype=np.float32)

    def error(weights: Any, h: Any, a: Any, q: Any, known: Any) -> Any:
        wide = {name: value[:, None] for name, value in weights.items()}  # one more axis, of runs
        everything = jnp.broadcast_to(a, (len(weights["V"]), *a.shape))
        for layer in (1, 2):
            seen = features(wide, layer, everything, jnp.tanh)
            everything = jnp.concatenate([everything, remember(jnp.exp(weights[f"log_tau{layer}"]), seen, h)], axis=-1)
        away = answer(wide, everything, jnp.tanh) - q
        wrong = ((away @ metric) * away).sum(axis=-1)
        return (wrong * known).sum() / (known.sum() * len(wrong))

    schedule = optax.warmup_cosine_decay_schedule(0.0, 3e-3, max(1, iterations // 50), iterations, 1e-6)
    optimizer = optax.chain(optax.clip_by_global_norm(10.0), optax.adam(schedule))

    def improve(weights: Any, state: Any, *batch: Any) -> Any:
        value, gradient = jax.value_and_grad(error)(weights, *batch)
        change, state = optimizer.update(gradient, state, weights)
        return optax.apply_updates(weights, change), state, value

    data = [np.asarray(values, dtype=np.float32) for values in (runs.h, runs.inputs, runs.coordinates, runs.known)]
    first = initial(data[1].shape[2], data[2].shape[2], seed) if begin is None else begin
    weights: Any = {name: np.asarray(value, dtype=np.float32) for name, value in first.items()}
    state = optimizer.init(weights)
    random, improved = np.random.default_rng(seed), jax.jit(improve)
    for i in range(iterations):
        chosen = random.choice(len(data[0]), min(BATCH, len(data[0])), replace=False)
        h, inputs, coordinates, known = (values[chosen] for values in data)
        mirrored = random.choice([-1.0, 1.0], (len(chosen), 1, 1)).astype(np.float32)  # each run as it was or as its mirror image
        inputs[..., inputs.shape[2] - runs.apart :] *= mirrored
        coordinates[..., coordinates.shape[2] - runs.odd :] *= mirrored
        weights, state, value = improved(weights, state, h, inputs, coordinates, known)
        if i % 100 == 99 or i == iterations - 1:
            report(i + 1, float(np.sqrt(value)))
    return {name: np.asarray(value, dtype=float) for name, value in weights.items()}
