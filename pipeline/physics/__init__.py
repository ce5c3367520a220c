"""Simulated worlds: floating hand, support, Panda and Allegro; contacts and drift."""
