"""How batches of any size run: padded to few programs, compacted, spread over cores and devices."""
