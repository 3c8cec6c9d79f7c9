"""Experiments of many runs: ablation and run-time profile, with their jobs, tables and plots."""
