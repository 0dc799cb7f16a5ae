"""Plans of a few burns for one deputy among others: what a plan costs, a search, and how plans are flown."""
