"""Plans of a few burns for one deputy among others: their cost, a search for them, and their execution."""
