"""Layer 10: many runs, and what they say."""

__all__: list[str] = []
