from pipeline.chain import chain  # noqa: F401
