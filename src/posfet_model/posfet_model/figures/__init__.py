"""Figures of the documents, made by code: ``python -m posfet_model.figures [--out docs/figures] [NAME ...]``.

One module a subject, each with a table FIGURES of name and function; `registry` puts them together. Only this package
imports matplotlib.
"""
