"""The stages of the pipeline: each reads and writes run directories around one function."""
