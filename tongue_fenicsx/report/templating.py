# SPDX-License-Identifier: MIT
"""HTML from the templates of this room; what stands in a value is text, unless it is `Markup`."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup

_ENVIRONMENT = Environment(
    loader=PackageLoader(__package__), autoescape=True, trim_blocks=True, lstrip_blocks=True, undefined=StrictUndefined
)
_ENVIRONMENT.policies["json.dumps_kwargs"] = {"allow_nan": False, "separators": (",", ":")}


def render(template: str, **values: Any) -> Markup:
    """The HTML of a template with values in place."""
    return Markup(_ENVIRONMENT.get_template(template).render(values))


def include(name: str) -> Markup:
    """A style or script as it is."""
    return Markup((files(__package__) / "templates" / name).read_text(encoding="utf-8"))
