"""The pages' templates."""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import jinja2


class _Beside(jinja2.BaseLoader):
    def get_source(self, environment: jinja2.Environment, template: str) -> tuple[str, None, None]:
        return (files("dynhair.report") / template).read_text("utf-8"), None, None


def render(name: str, **values: Any) -> str:
    """Fill a template of this package; what is not marked as safe is escaped."""
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True, loader=_Beside()
    )
    return environment.get_template(name).render(**values)
