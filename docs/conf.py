"""Settings of the site, which `make site` builds from these pages and others; see build_site.py."""

project = "dexgarmentlab"
copyright = "the dexgarmentlab authors, Apache-2.0"
html_title = "dexgarmentlab"
html_theme = "furo"
html_static_path = ["films"]
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
exclude_patterns = ["examples"]
default_role = "code"  # docstrings quote code with single backticks, as Markdown does
myst_heading_anchors = 4
autodoc_member_order = "groupwise"
autodoc_default_options = {"members": True, "imported-members": True}
