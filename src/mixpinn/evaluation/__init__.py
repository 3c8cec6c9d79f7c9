"""Metrics, tables, plots, pictures and the report."""
