"""Measurements that the docs quote: each is one verb of `rcdn evaluate` and leaves its provenance beside its figures."""
