"""The templates of the pages, which share one head."""

import jinja2


def template(name: str) -> jinja2.Template:
    """One of the templates beside this file; a word that it lacks is an error."""
    settings = jinja2.Environment(
        loader=jinja2.PackageLoader("studies.report", ""),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    return settings.get_template(name)
