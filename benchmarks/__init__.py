"""Measurements of throughput and quality; nothing imports them."""
