# SPDX-License-Identifier: MIT
"""What a model is made of: laws, tissue, contraction, contact, loads, control; values that read like the papers."""

__all__ = [
    "activation",
    "contact",
    "contraction",
    "control",
    "hyperelasticity",
    "kinematics",
    "loads",
    "model",
    "support",
    "suspension",
    "tissue",
]
