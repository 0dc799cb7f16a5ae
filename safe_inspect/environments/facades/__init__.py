"""The batch as Gymnasium's and PettingZoo's environments."""
