# SPDX-License-Identifier: MIT
"""One module for each command, loaded to list them all: what a command needs is imported where it runs."""
