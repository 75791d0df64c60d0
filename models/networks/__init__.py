"""The networks of Li 2021, chapters 5 and 6, as PyTorch modules: the twins of `reference/src/network`."""
