# SPDX-License-Identifier: MIT
"""What every room needs: errors, ranks, values that check themselves, fingerprints."""

__all__ = [
    "cache",
    "errors",
    "files",
    "fingerprint",
    "interruption",
    "memory",
    "number_tables",
    "parallel",
    "pieces",
    "tables",
    "types",
    "values",
    "versions",
]
