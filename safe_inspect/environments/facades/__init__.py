"""Façades of the batched core as Gymnasium and PettingZoo environments."""
