# SPDX-License-Identifier: MIT
"""The two ways a command can fail: the user's input, or the solve."""


class InputError(ValueError):
    """Something the user gave cannot be used: one sentence naming the file, the key and what is accepted."""


class SolveError(RuntimeError):
    """The nonlinear solve gave up at the smallest step; the last good state is saved."""
