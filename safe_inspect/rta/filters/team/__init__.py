"""The filters that keep deputies apart: jointly for a team, or each on its own."""
