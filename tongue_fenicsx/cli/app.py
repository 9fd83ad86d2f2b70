# SPDX-License-Identifier: MIT
"""The command ``tongue``: each module of `commands` is one, by its function, or its group of them, of the same name."""

from __future__ import annotations

import re
import signal
import sys
import traceback
from importlib import import_module
from pkgutil import iter_modules
from typing import Annotated

import typer
from rich.text import Text

from ..core.errors import InputError, SolveError
from ..core.interruption import Interrupted, launched
from . import commands, process
from .terminal import errors

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
for _module in iter_modules(commands.__path__):
    _command = getattr(import_module(f"{commands.__name__}.{_module.name}"), _module.name)
    if isinstance(_command, typer.Typer):
        app.add_typer(_command, name=_module.name)
    else:
        app.command()(_command)


def _version(asked: bool) -> None:
    """Say which one this is, and leave."""
    if asked:
        from .. import __version__

        print(f"tongue_fenicsx {__version__}")
        raise typer.Exit


@app.callback()
def tongue(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version and exit.")] = False,
) -> None:
    """Biomechanics of the human tongue: build a mesh, run a scenario, look at the pictures."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit with 0 done, 2 bad input, 3 the solve failed, 130 interrupted, 143 terminated."""
    try:
        command = typer.main.get_command(app)
        with command.make_context("tongue", sys.argv[1:] if arguments is None else arguments) as context:
            command.invoke(context)  # and not main(), which takes an interruption for its own
        code = 0
    except typer.Exit as leaving:
        code = leaving.exit_code
    except SystemExit as leaving:
        code = leaving.code if isinstance(leaving.code, int) else 1
    except BaseException as error:
        code = _end(error)
    sys.exit(code)


def _end(error: BaseException) -> int:
    """Say why a command ends, end it on all ranks, and return its exit code."""
    code, reason = _explain(error)

    def say() -> None:
        if code == 1:  # a fault of the program
            traceback.print_exception(error)
        else:
            errors.print(reason)

    if launched() or "mpi4py.MPI" in sys.modules:
        from ..core.parallel import end_together

        end_together(str(reason), code, say)
    else:
        say()
    return code


def _explain(error: BaseException) -> tuple[int, Text]:
    """Exit code and sentence for an exception."""
    if isinstance(error, Interrupted):
        return 128 + error.number, Text(str(error))
    if isinstance(error, KeyboardInterrupt) or process.received:  # then a library may have made another error of it
        return 128 + (process.received or signal.SIGINT), Text("interrupted")
    if isinstance(error, InputError | SolveError):
        return 2 if isinstance(error, InputError) else 3, _sentence(str(error))
    if isinstance(error, typer.TyperException):
        return 2, _sentence(f"{error.format_message() or 'A command is expected.'} See tongue --help.")
    if isinstance(error, ImportError) and not str(error.name).startswith("tongue_fenicsx"):
        return 2, _sentence(f"{error}; tongue doctor says how to install what is missing.")
    return 1, _sentence(repr(error))


def _sentence(text: str) -> Text:
    line = "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in re.sub(r"(\S{300})\S+", r"\1…", " ".join(text.split())))
    return Text.assemble(("error:", "red"), " ", line)
